"""Metamorphic trials: writing into everything that a result hands out must not change the result.

`handed_out.list_changes` overwrites all containers and reads them again.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import beamdae as bd
from robustness.handed_out import list_changes
from robustness.isolation import ScratchFolder
from robustness.trial_class import TrialClass

WRITE_TIME_LIMIT = 300.0  # s
QUICK_WRITE_COUNT = 4
STRIP = bd.Section.rectangle(bd.Material.of("steel"), width=0.01, height=0.004)


@bd.model(t_end=0.1)
def arm(stiffness=50.0):
    """Beam on a hinge with a spring, shaken at its tip."""
    mech = bd.Mechanism(gravity=(0.0, -9.81), start={"arm.x0": 0.0})
    beam = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP, elements=2))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.TorsionSpring("spring", hinge.a, hinge.b, stiffness))
    mech.add(bd.TorsionSpring("damper", hinge.a, hinge.b, damping=1.0))
    mech.add(bd.Force("shaker", beam.end, (0.0, bd.sine(1.0, frequency=10.0))))
    mech.observe("tip", beam.end)
    mech.when("tip.y", crosses=-0.001, direction="down", do="record", name="low")
    return mech


@bd.model(t_end=0.1)
def shaken(stiffness=100.0, damping=50.0):
    """Mass on a spring, shaken ten times per second."""
    mech = bd.Mechanism()
    bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), bob.point, (1.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), bob.point, stiffness, damping))
    mech.add(bd.Force("shaker", bob.point, (bd.sine(1.0, frequency=10.0), 0.0)))
    mech.observe("bob", bob.point)
    return mech


def run(**settings: Any) -> bd.results.Solution:
    """Run the arm; its metadata contain the warnings that have been read."""
    solution = bd.simulate(arm(), bd.Radau(1e-4), output_step=0.01, **settings)
    assert isinstance(solution.warnings, tuple)
    return solution


def _saved_run(folder: Path) -> Any:
    return bd.load(run().save(folder / "run.beamdae"))


# Objects that hand out data, made with files in a folder.
RESULTS: dict[str, Callable[[Path], Any]] = {
    "Solution": lambda _: run(),
    "SavedRun": _saved_run,
    "Solution.at": lambda _: run().at(0.05),
    "SectionForces": lambda _: run().section_forces("arm"),
    "Equilibrium": lambda _: bd.equilibrium(arm()),
    "Modes": lambda _: bd.modes(arm(), n=2),
    "LinearModel": lambda _: bd.linearize(arm(), inputs=["shaker"], outputs=["tip"]),
    "PeriodicMotion": lambda _: bd.periodic(shaken(), 0.1),
    "Check": lambda _: bd.check(shaken()),
    "refined Solution": lambda _: bd.simulate(shaken(), accuracy=0.01),
    "Sensitivities": lambda _: bd.sensitivities(shaken, "stiffness"),
    "EquilibriumSensitivities": lambda _: bd.equilibrium_sensitivities(shaken, "stiffness"),
    "ModeSensitivities": lambda _: bd.mode_sensitivities(shaken, "stiffness"),
    "PeriodicSensitivities": lambda _: bd.periodic_sensitivities(shaken, "stiffness", 0.1),
    "Fit": lambda _: bd.fit(
        shaken, {"t [s]": [0.0, 0.05, 0.1], "bob.x": [1.0, 1.001, 1.0]}, "stiffness"
    ),
    "Optimization": lambda _: bd.optimize(
        shaken, bd.quantities.Mass(), "stiffness", (), {"stiffness": (40.0, 160.0)}
    ),
    "SweepResults": lambda _: bd.sweep(shaken, {"stiffness": [50.0, 60.0]}, jobs=1),
    "Mechanism": lambda _: arm(),
    "Model": lambda _: arm,
}


@dataclass(frozen=True)
class WriteRow:
    """Row of one object; the complaint lists the expressions that read differently."""

    trial: str
    ended: str
    complaint: str = ""


def try_writes(name: str) -> WriteRow:
    """Write into everything that an object hands out."""
    with ScratchFolder() as scratch, warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        changes = list_changes(RESULTS[name](scratch.folder))
    complaint = f"changed by writing: {', '.join(changes)}" if changes else ""
    return WriteRow(name, "ran", complaint)


TRIALS = TrialClass(
    "writes",
    collect=lambda: list(RESULTS),
    attempt=try_writes,
    time_limit=WRITE_TIME_LIMIT,
    quick_size=QUICK_WRITE_COUNT,
)
