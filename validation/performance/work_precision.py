"""Time over error of beamdae and of Exudyn, for the hub beam and the pendulum.

    python validation/performance/work_precision.py --peer PYTHON    ten minutes
    python validation/performance/work_precision.py --quick          fewer settings, two minutes
    python validation/performance/work_precision.py --references     compute the references first
    python validation/performance/work_precision.py --exact          beams without floating frames

PYTHON is an interpreter with Exudyn (`pip install exudyn pandas scipy`); without it only beamdae is
measured. The error is the largest distance of the tip from that of the exact beam, every 0.01 s of
the run. The reference is Exudyn's beam of 64 elements with 3 nodes and steps of 5e-5 s, in
`references.csv`; `--references` also lists the distance of beamdae's finest run from it. Every
setting runs once; the fastest few of each tool at each error then take turns. Tables go to
`results`.
"""

import argparse
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[2] / "models"))

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from measurement import RESULTS, Worker, start_exudyn, time_integration, write_table
from systems import Problem, load_motion

import beamdae as bd

Array = np.ndarray

ERROR_LEVELS = (1.0, 0.3, 0.1, 0.03, 0.01)  # mm
FINALISTS = 3  # settings of each tool that take turns at each level


def exact_hub_beam(
    bodies: int, elements: int, damping: float, formulation: str = "floating frame"
) -> bd.Mechanism:
    kind = {"formulation": formulation}
    if formulation != "exact":
        kind = {"frame": "chord", "strain": "green"}
    return hub_beam(elements=elements, bodies=bodies, damping=damping, **kind)


def exact_pendulum(
    bodies: int, elements: int, damping: float, formulation: str = "floating frame"
) -> bd.Mechanism:
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arc = bd.Arc(radius=0.85, length=0.80, start=(0.0, 0.0), angle=-0.60)
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    strip = bd.Section.rectangle(alloy, width=0.03, height=0.0025, damping=damping)
    kind: dict[str, Any] = {"elements": elements, "formulation": formulation}
    beams = bd.welded_beams(mech, "beam", arc, strip, bodies, **kind)
    mech.add(bd.PointMass("tip mass", 0.060, on=beams[-1].end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beams[0].start))
    mech.observe("tip", beams[-1].end)
    return mech


@dataclass(frozen=True)
class Case:
    """System with its damping [s], end time [s] and beam formulation."""

    system: str
    damping: float
    end: float
    formulation: str = "floating frame"

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.system}, {'damped' if self.damping else 'undamped'}"

    @property
    def times(self) -> Array:
        """Times at which tips are compared [s]."""
        return np.linspace(0.0, self.end, round(self.end / 0.01) + 1)

    @property
    def problem(self) -> Problem:
        """Problem for Exudyn."""
        names = {"hub beam": "hub_beam_60", "pendulum": "pendulum_undamped"}
        return load_motion(names[self.system], self.damping, self.end)

    def mechanism(self, mesh: tuple[int, int]) -> bd.Mechanism:
        """Return the model whose limit, with many (bodies, elements of each), is the exact beam."""
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
EXUDYN_MESHES = ((3, 3), (4, 3), (6, 3), (8, 3), (16, 3), (16, 2), (32, 2))
REFERENCE_SETTINGS = {"elements": 64, "nodes": 3, "step": 5e-5}
FINEST_BEAMDAE = ((4, 4), bd.Radau(1e-6))

# Path of the tip (times, 2), and times of the integration and of the whole run [s].
Outcome = tuple[Array, float, float]


def run_beamdae(case: Case, mesh: tuple[int, int], integrator: bd.Integrator) -> Outcome:
    """Run beamdae from a model to the table of its tip."""
    begin = time.process_time()
    equations = bd.equations_of_motion(case.mechanism(mesh))
    integration, solution = time_integration(equations, integrator, case.times)
    path = solution.observed[["tip.x [m]", "tip.y [m]"]].to_numpy()
    return path, integration, time.process_time() - begin


def run_exudyn(peer: Worker, case: Case, **settings: float) -> Outcome:
    """Run Exudyn from a model to the path of its tip."""
    answer = peer(problem=case.problem, **settings)
    rows = np.array(answer["path"])
    assert len(rows) == len(case.times), settings
    return rows[:, 1:], answer["integrate"], answer["build"] + answer["integrate"]


class Setting(NamedTuple):
    """Tool, mesh and integrator, and the function that runs them."""

    tool: str
    mesh: str
    integrator: str
    run: Callable[[], Outcome]


def list_settings(case: Case, peer: Worker | None, quick: bool) -> list[Setting]:
    """Return all settings of a case."""
    every = slice(None, None, 3 if quick else 1)
    settings = []
    for mesh in (EXACT_MESHES if case.formulation == "exact" else MESHES)[every]:
        for integrator in INTEGRATORS[every]:
            run = partial(run_beamdae, case, mesh, integrator)
            settings.append(Setting("beamdae", f"{mesh[0]} x {mesh[1]}", integrator.label, run))
    for elements, nodes in EXUDYN_MESHES[every] if peer is not None else ():
        for step in STEPS[every]:
            run = partial(run_exudyn, peer, case, elements=elements, nodes=nodes, step=step)
            mesh = f"{elements} of {nodes} nodes"
            settings.append(Setting("Exudyn", mesh, f"step={step:g}", run))
    return settings


def run_settings(case: Case, settings: list[Setting], reference: Array) -> pd.DataFrame:
    """Return a row for each setting that reached its end."""
    rows = []
    for index, setting in enumerate(settings):
        path, integration, whole = setting.run()
        if len(path) < len(reference):
            continue
        row = {"case": case.name, **setting._asdict(), "error [mm]": max_distance(path, reference)}
        times = {"integration [s]": integration, "with setup [s]": whole}
        rows.append(row | times | {"setting": index})
    return pd.DataFrame(rows).drop(columns="run")


def time_finalists(table: pd.DataFrame, settings: list[Setting], rounds: int) -> pd.DataFrame:
    """Return the rows with the smallest and median times of settings that took turns.

    These are the fastest settings of each tool that meet each error level.
    """
    ordered = table.sort_values("integration [s]")
    accurate = (ordered[ordered["error [mm]"] <= level] for level in ERROR_LEVELS)
    heads = pd.concat([rows.groupby("tool").head(FINALISTS) for rows in accurate])
    finalists = sorted(set(heads["setting"]))
    turns = [[settings[k].run()[1:] for k in finalists] for _ in range(rounds)]
    table = table.set_index("setting").assign(**{"turns": 0, "median [s]": np.nan})
    table.loc[finalists, ["integration [s]", "with setup [s]"]] = np.min(turns, axis=0)
    table.loc[finalists, "median [s]"] = np.median(turns, axis=0)[:, 0]
    table.loc[finalists, "turns"] = rounds
    return table.reset_index(drop=True)


def select_fastest(table: pd.DataFrame) -> pd.DataFrame:
    """Return the fastest setting of each tool at each level, and the ratios of their times."""
    rows = []
    for case, timed in table[table["turns"] > 0].groupby("case", sort=False):
        for level in ERROR_LEVELS:
            row: dict[str, object] = {"case": case, "level [mm]": level}
            for tool, accurate in timed[timed["error [mm]"] <= level].groupby("tool", sort=False):
                fastest = accurate.loc[accurate["integration [s]"].idxmin()]
                row[tool] = f"{fastest['mesh']}, {fastest['integrator']}"
                row[f"{tool} [s]"] = fastest["integration [s]"]
                row[f"{tool}, median [s]"] = fastest["median [s]"]
                row[f"{tool}, with setup [s]"] = accurate["with setup [s]"].min()
            rows.append(row)
    result = pd.DataFrame(rows)
    if "Exudyn [s]" in result:
        for name, time_of in (
            ("ratio", "{} [s]"),
            ("ratio of medians", "{}, median [s]"),
            ("ratio with setup", "{}, with setup [s]"),
        ):
            result[name] = result[time_of.format("beamdae")] / result[time_of.format("Exudyn")]
    return result


REFERENCES = RESULTS / "references.csv"


def store_references(peer: Worker) -> pd.DataFrame:
    """Store the references; return distances of other fine runs from them [mm]."""
    rows, tables = [], []
    for case in CASES:
        finest, *_ = run_exudyn(peer, case, **REFERENCE_SETTINGS)
        coarser, *_ = run_exudyn(peer, case, **REFERENCE_SETTINGS | {"elements": 32, "step": 1e-4})
        computed, *_ = run_beamdae(case, *FINEST_BEAMDAE)
        rows.append(
            {
                "case": case.name,
                "beamdae 4 x 4, Radau(1e-6) [mm]": max_distance(computed, finest),
                "Exudyn, half the elements, twice the step [mm]": max_distance(coarser, finest),
            }
        )
        columns = {"t [s]": case.times, "x [m]": finest[:, 0], "y [m]": finest[:, 1]}
        tables.append(pd.DataFrame({"case": case.name} | columns))
    pd.concat(tables).to_csv(REFERENCES, index=False, float_format="%.9g")
    return pd.DataFrame(rows)


def max_distance(path: Array, other: Array) -> float:
    """Return the largest distance of two paths [mm]."""
    return 1e3 * float(np.linalg.norm(path - other, axis=1).max())


def load_reference(case: str) -> Array:
    """Return the tip (rows, 2) [m] of the reference of a case, such as "pendulum, damped"."""
    table = pd.read_csv(REFERENCES, index_col="case")
    return table.loc[case, ["x [m]", "y [m]"]].to_numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--quick", action="store_true", help="fewer settings and turns")
    parser.add_argument("--exact", action="store_true", help="beams without floating frames")
    parser.add_argument("--references", action="store_true", help="compute the references first")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    options = parser.parse_args()
    peer = start_exudyn(options.peer)
    if options.references:
        if peer is None:
            parser.exit(1)
        write_table(options.out, "reference_distances", store_references(peer))
    tables = []
    with peer or nullcontext():
        for case in CASES[1:3] if options.quick else CASES:
            if options.exact:
                case = replace(case, formulation="exact")
            settings = list_settings(case, peer, options.quick)
            table = run_settings(case, settings, load_reference(case.name))
            tables.append(time_finalists(table, settings, 3 if options.quick else 5))
    table = pd.concat(tables)
    options.out.mkdir(parents=True, exist_ok=True)
    name = "work_precision_exact" if options.exact else "work_precision"
    table.to_csv(options.out / f"{name}.csv", index=False, float_format="%.4g")
    write_table(options.out, f"{name}_best", select_fastest(table))


if __name__ == "__main__":
    main()
