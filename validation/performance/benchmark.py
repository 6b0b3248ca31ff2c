"""Time runs relative to Exudyn and to another version.

    python validation/performance/benchmark.py --peer PYTHON --before PATH
    python validation/performance/benchmark.py --quick

PYTHON is an interpreter with Exudyn (`pip install exudyn pandas scipy`), and PATH is a checkout of
beamdae; the tables of a missing tool are omitted. Times are processor times, the smallest of
several turns.
"""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import Any

MODELS_FOLDER = Path(__file__).parents[2] / "models"
sys.path.insert(0, str(MODELS_FOLDER))

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from measurement import (
    RESULTS,
    Worker,
    start_checkout,
    start_exudyn,
    time_in_turns,
    time_integration,
    write_table,
)
from pendulum import pendulum
from slider_crank import slider_crank
from systems import load_motion

import beamdae as bd

MODELS_BY_NAME = {"hub_beam": hub_beam, "pendulum": pendulum, "slider_crank": slider_crank}
Systems = tuple[tuple[str, dict[str, Any]], ...]
SYSTEMS: Systems = (
    ("hub_beam", {}),
    ("pendulum", {"damping": 0.0}),
    ("slider_crank", {"frame": "chord"}),
)


def compare_with_exudyn(peer: Worker, rounds: int) -> pd.DataFrame:
    """Compare eight elements of beamdae with eight of Exudyn, of three nodes, at one step."""
    rows = []
    for name, problem in (("hub_beam", "hub_beam_60"), ("pendulum", "pendulum_undamped")):
        model = MODELS_BY_NAME[name]
        equations = bd.equations_of_motion(model(elements=8, damping=0.0))
        times = np.linspace(0.0, model.t_end, round(model.t_end / 0.01) + 1)
        job = {"problem": load_motion(problem, 0.0, model.t_end), "elements": 8, "nodes": 3}
        job |= {"step": 1e-3, "path": False}
        run = partial(time_integration, equations, bd.GeneralizedAlpha(1e-3), times)
        samples = time_in_turns(
            {
                "beamdae": lambda run=run: run()[0],
                "Exudyn": lambda job=job: peer(**job)["integrate"],
            },
            rounds,
        )
        rows.append({"run": f"{name}, step=1e-3", **_ratio_columns(samples, "beamdae", "Exudyn")})
    return pd.DataFrame(rows)


def compare_with_checkout(folder: Path, rounds: int, systems: Systems = SYSTEMS) -> pd.DataFrame:
    """Compare runs of another checkout with runs of this one."""
    rows = []
    with start_checkout(folder) as before, start_checkout(MODELS_FOLDER.parent) as now:
        for name, parameters in systems:
            for integrator, settings in (
                ("Ida", {"rtol": 1e-5}),
                ("Radau", {"rtol": 1e-4}),
                ("GeneralizedAlpha", {"step": 1e-3}),
            ):
                job = {
                    "model": name,
                    "parameters": parameters,
                    "integrator": integrator,
                    "settings": settings,
                }
                actions = {
                    "now": lambda job=job: now(**job)["integrate"],
                    "before": lambda job=job: before(**job)["integrate"],
                }
                samples = time_in_turns(actions, rounds)
                line = {"run": f"{name}, {getattr(bd, integrator)(**settings).label}"}
                rows.append({**line, **_ratio_columns(samples, "now", "before")})
    return pd.DataFrame(rows)


def _ratio_columns(samples: dict[str, np.ndarray], one: str, other: str) -> dict[str, float]:
    ours, theirs = samples[one], samples[other]
    return {
        f"{one} [s]": ours.min(),
        f"{other} [s]": theirs.min(),
        "ratio": ours.min() / theirs.min(),
        "of medians": np.median(ours) / np.median(theirs),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--before", type=Path, help="a checkout to compare with")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    options = parser.parse_args()
    rounds = 2 if options.quick else 6
    peer = start_exudyn(options.peer)
    if peer is not None:
        with peer:
            write_table(options.out, "beside_exudyn", compare_with_exudyn(peer, 2 * rounds))
    if options.before is not None:
        write_table(options.out, "beside_before", compare_with_checkout(options.before, rounds))


if __name__ == "__main__":
    main()
