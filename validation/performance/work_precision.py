"""Time over error of beamdae and of Exudyn: the hub beam and the pendulum.

    python validation/performance/work_precision.py --peer PYTHON    ten minutes
    python validation/performance/work_precision.py --quick          fewer settings, two minutes
    python validation/performance/work_precision.py --references     the references anew, first
    python validation/performance/work_precision.py --exact          beams without floating frames

PYTHON is an interpreter with Exudyn (`pip install exudyn`); without it beamdae stands alone. The
error is the largest distance of the tip from that of the exact beam, every 0.01 s of the run: the
reference is Exudyn's with 64 elements of 3 nodes and steps of 5e-5 s. `references.csv` tells how
far beamdae's finest run is from it. Every setting is tried once; the fastest few of each tool that
keep an error then take turns. Tables and the picture go to `results`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from systems import exact_hub_beam, exact_pendulum
from tables import RESULTS, write
from timing import integrated
from work_precision_picture import draw
from workers import Worker, exudyn

import beamdae as bd

Array = np.ndarray

LEVELS = (1.0, 0.3, 0.1, 0.03, 0.01)
# Settings of each tool that take turns at each level.
FINALISTS = 3


@dataclass(frozen=True)
class Case:
    """A system with a damping [s], and when it ends [s]."""

    system: str
    damping: float
    end: float
    formulation: str = "floating frame"

    @property
    def name(self) -> str:
        """What tables call it."""
        return f"{self.system}, {'damped' if self.damping else 'undamped'}"

    @property
    def times(self) -> Array:
        """Times at which tips are compared [s]."""
        return np.linspace(0.0, self.end, round(self.end / 0.01) + 1)

    def mechanism(self, mesh: tuple[int, int]) -> bd.Mechanism:
        """The model of beamdae with (bodies, elements of each)."""
        model = exact_hub_beam if self.system == "hub beam" else exact_pendulum
        return model(*mesh, self.damping, self.formulation)


CASES = (
    Case("hub beam", 0.0, 2.0),
    Case("hub beam", 1e-4, 2.0),
    Case("pendulum", 0.0, 5.0),
    Case("pendulum", 1e-4, 5.0),
)
# (bodies, elements of each)
MESHES = ((1, 2), (1, 3), (1, 4), (1, 6), (2, 2), (4, 1))
EXACT_MESHES = ((1, 2), (1, 3), (1, 4), (1, 6), (1, 8), (1, 12))
STEPS = (1e-2, 5e-3, 2.5e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
INTEGRATORS = (
    *(bd.GeneralizedAlpha(step) for step in STEPS),
    *(bd.GeneralizedAlpha(rtol=rtol) for rtol in (1e-3, 1e-4, 3e-5)),
    *(bd.Radau(rtol) for rtol in (1e-2, 1e-3, 1e-4, 1e-5)),
    *(bd.Ida(rtol) for rtol in (1e-3, 1e-4, 3e-5, 1e-5)),
)
# (elements, nodes of each)
PEER_MESHES = ((3, 3), (4, 3), (6, 3), (8, 3), (16, 3), (16, 2), (32, 2))
FINEST = {"elements": 64, "nodes": 3, "step": 5e-5}
FINEST_OWN = ((4, 4), bd.Radau(1e-6))


@dataclass(frozen=True)
class Outcome:
    """Path of the tip (times, 2), and times of the integration and of all of the run [s]."""

    path: Array
    integration: float
    whole: float


@dataclass(frozen=True)
class Setting:
    """Something to run."""

    tool: str
    mesh: str
    integrator: str
    run: Callable[[], Outcome]


def own_run(case: Case, mesh: tuple[int, int], integrator: bd.Integrator) -> Outcome:
    """From a model to the table of its tip."""
    begin = time.process_time()
    equations = bd.equations_of_motion(case.mechanism(mesh))
    taken, solution = integrated(equations, integrator, case.times)
    path = tip(solution)
    return Outcome(path, taken, time.process_time() - begin)


def tip(solution: bd.Solution) -> Array:
    return solution.observed[["tip.x [m]", "tip.y [m]"]].to_numpy()


@cache
def _equations(case: Case, mesh: tuple[int, int]) -> bd.EquationsOfMotion:
    return bd.equations_of_motion(case.mechanism(mesh))


def peer_run(peer: Worker, case: Case, **settings: float) -> Outcome:
    """The same by Exudyn."""
    found = peer(system=case.system, damping=case.damping, end=case.end, **settings)
    rows = np.array(found["path"])
    assert len(rows) == len(case.times), settings
    return Outcome(rows[:, 1:], found["integrate"], found["build"] + found["integrate"])


def settings_of(case: Case, peer: Worker | None, quick: bool) -> list[Setting]:
    """All that is tried."""
    every = slice(None, None, 3 if quick else 1)
    found = [
        Setting(
            "beamdae",
            f"{mesh[0]} x {mesh[1]}",
            integrator.label,
            lambda mesh=mesh, integrator=integrator: own_run(case, mesh, integrator),
        )
        for mesh in (EXACT_MESHES if case.formulation == "exact" else MESHES)[every]
        for integrator in INTEGRATORS[every]
    ]
    for elements, nodes in PEER_MESHES[every] if peer is not None else ():
        for step in STEPS[every]:
            chosen = {"elements": elements, "nodes": nodes, "step": step}
            found.append(
                Setting(
                    "Exudyn",
                    f"{elements} of {nodes} nodes",
                    f"step={step:g}",
                    lambda chosen=chosen: peer_run(peer, case, **chosen),
                )
            )
    return found


def tried(case: Case, settings: list[Setting], reference: Array) -> pd.DataFrame:
    """A line for each setting that came to its end."""
    lines = []
    for at, setting in enumerate(settings):
        outcome = setting.run()
        if len(outcome.path) < len(reference):
            continue
        error = np.linalg.norm(outcome.path - reference, axis=1).max()
        lines.append(
            {
                "case": case.name,
                "tool": setting.tool,
                "mesh": setting.mesh,
                "integrator": setting.integrator,
                "error [mm]": 1e3 * error,
                "integration [s]": outcome.integration,
                "with setup [s]": outcome.whole,
                "setting": at,
            }
        )
    return pd.DataFrame(lines)


def finalists(lines: pd.DataFrame) -> list[int]:
    """The fastest settings of each tool that keep each level."""
    chosen: set[int] = set()
    for level in LEVELS:
        kept = lines[lines["error [mm]"] <= level].sort_values("integration [s]")
        chosen.update(kept.groupby("tool").head(FINALISTS)["setting"])
    return sorted(chosen)


def timed(lines: pd.DataFrame, settings: list[Setting], rounds: int) -> pd.DataFrame:
    """The lines with the least and the median times of those that took turns."""
    chosen = finalists(lines)
    found = {at: [] for at in chosen}
    for _ in range(rounds):
        for at in chosen:
            outcome = settings[at].run()
            found[at].append((outcome.integration, outcome.whole))
    lines = lines.set_index("setting")
    lines["turns"] = 0
    lines["median [s]"] = np.nan
    for at, all_times in found.items():
        least = np.min(all_times, axis=0)
        lines.loc[at, ["integration [s]", "with setup [s]"]] = least
        lines.loc[at, ["median [s]", "turns"]] = np.median(all_times, axis=0)[0], rounds
    return lines.reset_index(drop=True)


def best(lines: pd.DataFrame) -> pd.DataFrame:
    """The fastest of each tool at each level, and the ratios of their times."""
    rows = []
    for (case, level), group in (
        ((case, level), own[own["error [mm]"] <= level])
        for case, own in lines[lines["turns"] > 0].groupby("case", sort=False)
        for level in LEVELS
    ):
        row: dict[str, object] = {"case": case, "level [mm]": level}
        for tool in ("beamdae", "Exudyn"):
            kept = group[group["tool"] == tool]
            if kept.empty:
                continue
            fastest = kept.loc[kept["integration [s]"].idxmin()]
            row[tool] = f"{fastest['mesh']}, {fastest['integrator']}"
            row[f"{tool} [s]"] = fastest["integration [s]"]
            row[f"{tool}, median [s]"] = fastest["median [s]"]
            row[f"{tool}, with setup [s]"] = kept["with setup [s]"].min()
        rows.append(row)
    found = pd.DataFrame(rows)
    if "Exudyn [s]" in found:
        found["ratio"] = found["beamdae [s]"] / found["Exudyn [s]"]
        found["ratio of medians"] = found["beamdae, median [s]"] / found["Exudyn, median [s]"]
        found["ratio with setup"] = (
            found["beamdae, with setup [s]"] / found["Exudyn, with setup [s]"]
        )
    return found


def reference_file(case: Case) -> Path:
    return RESULTS / f"reference_{case.name.replace(', ', '_').replace(' ', '_')}.csv"


def make_references(peer: Worker) -> pd.DataFrame:
    """Store the references; how far other fine runs are from them [mm]."""
    lines = []
    for case in CASES:
        finest = peer_run(peer, case, **FINEST).path
        coarser = peer_run(peer, case, **{**FINEST, "elements": 32, "step": 1e-4}).path
        mesh, integrator = FINEST_OWN
        own = tip(integrator.integrate(_equations(case, mesh), case.times))
        lines.append(
            {
                "case": case.name,
                "beamdae 4 x 4, Radau(1e-6) [mm]": _apart(own, finest),
                "Exudyn, half the elements, twice the step [mm]": _apart(coarser, finest),
            }
        )
        table = pd.DataFrame({"t [s]": case.times, "x [m]": finest[:, 0], "y [m]": finest[:, 1]})
        table.to_csv(reference_file(case), index=False, float_format="%.9g")
    return pd.DataFrame(lines)


def _apart(path: Array, other: Array) -> float:
    return 1e3 * float(np.linalg.norm(path - other, axis=1).max())


def reference(case: Case) -> Array:
    return pd.read_csv(reference_file(case))[["x [m]", "y [m]"]].to_numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--quick", action="store_true", help="fewer settings and turns")
    parser.add_argument("--exact", action="store_true", help="beams without floating frames")
    parser.add_argument("--references", action="store_true", help="the references anew")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    options = parser.parse_args()
    peer = exudyn(options.peer)
    if options.references:
        if peer is None:
            parser.exit(1)
        write(RESULTS, "references", make_references(peer))
    tables = []
    with peer or nullcontext():
        for case in CASES[1:3] if options.quick else CASES:
            if options.exact:
                case = replace(case, formulation="exact")
            settings = settings_of(case, peer, options.quick)
            lines = tried(case, settings, reference(case))
            tables.append(timed(lines, settings, 3 if options.quick else 5))
    lines = pd.concat(tables)
    options.out.mkdir(parents=True, exist_ok=True)
    name = "work_precision_exact" if options.exact else "work_precision"
    lines.to_csv(options.out / f"{name}.csv", index=False, float_format="%.4g")
    write(options.out, f"{name}_best", best(lines))
    draw(lines, options.out / f"{name}.png")


if __name__ == "__main__":
    main()
