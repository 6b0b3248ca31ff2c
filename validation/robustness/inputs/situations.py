"""Unphysical or inconsistent models: laws, curves, starts, joints, units and studies."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np
from robustness.inputs.bad_input import BadInput
from robustness.inputs.sandbox import (
    INTEGRATORS,
    KNEE,
    Sandbox,
    run_study,
    run_with_curve,
    run_with_law,
)

import beamdae as bd

# Laws with poles, jumps, values that are not real from some time on, or unbounded growth. Runs end
# at 0.01 s.
LAWS: dict[str, Callable[[Any], Any]] = {
    "pole at the start": lambda t: 1.0 / t,
    "pole at 5 ms": lambda t: 1.0 / (t - 0.005),
    "even pole at 5 ms": lambda t: 1.0 / (t - 0.005) ** 2,
    "logarithm of zero": lambda t: np.log(t),
    "logarithm that ends": lambda t: np.log(0.005 - t),
    "root that ends": lambda t: np.sqrt(0.005 - t),
    "root of a negative number": lambda t: np.sqrt(-1.0 - t),
    "power that ends": lambda t: (0.005 - t) ** 0.3,
    "arc sine that ends": lambda t: np.arcsin(200.0 * t),
    "tangent": lambda t: np.tan(300.0 * t),
    "exp(1e5 t)": lambda t: np.exp(1e5 * t),
    "exp(exp)": lambda t: np.exp(np.exp(1e3 * t)),
    "1e300": lambda t: 1e300,
    "1e300 t": lambda t: 1e300 * t,
    "t**200 from the start": lambda t: (1e3 * t) ** 200,
    "noise": lambda t: np.sin(1e12 * t),
    "fast and large": lambda t: 1e9 * np.sin(1e6 * t),
    "if": lambda t: 1.0 if t < 0.005 else 0.0,
    "where": lambda t: np.where(t < 0.005, 1.0, 0.0),
    "sign": lambda t: np.sign(t - 0.005),
    "abs": lambda t: abs(t - 0.005),
    "floor": lambda t: np.floor(1e3 * t),
    "heaviside": lambda t: np.heaviside(t - 0.005, 0.0),
    "interpolated": lambda t: np.interp(t, [0.0, 1.0], [0.0, 1.0]),
    "math": lambda t: math.sin(t),
    "float of t": lambda t: float(t),
    "int of t": lambda t: int(t),
    "comparison": lambda t: t < 0.005,
    "complex": lambda t: 1j * t,
    "text": lambda t: "much",
    "list": lambda t: [t],
    "pair": lambda t: (t, t),
    "array": lambda t: np.array([1.0, 2.0]),
    "vector": lambda t: ca.vertcat(t, t),
    "foreign symbol": lambda t: t * ca.SX.sym("x"),
    "MX": lambda t: ca.MX.sym("x"),
    "nan": lambda t: math.nan * t,
    "nothing": lambda t: None,
    "error": lambda t: {}["no such key"],
    "recursion": lambda t: _recurse_forever(t),
    "stop": lambda t: _raise(StopIteration()),
}


def _recurse_forever(t: Any) -> Any:
    return _recurse_forever(t)


def _raise(problem: BaseException) -> Any:
    raise problem


CURVES: dict[str, Callable[[Sandbox], Any]] = {
    "function with a pole": lambda box: bd.Curve(lambda x: 1.0 / (x - 0.5), (0.0, 1.0)),
    "function with a jump": lambda box: bd.Curve(lambda x: float(x > 0.5), (0.0, 1.0)),
    "function with a kink": lambda box: bd.Curve(lambda x: abs(x - 0.5), (0.0, 1.0)),
    "function of noise": lambda box: bd.Curve(lambda x: math.sin(1e6 * x), (0.0, 1.0)),
    "vertical tangent": lambda box: bd.Curve(lambda x: math.sqrt(x), (0.0, 1.0)),
    "huge values": lambda box: bd.Curve(lambda x: 1e200 * x * x, (0.0, 1.0)),
    "tiny interval": lambda box: bd.Curve(lambda x: x * x, (0.0, 1e-300)),
    "interval backwards": lambda box: bd.Curve(lambda x: x * x, (1.0, 0.0)),
    "complex function": lambda box: bd.Curve(lambda x: (x - 0.5) ** 0.5, (0.0, 1.0)),
    "points in one place": lambda box: bd.Curve(points=[(0.0, 0.0)] * 5),
    "points back and forth": lambda box: bd.Curve(points=[(0, 0), (1, 0), (0.5, 0), (2, 0)]),
    "points near each other": lambda box: bd.Curve(
        points=[(0, 0), (1, 0), (1 + 1e-15, 0), (2, 0), (3, 1)]
    ),
    "huge points": lambda box: bd.Curve(points=[(0, 0), (1e200, 0), (2e200, 1e200), (3e200, 0)]),
    "points of text": lambda box: bd.Curve(points=["ab", "cd", "ef", "gh"]),
    "closed loop": lambda box: bd.Arc(1.0, 2.0 * math.pi, (0.0, 1.0)),
    "very tight arc": lambda box: bd.Arc(1e-9, 1e-9, (0.0, 1.0)),
    "arc far away": lambda box: bd.Arc(1.0, 1.0, (1e15, 1e15)),
    "line far away": lambda box: bd.Line((1e16, 0.0), (1e16 + 2.0, 0.0)),
    "high parabola": lambda box: bd.Parabola(1.0, 1e9, (0.0, 1.0)),
    "segment of nothing": lambda box: bd.Segment(bd.Arc(1.0, 1.0), 0.5, 0.5 + 1e-17),
    "own curve without a length": lambda box: _UserCurve(math.nan),
    "own curve of length zero": lambda box: _UserCurve(0.0),
    "own curve that fails": lambda box: _UserCurve(1.0),
}


class _UserCurve:
    """User's curve class whose methods return None, NaN or a constant point."""

    def __init__(self, length: float) -> None:
        self.length = length

    def point(self, s: Any) -> Any:
        return np.zeros((*np.shape(s), 2)) if self.length == 1.0 else None

    def tangent_angle(self, s: Any) -> Any:
        return np.full(np.shape(s), np.nan)

    def curvature(self, s: Any) -> Any:
        return np.zeros(np.shape(s))


Situation = Callable[[Sandbox], Any]


def _run_system(sandbox: Sandbox, **changed: Any) -> bd.results.Solution:
    return sandbox.run(bd.ConstrainedSystem(**sandbox.circle | changed))


def _run_with_parts(sandbox: Sandbox, *joints: Any) -> bd.results.Solution:
    for joint in joints:
        sandbox.mech.add(joint)
    return sandbox.run()


def _hinge_points(box: Sandbox) -> tuple[bd.results.Attachment, bd.results.Attachment]:
    return box.mech.ground.at(0.0, 0.0), box.bar.at(0.0, 0.0)


STARTS: dict[str, Situation] = {
    "far from the circle": lambda box: _run_system(box, q0=[1e6, 0.0]),
    "at its center": lambda box: _run_system(box, q0=[0.0, 0.0]),
    "on no circle": lambda box: _run_system(
        box, constraints=ca.dot(box.symbols[1], box.symbols[1]) + 1.0
    ),
    "velocity off the circle": lambda box: _run_system(box, v0=[1e6, 0.0]),
    "massless": lambda box: _run_system(box, mass=[0.0, 0.0]),
    "massless along one": lambda box: _run_system(box, mass=[1.0, 0.0], constraints=None),
    "negative mass": lambda box: _run_system(box, mass=[-1.0, 1.0]),
    "mass that is no number": lambda box: _run_system(box, mass=[math.nan, 1.0]),
    "skew mass": lambda box: _run_system(box, mass=[[0.0, 1.0], [-1.0, 0.0]]),
    "force that is no number at the start": lambda box: _run_system(
        box, force=ca.vertcat(0.0, 1.0 / box.symbols[1][1])
    ),
    "force that grows without bound": lambda box: _run_system(box, force=1e12 * box.symbols[1]),
    "constraint that is no number": lambda box: _run_system(
        box, constraints=ca.sqrt(box.symbols[1][0] - 2)
    ),
    "constraint of nothing": lambda box: _run_system(box, constraints=ca.SX(0)),
    "constraint that cannot hold": lambda box: _run_system(box, constraints=ca.SX(1)),
    "constraint twice": lambda box: _run_system(
        box, constraints=ca.vertcat(box.symbols[1][0] - 1.0, 2.0 * box.symbols[1][0] - 2.0)
    ),
    "more constraints than coordinates": lambda box: _run_system(
        box, constraints=ca.vertcat(box.symbols[1], box.symbols[1][0])
    ),
    "constraint on velocities": lambda box: _run_system(box, constraints=box.symbols[2][0]),
    "constraint with a kink": lambda box: _run_system(box, constraints=ca.fabs(box.symbols[1][1])),
    "spin of 1e9": lambda box: _run_with_parts(
        box, bd.RigidBody("top", 1.0, 0.1, (3, 0), (0, 0), 1e9)
    ),
    "velocity of 1e9": lambda box: _run_with_parts(
        box, bd.RigidBody("shot", 1.0, 0.1, (3, 0), (1e9, 0))
    ),
    "beam that spins at 1e6": lambda box: _run_with_parts(
        box, bd.Beam("rotor", bd.Line((0, 2), (1, 2)), box.section, 1, angular_velocity=1e6)
    ),
}

JOINTS: dict[str, Situation] = {
    "hinge twice": lambda box: _run_with_parts(box, bd.Revolute("again", *_hinge_points(box))),
    "hinge and weld": lambda box: _run_with_parts(box, bd.Weld("weld", *_hinge_points(box))),
    "two drivers": lambda box: _run_with_parts(
        box,
        bd.Driver("motor", *_hinge_points(box), 0.0),
        bd.Driver("second", *_hinge_points(box), 0.0),
    ),
    "two drivers that disagree": lambda box: _run_with_parts(
        box,
        bd.Driver("motor", *_hinge_points(box), lambda t: t),
        bd.Driver("second", *_hinge_points(box), lambda t: -t),
    ),
    "driver that jumps": lambda box: _run_with_parts(
        box, bd.Driver("motor", *_hinge_points(box), bd.piecewise((0.005, 0.0), 1.0))
    ),
    "driver whose speed jumps": lambda box: _run_with_parts(
        box,
        bd.Driver("motor", *_hinge_points(box), bd.piecewise((0.005, 0.0), lambda t: t - 0.005)),
    ),
    "driver that begins elsewhere": lambda box: _run_with_parts(
        box, bd.Driver("motor", *_hinge_points(box), 3.0)
    ),
    "driver of a million turns": lambda box: _run_with_parts(
        box, bd.Driver("motor", *_hinge_points(box), lambda t: 1e9 * t)
    ),
    "line along the bar": lambda box: _run_with_parts(
        box, bd.PointOnLine("guide", box.mech.ground.at(*KNEE), box.bar.at(*KNEE), (1.0, 0.0))
    ),
    "line across the bar": lambda box: _run_with_parts(
        box, bd.PointOnLine("guide", box.mech.ground.at(*KNEE), box.bar.at(*KNEE), (0.0, 1.0))
    ),
    "held at three points": lambda box: _run_with_parts(
        box,
        *(
            bd.Revolute(f"pin {k}", box.mech.ground.at(k, 0.0), box.bar.at(k, 0.0))
            for k in (0.5, 1.0)
        ),
    ),
    "open": lambda box: _run_with_parts(
        box, bd.Revolute("far", box.mech.ground.at(3.0, 0.0), box.bar.at(*KNEE))
    ),
    "body with itself": lambda box: _run_with_parts(
        box, bd.Revolute("own", box.bar.at(0, 0), box.bar.at(0, 0))
    ),
    "particle welded": lambda box: _run_with_parts(
        box, bob := bd.PointMass("bob", 1.0, at=KNEE), bd.Weld("weld", box.bar.at(*KNEE), bob.point)
    ),
    "not added": lambda box: _run_with_parts(
        box, bd.Revolute("pin", box.bar.at(*KNEE), bd.RigidBody("post", 1.0, 0.1, KNEE).at(*KNEE))
    ),
    "added twice": lambda box: _run_with_parts(box, box.bar),
    "named like the ground": lambda box: _run_with_parts(box, bd.RigidBody("ground", 1.0, 0.1)),
    "nothing at all": lambda box: box.run(bd.Mechanism()),
    "nothing that moves": lambda box: _run_with_parts(
        box, bd.Driver("motor", *_hinge_points(box), 0.0)
    ),
    "massless body on a spring of nothing": lambda box: _run_with_parts(
        box, bd.PointMass("dust", 1e-300, at=(2.0, 0.0))
    ),
    "two million observables' name": lambda box: (
        box.mech.observe("o" * 2_000_000, box.bar.at(0, 0)) or box.run()
    ),
}


def _run_in_units(sandbox: Sandbox, length: float, mass: float, time: float) -> bd.results.Solution:
    """Simulate a hinged beam with all quantities in other units of length, mass and time."""
    E, rho = 2.1e11 * mass / (length * time**2), 7850.0 * mass / length**3
    section = bd.Section.rectangle(bd.Material(E, 0.3, rho), 0.02 * length, 0.004 * length)
    mech = bd.Mechanism(gravity=(0.0, -9.81 * length / time**2))
    beam = mech.add(bd.Beam("beam", bd.Arc(length, length), section, elements=1))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return bd.simulate(mech, sandbox.integrator, 0.01 * time, 0.002 * time)


def _run_study_of(sandbox: Sandbox, cases: Any, **settings: Any) -> Any:
    study = bd.results.Study("few", tuple(cases), t_end=0.01, output_step=0.002, **settings)
    return run_study(sandbox, study)


STUDIES: dict[str, Situation] = {
    "unknown parameter": lambda box: _run_study_of(box, [box.case(weight=1.0)]),
    "mistyped value": lambda box: _run_study_of(box, [box.case(mass="heavy")]),
    "bad value": lambda box: _run_study_of(box, [box.case(mass=-1.0)]),
    "all cases fail": lambda box: _run_study_of(box, [box.case(mass=-1.0), box.case(mass=0.0)]),
    "the same case twice": lambda box: _run_study_of(box, [box.case(mass=2.0), box.case(mass=2.0)]),
    "unknown column": lambda box: _run_study_of(box, [box.case()], columns=("bob.z [m]",)),
    "one reference": lambda box: _run_study_of(box, [box.case()], references=(bd.Radau(),)),
    "references of one kind": lambda box: _run_study_of(
        box, [box.case()], references=(bd.Radau(), bd.Radau(1e-3))
    ),
    "over a parameter no case gives": lambda box: _run_study_of(box, [box.case()], over="spin"),
    "over a text": lambda box: _run_study_of(box, [box.case(name="a")], over="name"),
    "one mesh": lambda box: _run_study_of(box, [box.case(spin=1)], over="spin"),
    "grid of numbers": lambda box: bd.grid(mass=1.0),
    "grid of nothing": lambda box: _run_study_of(
        box, [box.case(**row) for row in bd.grid(mass=[])]
    ),
    "grid that does not end": lambda box: [bd.grid(mass=iter(lambda: 1.0, 2.0))],
    "name with separators": lambda box: run_study(
        box, bd.results.Study("a/../../b", (box.case(),))
    ),
    "compare nothing": lambda box: bd.compare([]),
    "compare one that fails": lambda box: bd.compare([box.case(mass=-1.0)]),
    "reference that fails": lambda box: bd.compare([box.case()], reference=box.case(mass=-1.0)),
    "unknown column to compare": lambda box: bd.compare(
        [box.case()], reference=box.case(), columns=["none"]
    ),
}
# Names that a refusal may contain, besides those of the sandbox.
_SITUATION_WORDS = (
    *("Curve", "Line", "Arc", "Parabola", "Segment", "ConstrainedSystem", "Mechanism", "ground"),
    *("q0", "q1", "system", "constraint", "law", "torque", "beam", "rotor", "top", "shot", "dust"),
    *("study", "again", "own", "far", "pin", "swing", "bob", "few", "grid", "compare", "simulate"),
)
_UNITS = ("length", "mass", "time")
_UNIT_EXPONENTS = (-12, -9, -6, -3, 3, 6, 9, 12)  # powers of ten of a unit


def situation_inputs() -> Iterator[BadInput]:
    """Yield studies once, and all other models by each integrator."""
    for integrator in range(len(INTEGRATORS)):
        for name, law in LAWS.items():
            yield _make_input("law", name, lambda box, law=law: run_with_law(box, law), integrator)
        for place, situations in (("start", STARTS), ("joint", JOINTS)):
            for name, situation in situations.items():
                yield _make_input(place, name, situation, integrator)
        for name, curve in CURVES.items():
            yield _make_input(
                "curve", name, lambda box, curve=curve: run_with_curve(box, curve(box)), integrator
            )
        for exponent in _UNIT_EXPONENTS:
            for unit in range(len(_UNITS)):
                units = [1.0] * len(_UNITS)
                units[unit] = 10.0**exponent
                name = f"unit of {_UNITS[unit]} of 1e{exponent}"
                yield _make_input(
                    "scale", name, lambda box, units=units: _run_in_units(box, *units), integrator
                )
    for name, situation in STUDIES.items():
        yield _make_input("study of", name, situation, 0)


def _make_input(place: str, name: str, situation: Situation, integrator: int) -> BadInput:
    def attempt(words: set[str]) -> Any:
        sandbox = Sandbox(integrator)
        try:
            return situation(sandbox)
        finally:
            words |= sandbox.names

    where = place if place == "study of" else f"{place} by {INTEGRATORS[integrator]().label}"
    return BadInput(where, name, attempt, _SITUATION_WORDS)
