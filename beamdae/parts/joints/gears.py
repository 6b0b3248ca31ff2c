"""Couplings of angles and travels: gears, racks and pinions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.errors import BeamdaeError, convert_fields, optional, require_finite
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_direction,
    rotate,
)
from beamdae.parts.joints.guides import project_along
from beamdae.parts.joints.joint import Joint
from beamdae.parts.point_parts import PlacedPoint
from beamdae.symbolic.statements import SX, Variable


def _require_nonzero(part: str, name: str, value: Any) -> float:
    number = require_finite(part, name, value)
    if number == 0.0:
        raise BeamdaeError(f"{part}: {name} must not be zero, got 0.")
    return number


@dataclass(frozen=True, eq=False)
class Gear(Joint):
    """Coupled rotations of two wheels: g = (theta_b - theta_c) - ratio (theta_a - theta_c).

    theta_a, theta_b and theta_c are the rotations of the wheels and of the carrier from the
    reference configuration [rad]. The reaction M is the moment on the body of `b`. The moment on
    the body of `a` is -ratio M, and the carrier balances both. Bearing forces due to the mesh are
    not part of the reactions.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Any points of the two wheels; their bearings are separate joints.
    ratio
        Rotation of `b` per rotation of `a`, both relative to the carrier; negative for an external
        mesh, -r_a / r_b.
    carrier
        Any point of the body that carries the bearings, as in a planetary gear. Defaults to the
        ground.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a`, `b` or `carrier` is not an attachment or is a particle, two of
        them belong to the same body, or `ratio` is zero or not finite.

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
    symbol = "gear"
    multipliers = (Variable("angle", "N m"),)
    reactions = ("M",)

    def __post_init__(self) -> None:
        super().__post_init__()
        convert_fields(self, ratio=_require_nonzero, carrier=optional(require_attachment))
        if self.carrier is not None and self.carrier.body in (self.a.body, self.b.body):
            raise BeamdaeError(
                f"{self.name}: the carrier must be a body other than the wheels, "
                f"got {self.carrier}."
            )
        for point in self.points.values():
            require_angle(self.name, point)

    @property
    def points(self) -> dict[str, Attachment]:
        """Points "a", "b" and, if there is one, "carrier"."""
        wheels = {"a": self.a, "b": self.b}
        return wheels if self.carrier is None else wheels | {"carrier": self.carrier}

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Gear ratio [-], passed to the gap function."""
        return (self.ratio,)

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, *carrier_and_ratio: Any) -> SX:
        """Return the actual minus the prescribed rotation of `b` relative to the carrier [rad]."""
        *carriers, ratio = carrier_and_ratio
        carrier = carriers[0].rotation if carriers else 0
        return b.rotation - carrier - ratio * (a.rotation - carrier)


@dataclass(frozen=True, eq=False)
class RackAndPinion(Joint):
    """Pinion that rolls on a rack: g = travel - radius (theta_a - theta_b).

    The travel [m] is the displacement of `b`, a point of the rack, relative to `a`, the center of
    the pinion, along `direction`, which is fixed to the body of `b`. The travel and the rotations
    theta_a and theta_b [rad] are measured from the reference configuration. With a rack on the
    ground, the pinion is a rolling wheel; with a particle as the rack, the pinion is a winch.

    The reaction F is the force on the rack along its direction; -radius F is the moment on the
    pinion.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Center of the pinion, and a point of the rack; bearing and guide are separate joints.
    radius
        Radius of the pinion [m]; negative if the pinion is on the right of the rack's direction.
    direction
        Direction (x, y) of the rack in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, both belong to the same body, `a` is
        a particle, `radius` is zero or not finite, or `direction` is not a nonzero vector.
    """

    radius: float = 1.0
    direction: tuple[float, float] = (1.0, 0.0)
    _with_angle = ("a",)
    symbol = "rack and pinion"
    multipliers = (Variable("travel", "N"),)
    reactions = ("F",)

    def __post_init__(self) -> None:
        super().__post_init__()
        convert_fields(self, radius=_require_nonzero, direction=require_direction)

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Unit vector of the direction, reference distance along the direction, and radius [m]."""
        return (*project_along(self.direction, self.a, self.b), self.radius)

    @staticmethod
    def gap(
        t: SX, a: PlacedPoint, b: PlacedPoint, ex: SX, ey: SX, reference_distance: SX, radius: SX
    ) -> SX:
        """Return the travel of the rack minus the travel that the pinion prescribes [m]."""
        distance = ca.dot(rotate(b.rotation, (ex, ey)), b.position - a.position)
        return distance - reference_distance - radius * (a.rotation - b.rotation)
