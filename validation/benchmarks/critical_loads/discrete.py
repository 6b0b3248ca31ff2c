"""Rigid bars on springs: critical loads in closed form, without a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

import beamdae as bd
from benchmarks.critical_loads.case import (
    BRANCH,
    FLUTTER,
    CriticalLoad,
    CriticalLoadCase,
)


def build_bars(
    count: int,
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
    for k in range(count):
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


def _discrete_case(
    name: str,
    source: str,
    end: float,
    loads: tuple[CriticalLoad, ...],
    count: int = 2,
    masses: tuple[float, ...] = (2.0, 1.0),
    follower: float = 0.0,
    damping: tuple[float, ...] = (),
    lateral: float = 0.0,
    rotational: float = 1.0,
) -> CriticalLoadCase:
    return CriticalLoadCase(
        "rigid bars",
        name,
        source,
        build=partial(build_bars, count, masses, follower, damping, lateral, rotational),
        reference=lambda slenderness, strain: loads,
        path=lambda slenderness: {"to": end},
        phase=lambda load: 0.0,
        published=loads[0].load,
        order=0,
        axial_force=lambda load: 1.0,
        formulations=("exact",),
        slenderness=(1e1,),
    )


_ZIEGLER = "H. Ziegler, Ing.-Arch. 20 (1952) 49"
# Bars in a chain of two: P l / c is an eigenvalue of [[2, -1], [-1, 1]].
_TWO_BARS = tuple(CriticalLoad(BRANCH, 0.5 * (3.0 + sign * np.sqrt(5.0))) for sign in (-1.0, 1.0))
# ... and of three: 2 - 2 cos((2 k - 1) pi / 7).
_THREE_BARS = tuple(
    CriticalLoad(BRANCH, 2.0 - 2.0 * np.cos((2.0 * k - 1.0) * np.pi / 7.0)) for k in (1, 2, 3)
)

_DAMPING = 0.02

DISCRETE_CASES = (
    _discrete_case(
        "inverted pendulum, torsion spring", "P l = c", 3.0, (CriticalLoad(BRANCH, 1.0),), 1, (1.0,)
    ),
    _discrete_case(
        "inverted pendulum, lateral spring",
        "P = k l",
        3.0,
        (CriticalLoad(BRANCH, 1.0),),
        1,
        (1.0,),
        lateral=1.0,
        rotational=0.0,
    ),
    _discrete_case(
        "two bars, dead load", "Bazant & Cedolin (1991): (3 -+ sqrt 5) / 2", 4.0, _TWO_BARS
    ),
    _discrete_case(
        "three bars, dead load", "2 - 2 cos((2 k - 1) pi / 7)", 4.0, _THREE_BARS, 3, (1.0, 1.0, 1.0)
    ),
    _discrete_case(
        "Ziegler, no damping",
        f"{_ZIEGLER}: 7 / 2 - sqrt 2",
        3.0,
        (CriticalLoad(FLUTTER, 3.5 - np.sqrt(2.0)),),
        follower=1.0,
    ),
    _discrete_case(
        "Ziegler, equal dampers",
        f"{_ZIEGLER}: 41 / 28 + b^2 / (2 c m l^2)",
        2.0,
        (CriticalLoad(FLUTTER, 41.0 / 28.0 + 0.5 * _DAMPING**2),),
        follower=1.0,
        damping=(_DAMPING, _DAMPING),
    ),
    _discrete_case(
        # The stiffness [[2 - p, f p - 1], [-1, 1 - (1 - f) p]] is singular.
        "two bars, a quarter of the load follows",
        f"{_ZIEGLER}: divergence",
        1.2,
        (CriticalLoad(BRANCH, 1.5 - np.sqrt(2.25 - 1.0 / 0.75)),),
        follower=0.25,
    ),
)
