"""Couplings of angles and travels: gears, racks and pinions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.errors import BeamdaeError, require_finite, set_fields
from beamdae.parts.attachments import Attachment, require_angle, require_attachment, rotate
from beamdae.parts.joints.guides import along, direction_of
from beamdae.parts.joints.joint import JointByFormula
from beamdae.symbolic.formulas import constant_formula
from beamdae.symbolic.statements import SX, Named


def _nonzero(part: str, name: str, value: Any) -> float:
    found = require_finite(part, name, value)
    if found == 0.0:
        raise BeamdaeError(f"{part}: {name} must not be zero.")
    return found


def _geared(time: SX, a: Any, b: Any, *more: Any) -> SX:
    *carriers, ratio = more
    carrier = carriers[0][1] if carriers else 0
    return b[1] - carrier - ratio()[0] * (a[1] - carrier)


def _rolling(time: SX, a: Any, b: Any, numbers: Callable[[], Any]) -> SX:
    ex, ey, drawn, radius = (numbers()[k] for k in range(4))
    travel = ca.dot(rotate(b[1], ca.vertcat(ex, ey)), b[0] - a[0]) - drawn
    return travel - radius * (a[1] - b[1])


@dataclass(frozen=True, eq=False)
class Gear(JointByFormula):
    """Coupled turns: g = turn_b - turn_c - ratio (turn_a - turn_c), turns since the drawing [rad].

    Parameters
    ----------
    name
        Unique name.
    a, b
        Any points of the two wheels; their bearings are joints of their own.
    ratio
        Turn of `b` for each turn of `a`, both seen from the carrier: negative where the wheels
        mesh from outside, -r_a / r_b.
    carrier
        Any point of the body the wheels are seen from, as in a planetary gear; None: the ground.

    The reaction M is the moment on the body of `b`; that on `a` is -ratio M, and the carrier has
    the rest. The forces of the mesh on the bearings are not among the reactions.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> pinion = mech.add(bd.RigidBody("pinion", mass=0.1, inertia=1e-5))
    >>> wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=1e-3, center=(0.06, 0.0)))
    >>> gear = bd.Gear("gear", pinion.at(0.0, 0.0), wheel.at(0.06, 0.0), ratio=-0.2)
    """

    ratio: float = -1.0
    carrier: Attachment | None = None
    multipliers = (Named("angle", "N m"),)
    reactions = ("M",)
    _gap = staticmethod(_geared)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_fields(self, ratio=_nonzero(self.name, "ratio", self.ratio))
        if self.carrier is not None:
            require_attachment(self.name, "carrier", self.carrier)
            if self.carrier.body in (self.a.body, self.b.body):
                raise BeamdaeError(
                    f"{self.name}: the carrier must be another body than the wheels, "
                    f"got {self.carrier}."
                )
        for place in self._points.values():
            require_angle(self.name, place)

    @property
    def _points(self) -> dict[str, Attachment]:
        wheels = {"a": self.a, "b": self.b}
        return wheels if self.carrier is None else wheels | {"carrier": self.carrier}

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (constant_formula(self.ratio),)


@dataclass(frozen=True, eq=False)
class RackAndPinion(JointByFormula):
    """A pinion that rolls on a rack: g = travel - radius (turn_a - turn_b), since the drawing.

    The travel [m] is that of `b`, a point of the rack, from `a`, the center of the pinion, along
    `direction`, which is fixed to the body of `b`. A rack on the ground makes a wheel that rolls; a
    particle as a rack hangs on a winch.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Center of the pinion, and a point of the rack; bearing and guide are joints of their own.
    radius
        Of the pinion [m]; negative where it lies to the right of the rack's direction.
    direction
        Along the rack.

    The reaction F is the force on the rack along its direction, -radius F the moment on the pinion.
    """

    radius: float = 1.0
    direction: tuple[float, float] = (1.0, 0.0)
    multipliers = (Named("travel", "N"),)
    reactions = ("F",)
    _gap = staticmethod(_rolling)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        set_fields(
            self,
            radius=_nonzero(self.name, "radius", self.radius),
            direction=direction_of(self.name, self.direction),
        )

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (constant_formula(*along(self.direction, self.a, self.b), self.radius),)
