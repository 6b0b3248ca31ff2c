"""Times of equilibria of five structures, beside Exudyn's static solver.

    python validation/performance/static_times.py --peer PYTHON
    python validation/performance/static_times.py --quick

PYTHON is an interpreter with Exudyn (`pip install exudyn pandas scipy`), whose elements have 2
nodes; those of beamdae have 4. Both tools take turns with each structure (`systems`), in 10 load
steps and in as few as succeed, with machine code in the cache. Times are processor times, the
smallest of several turns. "assembly" is the time of the equations of motion, with the plans of
their evaluation; "stability" that of the numbers of unstable directions, which Exudyn does not
compute. "ratio" compares the time without assembly with Exudyn's time without building, for equal
meshes; "ratio at equal error" does so for the fastest mesh of beamdae, of 2 to 256 elements, whose
error is at most Exudyn's. Errors are distances from the loaded point of the finest mesh [m].
"""

import argparse
import time
import warnings
from collections.abc import Callable
from contextlib import ExitStack
from itertools import product
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd
from measurement import RESULTS, Worker, start_exudyn, write_table
from systems import STRUCTURES, build

import beamdae as bd
from beamdae.analysis.statics import static_equilibrium, static_problem
from beamdae.linear.blas_threads import single_threaded

ELEMENTS = (8, 64, 256)
QUICK_ELEMENTS = (8, 64)
COARSE_ELEMENTS = (2, 4)  # of beamdae only: with 4 nodes, as accurate as 8 elements with 2
STEPS = (10, 1)
TURNS = 30
QUICK_TURNS = 2
FEW_ELEMENTS = 8  # of runs that take five times as many turns


@single_threaded
def time_path(mechanism: bd.Mechanism, steps: int) -> dict[str, Any]:
    """Return an equilibrium path and the processor times of it and of its parts [ms]."""
    times, active = {"assembly": 0.0, "stability": 0.0}, []

    def timed(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            begin = time.process_time()
            active.append(part)
            try:
                return function(*arguments, **options)
            finally:
                active.pop()
                # Calls within calls are not counted twice.
                if not active:
                    times[part] += 1e3 * (time.process_time() - begin)

        return call

    parts = (
        (static_equilibrium, "initial_positions", "assembly"),
        (static_equilibrium, "build_loading", "assembly"),
        (static_problem, "plan_static_sums", "assembly"),
        (static_problem.StaticProblem, "monitor", "stability"),
    )
    with ExitStack() as stack:
        for module, name, part in parts:
            stack.enter_context(patch.object(module, name, timed(part, getattr(module, name))))
        begin = time.process_time()
        path = bd.equilibrium(mechanism, step=1.0 / steps)
        total = 1e3 * (time.process_time() - begin)
    return {"path": path, "total": total, "solution": total - times["assembly"], **times}


def loaded_point(path: bd.results.Equilibrium) -> np.ndarray:
    """Return the end position of the loaded point."""
    return np.array([path.columns[f"point.{axis} [m]"][-1] for axis in "xy"])


def compare(
    name: str, elements: int, steps: int, reference: np.ndarray, peer: Worker | None, turns: int
) -> dict[str, object]:
    """Return a row of the table."""
    problem = STRUCTURES[name]
    mechanism = build(problem, elements)
    # Compile machine code that is not in the cache at the first iteration.
    with patch.object(static_problem, "_INTERPRETED_EVALUATIONS", 0):
        time_path(mechanism, steps)
    runs, answers = [], []
    for _ in range(turns):
        runs.append(time_path(mechanism, steps))
        if peer is not None:
            answers.append(peer(problem=problem, elements=elements, steps=steps))
    best = min(runs, key=lambda run: run["solution"])
    path = best["path"]
    row: dict[str, object] = {
        "structure": name,
        "elements": elements,
        "steps asked": steps,
        "status": path.status.kind,
        "steps": len(path.q) - 1,
        "iterations": path.settings["iterations"],
        "unknowns": path.q.shape[1],
        **{f"{part} [ms]": best[part] for part in ("total", "assembly", "stability")},
        "error": np.linalg.norm(loaded_point(path) - reference),
    }
    if answers:
        answer = min(answers, key=lambda answer: answer["solve"])
        spent = 1e3 * answer["solve"]
        row |= {
            "Exudyn steps": answer["steps"],
            "Exudyn iterations": answer["newton"],
            "Exudyn unknowns": answer["unknowns"],
            "Exudyn [ms]": spent,
            "Exudyn error": np.linalg.norm(np.array(answer["point"]) - reference),
            "ratio": best["solution"] / spent,
            "ratio without stability": (best["solution"] - best["stability"]) / spent,
        }
    return row


def find_ratio_at_equal_error(row: pd.Series, table: pd.DataFrame) -> float:
    """Return the ratio of the fastest mesh that is as accurate as Exudyn's, of one structure."""
    rows = table[(table["structure"] == row["structure"])]
    rows = rows[
        (rows["error"] <= row["Exudyn error"]) & (rows["steps asked"] == row["steps asked"])
    ]
    return (rows["total [ms]"] - rows["assembly [ms]"]).min() / row["Exudyn [ms]"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", help="interpreter with Exudyn")
    parser.add_argument("--quick", action="store_true", help="fewer elements and repetitions")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the table")
    options = parser.parse_args()
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    sizes = QUICK_ELEMENTS if options.quick else ELEMENTS
    turns = QUICK_TURNS if options.quick else TURNS
    peer = start_exudyn(options.peer) if options.peer else None
    rows = []
    for name, problem in STRUCTURES.items():
        finest = bd.equilibrium(build(problem, 2 * max(QUICK_ELEMENTS)))
        reference = loaded_point(finest)
        for meshes, opponent in ((COARSE_ELEMENTS, None), (sizes, peer)):
            for elements, steps in product(meshes, STEPS):
                # Other processes disturb short runs more.
                count = 5 * turns if elements <= FEW_ELEMENTS else turns
                rows.append(compare(name, elements, steps, reference, opponent, count))
    table = pd.DataFrame(rows)
    if peer is not None:
        ratios = [find_ratio_at_equal_error(row, table) for _, row in table.iterrows()]
        table["ratio at equal error"] = ratios
    write_table(options.out, "static_times", table)


if __name__ == "__main__":
    main()
