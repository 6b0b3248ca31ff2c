"""Small working mechanism in which bad values are tried, and short runs of it."""

from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import casadi as ca
from sample_parts import SampleMechanism

import beamdae as bd
from beamdae import catalog
from beamdae.studies import study_run as study_execution
from beamdae.studies.executors import SerialPool

T_END = 0.01  # s
OUTPUT_STEP = 0.002  # s
RUN_TIME_LIMIT = 5.0  # s; a run that takes longer ends with its limit as the reason
INTEGRATORS: tuple[Callable[[], bd.Integrator], ...] = (
    lambda: bd.Auto(1e-3, time_limit=RUN_TIME_LIMIT),
    lambda: bd.GeneralizedAlpha(2e-3, time_limit=RUN_TIME_LIMIT),
    lambda: bd.Radau(1e-3, time_limit=RUN_TIME_LIMIT),
    lambda: bd.GeneralizedAlpha(rtol=1e-3, time_limit=RUN_TIME_LIMIT),
    lambda: bd.Ida(1e-3, time_limit=RUN_TIME_LIMIT),
)
KNEE = (1.0, 0.0)  # m, observed point of the bar
# Further names that messages may contain: functions, and objects created outside the sandbox.
_OTHER_NAMES = (
    *("beam", "bob", "compare", "constraint", "disk", "drive", "end", "event", "few", "ground"),
    *("joint", "lag", "Law", "mass", "odd", "pin", "place", "simulate", "spring", "start", "Study"),
    *("swing", "system", "torque", "watched", "x", "y"),
)


class Sandbox(SampleMechanism):
    """Sample mechanism with a hinged bar, which short runs simulate."""

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

    def run(self, model: Any = None, **settings: Any) -> bd.results.Solution:
        """Simulate a few steps of a model, by default of the mechanism."""
        options = {"t_end": T_END, "output_step": OUTPUT_STEP} | settings
        return bd.simulate(self.mech if model is None else model, self.integrator, **options)

    @property
    def solution(self) -> bd.results.Solution:
        """Solution of the mechanism."""
        return self.run()

    @property
    def swing(self) -> bd.results.Model:
        """Model with parameters of each type, which it passes on unchecked."""

        @bd.model(t_end=T_END)
        def swing(mass=1.0, spin=0, stiff=True, name="bob", at=(1.0, 0.0), extra=None):
            mech = bd.Mechanism(gravity=(0.0, -9.81))
            bob = mech.add(bd.RigidBody(name, mass, 0.1, at, (0.0, 0.0), spin))
            mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
            mech.observe("bob", bob.at(0.5, 0.5))
            return mech

        return swing

    def case(self, **parameters: Any) -> bd.Case:
        """Return a case of `swing`."""
        return bd.Case(self.swing, parameters, self.integrator)

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Time, coordinates and velocities of a constrained system."""
        return ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)

    @property
    def circle(self) -> dict[str, Any]:
        """Arguments of a constrained system: a point mass on a circle."""
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

    @property
    def names(self) -> set[str]:
        """Names that a message may contain."""
        return {*self.mech.parts, *self.mech.observables, *_OTHER_NAMES}


@dataclass(frozen=True)
class WorkingCall:
    """Small working call of a public name.

    Attributes
    ----------
    arguments
        Function that returns the arguments by name.
    use
        Function that uses the result of the call; what it returns is judged. None: the result.
    call
        Function to call with the sandbox and the arguments; None: the one that the key names.
    on
        Function that returns the object whose method the key names.
    model
        Function that returns the first argument, which no bad value replaces.
    writes
        True if the call writes files: it is made two folders down, because a path may lead up.
    """

    arguments: Callable[[Sandbox], dict[str, Any]]
    use: Callable[[Sandbox, Any], Any] | None = None
    call: Callable[..., Any] | None = None
    on: Callable[[Sandbox], Any] | None = None
    model: Callable[[Sandbox], Any] | None = None
    writes: bool = False

    def make(self, key: str, sandbox: Sandbox, arguments: dict[str, Any]) -> Any:
        """Make the call of a key, such as "Fit.page" or "fit of several starts"."""
        if self.call:
            function = partial(self.call, sandbox)
        else:
            name, _, method = key.split(" ")[0].partition(".")
            owner = self.on(sandbox) if self.on else attrgetter(catalog.NAMES[name].path)(bd)
            function = getattr(owner, method) if method else owner
        if self.model:
            function = partial(function, self.model(sandbox))
        folder = sandbox.folder / "deep" if self.writes else Path()
        folder.mkdir(parents=True, exist_ok=True)
        with chdir(folder):
            result = function(**arguments)
        return self.use(sandbox, result) if self.use else result


def tabulate(sandbox: Sandbox, result: Any) -> Any:
    """Return the table of a result."""
    return result.table()


def run_with_part(sandbox: Sandbox, part: Any) -> bd.results.Solution:
    """Simulate with the part added."""
    sandbox.mech.add(part)
    return sandbox.run()


def run_with_law(sandbox: Sandbox, law: Any) -> bd.results.Solution:
    """Simulate with a moment that follows the law."""
    return run_with_part(sandbox, bd.Moment("torque", sandbox.bar.at(*KNEE), law))


def run_with_curve(sandbox: Sandbox, curve: Any) -> bd.results.Solution:
    """Simulate with a beam along the curve."""
    sandbox.falling(curve=curve)
    return sandbox.run()


def run_with_section(sandbox: Sandbox, section: Any) -> bd.results.Solution:
    """Simulate with a beam of the section."""
    sandbox.falling(section=section)
    return sandbox.run()


def run_with_observable(sandbox: Sandbox, quantity: Any) -> bd.results.Solution:
    """Simulate with the quantity observed."""
    sandbox.mech.observe("watched", quantity)
    return sandbox.run()


def run_with_mass_at(sandbox: Sandbox, attachment: Any) -> bd.results.Solution:
    """Simulate with a point mass on the attachment."""
    return run_with_part(sandbox, bd.PointMass("mass", 0.1, on=attachment))


def run_with_integrator(sandbox: Sandbox, integrator: Any) -> bd.results.Solution:
    """Simulate with the integrator."""
    return bd.simulate(sandbox.mech, integrator, T_END, OUTPUT_STEP)


def run_study(sandbox: Sandbox, study: Any) -> Any:
    """Run the study in this process and return its table of cases."""
    return study_execution.run_study(study, sandbox.folder, SerialPool()).table
