"""Errors of parts, laws and tables: one row a sentence, with a call that causes it.

Arguments of wrong types and signs have sentences in `tests/test_sentences.py`.
"""

import re

import casadi as ca
import numpy as np
import pytest
from mechanisms import rectangle

import beamdae as bd

BODY, WHEEL = bd.RigidBody("body", 1.0, 1.0), bd.RigidBody("wheel", 1.0, 0.1, center=(0.0, 1.0))
ON, FAR, HUB = BODY.at(0.0, 0.0), BODY.at(1.0, 0.0), WHEEL.at(0.0, 1.0)
BOB = bd.PointMass("bob", 1.0, at=(1.0, 0.0))
GROUND = bd.Mechanism().ground
ORIGIN = GROUND.at(0.0, 0.0)
FLOOR = bd.LineSurface(ORIGIN)
PIN, LINE = bd.Revolute("pin", ORIGIN, ON), bd.PointOnLine("line", ORIGIN, ON)
STRIP = rectangle(0.01, 0.01)
BEAM = bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), STRIP, elements=2)
X, Y = [-0.4, 0.1, 0.7, 1.5], [2.0, -1.0, 0.2, 2.5]
GRID = bd.table((X, X), np.outer(Y, Y))
polygon, rod = bd.RigidBody.polygon, bd.RigidBody.rod


def push(law, on=ON):
    return bd.ForceLaw("f", on, law)


def pull(law, **settings):
    return bd.Spring("s", ON, BOB.point, law=law, **settings)


def touch(**settings):
    return bd.Contact("c", BOB.point, FLOOR, 1.0, **settings)


def rub(joint, *settings, **more):
    return bd.Friction("f", joint, 0.1, 1e-3, *settings, **more)


def load(law):
    return bd.Moment("motor", ON, law)


def mechanism_with(*parts):
    mech = bd.Mechanism()
    for part in parts:
        mech.add(part)
    return mech


def signal():
    mech = bd.Mechanism()
    return mech, mech.input("value")


def pid(*gains, **settings):
    return bd.pid(*signal()[:1], "servo", 1.0, *gains, **settings)


def unknown_rate():
    mech, error = signal()
    bd.pid(mech, "servo", error, 1.0, kd=1.0, rate=error + ca.SX.sym("other"))


def driven_twice():
    mech, value = signal()
    mech.add(bd.Controller("first", 0.1, [], value, lambda sample: 0.0))
    mech.add(bd.Controller("second", 0.1, [], value, lambda sample: 0.0))


def state_without_rate():
    mech = mechanism_with(BOB)
    mech.state("x")
    bd.equations_of_motion(mech)


def law_of_another_mechanism():
    mech = mechanism_with(BODY)
    mech.add(load(signal()[1]))
    bd.equations_of_motion(mech)


SENTENCES = {
    # Bodies and mechanisms
    r"^bob: pass either on= \(an attachment\) or at=\(x, y\)": lambda: bd.PointMass("bob", 1.0),
    r"^bob: a mass on body at \(0, 0\) has no velocity of its own": lambda: bd.PointMass(
        "bob", 1.0, on=ON, velocity=(1.0, 0.0)
    ),
    "^r: a and b must differ": lambda: rod("r", (0, 0), (0, 0), mass=1.0),
    "^r: pass either mass=, or both density= and area=": lambda: rod("r", (0, 0), (1, 0)),
    "^d: a shape accepts only velocity and angular_velocity .*, got inertia": lambda: (
        bd.RigidBody.disk("d", (0, 0), 1.0, mass=1.0, inertia=1.0)
    ),
    "^p: points must be at least 3 pairs": lambda: polygon("p", [(0, 0), (1, 0)], mass=1.0),
    r"^p: points must enclose an area, got 0 m\^2": lambda: polygon(
        "p", [(0, 0), (1, 0), (2, 0)], mass=1.0
    ),
    "^p: the edges that begin at .* meet; list the points in order around": lambda: polygon(
        "p", [(0, 0), (2, 2), (2, 0), (0, 1)], mass=1.0
    ),
    r"^p: the point \(2, 0\) m is repeated": lambda: polygon(
        "p", [(0, 0), (2, 0), (2, 0), (0, 1)], mass=1.0
    ),
    "'ground' is reserved for the fixed ground": lambda: mechanism_with(GROUND),
    "^Mechanism: only parts .subclasses of beamdae.Part. can be added": lambda: mechanism_with(3),
    "the name 'body' is in use": lambda: mechanism_with(BODY, BODY),
    "^twist: 'body' is not part": lambda: mechanism_with(bd.Moment("twist", ON, 1.0)),
    "^pin: the ground belongs to another mechanism": lambda: mechanism_with(BODY, PIN),
    "there is no body that can move": lambda: bd.equations_of_motion(bd.Mechanism()),
    r"no part 'bodi' \(did you mean 'body'\?\)": lambda: mechanism_with(BODY).part("bodi"),
    r"there is no part 'zzz'; see mechanism.parts": lambda: bd.Mechanism().part("zzz"),
    "the observable name 't' is reserved for the time": lambda: mechanism_with(BODY).observe(
        "t", ON
    ),
    "^rim: only attachments, quantities such as .* body: its .at": lambda: mechanism_with(
        BODY
    ).observe("rim", BODY),
    "^force: the joint 'pin' is not part of this mechanism": lambda: bd.Mechanism().observe(
        "force", PIN.reaction
    ),
    r"^push: on must .*; pass a point of body: its \.at\(x, y\)\.": lambda: bd.Force(
        "push", BODY, (1.0, 0.0)
    ),
    r"^push: on must .*; pass a point of bob: its \.point, if it is free\.": lambda: bd.Force(
        "push", BOB, (1.0, 0.0)
    ),
    r"^push: on must .*; pass a point of beam: its \.start, \.end or \.at": lambda: bd.Force(
        "push", BEAM, (1.0, 0.0)
    ),
    r"^push: on must .*; pass a point of it: mech\.ground\.at": lambda: bd.Force(
        "push", bd.Mechanism(), (1.0, 0.0)
    ),
    # Joints
    r"^pin: the two points must coincide .* body at \(1, 0\) and .* are 1.41\d* m apart": lambda: (
        bd.Revolute("pin", FAR, HUB)
    ),
    r"^slot: the point must lie on the line .* is 1 m off the line through ground": lambda: (
        bd.PointOnLine("slot", ORIGIN, HUB)
    ),
    "^pin: a joint must connect two different bodies, but both .* belong to 'body'": lambda: (
        bd.Revolute("pin", ON, ON)
    ),
    "^motor: law= is missing; pass the angle": lambda: bd.Driver("motor", ORIGIN, ON),
    "^motor: law= is missing; pass the travel": lambda: bd.TranslationalDriver("motor", ORIGIN, ON),
    "^rail: direction must not be zero": lambda: bd.Prismatic("rail", ORIGIN, ON, (0.0, 0.0)),
    r"^w: bob at \(1, 0\) is a particle without an angle": lambda: bd.Weld("w", FAR, BOB.point),
    "^link: .* coincide in the reference .* join the points by a Revolute": lambda: bd.Distance(
        "link", ORIGIN, ON
    ),
    r"length must equal the distance .* \(1 m\) or be a time law, got 2.9 m": lambda: bd.Distance(
        "link", ORIGIN, BOB.point, length=2.9
    ),
    "^link: length at t = 0 must be positive, got -1": lambda: bd.Distance(
        "link", ORIGIN, BOB.point, lambda t: t - 1.0
    ),
    "^gear: ratio must not be zero": lambda: bd.Gear("gear", ORIGIN, ON, 0.0),
    "^gear: the carrier must be a body other than the wheels": lambda: bd.Gear(
        "gear", ORIGIN, ON, 2.0, carrier=FAR
    ),
    "^rack: radius must not be zero": lambda: bd.RackAndPinion("rack", ON, ORIGIN, 0.0),
    "^pin: place must be .*'a', 'b'": lambda: PIN.reaction_on("c"),
    "^r: the disk must touch the line .* is 1 m off .* radius is 0.9 m": lambda: bd.RollingOnLine(
        "r", ORIGIN, HUB, 0.9
    ),
    "^r: the disk must touch the circle .* neither the sum nor the difference": lambda: (
        bd.RollingOnCircle("r", ORIGIN, HUB, (0.5, 0.4))
    ),
    r"^s: ground at \(0, 0\) belongs to the ground": lambda: bd.Skate("s", ORIGIN),
    # Loads
    "^push: bob .* is a particle without an angle": lambda: (
        bd.Force("push", BOB.point, (1.0, 0.0)).moment
    ),
    r"^s: .* coincide in the reference configuration.*Bushing": lambda: bd.Spring(
        "s", FAR, BOB.point, 1.0, free_length=1.0
    ),
    r"^s: neither ground at \(0, 0\) nor ground at \(1, 0\) can move; attach one of": lambda: (
        bd.Spring("s", ORIGIN, GROUND.at(1, 0), 1.0)
    ),
    "^s: give either a law or": lambda: pull(lambda x, r: x, stiffness=1.0),
    "^s: energy requires law=": lambda: bd.Spring("s", ON, BOB.point, 1.0, energy=lambda x: x),
    "^s: law must be a formula .*the call failed": lambda: pull(lambda x: x),
    "^s: law must return one number": lambda: pull(lambda x, r: (x, r)),
    r"^s: law must be a formula without branches on .* use np.maximum\(x, 0.0\)": lambda: pull(
        lambda x, r: x if x > 0 else 0.0
    ),
    r"^s: law must be continuous, but uses np.sign; .*np.tanh\(x / scale\)": lambda: pull(
        lambda x, r: np.sign(x)
    ),
    "^s: the derivative of energy must equal law at zero rate, but at .* the values": lambda: pull(
        lambda x, r: x, energy=lambda x: x**2
    ),
    "^s: law must return 3 numbers": lambda: bd.Bushing("s", ON, BEAM.end, law=lambda x, r: x[0]),
    "^s: the derivative of energy must equal law .* the values of entry 3 are 0": lambda: (
        bd.Bushing(
            "s",
            ON,
            BEAM.end,
            law=lambda x, rate: (x[0], 0.0, 3.0 * x[2]),
            energy=lambda x: 0.5 * x[0] ** 2,
        )
    ),
    "^f: none of the attachments can move": lambda: push(lambda a, t: (0, 0), on=ORIGIN),
    r"^f: each load returned by law must be \(Fx, Fy\)": lambda: push(lambda a, t: 1.0),
    "^f: law must return 2 numbers": lambda: push(lambda a, t: ("up", 0.0)),
    "^f: law must return a list of 2 loads": lambda: push(
        lambda a, b, t: (1.0, 2.0, 3.0), on=(ON, BOB.point)
    ),
    r"^f: bob at .* is a particle .*; law must return \(Fx, Fy\)": lambda: push(
        lambda a, t: (0.0, 0.0, 1.0), on=BOB.point
    ),
    "^f: law must be continuous, but uses <, np.where; use np.maximum": lambda: push(
        lambda a, t: (np.where(a.rate > 0, 1.0, 0.0), 0.0)
    ),
    "^f: law must be a formula without conversions of rate to a number .* such as np.sin": lambda: (
        push(lambda a, t: (float(a.rate), 0.0))
    ),
    "^f: law must be a formula .* do not match. Use vectors of equal length": lambda: push(
        lambda a, t: a.velocity @ ca.vertcat(1.0, 2.0) * t
    ),
    "^f: energy must depend only on positions and angles": lambda: bd.ForceLaw(
        "f", ON, lambda a, t: (0, 0), energy=lambda a: a.rate
    ),
    "a table with outside='repeat'.$": lambda: push(lambda a, t: (np.mod(a.position[0], 1.0), 0.0)),
    "^f: friction in pin requires radius= .radius of the bear": lambda: rub(PIN),
    "^f: radius does not apply to line": lambda: rub(LINE, radius=1.0),
    "^f: static and stribeck must be given together": lambda: rub(LINE, 0.2),
    "^f: static must be at least coefficient, .* got 0.05 and 0.1": lambda: rub(LINE, 0.05, 0.1),
    "^f: joint must be a rotating or sliding joint .* got Weld": lambda: rub(
        bd.Weld("w", ORIGIN, ON)
    ),
    "'line' is not part": lambda: mechanism_with(BODY, rub(LINE)),
    "^c: neither the point nor the surface can move": lambda: bd.Contact("c", ORIGIN, FLOOR, 1.0),
    r"^c: exponent must lie in \[1, 10\], got": lambda: touch(exponent=0.5),
    r"^c: restitution must lie in \[0.05, 1\], got 1.2": lambda: touch(
        restitution=1.2, impact_speed=1.0
    ),
    "^c: restitution=0.5 requires impact_speed=": lambda: touch(restitution=0.5),
    "^c: .*friction must be positive, got 0.4 and 0": lambda: touch(
        friction=0.0, friction_speed=0.1, static=0.4, stribeck=0.1
    ),
    # Time laws
    "^motor: the law must be a formula in t .* positional argument": lambda: load(lambda: 1.0),
    "^motor: the law must be finite, got inf at t = 0": lambda: load(lambda t: 1.0 / t),
    "^motor: the law must be smooth, but uses np.abs; .*piecewise": lambda: load(
        lambda t: np.abs(t - 1.0)
    ),
    "^piecewise: .* give at least one law": lambda: bd.piecewise(),
    r"^piecewise: .* a pair \(end time, law\), got 1.0": lambda: bd.piecewise(1.0, 2.0),
    r"^piecewise: end times must ascend, got \[2.0, 1.0\]": lambda: bd.piecewise(
        (2.0, 1.0), (1.0, 2.0), 0.0
    ),
    "^piecewise: the law must be finite, got inf at t = 1": lambda: bd.piecewise(
        (1.0, 2.0), lambda t: 1.0 / (t - 1.0)
    ),
    "1 pieces require 0 breakpoints, got 1": lambda: bd.results.Law((lambda t: t,), (1.0,)),
    r"use law\.at\(t\) for its value at a number t": lambda: bd.run_up(1.0, 2.0)(2.0),
    # Tables
    "the first and last values must be equal, got 2 and 2.5; end the table": lambda: bd.table(
        X, Y, outside="repeat"
    ),
    "^motor: table is repeated and linear, so that a law of time would have": lambda: load(
        bd.table([0, 1, 2], [0, 1, 0], "linear", outside="repeat")
    ),
    "^table: outside='repeat' is not defined for kind='previous'; repeat the rows": lambda: (
        bd.table([0, 1, 2], [0, 1, 0], "previous", outside="repeat")
    ),
    "^table: kind='previous' jumps at the rows, where integrators stop only in time": lambda: push(
        lambda a, t: (bd.table(X, Y, "previous")(a.position[0]), 0.0)
    ),
    "^table: kind='previous' is not defined for two arguments; use 'linear'": lambda: bd.table(
        (X, X), np.outer(Y, Y), "previous"
    ),
    "^table: x must have at least 3 entries for kind='spline', got 2": lambda: bd.table(
        [0.0, 1.0], [1.0, 2.0]
    ),
    "^table: x and y must be lists of the same length, got 3 and 2": lambda: bd.table(
        [0.0, 1.0, 2.0], [1.0, 2.0]
    ),
    "^table: x must ascend, but 1 is followed by 1": lambda: bd.table([0.0, 1.0, 1.0], [1, 2, 3]),
    "^table: x must be a list of numbers or a pair of lists": lambda: bd.table(3.0, Y),
    "y must have 4 rows of 4 values": lambda: bd.table((X, X), np.outer(Y, Y[:3])),
    r"^table: the table has 1 argument \(x\), got 2": lambda: bd.table(X, Y)(1.0, 2.0),
    "arguments must be numbers, arrays or symbols": lambda: bd.table(X, Y)("far"),
    "^motor: .* each argument of table must be a t \\+ b": lambda: load(
        lambda t: bd.table(X, Y)(t**2)
    ),
    "^motor: table has two arguments and is no time law": lambda: load(GRID),
    "^pad: x = 3 leaves the range 1 to 2 of pad": lambda: bd.table(
        [1.0, 2.0], [0.0, 1.0], "linear", "error", "pad"
    )(3.0),
    "^pad: outside='error' requires": lambda: bd.table(
        [1.0, 2.0], [0.0, 1.0], "linear", "error", "pad"
    )(ca.SX.sym("x")),
    r"the path 'a\\x1b\\n\\x00' is too long or con": lambda: bd.table_from_csv("a\x1b\n\0"),
    "'no.csv' cannot be read: No such file": lambda: bd.table_from_csv("no.csv"),
    # Signals, states and controllers
    "'value' is already driven": driven_twice,
    "^second: drives must be inputs": lambda: bd.Controller(
        "second", 0.1, [], [BOB.point], lambda sample: 0.0
    ),
    "cannot read the reaction of a joint": lambda: mechanism_with(
        BODY, bd.Controller("c", 0.1, PIN.reaction, signal()[1], lambda sample: 0.0)
    ),
    "^x: the state has no rate": state_without_rate,
    "^value: the input is not part of this mechanism": law_of_another_mechanism,
    "the name 'value' is in use": lambda: signal()[0].input("value"),
    "there is no input 'valeu'": lambda: bd.simulate(
        mechanism_with(BOB), t_end=1.0, inputs={"valeu": 1.0}
    ),
    "degree of the numerator must not exceed": lambda: bd.transfer_function(
        signal()[0], "filter", 1.0, [1.0, 0.0], [1.0]
    ),
    "^filter: the coefficients divided by the first": lambda: bd.transfer_function(
        signal()[0], "filter", 1.0, [1.0], [1e-308, 1.0]
    ),
    "the derivative requires rate= or filter_time=": lambda: pid(1.0, kd=1.0),
    "^servo: rate must be a number or a formula of inputs, sensors and states": unknown_rate,
    "limits must ascend": lambda: pid(1.0, ki=1.0, limits=(1.0, 0.0)),
    "tracking_time has no default with limits, kp = 0 ": lambda: pid(
        0.0, ki=1.0, limits=(0.0, 1.0)
    ),
    # Observed motion
    "^relative_displacement: bob .* without an angle": lambda: bd.relative_displacement(
        BOB.point, ON
    ),
    "^beam: deformation at s = 1 m has no transverse .* use deflection": lambda: bd.Beam(
        "beam", BEAM.curve, STRIP, frame="chord"
    ).deformation(1.0),
}


def test_errors_of_parts_are_one_sentence():
    for sentence, call in SENTENCES.items():
        with pytest.raises(bd.BeamdaeError, match=sentence) as caught:
            call()
        assert re.fullmatch(r".+\.", str(caught.value)), sentence
