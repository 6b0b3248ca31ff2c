"""Mechanisms with flexible beams that no default setting was chosen on.

Each function builds one mechanism in the geometry and size in which it is usually met.
"""

from __future__ import annotations

import numpy as np

import beamdae as bd
from tolerances.mechanisms import GRAVITY, STEEL, triangle_apex

SILICON = bd.Material(E=169e9, nu=0.22, rho=2330.0)
LEATHER = bd.Material(E=5e7, nu=0.4, rho=1000.0)
GLASS_FIBER = bd.Material(E=40e9, nu=0.3, rho=1900.0)


def _add_strip(
    mech: bd.Mechanism, name: str, start, end, height, damping, width=0.02, **settings
) -> bd.Beam:
    """Add a straight steel strip and observe the deflection of its middle."""
    section = bd.Section.rectangle(STEEL, width=width, height=height, damping=damping)
    beam = mech.add(bd.Beam(name, bd.Line(start, end), section, **{"elements": 2} | settings))
    _observe_bend(mech, beam, f"{name} bend")
    return beam


def _observe_bend(mech: bd.Mechanism, beam: bd.Beam, name: str = "bend") -> None:
    mech.observe(name, beam.deformation(0.5 * beam.length, axes="frame"))


def _hinge(mech: bd.Mechanism, name: str, *points: bd.Attachment) -> bd.Revolute:
    """Hinge the points, which coincide, to the first one; return the last joint."""
    first, *others = points
    joints = [mech.add(bd.Revolute(f"{name} {k}", first, p)) for k, p in enumerate(others)]
    return joints[-1]


def _add_rod(mech: bd.Mechanism, name: str, start, end, area=2e-4) -> bd.RigidBody:
    return mech.add(bd.RigidBody.rod(name, start, end, density=STEEL.rho, area=area))


@bd.model(t_end=5.0)
def tutorial_four_bar(stiffness=0.0, damping=1e-4, elements=4, formulation="floating frame"):
    """Four-bar of the tutorial; without the spring of `stiffness` [N/m] it swings freely."""
    mech = bd.Mechanism(gravity=GRAVITY)
    shaft, foot, pin = (0.0, 0.0), (0.9, 0.0), (0.0, 0.25)
    knee = triangle_apex(pin, foot, 0.8, 0.6)
    crank, rocker = _add_rod(mech, "crank", shaft, pin), _add_rod(mech, "rocker", foot, knee)
    mesh = {"elements": elements, "formulation": formulation}
    coupler = _add_strip(mech, "coupler", pin, knee, 0.004, damping, **mesh)
    _hinge(mech, "shaft", mech.ground.at(*shaft), crank.at(*shaft))
    _hinge(mech, "crank pin", crank.at(*pin), coupler.start)
    joint = _hinge(mech, "rocker pin", coupler.end, rocker.at(*knee))
    _hinge(mech, "foot", mech.ground.at(*foot), rocker.at(*foot))
    if stiffness:
        middle = rocker.at(*(np.add(foot, knee) / 2.0))
        anchor = mech.ground.at(1.4, 0.3)
        mech.add(bd.Spring("spring", anchor, middle, stiffness, free_length=0.3))
    mech.observe("pin", rocker.at(*knee))
    mech.observe("rocker pin", joint.reaction)
    return mech


@bd.model(t_end=5.0)
def hanging_four_bar(damping=1e-4, height=0.004, formulation="floating frame"):
    """Two flexible hangers of 0.4 and 0.45 m and a flexible coupler, released from one side."""
    mech = bd.Mechanism(gravity=GRAVITY)
    left, right, angle = (0.0, 0.0), (0.6, 0.0), -2.3
    pin = (0.4 * float(np.cos(angle)), 0.4 * float(np.sin(angle)))
    knee = triangle_apex(right, pin, 0.45, 0.6)
    sides = (("left", left, pin), ("coupler", pin, knee), ("right", knee, right))
    mesh = {"formulation": formulation}
    first, coupler, last = (_add_strip(mech, n, a, b, height, damping, **mesh) for n, a, b in sides)
    joint = _hinge(mech, "left", mech.ground.at(*left), first.start)
    _hinge(mech, "pin", first.end, coupler.start)
    _hinge(mech, "knee", coupler.end, last.start)
    _hinge(mech, "right", mech.ground.at(*right), last.end)
    mech.observe("pin", first.end)
    mech.observe("knee", last.start)
    mech.observe("left", joint.reaction)
    return mech


@bd.model(t_end=3.0)
def watt_six_bar(damping=1e-4, height=0.005, elements=2):
    """Hanging Watt linkage of the first kind with a flexible crank and dyad, released at rest."""
    mech = bd.Mechanism(gravity=GRAVITY)
    left, right, a = (0.0, 0.0), (0.5, 0.0), (-0.12, -0.27)
    b = triangle_apex(right, a, 0.35, 0.5)
    c = triangle_apex(b, a, 0.3, 0.3)
    d = triangle_apex(b, right, 0.2, 0.4)
    e = triangle_apex(d, c, 0.35, 0.4)
    settings = {"elements": elements}
    crank = _add_strip(mech, "crank", left, a, height, damping, **settings)
    coupler = mech.add(bd.RigidBody.polygon("coupler", (a, b, c), mass=0.5))
    rocker = mech.add(bd.RigidBody.polygon("rocker", (right, b, d), mass=0.5))
    first = _add_strip(mech, "first", c, e, height, damping, **settings)
    second = _add_strip(mech, "second", e, d, height, damping, **settings)
    joint = _hinge(mech, "left", mech.ground.at(*left), crank.start)
    _hinge(mech, "a", crank.end, coupler.at(*a))
    _hinge(mech, "b", coupler.at(*b), rocker.at(*b))
    _hinge(mech, "right", mech.ground.at(*right), rocker.at(*right))
    _hinge(mech, "c", coupler.at(*c), first.start)
    _hinge(mech, "d", rocker.at(*d), second.end)
    _hinge(mech, "e", first.end, second.start)
    mech.observe("b", rocker.at(*b))
    mech.observe("e", first.end)
    mech.observe("left", joint.reaction)
    return mech


@bd.model(t_end=1.0)
def bouncing_beam(damping=1e-4, restitution=0.8, height=0.006):
    """Inclined strip of 0.6 m that falls 0.2 m and bounces on both ends."""
    mech = bd.Mechanism(gravity=GRAVITY)
    beam = _add_strip(mech, "beam", (0.0, 0.2), (0.57, 0.38), height, damping, elements=4)
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"stiffness": 2e5, "restitution": restitution, "impact_speed": 2.0}
    for name, end in (("left", beam.start), ("right", beam.end)):
        contact = mech.add(bd.Contact(f"{name} impact", end, floor, **law))
        mech.observe(name, end)
        mech.observe(f"{name} impact", contact.force)
    return mech


@bd.model(t_end=2.0)
def wound_spiral(damping=1e-4, turn=1.5, elements=8):
    """Balance wheel on a spiral of 0.4 m and two turns, wound up by `turn` [rad] and released."""
    mech = bd.Mechanism()

    def spiral(unwound: float) -> bd.IntrinsicCurve:
        return bd.IntrinsicCurve(lambda s: (11.0 - unwound) / 0.4 + 60.0 * s, length=0.4)

    section = bd.Section.rectangle(STEEL, width=0.01, height=8e-4, damping=damping)
    settings = {"elements": elements, "formulation": "exact", "free_curve": spiral(turn)}
    spring = mech.add(bd.Beam("spiral", spiral(0.0), section, **settings))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(*spring.start.point), spring.start))
    # The inner end sits on the rim of the hub, 15 mm from the arbor.
    inner = np.array(spring.end.point)
    arbor = tuple((inner + 0.015 * (spring.curve.point(0.36) - inner) / 0.04).tolist())
    wheel = mech.add(bd.RigidBody.disk("wheel", arbor, radius=0.05, mass=0.3))
    _hinge(mech, "arbor", mech.ground.at(*arbor), wheel.at(*arbor))
    mech.add(bd.Weld("collet", wheel.at(*spring.end.point), spring.end))
    mech.observe("wheel", wheel.at(*arbor))
    mech.observe("middle", spring.at(0.2))
    bend = bd.relative_displacement(spring.at(0.2), spring.start)
    mech.observe("bend", bend)
    mech.observe("clamp", clamp.reaction)
    return mech


@bd.model(t_end=2.0)
def peaucellier(damping=1e-4, height=0.009, frequency=1.0):
    """Driven Peaucellier-Lipkin linkage whose fixed pivot is the tip of a clamped column."""
    mech = bd.Mechanism(gravity=GRAVITY)
    pivot, shaft, p, q = (0.0, 0.0), (0.175, 0.0), (0.35, 0.0), (0.24 / 0.35, 0.0)
    upper = triangle_apex(pivot, p, 0.55, 0.25)
    lower = (upper[0], -upper[1])
    column = _add_strip(mech, "column", (0.0, -0.6), pivot, height, damping)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, -0.6), column.start))
    crank = _add_rod(mech, "crank", shaft, p)
    longs = [_add_rod(mech, f"long {k}", pivot, x) for k, x in enumerate((upper, lower))]
    inner = [_add_rod(mech, f"inner {k}", p, x) for k, x in enumerate((upper, lower))]
    outer = [_add_rod(mech, f"outer {k}", q, x) for k, x in enumerate((upper, lower))]
    _hinge(mech, "pivot", column.end, *(x.at(*pivot) for x in longs))
    _hinge(mech, "shaft", mech.ground.at(*shaft), crank.at(*shaft))
    _hinge(mech, "p", crank.at(*p), *(x.at(*p) for x in inner))
    _hinge(mech, "q", *(x.at(*q) for x in outer))
    for k, x in enumerate((upper, lower)):
        _hinge(mech, f"side {k}", longs[k].at(*x), inner[k].at(*x), outer[k].at(*x))
    mech.add(bd.PointMass("payload", 1.0, on=outer[0].at(*q)))
    rate = 2.0 * np.pi * frequency
    law = bd.Law((lambda t: 0.3 * (1.0 - np.cos(rate * t)),), (), 1.0 / frequency)
    motor = bd.Driver("motor", mech.ground.at(*shaft), crank.at(*shaft), law)
    mech.add(motor)
    mech.observe("q", outer[0].at(*q))
    mech.observe("top", column.end)
    mech.observe("motor", motor.drive)
    return mech


@bd.model(t_end=3.0)
def cart_mast(damping=1e-4, force=10.0, height=0.003):
    """Cart of 2 kg with a flexible mast and a tip mass, pushed for 0.2 s and held by a spring."""
    mech = bd.Mechanism(gravity=GRAVITY)
    cart = mech.add(bd.RigidBody.plate("cart", (0.0, 0.0), width=0.3, height=0.1, mass=2.0))
    mast = _add_strip(mech, "mast", (0.0, 0.0), (0.0, 0.6), height, damping)
    mech.add(bd.Weld("socket", cart.at(0.0, 0.0), mast.start))
    mech.add(bd.PointMass("tip mass", 0.1, on=mast.end))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), cart.at(0.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), cart.at(0.0, 0.0), 80.0))
    mech.add(bd.Force("push", cart.at(0.0, 0.0), (bd.piecewise((0.2, force), 0.0), 0.0)))
    mech.observe("cart", cart.at(0.0, 0.0))
    mech.observe("tip", mast.end)
    mech.observe("flap", bd.relative_displacement(mast.end, cart.at(0.0, 0.0)))
    mech.observe("socket", mast.section_forces(0.0))
    return mech


@bd.model(t_end=2.0)
def scotch_yoke(damping=1e-4, speed=4.0 * np.pi):
    """Scotch yoke that pushes a mass of 0.5 kg through a slightly curved stem of 0.5 m."""
    mech = bd.Mechanism(gravity=GRAVITY)
    crank = mech.add(bd.RigidBody.disk("crank", (0.0, 0.0), radius=0.1, mass=2.0))
    yoke = mech.add(bd.RigidBody.plate("yoke", (0.1, 0.0), width=0.03, height=0.25, mass=0.6))
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.004, damping=damping)
    stem = mech.add(bd.Beam("stem", bd.Parabola(0.5, 0.01, (0.1, 0.0)), section, elements=2))
    ground, pin = mech.ground, (0.1, 0.0)
    _hinge(mech, "shaft", ground.at(0.0, 0.0), crank.at(0.0, 0.0))
    law = bd.run_up(speed, 0.5)
    mech.add(bd.Driver("motor", ground.at(0.0, 0.0), crank.at(0.0, 0.0), law))
    mech.add(bd.Prismatic("guide", ground.at(*pin), yoke.at(*pin)))
    mech.add(bd.PointOnLine("slot", yoke.at(*pin), crank.at(*pin), direction=(0.0, 1.0)))
    mech.add(bd.Weld("root", yoke.at(*pin), stem.start))
    mech.add(bd.PointMass("load", 0.5, on=stem.end))
    mech.add(bd.PointOnLine("track", ground.at(*stem.end.point), stem.end))
    mech.observe("load", stem.end)
    _observe_bend(mech, stem)
    mech.observe("root", stem.section_forces(0.0))
    return mech


@bd.model(t_end=3.0)
def wiper(damping=1e-3, friction=2.0, height=0.003):
    """Flexible arm of 0.45 m that sweeps 1.2 rad at 1 Hz; its tip rubs with `friction` [N]."""
    mech = bd.Mechanism()
    arm = _add_strip(mech, "arm", (0.0, 0.0), (0.45, 0.0), height, damping)
    ground = mech.ground.at(0.0, 0.0)
    motor_law = bd.Law((lambda t: 0.6 * (1.0 - np.cos(2.0 * np.pi * t)),), (), 1.0)
    _hinge(mech, "shaft", ground, arm.start)
    motor = mech.add(bd.Driver("motor", ground, arm.start, motor_law))
    mech.add(bd.PointMass("blade", 0.1, on=arm.end))

    def rub(tip, t):
        speed = np.sqrt(tip.velocity @ tip.velocity + 0.02**2)
        return -friction * tip.velocity / speed

    mech.add(bd.ForceLaw("rubbing", (arm.end,), rub, dissipative=True))
    mech.observe("tip", arm.end)
    mech.observe("motor", motor.drive)
    return mech


@bd.model(t_end=0.8)
def whip(damping=2e-3, swing=1.2, elements=4):
    """Tapered leather whip of 0.8 m on a driven handle that swings forth and back once."""
    mech = bd.Mechanism(gravity=GRAVITY)

    def section(s):
        return bd.Section.circle(LEATHER, diameter=0.012 - 0.01 * s, damping=damping)

    line = bd.Line((0.0, 0.0), (0.0, -0.8))
    lash = mech.add(bd.Beam("lash", line, section, elements=elements, formulation="exact"))
    ground = mech.ground.at(0.0, 0.0)
    _hinge(mech, "hand", ground, lash.start)
    rate = 2.0 * np.pi / 0.4
    law = bd.piecewise((0.4, lambda t: 0.5 * swing * (1.0 - np.cos(rate * t))), 0.0)
    motor = mech.add(bd.Driver("wrist", ground, lash.start, law))
    mech.observe("tip", lash.end)
    _observe_bend(mech, lash)
    mech.observe("wrist", motor.drive)
    return mech


@bd.model(t_end=2.0)
def spinning_beam(damping=0.0, force=40.0, height=0.005, formulation="floating frame"):
    """Free strip of 0.8 m without gravity, set spinning by a pulse on one end for 0.05 s."""
    mech = bd.Mechanism()
    mesh = {"formulation": formulation}
    beam = _add_strip(mech, "beam", (-0.4, 0.0), (0.4, 0.0), height, damping, **mesh)
    rate = 2.0 * np.pi / 0.05
    pulse = bd.piecewise((0.05, lambda t: 0.5 * force * (1.0 - np.cos(rate * t))), 0.0)
    mech.add(bd.Force("pulse", beam.end, (0.0, pulse)))
    mech.observe("start", beam.start)
    mech.observe("end", beam.end)
    mech.observe("middle", beam.at(0.4))
    return mech


@bd.model(t_end=5.0)
def exact_pendulum(damping=0.0, height=0.001, formulation="exact", elements=1):
    """Straight strip of 0.5 m, hinged at one end and released from the horizontal."""
    mech = bd.Mechanism(gravity=GRAVITY)
    mesh = {"elements": elements, "formulation": formulation}
    strip = _add_strip(mech, "strip", (0.0, 0.0), (0.5, 0.0), height, damping, **mesh)
    joint = _hinge(mech, "hinge", mech.ground.at(0.0, 0.0), strip.start)
    mech.observe("tip", strip.end)
    mech.observe("hinge", joint.reaction)
    return mech
