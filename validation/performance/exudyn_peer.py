"""Worker that times runs and equilibria in Exudyn 1.13 or later (`measurement.start_exudyn`).

It reads jobs from standard input, one per line, and answers with times, counts and the path of the
first output of the problem, or its end. Runs use one thread, write no files and reuse
factorizations (modified Newton); equilibria use a new matrix in each iteration.
"""

import contextlib
import io
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "record"))
# Import the module without range checks, which prints a note.
sys.exudynFast = True
with contextlib.redirect_stdout(io.StringIO()):
    import exudyn as exu
    from adapters.exudyn_adapter import System
    from exudyn import utilities as exd

STATIC_TOLERANCE = 1e-8  # of residuals of equilibria


def time_run(
    problem: dict[str, Any], elements: int, nodes: int, step: float, path: bool = True
) -> dict[str, Any]:
    """Return processor times of building and integration [s], counts, and the path."""
    begin = time.process_time()
    system = System(problem, elements, nodes)
    node = system.node(problem["outputs"][0]["on"])
    position = exd.SensorNode(
        nodeNumber=node, storeInternal=True, outputVariableType=exu.OutputVariableType.Position
    )
    sensor = system.mbs.AddSensor(position)
    system.mbs.Assemble()
    settings = system.settings(problem["time"]["end"], step)
    settings.solution.sensors.writePeriod = problem["time"]["output_step"]
    built = time.process_time()
    system.mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    solved = time.process_time()
    rows = np.asarray(system.mbs.GetSensorStoredData(sensor))[:, :3]
    return {
        "build": built - begin,
        "integrate": solved - built,
        "path": np.unique(rows, axis=0).tolist() if path else [],
        **_count(system, "dynamicSolver"),
    }


def time_equilibrium(problem: dict[str, Any], elements: int, steps: int) -> dict[str, Any]:
    """Return processor times of building and solution [s], counts, and the loaded point."""
    begin = time.process_time()
    system = System(problem, elements)
    system.mbs.Assemble()
    settings = system.settings(1.0, 1.0 / steps)
    settings.staticSolver.adaptiveStep = True
    settings.staticSolver.newton.absoluteTolerance = STATIC_TOLERANCE
    built = time.process_time()
    try:
        success = bool(system.mbs.SolveStatic(settings))
    except Exception:
        success = False
    solved = time.process_time()
    node = system.node(problem["outputs"][0]["on"])
    position = system.mbs.GetNodeOutput(node, exu.OutputVariableType.Position)
    return {
        "build": built - begin,
        "solve": solved - built,
        "success": success,
        "point": [float(x) for x in position[:2]],
        **_count(system, "staticSolver"),
    }


def _count(system: System, solver: str) -> dict[str, int]:
    counts = system.mbs.sys[solver].it
    return {
        "unknowns": len(system.mbs.systemData.GetODE2Coordinates()),
        "steps": counts.currentStepIndex - 1,
        "newton": counts.newtonStepsCount,
    }


def answer_jobs() -> None:
    """Answer the jobs in the lines of standard input."""
    # Output of the library goes to standard error, so that answers are the only output.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.stdin:
        job = json.loads(line)
        run = time_equilibrium if "steps" in job else time_run
        print(json.dumps(run(**job)), file=answers, flush=True)


if __name__ == "__main__":
    answer_jobs()
