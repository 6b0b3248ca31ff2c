"""Mechanisms with flexible beams that were not used to choose default settings.

Each function builds one mechanism with typical geometry and size.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from benchmarks.systems import create_symbols, lagrange_force
from tolerances.mechanisms import ALLOY, GRAVITY, STEEL, attract, triangle_apex

import beamdae as bd

SILICON = bd.Material(E=169e9, nu=0.22, rho=2330.0)
LEATHER = bd.Material(E=5e7, nu=0.4, rho=1000.0)
GLASS_FIBER = bd.Material(E=40e9, nu=0.3, rho=1900.0)


def _add_strip(
    mech: bd.Mechanism, name: str, start, end, height, damping, width=0.02, **settings
) -> bd.Beam:
    """Add a straight steel strip and observe the deflection of its middle."""
    beam = _add_beam(mech, name, bd.Line(start, end), STEEL, (width, height), damping, **settings)
    _observe_bend(mech, beam, f"{name} bend")
    return beam


def _add_beam(
    mech: bd.Mechanism, name: str, curve, material, sizes, damping, **settings
) -> bd.Beam:
    """Add a beam of the width and height `sizes`."""
    width, height = sizes
    section = bd.Section.rectangle(material, width=width, height=height, damping=damping)
    return mech.add(bd.Beam(name, curve, section, **{"elements": 2} | settings))


def _observe_bend(mech: bd.Mechanism, beam: bd.Beam, name: str = "bend") -> None:
    mech.observe(name, beam.deformation(0.5 * beam.length, axes="frame"))


def _hinge(mech: bd.Mechanism, name: str, *points: bd.results.Attachment) -> bd.Revolute:
    """Hinge the points, which coincide, to the first one; return the last joint."""
    first, *others = points
    joints = [mech.add(bd.Revolute(f"{name} {k}", first, p)) for k, p in enumerate(others)]
    return joints[-1]


def _rise(height: float, duration: float) -> Callable[[Any], Any]:
    """Return a smooth rise from 0 to `height` as a function of time."""
    return lambda t: 0.5 * height * (1.0 - np.cos(np.pi * t / duration))


def _pulse(size: float, duration: float) -> Any:
    """Return a smooth pulse of `size` within `duration` [s]."""
    return bd.piecewise((duration, _rise(size, 0.5 * duration)), 0.0)


def _gravity(onset: float) -> tuple[float, Any]:
    """Return gravity that rises within `onset` [s], which hardly excites axial vibrations."""
    return (0.0, bd.piecewise((onset, _rise(GRAVITY[1], onset)), GRAVITY[1])) if onset else GRAVITY


def _add_rod(mech: bd.Mechanism, name: str, start, end) -> bd.RigidBody:
    return mech.add(bd.RigidBody.rod(name, start, end, density=STEEL.rho, area=2e-4))


@bd.model(t_end=5.0)
def tutorial_four_bar(damping=1e-4, elements=4, onset=0.0):
    """Four-bar of the tutorial without its spring, which swings freely."""
    mech = bd.Mechanism(gravity=_gravity(onset))
    shaft, foot, pin = (0.0, 0.0), (0.9, 0.0), (0.0, 0.25)
    knee = triangle_apex(pin, foot, 0.8, 0.6)
    crank, rocker = _add_rod(mech, "crank", shaft, pin), _add_rod(mech, "rocker", foot, knee)
    coupler = _add_strip(mech, "coupler", pin, knee, 0.004, damping, elements=elements)
    _hinge(mech, "shaft", mech.ground.at(*shaft), crank.at(*shaft))
    _hinge(mech, "crank pin", crank.at(*pin), coupler.start)
    joint = _hinge(mech, "rocker pin", coupler.end, rocker.at(*knee))
    _hinge(mech, "foot", mech.ground.at(*foot), rocker.at(*foot))
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
def watt_six_bar(damping=1e-4, height=0.005, elements=2, onset=0.0):
    """Hanging Watt linkage of the first kind with a flexible crank and dyad, released at rest."""
    mech = bd.Mechanism(gravity=_gravity(onset))
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

    settings = {"elements": elements, "formulation": "exact", "free_curve": spiral(turn)}
    spring = _add_beam(mech, "spiral", spiral(0.0), STEEL, (0.01, 8e-4), damping, **settings)
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
    law = bd.results.Law((lambda t: 0.3 * (1.0 - np.cos(rate * t)),), (), 1.0 / frequency)
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
    axis = bd.Parabola(0.5, 0.01, (0.1, 0.0))
    stem = _add_beam(mech, "stem", axis, STEEL, (0.02, 0.004), damping)
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
    motor_law = bd.results.Law((lambda t: 0.6 * (1.0 - np.cos(2.0 * np.pi * t)),), (), 1.0)
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
    motor = mech.add(bd.Driver("wrist", ground, lash.start, _pulse(swing, 0.4)))
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
    mech.add(bd.Force("pulse", beam.end, (0.0, _pulse(force, 0.05))))
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


@bd.model(t_end=0.4)
def bow(damping=1e-4, draw=150.0, hold=0.3):
    """Bow of glass fiber, drawn with up to `draw` [N] for `hold` [s]; then it shoots an arrow.

    The string pushes the arrow of 25 g, which leaves it.
    """
    mech = bd.Mechanism()
    nock = mech.add(bd.PointMass("nock", 5e-3, at=(-0.15, 0.0)))
    arrow = mech.add(bd.PointMass("arrow", 0.025, at=(-0.15, 0.0)))
    ground, string = mech.ground, {"stiffness": 2e4, "damping": 2.0}
    for side, name in ((1.0, "upper"), (-1.0, "lower")):
        line = bd.Line((0.0, 0.1 * side), (-0.05, 0.7 * side))
        limb = _add_beam(mech, f"{name} limb", line, GLASS_FIBER, (0.03, 0.01), damping)
        mech.add(bd.Weld(f"{name} grip", ground.at(0.0, 0.1 * side), limb.start))
        mech.add(bd.Spring(f"{name} string", limb.end, nock.point, **string))
        _observe_bend(mech, limb, f"{name} bend")
        mech.observe(f"{name} tip", limb.end)
    for body in (nock, arrow):
        mech.add(bd.PointOnLine(f"{body.name} line", ground.at(-0.15, 0.0), body.point))

    def push(nock, arrow, t):
        force = 1e6 * np.maximum(nock.position[0] - arrow.position[0], 0.0) ** 1.5
        return [(-force, 0.0), (force, 0.0)]

    mech.add(bd.ForceLaw("contact", (nock.point, arrow.point), push))
    for body, force in ((nock, draw), (arrow, 2.0)):
        rise = _rise(-force, hold)
        mech.add(bd.Force(f"{body.name} hand", body.point, (bd.piecewise((hold, rise), 0.0), 0.0)))
    mech.observe("arrow", arrow.point)
    mech.observe("nock", nock.point)
    return mech


@bd.model(t_end=2.0)
def magnet_strip(damping=1e-4, gap=0.02):
    """Hanging strip with a magnet at its tip, above a pole beside which it is released."""
    mech = bd.Mechanism(gravity=GRAVITY)
    strip = _add_strip(mech, "strip", (0.0, 0.0), (0.0, -0.4), 8e-4, damping)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.PointMass("magnet", 0.05, on=strip.end))
    attract(mech, "pole", strip.end, 2e-4, (0.03, -0.4 - gap), 1e-4)
    mech.observe("tip", strip.end)
    mech.observe("clamp", strip.section_forces(0.0))
    return mech


@bd.model(t_end=1e-3)
def micro_resonator(damping=1e-8, force=2e-9, frequency=1.6e4):
    """Clamped silicon strip of 300 um x 1 um, driven at its tip near its first resonance."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (3e-4, 0.0))
    strip = _add_beam(mech, "strip", line, SILICON, (2e-5, 1e-6), damping)
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.Force("drive", strip.end, (0.0, bd.sine(force, frequency))))
    mech.observe("tip", strip.end)
    _observe_bend(mech, strip)
    mech.observe("clamp", clamp.reaction)
    return mech


@bd.model(t_end=0.06)
def tuning_fork(damping=1e-7, force=0.01):
    """Steel fork of 440 Hz on a soft stem; one prong is struck and moves by micrometers."""
    mech = bd.Mechanism()
    foot = mech.add(bd.RigidBody.plate("foot", (0.0, -0.01), width=0.03, height=0.02, mass=0.03))
    stem = {"kx": 1e4, "ky": 1e4, "ktheta": 1.0, "cx": 1.0, "cy": 1.0, "ctheta": 1e-4}
    mech.add(bd.Bushing("stem", mech.ground.at(0.0, -0.02), foot.at(0.0, -0.02), **stem))
    for x, name in ((-0.01, "left"), (0.01, "right")):
        settings = {"width": 0.006, "height": 0.0045}
        prong = _add_strip(mech, name, (x, 0.0), (x, 0.0925), damping=damping, **settings)
        mech.add(bd.Weld(f"{name} root", foot.at(x, 0.0), prong.start))
        mech.observe(f"{name} tip", prong.end)
        mech.observe(f"{name} shift", bd.relative_displacement(prong.end, foot.at(x, 0.0)))
    mech.add(bd.Force("strike", prong.end, (_pulse(force, 1e-3), 0.0)))
    mech.observe("foot", foot.at(0.0, -0.02))
    return mech


@bd.model(t_end=20.0)
def clock_pendulum(damping=1e-4, start=0.1):
    """Pendulum of 1 m and 2 s on a suspension spring of 20 mm x 0.1 mm, ten periods."""
    mech = bd.Mechanism(gravity=GRAVITY)
    strip = _add_strip(mech, "suspension", (0.0, 0.02), (0.0, 0.0), 1e-4, damping, 0.005)
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (0.0, -1.0), mass=0.3))
    mech.add(bd.Weld("cheeks", mech.ground.at(0.0, 0.02), strip.start))
    mech.add(bd.Weld("top", strip.end, rod.at(0.0, 0.0)))
    mech.add(bd.PointMass("bob", 4.0, on=rod.at(0.0, -0.98)))
    force = bd.piecewise((1.0, lambda t: 0.5 * start * 40.0 * np.sin(np.pi * t) ** 2), 0.0)
    mech.add(bd.Force("start", rod.at(0.0, -0.98), (force, 0.0)))
    mech.observe("bob", rod.at(0.0, -0.98))
    mech.observe("cheeks", strip.section_forces(0.0))
    return mech


@bd.model(t_end=0.6)
def hammered_cantilever(damping=1e-4, speed=1.5):
    """Clamped strip of 0.5 m, hit at its tip by a falling ball that bounces on it."""
    mech = bd.Mechanism(gravity=GRAVITY)
    strip = _add_strip(mech, "strip", (0.0, 0.0), (0.5, 0.0), 0.01, damping)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    ball = mech.add(bd.PointMass("ball", 0.2, at=(0.48, 0.05), velocity=(0.0, -speed)))
    surface = bd.LineSurface(strip.end, direction=(1.0, 0.0))
    law = {"stiffness": 1e6, "restitution": 0.6, "impact_speed": speed}
    contact = mech.add(bd.Contact("impact", ball.point, surface, **law))
    mech.observe("ball", ball.point)
    mech.observe("tip", strip.end)
    mech.observe("shift", bd.relative_displacement(strip.end, strip.start))
    mech.observe("impact", contact.force)
    return mech


@bd.model(t_end=1.0)
def crossed_bridge(damping=1e-4, speed=8.0, load=150.0):
    """Pinned girder of 3 m, crossed by a load of 150 N in 0.4 s; free vibration follows."""
    mech = bd.Mechanism()
    girder = _add_strip(mech, "girder", (0.0, 0.0), (3.0, 0.0), 0.03, damping, elements=4)
    joint = _hinge(mech, "left", mech.ground.at(0.0, 0.0), girder.start)
    mech.add(bd.PointOnLine("right", mech.ground.at(3.0, 0.0), girder.end))
    mech.add(bd.MovingForce("wheel", girder, (0.0, -load), speed, start=-0.2))
    mech.observe("quarter", girder.at(0.75))
    mech.observe("end", girder.end)
    mech.observe("left", joint.reaction)
    return mech


@bd.model(t_end=3.0)
def drag_flag(drag=0.3, damping=1e-4):
    """Thin strip of 0.4 m released from the horizontal in air, which brakes its swing."""
    mech = bd.Mechanism(gravity=GRAVITY)
    line, kind = bd.Line((0.0, 0.0), (0.4, 0.0)), {"formulation": "exact"}
    strip = _add_beam(mech, "flag", line, ALLOY, (0.03, 5e-4), damping, **kind)
    joint = _hinge(mech, "hinge", mech.ground.at(0.0, 0.0), strip.start)
    mech.add(bd.AirDrag("air", strip, drag))
    mech.observe("tip", strip.end)
    _observe_bend(mech, strip)
    mech.observe("hinge", joint.reaction)
    return mech


@bd.model(t_end=4.0)
def bead_in_bowl(damping=1e-4, height=0.003):
    """Bead of 0.1 kg that slides to and fro without friction in a bowl bent from a strip."""
    mech = bd.Mechanism(gravity=GRAVITY)
    arc = bd.Arc(radius=0.5, length=1.0, start=(-0.5 * np.sin(1.0), 0.0), angle=-1.0)
    bowl = _add_beam(mech, "bowl", arc, STEEL, (0.02, height), damping, elements=3)
    for name, end in (("left", bowl.start), ("right", bowl.end)):
        mech.add(bd.Weld(name, mech.ground.at(*end.point), end))
    bead = mech.add(bd.PointMass("bead", 0.1, at=tuple(arc.point(0.2))))
    slide = mech.add(bd.SlidingOnBeam("slide", bead.point, bowl))
    mech.observe("bead", bead.point)
    mech.observe("bottom", bowl.at(0.5))
    _observe_bend(mech, bowl)
    mech.observe("slide", slide.reaction)
    return mech


@bd.model(t_end=3.0)
def blade_in_gusts(damping=1e-4, speed=6.0, gust=0.8):
    """Blade of 1 m on a hub at constant speed after 0.5 s, shaken by gusts of 3.3 Hz."""
    mech = bd.Mechanism(gravity=GRAVITY)
    line = bd.Line((0.1, 0.0), (1.1, 0.0))
    blade = _add_beam(mech, "blade", line, GLASS_FIBER, (0.05, 0.008), damping)
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.1, mass=3.0))
    ground = mech.ground.at(0.0, 0.0)
    _hinge(mech, "bearing", ground, hub.at(0.0, 0.0))
    motor = mech.add(bd.Driver("motor", ground, hub.at(0.0, 0.0), bd.run_up(speed, 0.5)))
    mech.add(bd.Weld("root", hub.at(0.1, 0.0), blade.start))
    wind = (0.0, bd.sine(gust, 3.3))
    mech.add(bd.DistributedForce("wind", blade, wind, axes="section"))
    mech.observe("tip", blade.end)
    _observe_bend(mech, blade)
    mech.observe("motor", motor.drive)
    return mech


@bd.model(t_end=12.0)
def tethered_satellites(damping=1e-3, speed=0.55):
    """Two masses on a flexible tether in the field of a star at the origin, about two orbits."""
    mech = bd.Mechanism()
    material = bd.Material(E=1e6, nu=0.3, rho=1000.0)
    line, settings = bd.Line((0.95, 0.0), (1.1, 0.0)), {"velocity": (0.0, speed)}
    settings |= {"formulation": "exact"}
    tether = _add_beam(mech, "tether", line, material, (0.01, 0.01), damping, **settings)
    for name, end, mass in (("inner", tether.start, 0.1), ("outer", tether.end, 0.05)):
        mech.add(bd.PointMass(name, mass, on=end))
        attract(mech, f"{name} gravity", end, 0.4 * mass)
        mech.observe(name, end)
    _observe_bend(mech, tether)
    return mech


@bd.model(t_end=2.0)
def falling_mast(damping=1e-4, lean=0.05):
    """Mast of 2 m with a heavy top that falls from almost upright onto a rubber block."""
    mech = bd.Mechanism(gravity=GRAVITY)
    top = (2.0 * float(np.sin(lean)), 2.0 * float(np.cos(lean)))
    section = bd.Section.pipe(ALLOY, diameter=0.03, wall=0.002, damping=damping)
    mast = mech.add(bd.Beam("mast", bd.Line((0.0, 0.0), top), section, elements=2))
    joint = _hinge(mech, "foot", mech.ground.at(0.0, 0.0), mast.start)
    mech.add(bd.PointMass("lamp", 0.5, on=mast.end))
    block = bd.LineSurface(mech.ground.at(0.0, 0.1))
    law = {"stiffness": 3e5, "restitution": 0.5, "impact_speed": 5.0}
    mech.add(bd.Contact("block", mast.end, block, **law))
    mech.observe("tip", mast.end)
    _observe_bend(mech, mast)
    mech.observe("foot", joint.reaction)
    return mech


@bd.model(t_end=2.0)
def five_bar(damping=1e-4, height=0.003):
    """Parallel robot of two driven cranks and two flexible links that carry a tool of 0.3 kg."""
    mech = bd.Mechanism(gravity=GRAVITY)
    tool, arms = (0.0, 0.6), []
    for side, name, rate in ((-1.0, "left", 1.0), (1.0, "right", 1.5)):
        shaft, elbow = (0.15 * side, 0.0), (0.35 * side, 0.22)
        crank = _add_rod(mech, f"{name} crank", shaft, elbow)
        link = _add_strip(mech, f"{name} link", elbow, tool, height, damping)
        ground = mech.ground.at(*shaft)
        _hinge(mech, f"{name} shaft", ground, crank.at(*shaft))
        _hinge(mech, f"{name} elbow", crank.at(*elbow), link.start)

        def angle(t, side=side, omega=2.0 * np.pi * rate):
            return 0.2 * side * (1.0 - np.cos(omega * t))

        law = bd.results.Law((angle,), (), 1.0 / rate)
        motor = mech.add(bd.Driver(f"{name} motor", ground, crank.at(*shaft), law))
        mech.observe(f"{name} motor", motor.drive)
        arms.append(link)
    _hinge(mech, "tool", arms[0].end, arms[1].end)
    mech.add(bd.PointMass("gripper", 0.3, on=arms[0].end))
    mech.observe("tool", arms[0].end)
    return mech


@bd.model(t_end=1.5)
def running_blade(damping=1e-4, height=0.008):
    """Mass of 10 kg on a curved blade that drops onto the floor and hops."""
    mech = bd.Mechanism(gravity=GRAVITY)
    arc = bd.Arc(radius=0.15, length=0.45, start=(0.0, 0.35), angle=np.pi)
    blade = _add_beam(mech, "blade", arc, GLASS_FIBER, (0.05, height), damping)
    trunk = mech.add(bd.RigidBody.plate("trunk", (0.0, 0.4), width=0.2, height=0.1, mass=10.0))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.4), trunk.at(0.0, 0.4), (0.0, 1.0)))
    mech.add(bd.Weld("socket", trunk.at(0.0, 0.35), blade.start))
    law = {"stiffness": 1e6, "friction": 0.3, "friction_speed": 0.02}
    contact = bd.Contact("toe", blade.end, bd.LineSurface(mech.ground.at(0.0, 0.0)), **law)
    mech.add(contact)
    mech.observe("trunk", trunk.at(0.0, 0.4))
    mech.observe("toe", blade.end)
    mech.observe("shift", bd.relative_displacement(blade.end, blade.start))
    mech.observe("contact", contact.force)
    return mech


@bd.model(t_end=6.0)
def jib_crane(damping=1e-4, travel=0.8):
    """Flexible jib of 2 m; the drive moves its trolley by `travel` [m], and the load swings."""
    mech = bd.Mechanism(gravity=GRAVITY)
    jib = _add_strip(mech, "jib", (0.0, 0.0), (2.0, 0.0), 0.05, damping, 0.03)
    clamp = mech.add(bd.Weld("mast", mech.ground.at(0.0, 0.0), jib.start))
    trolley = mech.add(bd.PointMass("trolley", 1.0, at=(0.0, -0.2)))
    frame = mech.add(bd.RigidBody.rod("frame", (2.0, 0.0), (2.0, -0.2), mass=2.0))
    mech.add(bd.Weld("hanger", jib.end, frame.at(2.0, 0.0)))
    rail = frame.at(2.0, -0.2)
    mech.add(bd.PointOnLine("rail", rail, trolley.point))
    rise = bd.piecewise((2.0, _rise(travel, 2.0)), travel)
    mech.add(bd.TranslationalDriver("winch", rail, trolley.point, rise))
    load = mech.add(bd.PointMass("load", 10.0, at=(0.0, -1.2)))
    mech.add(bd.Distance("rope", trolley.point, load.point))
    mech.observe("load", load.point)
    mech.observe("tip", jib.end)
    mech.observe("mast", clamp.reaction)
    return mech


@bd.model(t_end=1.0)
def gas_engine(damping=1e-5, speed=60.0, pressure=1500.0):
    """Slider-crank with a flexible rod, a piston of 0.4 kg and a gas force in every turn."""
    mech = bd.Mechanism()
    pin, wrist = (0.04, 0.0), (0.2, 0.0)
    crank = mech.add(bd.RigidBody.disk("crank", (0.0, 0.0), radius=0.08, mass=4.0))
    rod = _add_strip(mech, "rod", pin, wrist, 0.008, damping)
    piston = mech.add(bd.PointMass("piston", 0.4, at=wrist))
    ground = mech.ground
    _hinge(mech, "shaft", ground.at(0.0, 0.0), crank.at(0.0, 0.0))
    _hinge(mech, "crank pin", crank.at(*pin), rod.start)
    joint = mech.add(bd.Revolute("wrist pin", rod.end, piston.point))
    mech.add(bd.PointOnLine("cylinder", ground.at(*wrist), piston.point))
    motor = bd.Driver("motor", ground.at(0.0, 0.0), crank.at(0.0, 0.0), bd.run_up(speed, 0.4))
    mech.add(motor)

    def gas(head, t):
        stroke = (0.21 - head.position[0]) / 0.01
        return -pressure / stroke**1.3, 0.0

    mech.add(bd.ForceLaw("gas", (piston.point,), gas))
    mech.observe("piston", piston.point)
    mech.observe("crank", crank.at(*pin))
    mech.observe("wrist", joint.reaction)
    return mech


@bd.model(t_end=2.0)
def exact_chain(damping=1e-4, height=0.002):
    """Two straight exact strips of 0.4 m hinged to each other, released from a bent position."""
    mech = bd.Mechanism(gravity=GRAVITY)
    middle, tip = (0.32, -0.24), (0.32, -0.64)
    mesh = {"formulation": "exact"}
    upper = _add_strip(mech, "upper", (0.0, 0.0), middle, height, damping, **mesh)
    lower = _add_strip(mech, "lower", middle, tip, height, damping, **mesh)
    joint = _hinge(mech, "top", mech.ground.at(0.0, 0.0), upper.start)
    _hinge(mech, "knee", upper.end, lower.start)
    mech.observe("knee", upper.end)
    mech.observe("tip", lower.end)
    mech.observe("top", joint.reaction)
    return mech


@bd.model(t_end=4.0)
def rolling_arm(damping=1e-4, height=0.002):
    """Wheel that rolls to and fro below a hanging flexible arm, which is released sideways."""
    mech = bd.Mechanism(gravity=GRAVITY)
    wheel = mech.add(bd.RigidBody.disk("wheel", (0.0, 0.0), radius=0.15, mass=1.0))
    rail = mech.ground.at(0.0, -0.15)
    mech.add(bd.RollingOnLine("rail", rail, wheel.at(0.0, 0.0), radius=0.15))
    arm = _add_strip(mech, "arm", (0.0, 0.0), (0.35, -0.35), height, damping)
    joint = _hinge(mech, "axle", wheel.at(0.0, 0.0), arm.start)
    mech.add(bd.PointMass("weight", 0.3, on=arm.end))
    mech.observe("wheel", wheel.at(0.0, 0.0))
    mech.observe("tip", arm.end)
    mech.observe("axle", joint.reaction)
    return mech


# Slider-crank of the IVP test set; the flexible rod has two bending and two axial coordinates.

# Eight digits as in the test set; its end values depend on them.
PI = 3.1415927
CRANK = 0.15  # length [m]
ROD = 0.30  # length [m]
SPEED = 150.0  # [rad/s]
ROD_MASS = 0.151104  # [kg]
SLIDER_MASS = 0.075552  # [kg]
CRANK_INERTIA = 0.002727  # [kg m^2]
ROD_INERTIA = 0.0045339259  # [kg m^2]
DENSITY = 7870.0  # [kg/m^3]
YOUNG = 0.2e12  # modulus [Pa]
SIDE = 0.008  # of the square section [m]
VOLUME = SIDE**2 * ROD


def _fill_matrix(shape: tuple[int, ...], entries: dict) -> np.ndarray:
    array = np.zeros(shape)
    for index, value in entries.items():
        array[index] = value
    return array


# Shape functions of the rod: sin(pi x/l) and sin(2 pi x/l) transverse, quadratic ones axial. The
# arrays below are integrals over the rod of the shapes, of x times the shapes, and of products of
# transverse and axial shapes.
MASS = DENSITY * VOLUME * _fill_matrix((4, 4), {(0, 0): 0.5, (1, 1): 0.5, (2, 2): 8.0, (3, 3): 2.0})
MASS[2, 3] = MASS[3, 2] = DENSITY * VOLUME
STIFFNESS = (YOUNG * SIDE**2 / ROD) * _fill_matrix(
    (4, 4),
    {
        (0, 0): PI**4 / 24.0 * (SIDE / ROD) ** 2,
        (1, 1): PI**4 * 2.0 / 3.0 * (SIDE / ROD) ** 2,
        (2, 2): 16.0 / 3.0,
        (2, 3): -8.0 / 3.0,
        (3, 2): -8.0 / 3.0,
        (3, 3): 7.0 / 3.0,
    },
)
DAMPING = _fill_matrix(
    (4, 4),
    {
        (0, 0): 5.0,
        (1, 1): 25.0,
        (2, 2): 0.5 * 2.308375455264791e2,
        (2, 3): -0.5 * 2.62688487992052e2,
        (3, 2): -0.5 * 2.62688487992052e2,
        (3, 3): 0.5 * 4.217421837156818e2,
    },
)
GYROSCOPIC = VOLUME * _fill_matrix(
    (4, 4), {(0, 2): -16.0 / PI**3, (0, 3): 8.0 / PI**3 - 1.0 / PI, (1, 3): 0.5 / PI}
)
GYROSCOPIC -= GYROSCOPIC.T
ALONG = VOLUME * np.array([0.0, 0.0, 2.0 / 3.0, 1.0 / 6.0])
ACROSS = VOLUME * np.array([2.0 / PI, 0.0, 0.0, 0.0])
ALONG_X = ROD * VOLUME * np.array([0.0, 0.0, 1.0 / 3.0, 1.0 / 6.0])
ACROSS_X = ROD * VOLUME * np.array([1.0 / PI, -0.5 / PI, 0.0, 0.0])


def _mass_matrix(u: ca.SX) -> ca.SX:
    """Return M of (phi1, phi2, x3, q1..q4) from the kinetic energy of crank, rod and slider."""
    q, difference = u[3:], u[0] - u[1]
    cosine, sine = ca.cos(difference), ca.sin(difference)
    along, across = ca.dot(ALONG, q), ca.dot(ACROSS, q)
    m = ca.SX.zeros(7, 7)
    m[0, 0] = CRANK_INERTIA + ROD_MASS * CRANK**2
    m[0, 1] = 0.5 * CRANK * ROD * ROD_MASS * cosine
    m[0, 1] += DENSITY * CRANK * (sine * across + cosine * along)
    m[1, 1] = ROD_INERTIA + ca.dot(q, MASS @ q) + 2.0 * DENSITY * ca.dot(ALONG_X, q)
    m[2, 2] = SLIDER_MASS
    m[0, 3:] = (DENSITY * CRANK * (cosine * ACROSS - sine * ALONG)).T
    m[1, 3:] = (DENSITY * (ACROSS_X + GYROSCOPIC.T @ q)).T
    m[3:, 3:] = MASS
    return ca.triu2symm(ca.triu(m))


@bd.model(t_end=0.1)
def flexible_slider_crank(damped=False):
    """Crank at 150 rad/s, flexible rod and slider, in the coordinates of the test set.

    B. Simeon, Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs,
    Math. Modelling of Systems 2 (1996) 1, doi:10.1080/13873959608837026; F. Mazzia, C. Magherini,
    Test Set for Initial Value Problem Solvers, problem crank, linear stiffness, start close to the
    smooth motion; https://archimede.dm.uniba.it/~testset/. Damping is that of the test set, 0.5 %.
    """
    t, u, v = create_symbols(7)
    mass = _mass_matrix(u)
    resistance = STIFFNESS @ u[3:] + (DAMPING @ v[3:] if damped else 0.0)
    length = ROD + u[6]
    return bd.ConstrainedSystem(
        t=t,
        q=u,
        v=v,
        mass=mass,
        force=lagrange_force(u, v, mass, ca.vertcat(ca.SX.zeros(3), -resistance)),
        constraints=ca.vertcat(
            CRANK * ca.sin(u[0]) + length * ca.sin(u[1]),
            u[2] - CRANK * ca.cos(u[0]) - length * ca.cos(u[1]),
            u[0] - SPEED * t,
        ),
        q0=[0.0, 0.0, 0.450016933, 0.0, 0.0, 0.103339863e-4, 0.169327969e-4],
        v0=[
            150.0,
            -74.9957670,
            -0.268938672e-5,
            0.444896105,
            0.463434311e-2,
            -0.178591076e-5,
            -0.268938672e-5,
        ],
        names=("phi1", "phi2", "x3", "q1", "q2", "q3", "q4"),
        units=("rad", "rad", "m", "m", "m", "m", "m"),
    )


# Undamped motion at t = 0.1 s from the test set.
CRANK_END = {
    "phi2 [rad]": -3.311734987910881e-1,
    "x3 [m]": 1.697373326718410e-1,
    "q1 [m]": 1.893192460247178e-4,
    "q2 [m]": 2.375751865617931e-5,
    "q3 [m]": -5.323907988763734e-6,
    "q4 [m]": -8.363283141616840e-6,
}
