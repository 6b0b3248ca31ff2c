"""Guides: points that slide along straight lines fixed to a body."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from beamdae.errors import BeamdaeError, convert_fields
from beamdae.parts.attachments import Attachment, normalize, require_direction, rotate
from beamdae.parts.joints.joint import Joint, meeting_tolerance
from beamdae.parts.part import PlacedPoint
from beamdae.symbolic.statements import SX, Variable


def project_along(
    direction: tuple[float, float], a: Attachment, b: Attachment
) -> tuple[float, float, float]:
    """Return ex, ey of the unit vector e of `direction`, and e . (r_b - r_a) [m].

    r_a and r_b are the positions of the points in the reference configuration.
    """
    ex, ey = normalize(direction)
    return ex, ey, ex * (b.point[0] - a.point[0]) + ey * (b.point[1] - a.point[1])


def project_across(
    direction: tuple[float, float], a: Attachment, b: Attachment
) -> tuple[float, float, float]:
    """Return nx, ny of the left unit normal n of `direction`, and n . (r_b - r_a) [m].

    r_a and r_b are the positions of the points in the reference configuration.
    """
    return project_along((-direction[1], direction[0]), a, b)


@dataclass(frozen=True, eq=False)
class _Guide(Joint):
    """Joint of a point that slides along `direction`, which is fixed to the body of `a`."""

    direction: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        convert_fields(self, direction=require_direction)

    @property
    def slide_direction(self) -> tuple[float, float]:
        """Direction in the reference configuration."""
        return self.direction


@dataclass(frozen=True, eq=False)
class PointOnLine(_Guide):
    """Point `b` stays on the line through `a` along `direction`: g = n . (r_b - r_a).

    The line is fixed to the body of `a` and rotates with it; n is its left normal, and r_a and r_b
    are the positions of the points. The reaction F is the force on the body of `b` along n.

    Parameters
    ----------
    name
        Unique name.
    a, b
        A point of the line, and the sliding point, on two different bodies. `a` may belong to the
        ground but not to a particle.
    direction
        Direction (x, y) of the line in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, both belong to the same body, `a` is
        a particle, `direction` is not a nonzero vector, or `b` does not lie on the line in the
        reference configuration (with a tolerance of 1e-6 times the size of the bodies).
    """

    _with_angle = ("a",)
    symbol = "slot"
    multipliers = (Variable("normal", "N"),)
    reactions = ("F",)

    def __post_init__(self) -> None:
        super().__post_init__()
        *_, offset = project_across(self.direction, self.a, self.b)
        gap = abs(offset)
        if gap > meeting_tolerance(self.a, self.b):
            raise BeamdaeError(
                f"{self.name}: the point must lie on the line in the reference "
                f"configuration, but {self.b} is {gap:.6g} m off the line through "
                f"{self.a}."
            )

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Left unit normal of the line in the reference configuration."""
        return project_across(self.direction, self.a, self.b)[:2]

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, nx: SX, ny: SX) -> SX:
        """Return the distance of `b` from the line [m], positive on the left of the line."""
        return ca.dot(rotate(a.rotation, (nx, ny)), b.position - a.position)


@dataclass(frozen=True, eq=False)
class Prismatic(_Guide):
    """Slider on an axis of a body: g = (n . (r_b - r_a) - offset, rotation_b - rotation_a).

    The axis passes through `a` along `direction`, is fixed to the body of `a` and rotates with it;
    n is its left normal. The offset of `b` from the axis keeps its value in the reference
    configuration. The reaction F is the force on the body of `b` along n, at point `b`, and M the
    moment on this body.

    Parameters
    ----------
    name
        Unique name.
    a, b
        A point of the axis, and the sliding point, on two different bodies. Neither may be a
        particle; one of them may belong to the ground.
    direction
        Direction (x, y) of the axis in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, both belong to the
        same body, or `direction` is not a nonzero vector.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> ram = mech.add(bd.RigidBody("ram", mass=25.0, inertia=0.4, center=(0.5, 0.6)))
    >>> way = bd.Prismatic("way", mech.ground.at(0.0, 0.6), ram.at(0.5, 0.6), direction=(1.0, 0.0))
    """

    _with_angle = ("a", "b")
    symbol = "slider"
    multipliers = (Variable("normal", "N"), Variable("angle", "N m"))
    reactions = ("F", "M")

    @property
    def gap_parameters(self) -> tuple[float, ...]:
        """Left unit normal of the axis in the reference configuration, and offset of `b` [m]."""
        return project_across(self.direction, self.a, self.b)

    @staticmethod
    def gap(t: SX, a: PlacedPoint, b: PlacedPoint, nx: SX, ny: SX, offset: SX) -> SX:
        """Return the change of the offset of `b` [m], and the relative rotation [rad]."""
        normal = rotate(a.rotation, (nx, ny))
        return ca.vertcat(ca.dot(normal, b.position - a.position) - offset, b.rotation - a.rotation)
