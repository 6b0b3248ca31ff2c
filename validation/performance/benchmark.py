"""Time runs, as ratios: beside Exudyn, beside the code before, over what they consist of.

    python validation/performance/benchmark.py --peer PYTHON --before PATH
    python validation/performance/benchmark.py --quick
    python validation/performance/benchmark.py --linear   dense against sparse factorization

PYTHON is an interpreter with Exudyn (`pip install exudyn`), PATH a checkout of beamdae; without
them their tables are left out. "price of Python" is the time of a run over the time that its own
counted residuals, matrices, factorizations and solutions take back to back (`pieces`), without a
scout; "in loops" is the part of it within machine code. "setup" and "books" (the energy ledger of
a run, its drift and residual) are those of a second run with the same equations of motion.
Processor times, the least of several turns, unless they are called wall.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

MODELS = Path(__file__).parents[2] / "models"
sys.path.insert(0, str(MODELS))

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from lapack_superlu import linear
from pendulum import pendulum
from pieces import PIECES, Pieces, first_order_pieces, step_pieces
from slider_crank import slider_crank
from tables import RESULTS, write
from timing import Times, in_turns, integrated, taken, within_loops
from workers import Worker, checkout, exudyn

import beamdae as bd
from beamdae.linear.blas_threads import single_threaded
from beamdae.results.outcome import Statistics

MODEL = {"hub_beam": hub_beam, "pendulum": pendulum, "slider_crank": slider_crank}
Systems = tuple[tuple[str, dict[str, Any]], ...]
SYSTEMS: Systems = (
    ("hub_beam", {}),
    ("pendulum", {"damping": 0.0}),
    ("slider_crank", {"frame": "chord"}),
)
INTEGRATORS = (bd.GeneralizedAlpha(1e-3), bd.Ida(1e-5), bd.Radau(1e-4))
# Steps and tolerances at which pieces are evaluated: what they take does not depend on them.
STEP, RATE = 1e-3, 2e3


def calls_of(
    equations: bd.EquationsOfMotion, integrator: bd.Integrator, found: Statistics
) -> Callable[[], float]:
    """What tells the time of a run's counted calls, back to back [s]."""
    counts = dict(
        zip(
            PIECES,
            (found.residual_calls, found.jacobian_calls, found.factorizations, found.solves),
            strict=True,
        )
    )
    if isinstance(integrator, bd.GeneralizedAlpha):
        return partial(_total, [(step_pieces(equations, STEP, 200), counts)])
    real = first_order_pieces(equations, RATE, 200)
    if isinstance(integrator, bd.Ida):
        return partial(_total, [(real, counts)])
    # An iteration of Radau is three residuals, a real and a complex solution; its matrices come in
    # pairs, and further solutions, those of the error, are real.
    pair = first_order_pieces(equations, complex(RATE, RATE), 200)
    of_pair = {"factorize": found.factorizations // 2, "solve": found.residual_calls // 3}
    counts = {name: count - of_pair.get(name, 0) for name, count in counts.items()}
    return partial(_total, [(real, counts), (pair, of_pair)])


def _total(parts: list[tuple[Pieces, dict[str, int]]]) -> float:
    return sum(count * pieces[name]() for pieces, counts in parts for name, count in counts.items())


@single_threaded
def runs(rounds: int, systems: Systems = SYSTEMS) -> pd.DataFrame:
    """Integration time of the published systems, over that of its pieces."""
    lines = []
    for name, parameters in systems:
        model = MODEL[name]
        equations = bd.equations_of_motion(model(**parameters))
        # With scales given no scout goes before a run: its calls are not counted.
        equations = replace(equations, scales=equations.position_scales)
        times = np.linspace(0.0, model.t_end, 201)
        for integrator in INTEGRATORS:
            _, solution = integrated(equations, integrator, times)
            found = solution.statistics
            in_loops = Times()
            actions = {
                "run": partial(_watched, equations, integrator, times, in_loops),
                "calls": calls_of(equations, integrator, found),
            }
            taken_by = in_turns(actions, rounds)
            run, calls = taken_by["run"], taken_by["calls"]
            lines.append(
                {
                    "run": f"{name}, {integrator.label}",
                    "steps": found.steps,
                    "run [s]": run.least,
                    "in loops [s]": in_loops.least,
                    "calls [s]": calls.least,
                    "price of Python": run.least / calls.least,
                    "of medians": run.median / calls.median,
                    "loops / calls": in_loops.least / calls.least,
                    "setup [s]": found.setup_time,
                    "books [s]": taken(lambda of=solution: of.quality),
                }
            )
    return pd.DataFrame(lines)


def _watched(
    equations: bd.EquationsOfMotion,
    integrator: bd.Integrator,
    times: np.ndarray,
    in_loops: Times,
) -> float:
    """Time of a run; that within its compiled loops goes to `in_loops`."""
    whole, inside = within_loops(equations, integrator, times)
    in_loops.all.append(inside)
    return whole


def beside_exudyn(peer: Worker, rounds: int) -> pd.DataFrame:
    """Eight elements of beamdae, and of Exudyn with three nodes, at the same step."""
    lines = []
    for name, system in (("hub_beam", "hub beam"), ("pendulum", "pendulum")):
        model = MODEL[name]
        equations = bd.equations_of_motion(model(elements=8, damping=0.0))
        times = np.linspace(0.0, model.t_end, round(model.t_end / 0.01) + 1)
        asked = {"system": system, "elements": 8, "nodes": 3, "step": 1e-3, "path": False}
        actions = {
            "beamdae": partial(_own, equations, bd.GeneralizedAlpha(1e-3), times),
            "Exudyn": lambda asked=asked: peer(**asked)["integrate"],
        }
        found = in_turns(actions, rounds)
        lines.append({"run": f"{name}, step=1e-3", **_compared(found, "beamdae", "Exudyn")})
    return pd.DataFrame(lines)


def _own(equations: bd.EquationsOfMotion, integrator: bd.Integrator, times: np.ndarray) -> float:
    return integrated(equations, integrator, times)[0]


def beside_before(folder: Path, rounds: int, systems: Systems = SYSTEMS) -> pd.DataFrame:
    """Runs of another checkout and of this one."""
    lines = []
    with checkout(folder) as before, checkout(MODELS.parent) as now:
        for name, parameters in systems:
            for integrator, settings in (
                ("Ida", {"rtol": 1e-5}),
                ("Radau", {"rtol": 1e-4}),
                ("GeneralizedAlpha", {"step": 1e-3}),
            ):
                asked = {
                    "model": name,
                    "parameters": parameters,
                    "integrator": integrator,
                    "settings": settings,
                }
                actions = {
                    "now": lambda asked=asked: now(**asked)["integrate"],
                    "before": lambda asked=asked: before(**asked)["integrate"],
                }
                found = in_turns(actions, rounds)
                line = {"run": f"{name}, {getattr(bd, integrator)(**settings).label}"}
                lines.append({**line, **_compared(found, "now", "before")})
    return pd.DataFrame(lines)


def _compared(found: dict[str, Times], one: str, other: str) -> dict[str, float]:
    return {
        f"{one} [s]": found[one].least,
        f"{other} [s]": found[other].least,
        "ratio": found[one].least / found[other].least,
        "of medians": found[one].median / found[other].median,
    }


def building() -> pd.DataFrame:
    """From a model to its equations, and to all that Ida needs, in a warm process."""
    lines = []
    for elements in (8, 32, 128, 512):
        mechanism = hub_beam(elements=elements)
        states = [
            taken(lambda mechanism=mechanism: bd.equations_of_motion(mechanism)) for _ in range(3)
        ]
        setups = []
        for _ in range(3):
            equations = bd.equations_of_motion(mechanism)
            whole = taken(
                lambda of=equations: bd.GeneralizedAlpha(1e-3).integrate(of, np.array([0.0, 1e-3]))
            )
            setups.append(whole)
        lines.append(
            {"elements": elements, "equations [s]": min(states), "first step [s]": min(setups)}
        )
    return pd.DataFrame(lines)


def shell() -> pd.DataFrame:
    """From shell to table."""
    command = [sys.executable, "-m", "beamdae", "run", str(MODELS / "hub_beam.py"), "--out"]
    walls = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(4):
            begin = time.perf_counter()
            subprocess.run([*command, folder], check=True, capture_output=True)
            walls.append(time.perf_counter() - begin)
    return pd.DataFrame([{"command": "beamdae run hub_beam.py", "wall [s]": min(walls)}])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--linear", action="store_true")
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--before", type=Path, help="a checkout to compare with")
    parser.add_argument("--quick", action="store_true", help="fewer turns")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    options = parser.parse_args()
    if options.linear:
        print(linear().to_string(index=False))
        return
    rounds = 2 if options.quick else 6
    write(options.out, "price_of_python", runs(rounds))
    peer = exudyn(options.peer)
    if peer is not None:
        with peer:
            write(options.out, "beside_exudyn", beside_exudyn(peer, 2 * rounds))
    if options.before is not None:
        write(options.out, "beside_before", beside_before(options.before, rounds))
    write(options.out, "building", building())
    print(shell().to_string(index=False))


if __name__ == "__main__":
    main()
