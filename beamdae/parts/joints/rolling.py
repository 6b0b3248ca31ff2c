"""Couplings without slip: gears, racks and pinions, rolling disks and skates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    format_distinct,
    optional,
    require_finite,
    require_pair,
    require_positive,
    set_fields,
)
from beamdae.parts.attachments import (
    Attachment,
    left_normal,
    require_angle,
    require_attachment,
    require_direction,
    require_movable,
    rotate,
)
from beamdae.parts.joints.guides import project_across, project_along
from beamdae.parts.joints.joint import Joint, KinematicConstraint, MovingPoint
from beamdae.parts.part import PlacedPoint
from beamdae.symbolic.statements import SX, Quantity, Variable


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


# Relative to the radius; allows for coordinates rounded by hand.
_CONTACT_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class _RollingJoint(Joint):
    """Joint of a rolling disk with center `b`: normal and tangential reaction at the contact."""

    _with_angle = ("a", "b")
    multipliers = (Variable("normal", "N"), Variable("rolling", "N"))
    reactions = ("Fn", "Ft")


@dataclass(frozen=True, eq=False)
class RollingOnLine(_RollingJoint):
    """Disk with center `b` that rolls without slip on the line through `a` along `direction`.

    The line is fixed to the body of `a` and rotates with it; n is its left normal, t its direction.
    The distance of the center from the line is constant, n . (r_b - r_a) = h = +-radius. In the
    plane, rolling on a line is holonomic: t . (r_b - r_a) + h (rotation_b - rotation_a) is
    constant. Reactions Fn and Ft are the components along n and t of the force on the disk at the
    contact.

    Parameters
    ----------
    name
        Unique name.
    a, b
        A point of the line, and the center of the disk, on two different bodies. Neither may be a
        particle; one of them may belong to the ground.
    radius
        Radius of the disk [m]; required. The disk must touch the line in the reference
        configuration, with a tolerance of 1e-6 times the radius.
    direction
        Direction (x, y) of the line in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, both belong to the
        same body, `radius` is not positive, `direction` is not a nonzero vector, or the disk does
        not touch the line in the reference configuration.
    """

    radius: float = 0.0
    direction: tuple[float, float] = (1.0, 0.0)
    symbol = "rolling on line"

    def __post_init__(self) -> None:
        super().__post_init__()
        convert_fields(self, radius=require_positive, direction=require_direction)
        height = abs(project_across(self.direction, self.a, self.b)[-1])
        if abs(height - self.radius) > _CONTACT_TOLERANCE * self.radius:
            distance, radius = format_distinct(height, self.radius)
            raise BeamdaeError(
                f"{self.name}: the disk must touch the line in the reference configuration, but "
                f"the center {self.b} is {distance} m off the line through {self.a} and the radius "
                f"is {radius} m."
            )

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Unit normal of the line, and reference height and travel of the disk [m]."""
        *_, travel = project_along(self.direction, self.a, self.b)
        return (*project_across(self.direction, self.a, self.b), travel)

    @staticmethod
    def gap(
        t: SX, a: PlacedPoint, b: PlacedPoint, nx: SX, ny: SX, height: SX, reference_travel: SX
    ) -> SX:
        """Return the change of the distance from the line, and the accumulated slip [m]."""
        normal, arm = rotate(a.rotation, (nx, ny)), b.position - a.position
        along = normal[1] * arm[0] - normal[0] * arm[1]
        slip = along - reference_travel + height * (b.rotation - a.rotation)
        return ca.vertcat(ca.dot(normal, arm) - height, slip)


@dataclass(frozen=True, eq=False)
class RollingOnCircle(_RollingJoint):
    """Disk with center `b` that rolls without slip on a circle around `a`.

    The circle is fixed to the body of `a`; the disk may lie outside or inside it. The distance of
    the centers is constant, and the slip at the contact is zero. In the plane, the condition of
    zero slip is integrable; it is imposed on velocities only, so the rotation of the disk may drift
    within the integration error. Reactions Fn and Ft are the components of the force on the disk at
    the contact along e, the direction from `a` to `b`, and along the left normal of e.

    Parameters
    ----------
    name
        Unique name.
    a, b
        Centers of the circle and of the disk, on two different bodies. Neither may be a particle;
        one of them may belong to the ground.
    radii
        Radii of the circle and of the disk [m]; required. In the reference configuration, the
        distance of the centers must not be zero and must be the sum or the difference of the radii,
        with a tolerance of 1e-6 times the larger radius.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, both belong to the
        same body, `radii` is not a pair of positive numbers, or the disk does not touch the circle
        in the reference configuration.
    """

    radii: tuple[float, float] = (0.0, 0.0)
    symbol = "rolling on circle"

    def __post_init__(self) -> None:
        super().__post_init__()
        radii = require_pair(self.name, "radii", self.radii, "a pair (of the circle, of the disk)")
        set_fields(
            self, radii=tuple(require_positive(self.name, "radii", radius) for radius in radii)
        )
        _ = self.gap_parameters

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Signed distances along e from the centers of circle and disk to the contact [m].

        Raises
        ------
        BeamdaeError
            If the disk does not touch the circle in the reference configuration.
        """
        distance, (circle, disk) = math.dist(self.a.point, self.b.point), self.radii
        arms_by_distance = {
            circle + disk: (circle, -disk),
            circle - disk: (circle, disk),
            disk - circle: (-circle, -disk),
        }
        for touching_distance, arms in arms_by_distance.items():
            tolerance = _CONTACT_TOLERANCE * max(self.radii)
            if touching_distance > 0.0 and abs(touching_distance - distance) <= tolerance:
                return arms
        radii = f"{circle:.9g} m and {disk:.9g} m"
        drawn, *_ = format_distinct(distance, *arms_by_distance)
        raise BeamdaeError(
            f"{self.name}: the disk must touch the circle in the reference configuration, but the "
            f"distance between the centers {self.b} and {self.a}, {drawn} m, is neither the sum "
            f"nor the difference of the radii {radii}."
        )

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, arm_a: SX, arm_b: SX) -> SX:
        """Return the distance between the centers minus its prescribed value [m]."""
        return ca.norm_2(b.position - a.position) - (arm_a - arm_b)

    @staticmethod
    def slip(t: SX, a: MovingPoint, b: MovingPoint, arm_a: SX, arm_b: SX) -> SX:
        """Return the velocity of the disk relative to the circle at the contact [m/s]."""
        arm, rate = b.position - a.position, b.velocity - a.velocity
        across = (arm[0] * rate[1] - arm[1] * rate[0]) / ca.norm_2(arm)
        return across + arm_b * b.angular_velocity - arm_a * a.angular_velocity


@dataclass(frozen=True, eq=False)
class Skate(KinematicConstraint):
    """Skate (knife edge): the point `on` does not move across `direction`.

    The direction rotates with the body; n is its left normal, and v is the velocity of the point.
    The constraint n . v = 0 is nonholonomic: the constraint restricts the velocity, but not the
    positions that the body can reach. The reaction F is the force on the body along n.

    Parameters
    ----------
    name
        Unique name.
    on
        Point of the blade on a body that can move and is not a particle.
    direction
        Direction (x, y) of the blade in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `on` is not an attachment, belongs to the ground or is a particle, or
        `direction` is not a nonzero vector.
    """

    name: str
    on: Attachment
    direction: tuple[float, float] = (1.0, 0.0)
    symbol = "skate"
    multipliers = (Variable("side", "N"),)
    reactions = ("F",)

    def __post_init__(self) -> None:
        convert_fields(self, on=require_movable)
        require_angle(self.name, self.on)
        convert_fields(self, direction=require_direction)

    @property
    def points(self) -> dict[str, Attachment]:
        """The point of the blade, "on"."""
        return {"on": self.on}

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Left unit normal of the blade in the reference configuration."""
        return left_normal(self.direction)

    @staticmethod
    def slip(t: SX, on: MovingPoint, nx: SX, ny: SX) -> SX:
        """Return the velocity of the point across the blade [m/s]."""
        return ca.dot(rotate(on.rotation, (nx, ny)), on.velocity)

    def reaction_on(self, place: str = "on", axes: str = "inertial") -> Quantity:
        """Return force Fx, Fy [N] and moment M [N m] on the body, at the blade; M is zero.

        Parameters
        ----------
        place
            Name of the point, which must be "on".
        axes
            "inertial", or "body" for axes that rotate with the body; in the reference
            configuration, these are the inertial axes.

        Raises
        ------
        BeamdaeError
            If `place` is not "on", or `axes` is invalid.
        """
        return super().reaction_on(place, axes)
