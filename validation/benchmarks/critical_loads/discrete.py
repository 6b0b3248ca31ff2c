"""Rigid bars on springs: critical loads in closed form, without a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import beamdae as bd
from benchmarks.critical_loads.case import CriticalLoad


def build_bars(
    masses: tuple[float, ...],
    follower: float,
    damping: tuple[float, ...],
    lateral: float,
    rotational: float,
    slenderness: float,
    elements: int,
    settings: Mapping[str, Any],
) -> bd.Mechanism:
    """Return a chain of upright unit bars with springs and dampers in the hinges.

    Bar k carries the point mass `masses[k]` at its upper end and has negligible inertia; every
    joint has the torsion spring `rotational`, and every upper end a spring `lateral` to the ground.
    A unit load acts on the last end; the fraction `follower` of it rotates with the last bar.
    """
    mech = bd.Mechanism()
    light = {"mass": 1e-9, "inertia": 1e-9}
    lower, height = mech.ground.at(0.0, 0.0), 0.0
    for k in range(len(masses)):
        bar = mech.add(bd.RigidBody(f"bar {k}", **light, center=(0.0, height + 1.0)))
        foot, head = bar.at(0.0, height), bar.at(0.0, height + 1.0)
        mech.add(bd.Revolute(f"hinge {k}", lower, foot))
        damper = damping[k] if damping else 0.0
        if rotational or damper:
            mech.add(bd.TorsionSpring(f"spring {k}", lower, foot, rotational, damping=damper))
        if lateral:
            ground = mech.ground.at(0.0, height + 1.0)
            mech.add(bd.Bushing(f"support {k}", ground, head, kx=lateral))
        mech.add(bd.PointMass(f"mass {k}", masses[k], on=head))
        lower, height = head, height + 1.0
    for name, axes, share in (("dead", "inertial", 1.0 - follower), ("follower", "body", follower)):
        if share:
            mech.add(bd.Force(name, lower, (0.0, -share), axes=axes))
    return mech


def bars(
    end: float,
    loads: tuple[tuple[str, float], ...],
    masses: tuple[float, ...],
    follower: float = 0.0,
    damping: tuple[float, ...] = (),
    lateral: float = 0.0,
    rotational: float = 1.0,
) -> dict[str, Any]:
    """Return the fields of a case of rigid bars with known critical points."""
    points = tuple(CriticalLoad(*load) for load in loads)
    return {
        "build": partial(build_bars, masses, follower, damping, lateral, rotational),
        "reference": lambda slenderness, strain: points,
        "path": lambda slenderness: {"to": end},
        "phase": lambda load: 0.0,
        "order": 0,
        "axial_force": lambda load: 1.0,
        "formulations": ("exact",),
        "slenderness": (1e1,),
    }
