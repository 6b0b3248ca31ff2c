"""Integrators, joints, loads and kinematics on which the laws of their kind are tested.

Joints and loads enter with their sample call; further variants are listed here.
"""

from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from sample_parts import SAMPLES, SampleMechanism, find_public
from support import ARC

import beamdae as bd
from beamdae import catalog
from beamdae.beams.exact import GeometricallyExact
from beamdae.beams.floating_frame import FloatingFrame
from beamdae.beams.sections import VaryingSection
from beamdae.equations.formulations.first_order import FIRST_ORDER

INTEGRATORS = {
    "ida": bd.Ida(),
    "radau": bd.Radau(),
    "alpha": bd.GeneralizedAlpha(),
    "alpha stabilized": bd.GeneralizedAlpha(formulation="stabilized-index2"),
    "alpha adaptive": bd.GeneralizedAlpha(rtol=1e-5),
}
IDA_FORMS = {
    f"ida {form}": bd.Ida(formulation=form, error_control="positions") for form in FIRST_ORDER
}


def tuned(rtol, step, also=None, **settings):
    """Return all integrators at this tolerance or step, with those settings that each accepts."""

    def tune(integrator):
        names = {field.name for field in fields(integrator)}
        values = {name: value for name, value in settings.items() if name in names}
        if integrator.accuracy.name == "step":
            # Fixed steps have no limit of steps.
            values.pop("max_steps", None)
        accuracy = {"rtol": rtol, "step": step}[integrator.accuracy.name]
        return replace(integrator, **{integrator.accuracy.name: accuracy}, **values)

    return {name: tune(one) for name, one in (INTEGRATORS | (also or {})).items()}


def integrators(rtol, step, also=None, slow=(), **settings):
    """Parametrize a test over `tuned` integrators; those named in `slow` are slow tests."""
    return pytest.mark.parametrize(
        "integrator",
        [
            pytest.param(
                one,
                id=name,
                marks=[pytest.mark.slow(reason="several runs")] if name in slow else [],
            )
            for name, one in tuned(rtol, step, also, **settings).items()
        ],
    )


def catalog_parts(heading, name, without=()):
    """Return the sample parts under a heading, as functions of (mechanism, disk, beam)."""

    def builder(kind):
        def build(mechanism, disk, beam):
            sample = SampleMechanism()
            sample.mechanism, sample.disk, sample.beam = mechanism, disk, beam
            return find_public(kind)(**(SAMPLES[kind](sample) | {"name": name}))

        return build

    return {
        public.name: builder(public.name)
        for group in catalog.GROUPS
        if group.heading == heading
        for public in group.names
        if public.name in SAMPLES and public.name not in without
    }


TIP = tuple(ARC.point(ARC.length))
# Distance of the beam's end from (3, 0), and distance and direction of the disk's center from it.
LINK_LENGTH = float(np.hypot(TIP[0] - 3.0, TIP[1]))
DISK_DISTANCE = float(np.hypot(*np.subtract((0.5, 0.4), TIP)))
DISK_DIRECTION = float(np.arctan2(0.4 - TIP[1], 0.5 - TIP[0]))


def swing(t):
    return 0.4 * np.sin(2.0 * t) + t**2


NONHOLONOMIC_NAMES = ("RollingOnCircle", "Skate")
# Joints named "j" of a mechanism m with a disk d centered at (0.5, 0.4) and a beam b on ARC.
JOINTS = {
    # The slider of the catalog starts between nodes, where the axis is interpolated.
    **catalog_parts("Joints", "j", without=(*NONHOLONOMIC_NAMES, "SlidingOnBeam")),
    **catalog_parts("Drivers", "j"),
    "ground to revolute": lambda m, d, b: bd.Revolute("j", d.at(0.1, 0.2), m.ground.at(0.1, 0.2)),
    "revolute": lambda m, d, b: bd.Revolute("j", d.at(*TIP), b.end),
    "revolute in the span": lambda m, d, b: bd.Revolute("j", d.at(*ARC.point(0.7)), b.at(0.7)),
    "weld": lambda m, d, b: bd.Weld("j", d.at(*TIP), b.end),
    "weld to start": lambda m, d, b: bd.Weld("j", b.start, d.at(*ARC.start)),
    "driver": lambda m, d, b: bd.Driver("j", d.at(0.0, 0.0), b.end, law=swing),
    "run-up": lambda m, d, b: bd.Driver(
        "j", m.ground.at(0.0, 0.0), d.at(0, 0), law=bd.run_up(2, 1)
    ),
    "fixed line": lambda m, d, b: bd.PointOnLine("j", m.ground.at(*TIP), b.end, (1.0, -0.5)),
    "turning line": lambda m, d, b: bd.PointOnLine("j", d.at(0.0, TIP[1]), b.end, (-2.0, 0.0)),
    "line on a beam": lambda m, d, b: bd.PointOnLine("j", b.end, d.at(TIP[0], 0.0), (0.0, 3.0)),
    "slider on a body": lambda m, d, b: bd.Prismatic("j", d.at(0.1, 0.3), b.end, (1.0, -0.5)),
    "slider on a beam": lambda m, d, b: bd.Prismatic("j", b.at(0.7), d.at(1.0, 1.0), (0.2, 0.0)),
    "link": lambda m, d, b: bd.Distance("j", d.at(0.0, 0.0), b.at(0.7)),
    "growing link": lambda m, d, b: bd.Distance(
        "j", m.ground.at(3.0, 0.0), b.end, lambda t: LINK_LENGTH + 0.1 * swing(t)
    ),
    "gear": lambda m, d, b: bd.Gear("j", b.start, d.at(0.0, 0.0), -1.7),
    "planetary gear": lambda m, d, b: bd.Gear(
        "j", m.ground.at(0.0, 0.0), d.at(0.0, 0.0), 0.4, carrier=b.end
    ),
    "rack and pinion": lambda m, d, b: bd.RackAndPinion(
        "j", d.at(0.5, 0.4), b.start, 0.3, (1.0, 0.2)
    ),
    "rolling on a line": lambda m, d, b: bd.RollingOnLine(
        "j", m.ground.at(0.3, 0.0), d.at(0.5, 0.4), 0.4
    ),
    "rolling along a beam": lambda m, d, b: bd.RollingOnLine(
        "j",
        b.end,
        d.at(0.5, 0.4),
        DISK_DISTANCE * abs(np.sin(DISK_DIRECTION - 1.3)),
        (np.cos(1.3), np.sin(1.3)),
    ),
    "sliding from the start": lambda m, d, b: bd.SlidingOnBeam("j", d.at(*ARC.start), b),
    "sliding in the span": lambda m, d, b: bd.SlidingOnBeam("j", d.at(*ARC.point(1.0)), b),
    "travel": lambda m, d, b: bd.TranslationalDriver(
        "j", d.at(0.0, 0.0), b.end, swing, (0.3, -1.0)
    ),
}

# Nonholonomic joints of the same mechanism.
NONHOLONOMIC = {
    name: build
    for name, build in catalog_parts("Joints", "j").items()
    if name in NONHOLONOMIC_NAMES
} | {
    "skate on a beam": lambda m, d, b: bd.Skate("j", b.at(0.7), direction=(0.0, 2.0)),
    "outside a circle": lambda m, d, b: bd.RollingOnCircle(
        "j", b.end, d.at(0.5, 0.4), (0.4 * DISK_DISTANCE, 0.6 * DISK_DISTANCE)
    ),
    "inside a ring": lambda m, d, b: bd.RollingOnCircle(
        "j", m.ground.at(0.5, 0.1), d.at(0.5, 0.4), (0.8, 0.5)
    ),
    "ring around a circle": lambda m, d, b: bd.RollingOnCircle(
        "j", d.at(0.5, 0.4), b.end, (0.2, 0.2 + DISK_DISTANCE)
    ),
}

CURVE = bd.table([-2.0, -0.3, 0.1, 0.8, 2.5], [-1.0, 0.4, 0.5, -0.3, 0.7], kind="pchip")
MAP = bd.table(
    ([-1.0, 0.3, 1.2, 3.0], [-1.0, 0.2, 0.9]),
    [[0.1, 0.4, 1.2], [0.7, -0.3, 0.2], [1.1, 0.9, -0.4], [0.3, 0.6, 0.8]],
)
NO_PARTS = ("LineSurface", "CircleSurface", "Friction")
# Loads named "load" of the same mechanism.
# The contacts of the catalog are open; those below penetrate.
LOADS = catalog_parts("Loads and forces", "load", without=(*NO_PARTS, "Contact", "BeamContact")) | {
    "follower force": lambda m, d, b: bd.Force("load", b.at(0.7), (swing, 3.0), axes="body"),
    "force on a rigid body": lambda m, d, b: bd.Force("load", d.at(1.0, 1.0), (swing, 1.0), "body"),
    "moment on a rigid body": lambda m, d, b: bd.Moment("load", d.at(0.1, 0.2), swing),
    "motor on a rigid body": lambda m, d, b: bd.Moment("load", b.end, swing, d.at(0.1, 0.2)),
    "motor on the ground": lambda m, d, b: bd.Moment("load", b.at(0.7), 2.0, m.ground.at(0.0, 0.0)),
    "moments within a beam": lambda m, d, b: bd.Moment("load", b.end, swing, b.start),
    "fixed mass": lambda m, d, b: bd.PointMass("load", 0.4, on=b.at(1.1)),
    "Rayleigh": lambda m, d, b: bd.RayleighDamping("load", b, mass=0.7, stiffness=0.02),
    "spring": lambda m, d, b: bd.Spring(
        "load", d.at(0.3, -0.4), b.end, 3.0, free_length=0.9, preload=0.3
    ),
    "spring to ground": lambda m, d, b: bd.Spring("load", b.at(0.7), m.ground.at(2.0, 2.0), 3.0),
    "spring without length": lambda m, d, b: bd.Spring(
        "load", d.at(*TIP), b.end, 3.0, free_length=0.0
    ),
    "spring within a beam": lambda m, d, b: bd.Spring("load", b.start, b.end, 3.0, free_length=0.1),
    "spring and damper": lambda m, d, b: bd.Spring("load", d.at(0.3, -0.4), b.end, 3.0, 0.7),
    "law of a spring": lambda m, d, b: bd.Spring(
        "load", d.at(0.3, -0.4), b.end, law=lambda x, rate: 2.0 * np.sinh(x) + 0.3 * rate
    ),
    "law with energy": lambda m, d, b: bd.Spring(
        "load",
        d.at(0.3, -0.4),
        b.end,
        law=lambda x, rate: 2.0 * np.sinh(x) + 0.3 * np.tanh(rate),
        energy=lambda x: 2.0 * np.cosh(x),
    ),
    "torsion spring": lambda m, d, b: bd.TorsionSpring(
        "load", d.at(0.0, 0.0), b.end, 3.0, 0.4, free_angle=0.2, preload=1.0
    ),
    "bushing": lambda m, d, b: bd.Bushing(
        "load", b.end, d.at(*TIP), kx=3.0, ky=1.0, ktheta=0.4, cx=0.3, cy=0.2, ctheta=0.1
    ),
    "law of a bushing": lambda m, d, b: bd.Bushing(
        "load",
        d.at(0.1, 0.2),
        b.end,
        law=lambda x, rate: (x[0] ** 3 + rate[0], np.sin(x[1]), x[2] + 0.2 * rate[2]),
        energy=lambda x: 0.25 * x[0] ** 4 - np.cos(x[1]) + 0.5 * x[2] ** 2,
    ),
    "contact with a line": lambda m, d, b: bd.Contact(
        "load",
        b.end,
        bd.LineSurface(d.at(TIP[0], TIP[1] + 0.5), (1.0, 0.3)),
        7.0,
        restitution=0.8,
        impact_speed=3.0,
        friction=0.3,
        friction_speed=0.5,
    ),
    "contact with a circle": lambda m, d, b: bd.Contact(
        "load", d.at(0.1, 0.2), bd.CircleSurface(b.end, 30.0), 7.0, friction=0.3, friction_speed=0.5
    ),
    "contact along a beam": lambda m, d, b: bd.BeamContact(
        "load",
        b,
        bd.LineSurface(d.at(TIP[0], TIP[1] + 0.5), (1.0, 0.3)),
        7.0,
        start=0.3,
        restitution=0.8,
        impact_speed=3.0,
        friction=0.3,
        friction_speed=0.5,
    ),
    "contact inside a circle": lambda m, d, b: bd.Contact(
        "load", b.end, bd.CircleSurface(m.ground.at(*ARC.start), 0.1, "inside"), 7.0, 2.0
    ),
    "law of a force": lambda m, d, b: bd.ForceLaw(
        "load",
        (d.at(0.3, 0.1), b.end),
        lambda disk, tip, t: [
            (tip.position[0] * disk.rate, np.sin(t), disk.angle),
            tip.velocity - disk.velocity,
        ],
    ),
    "law of damping": lambda m, d, b: bd.ForceLaw(
        "load",
        b.end,
        lambda tip, t: -np.sqrt(tip.velocity @ tip.velocity + 1e-6) * tip.velocity,
        dissipative=True,
    ),
    "potential": lambda m, d, b: bd.ForceLaw(
        "load",
        b.end,
        lambda tip, t: (-2.0 * tip.position[0] - tip.velocity[0], 0.0, -3.0 * tip.angle**2),
        energy=lambda tip: tip.position[0] ** 2 + tip.angle**3,
        dissipative=True,
    ),
    "table of a spring": lambda m, d, b: bd.Spring(
        "load", d.at(0.3, -0.4), b.end, law=lambda x, rate: CURVE(x) + 0.1 * rate
    ),
    "map of a force": lambda m, d, b: bd.ForceLaw(
        "load",
        (d.at(0.3, 0.1), b.end),
        lambda disk, tip, t: [(0.0, 0.0, MAP(tip.angle, t)), (0, 0)],
    ),
    "table by place": lambda m, d, b: bd.DistributedForce(
        "load", b, lambda s, x, y, t: (CURVE(s), MAP(x, y))
    ),
    "dead load by length": lambda m, d, b: bd.DistributedForce("load", b, (swing, -2.0)),
    "pressure": lambda m, d, b: bd.DistributedForce("load", b, (0.0, swing), axes="section"),
    "load by place": lambda m, d, b: bd.DistributedForce(
        "load", b, lambda s, x, y, t: (np.sin(y) * t, s - x), axes="section"
    ),
    "air drag": lambda m, d, b: bd.AirDrag("load", b, 1.4),
}

# Kinematics as functions of (name, mesh, section).
KINEMATICS = {
    "tangent frame": partial(FloatingFrame, frame="tangent", strain="nonlinear"),
    "chord frame": partial(FloatingFrame, frame="chord", strain="nonlinear"),
    "chord frame, Green's strain": FloatingFrame,
    "section by a law": lambda name, mesh, section: FloatingFrame(
        name, mesh, VaryingSection(name, lambda s: section, mesh.curve.length)
    ),
    "chord frame, Reissner's strain": partial(FloatingFrame, strain="exact"),
    "nodes": GeometricallyExact,
    "nodes, section by a law": lambda name, mesh, section: GeometricallyExact(
        name, mesh, VaryingSection(name, lambda s: section, mesh.curve.length)
    ),
    "nodes, free shape": lambda name, mesh, section: GeometricallyExact(
        name, mesh, section, free_curve=mesh.curve
    ),
    "free shape": lambda name, mesh, section: FloatingFrame(
        name, mesh, section, free_curve=mesh.curve
    ),
}
