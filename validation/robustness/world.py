"""A small working mechanism for a bad value to be put into, and what is done with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import casadi as ca

import beamdae as bd
from beamdae.testing import SampleMechanism

# All runs are this short [s]; a run that would take long tells that it reached its limit.
T_END, OUTPUT_STEP, TIME_LIMIT = 0.01, 0.002, 5.0
INTEGRATORS: tuple[Callable[[], bd.Integrator], ...] = (
    lambda: bd.Auto(1e-3, time_limit=TIME_LIMIT),
    lambda: bd.GeneralizedAlpha(2e-3, time_limit=TIME_LIMIT),
    lambda: bd.Radau(1e-3, time_limit=TIME_LIMIT),
    lambda: bd.GeneralizedAlpha(rtol=1e-3, time_limit=TIME_LIMIT),
    lambda: bd.Ida(1e-3, time_limit=TIME_LIMIT),
)
KNEE = (1.0, 0.0)
# Parts, models and studies that are made of what an input gives.
_MADE = (
    *("torque", "mass", "watched", "end", "swing", "bob", "pin", "few", "place", "ground"),
    *(
        "beam",
        "disk",
        "joint",
        "spring",
        "odd",
        "system",
        "constraint",
        "x",
        "y",
        "compare",
        "simulate",
        "Law",
        "Study",
    ),
    *("event", "start"),
)


class World(SampleMechanism):
    """The sample mechanism with a hinged bar, and short runs of it."""

    def __init__(self, integrator: int = 0, folder: Path = Path("out")) -> None:
        self.integrator = INTEGRATORS[integrator % len(INTEGRATORS)]()
        self.folder = folder
        super().__init__()
        self.mech = self.mechanism
        self.bar = self.mech.add(bd.RigidBody("bar", 1.0, 0.1, (0.5, 0.0)))
        self.mech.add(bd.Revolute("hinge", self.mech.ground.at(0.0, 0.0), self.bar.at(0.0, 0.0)))
        self.mech.observe("knee", self.bar.at(*KNEE))

    @property
    def hinge(self) -> bd.Joint:
        """Hinge of the bar."""
        return self.mech.part("hinge")

    @cached_property
    def beam(self) -> bd.Beam:
        """Unconstrained beam, observed at its end."""
        return self.falling()

    def falling(self, curve: Any = None, section: Any = None) -> bd.Beam:
        """Add an unconstrained beam, observed at its end."""
        curve = bd.Line((0.0, 1.0), (1.0, 1.0)) if curve is None else curve
        section = self.section if section is None else section
        beam = self.mech.add(bd.Beam("beam", curve, section, elements=1))
        self.mech.observe("end", beam.end)
        return beam

    def run(self, model: Any = None, **settings: Any) -> bd.Solution:
        """A few steps."""
        given = {"t_end": T_END, "output_step": OUTPUT_STEP} | settings
        return bd.simulate(self.mech if model is None else model, self.integrator, **given)

    @property
    def solution(self) -> bd.Solution:
        """A result that knows its integrator."""
        return self.run()

    @property
    def swing(self) -> bd.Model:
        """A model with parameters of each type."""

        # Whatever is given goes to beamdae as it is.
        @bd.model(t_end=T_END)
        def swing(mass=1.0, spin=0, stiff=True, name="bob", at=(1.0, 0.0), extra=None):
            mech = bd.Mechanism(gravity=(0.0, -9.81))
            bob = mech.add(bd.RigidBody(name, mass, 0.1, at, (0.0, 0.0), spin))
            mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
            mech.observe("bob", bob.at(0.5, 0.5))
            return mech

        return swing

    def case(self, **parameters: Any) -> bd.Case:
        """A case of that model."""
        return bd.Case(self.swing, parameters, self.integrator)

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Time, coordinates and velocities of a constrained system."""
        return ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)

    @property
    def circle(self) -> dict[str, Any]:
        """Arguments of a constrained system: a mass on a circle."""
        t, q, v = self.symbols
        return {
            "t": t,
            "q": q,
            "v": v,
            "mass": [1.0, 1.0],
            "force": ca.vertcat(0.0, -9.81),
            "constraints": ca.dot(q, q) - 1.0,
            "q0": [1.0, 0.0],
            "v0": [0.0, 0.0],
        }

    def write_model(self) -> None:
        """A model file, swing.py, among what may be left."""
        self.folder.mkdir(exist_ok=True)
        (self.folder / "swing.py").write_text(
            "import beamdae as bd\n\n@bd.model(t_end=0.01)\ndef swing(mass=1.0):\n"
            "    mech = bd.Mechanism()\n    mech.add(bd.RigidBody('bob', mass, 0.1))\n"
            "    return mech\n"
        )

    @property
    def names(self) -> set[str]:
        """What a sentence may name."""
        return {*self.mech.parts, *self.mech.observables, *_MADE}


@dataclass(frozen=True)
class Base:
    """A small working call: its arguments, the call, and what is done with what it gives.

    Attributes
    ----------
    arguments
        The arguments by name, in a world.
    use
        What is done with what the call gives; the answer is judged.
    call
        What is called in a world, with these arguments; None: the public name itself.
    """

    arguments: Callable[[World], dict[str, Any]]
    use: Callable[[World, Any], Any]
    call: Callable[..., Any] | None = None


def itself(world: World, made: Any) -> Any:
    """The answer as it is."""
    return made


def added(world: World, part: Any) -> bd.Solution:
    """A run with the part."""
    world.mech.add(part)
    return world.run()


def loaded(world: World, law: Any) -> bd.Solution:
    """A run with a load that follows the law."""
    return added(world, bd.Moment("torque", world.bar.at(*KNEE), law))


def bent(world: World, curve: Any) -> bd.Solution:
    """A run with a beam along the curve."""
    world.falling(curve=curve)
    return world.run()


def made_of(world: World, section: Any) -> bd.Solution:
    """A run with a beam of the section."""
    world.falling(section=section)
    return world.run()


def observed(world: World, quantity: Any) -> bd.Solution:
    """A run with the quantity among its columns."""
    world.mech.observe("watched", quantity)
    return world.run()


def held(world: World, attachment: Any) -> bd.Solution:
    """A run with a mass on the attachment."""
    return added(world, bd.PointMass("mass", 0.1, on=attachment))


def integrated(world: World, integrator: Any) -> bd.Solution:
    """A run by the integrator, of no more than a few seconds."""
    return bd.simulate(world.mech, integrator, T_END, OUTPUT_STEP)


def done(world: World, study: Any) -> Any:
    """The study, run here and now."""
    from beamdae.studies.execution import study_run
    from beamdae.studies.execution.executors import SerialPool

    return study_run.run_study(study, world.folder, SerialPool()).table
