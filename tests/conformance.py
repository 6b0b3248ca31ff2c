"""What exists: every integrator, joint, load and beam kinematics enters the laws by a line here."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from support import ARC

import beamdae as bd
from beamdae.beams.floating_frame import FloatingFrame
from beamdae.beams.varying import VaryingSection
from beamdae.equations.formulations import FIRST_ORDER

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
    """All integrators at this tolerance or step, and with whatever of `settings` they know."""

    def settled(integrator):
        known = {field.name for field in fields(integrator)}
        given = {name: value for name, value in settings.items() if name in known}
        if integrator.accuracy.name == "step":
            # Without a tolerance a limit of steps means nothing.
            given.pop("max_steps", None)
        refined = {"rtol": rtol, "step": step}[integrator.accuracy.name]
        return replace(integrator, **{integrator.accuracy.name: refined}, **given)

    return {name: settled(one) for name, one in (INTEGRATORS | (also or {})).items()}


def integrators(rtol, step, also=None, slow=(), **settings):
    """The same, for tests that take an `integrator`; those named `slow` run with the slow tests."""
    chosen = tuned(rtol, step, also, **settings)
    return pytest.mark.parametrize(
        "integrator",
        [
            pytest.param(one, id=name, marks=[pytest.mark.slow] if name in slow else [])
            for name, one in chosen.items()
        ],
    )


TIP = tuple(ARC.point(ARC.length))


# Of the end of the beam from (3, 0).
DRAWN_LINK = float(np.hypot(TIP[0] - 3.0, TIP[1]))


def swing(t):
    return 0.4 * np.sin(2.0 * t) + t**2


# Of a mechanism with a disk and a beam on ARC, each apart from the other; the name has to be "j".
JOINTS = {
    "revolute to ground": lambda m, d, b: bd.Revolute("j", m.ground.at(0.1, 0.2), d.at(0.1, 0.2)),
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
        "j", m.ground.at(3.0, 0.0), b.end, lambda t: DRAWN_LINK + 0.1 * swing(t)
    ),
    "gear": lambda m, d, b: bd.Gear("j", b.start, d.at(0.0, 0.0), -1.7),
    "planetary gear": lambda m, d, b: bd.Gear(
        "j", m.ground.at(0.0, 0.0), d.at(0.0, 0.0), 0.4, carrier=b.end
    ),
    "rack and pinion": lambda m, d, b: bd.RackAndPinion(
        "j", d.at(0.5, 0.4), b.start, 0.3, (1.0, 0.2)
    ),
    "sliding from the start": lambda m, d, b: bd.SlidingOnBeam("j", d.at(*ARC.start), b),
    "sliding in the span": lambda m, d, b: bd.SlidingOnBeam("j", d.at(*ARC.point(1.0)), b),
    "travel": lambda m, d, b: bd.TranslationalDriver(
        "j", d.at(0.0, 0.0), b.end, swing, (0.3, -1.0)
    ),
}

# Of the same mechanism; the name has to be "load".
LOADS = {
    "dead force": lambda m, d, b: bd.Force("load", b.end, (swing, -2.0)),
    "follower force": lambda m, d, b: bd.Force("load", b.at(0.7), (swing, 3.0), axes="body"),
    "moment": lambda m, d, b: bd.Moment("load", b.end, swing),
    "force on a rigid body": lambda m, d, b: bd.Force("load", d.at(1.0, 1.0), (swing, 1.0), "body"),
    "fixed mass": lambda m, d, b: bd.PointMass("load", 0.4, on=b.at(1.1)),
    "Rayleigh": lambda m, d, b: bd.RayleighDamping("load", b, mass=0.7, stiffness=0.02),
    "air drag": lambda m, d, b: bd.AirDrag("load", b, 1.4),
}

# Functions of (name, mesh, section).
KINEMATICS = {
    "tangent frame": partial(FloatingFrame, frame="tangent", strain="nonlinear"),
    "chord frame": partial(FloatingFrame, frame="chord", strain="nonlinear"),
    "chord frame, Green's strain": FloatingFrame,
    "section by a law": lambda name, mesh, section: FloatingFrame(
        name, mesh, VaryingSection(name, lambda s: section)
    ),
    "free shape": lambda name, mesh, section: FloatingFrame(
        name, mesh, section, free_curve=mesh.curve
    ),
}
