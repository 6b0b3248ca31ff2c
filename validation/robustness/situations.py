"""Models that are wrong as a whole: by laws, curves, starts, joints, scales, studies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca

import beamdae as bd
from robustness.inputs import Input
from robustness.laws import CURVES, LAWS
from robustness.world import INTEGRATORS, KNEE, World, bent, done, loaded

Situation = Callable[[World], Any]


def _system(world: World, **changed: Any) -> bd.Solution:
    return world.run(bd.ConstrainedSystem(**world.circle | changed))


def _again(world: World, *joints: Any) -> bd.Solution:
    for joint in joints:
        world.mech.add(joint)
    return world.run()


def _origin(w: World) -> tuple[bd.Attachment, bd.Attachment]:
    return w.mech.ground.at(0.0, 0.0), w.bar.at(0.0, 0.0)


STARTS: dict[str, Situation] = {
    "far from the circle": lambda w: _system(w, q0=[1e6, 0.0]),
    "at its center": lambda w: _system(w, q0=[0.0, 0.0]),
    "on no circle": lambda w: _system(w, constraints=ca.dot(w.symbols[1], w.symbols[1]) + 1.0),
    "velocity off the circle": lambda w: _system(w, v0=[1e6, 0.0]),
    "massless": lambda w: _system(w, mass=[0.0, 0.0]),
    "massless along one": lambda w: _system(w, mass=[1.0, 0.0], constraints=None),
    "negative mass": lambda w: _system(w, mass=[-1.0, 1.0]),
    "mass that is no number": lambda w: _system(w, mass=[math.nan, 1.0]),
    "skew mass": lambda w: _system(w, mass=[[0.0, 1.0], [-1.0, 0.0]]),
    "force that is no number at the start": lambda w: _system(
        w, force=ca.vertcat(0.0, 1.0 / w.symbols[1][1])
    ),
    "force that grows without bound": lambda w: _system(w, force=1e12 * w.symbols[1]),
    "constraint that is no number": lambda w: _system(w, constraints=ca.sqrt(w.symbols[1][0] - 2)),
    "constraint of nothing": lambda w: _system(w, constraints=ca.SX(0)),
    "constraint that cannot hold": lambda w: _system(w, constraints=ca.SX(1)),
    "constraint twice": lambda w: _system(
        w, constraints=ca.vertcat(w.symbols[1][0] - 1.0, 2.0 * w.symbols[1][0] - 2.0)
    ),
    "more constraints than coordinates": lambda w: _system(
        w, constraints=ca.vertcat(w.symbols[1], w.symbols[1][0])
    ),
    "constraint on velocities": lambda w: _system(w, constraints=w.symbols[2][0]),
    "constraint with a kink": lambda w: _system(w, constraints=ca.fabs(w.symbols[1][1])),
    "spin of 1e9": lambda w: _again(w, bd.RigidBody("top", 1.0, 0.1, (3, 0), (0, 0), 1e9)),
    "velocity of 1e9": lambda w: _again(w, bd.RigidBody("shot", 1.0, 0.1, (3, 0), (1e9, 0))),
    "beam that spins at 1e6": lambda w: _again(
        w, bd.Beam("rotor", bd.Line((0, 2), (1, 2)), w.section, 1, angular_velocity=1e6)
    ),
}

JOINTS: dict[str, Situation] = {
    "hinge twice": lambda w: _again(w, bd.Revolute("again", *_origin(w))),
    "hinge and weld": lambda w: _again(w, bd.Weld("weld", *_origin(w))),
    "two drivers": lambda w: _again(
        w, bd.Driver("motor", *_origin(w), 0.0), bd.Driver("second", *_origin(w), 0.0)
    ),
    "two drivers that disagree": lambda w: _again(
        w,
        bd.Driver("motor", *_origin(w), lambda t: t),
        bd.Driver("second", *_origin(w), lambda t: -t),
    ),
    "driver that jumps": lambda w: _again(
        w, bd.Driver("motor", *_origin(w), bd.piecewise((0.005, 0.0), 1.0))
    ),
    "driver whose speed jumps": lambda w: _again(
        w, bd.Driver("motor", *_origin(w), bd.piecewise((0.005, 0.0), lambda t: t - 0.005))
    ),
    "driver that begins elsewhere": lambda w: _again(w, bd.Driver("motor", *_origin(w), 3.0)),
    "driver of a million turns": lambda w: _again(
        w, bd.Driver("motor", *_origin(w), lambda t: 1e9 * t)
    ),
    "line along the bar": lambda w: _again(
        w, bd.PointOnLine("guide", w.mech.ground.at(*KNEE), w.bar.at(*KNEE), (1.0, 0.0))
    ),
    "line across the bar": lambda w: _again(
        w, bd.PointOnLine("guide", w.mech.ground.at(*KNEE), w.bar.at(*KNEE), (0.0, 1.0))
    ),
    "held at three points": lambda w: _again(
        w,
        *(bd.Revolute(f"pin {k}", w.mech.ground.at(k, 0.0), w.bar.at(k, 0.0)) for k in (0.5, 1.0)),
    ),
    "open": lambda w: _again(w, bd.Revolute("far", w.mech.ground.at(3.0, 0.0), w.bar.at(*KNEE))),
    "body with itself": lambda w: _again(w, bd.Revolute("own", w.bar.at(0, 0), w.bar.at(0, 0))),
    "particle welded": lambda w: _again(
        w, bob := bd.PointMass("bob", 1.0, at=KNEE), bd.Weld("weld", w.bar.at(*KNEE), bob.point)
    ),
    "not added": lambda w: _again(
        w, bd.Revolute("pin", w.bar.at(*KNEE), bd.RigidBody("post", 1.0, 0.1, KNEE).at(*KNEE))
    ),
    "added twice": lambda w: _again(w, w.bar),
    "named like the ground": lambda w: _again(w, bd.RigidBody("ground", 1.0, 0.1)),
    "nothing at all": lambda w: w.run(bd.Mechanism()),
    "nothing that moves": lambda w: _again(w, bd.Driver("motor", *_origin(w), 0.0)),
    "massless body on a spring of nothing": lambda w: _again(
        w, bd.PointMass("dust", 1e-300, at=(2.0, 0.0))
    ),
    "two million observables' name": lambda w: (
        w.mech.observe("o" * 2_000_000, w.bar.at(0, 0)) or w.run()
    ),
}


def _scaled(world: World, length: float, mass: float, time: float) -> bd.Solution:
    """The beam and a load on it in other units of length, mass and time."""
    E, rho = 2.1e11 * mass / (length * time**2), 7850.0 * mass / length**3
    section = bd.Section.rectangle(bd.Material(E, 0.3, rho), 0.02 * length, 0.004 * length)
    mech = bd.Mechanism(gravity=(0.0, -9.81 * length / time**2))
    beam = mech.add(bd.Beam("beam", bd.Arc(length, length), section, elements=1))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return bd.simulate(mech, world.integrator, 0.01 * time, 0.002 * time)


def _studied(world: World, cases: Any, **settings: Any) -> Any:
    study = bd.Study("few", tuple(cases), t_end=0.01, output_step=0.002, **settings)
    return done(world, study)


STUDIES: dict[str, Situation] = {
    "unknown parameter": lambda w: _studied(w, [w.case(weight=1.0)]),
    "mistyped value": lambda w: _studied(w, [w.case(mass="heavy")]),
    "bad value": lambda w: _studied(w, [w.case(mass=-1.0)]),
    "all cases fail": lambda w: _studied(w, [w.case(mass=-1.0), w.case(mass=0.0)]),
    "the same case twice": lambda w: _studied(w, [w.case(mass=2.0), w.case(mass=2.0)]),
    "unknown column": lambda w: _studied(w, [w.case()], columns=("bob.z [m]",)),
    "one reference": lambda w: _studied(w, [w.case()], references=(bd.Radau(),)),
    "references of one kind": lambda w: _studied(
        w, [w.case()], references=(bd.Radau(), bd.Radau(1e-3))
    ),
    "over a parameter no case gives": lambda w: _studied(w, [w.case()], over="spin"),
    "over a text": lambda w: _studied(w, [w.case(name="a")], over="name"),
    "one mesh": lambda w: _studied(w, [w.case(spin=1)], over="spin"),
    "grid of numbers": lambda w: bd.grid(mass=1.0),
    "grid of nothing": lambda w: _studied(w, [w.case(**row) for row in bd.grid(mass=[])]),
    "grid that does not end": lambda w: [bd.grid(mass=iter(lambda: 1.0, 2.0))],
    "name with separators": lambda w: done(w, bd.Study("a/../../b", (w.case(),))),
    "compare nothing": lambda w: bd.compare([]),
    "compare one that fails": lambda w: bd.compare([w.case(mass=-1.0)]),
    "reference that fails": lambda w: bd.compare([w.case()], reference=w.case(mass=-1.0)),
    "unknown column to compare": lambda w: bd.compare(
        [w.case()], reference=w.case(), columns=["none"]
    ),
}
# What these models are made of, beside what is in every world.
_WORDS = (
    *("Curve", "Line", "Arc", "Parabola", "Segment", "ConstrainedSystem", "Mechanism", "ground"),
    *("q0", "q1", "system", "constraint", "law", "torque", "beam", "rotor", "top", "shot", "dust"),
    *("study", "again", "own", "far", "pin", "swing", "bob", "few", "grid", "compare", "simulate"),
)
_HOPELESS = {"grid that does not end": "a listing without an end cannot be told from a long one"}


def situation_inputs() -> Iterator[Input]:
    """All of them; laws, starts and joints by each integrator."""
    for k in range(len(INTEGRATORS)):
        for name, law in LAWS.items():
            yield _input("law", name, lambda w, law=law: loaded(w, law), k)
        for place, situations in (("start", STARTS), ("joint", JOINTS)):
            for name, situation in situations.items():
                yield _input(place, name, situation, k)
        for name, curve in CURVES.items():
            yield _input("curve", name, lambda w, curve=curve: bent(w, curve(w)), k)
        for exponent in (-12, -9, -6, -3, 3, 6, 9, 12):
            for unit in range(3):
                units = [1.0, 1.0, 1.0]
                units[unit] = 10.0**exponent
                what = f"unit of {('length', 'mass', 'time')[unit]} of 1e{exponent}"
                yield _input("scale", what, lambda w, units=units: _scaled(w, *units), k)
    for name, situation in STUDIES.items():
        yield _input("study of", name, situation, 0)


def _input(place: str, name: str, situation: Situation, k: int) -> Input:
    def attempt(words: set[str]) -> Any:
        world = World(k)
        try:
            return situation(world)
        finally:
            words |= world.names

    where = place if place == "study of" else f"{place} by {INTEGRATORS[k]().label}"
    return Input(where, name, attempt, _WORDS, _HOPELESS.get(name, ""))
