"""Guides: points that slide along straight lines of a body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_point, set_fields
from beamdae.parts.attachments import Attachment, require_angle, rotate
from beamdae.parts.joints.joint import JointByFormula, meeting_tolerance
from beamdae.symbolic.formulas import constant_formula
from beamdae.symbolic.statements import SX, Named


def direction_of(part: str, value: Any) -> tuple[float, float]:
    """Return `value` if it is a direction."""
    direction = require_point(part, "direction", value)
    if np.hypot(*direction) == 0.0:
        raise BeamdaeError(f"{part}: direction must not be zero.")
    return direction


def left_normal(part: str, direction: Any) -> tuple[float, float]:
    """The left unit normal of a direction."""
    dx, dy = direction_of(part, direction)
    length = float(np.hypot(dx, dy))
    return -dy / length, dx / length


def along(
    direction: tuple[float, float], a: Attachment, b: Attachment
) -> tuple[float, float, float]:
    """The unit vector along a direction, and how far `b` is from `a` along it as drawn [m]."""
    ex, ey = (float(x) for x in np.divide(direction, np.hypot(*direction)))
    return ex, ey, ex * (b.point[0] - a.point[0]) + ey * (b.point[1] - a.point[1])


def across(
    direction: tuple[float, float], a: Attachment, b: Attachment
) -> tuple[float, float, float]:
    """The same along the left normal of a direction."""
    return along((-direction[1], direction[0]), a, b)


def _on_line(time: SX, a: Any, b: Any, normal: Callable[[], Any]) -> SX:
    return ca.dot(rotate(a[1], normal()), b[0] - a[0])


def _guided(time: SX, a: Any, b: Any, line: Callable[[], Any]) -> SX:
    numbers = line()
    offset = ca.dot(rotate(a[1], numbers), b[0] - a[0]) - numbers[2]
    return ca.vertcat(offset, b[1] - a[1])


@dataclass(frozen=True, eq=False)
class PointOnLine(JointByFormula):
    """Point `b` stays on the line through `a` along `direction`: g = n . (r_b - r_a).

    The line is fixed to the body of `a` and turns with it; n is its left normal. The reaction is
    the force on the body of `b` along n.
    """

    direction: tuple[float, float] = (1.0, 0.0)
    multipliers = (Named("normal", "N"),)
    reactions = ("F",)
    _gap = staticmethod(_on_line)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        set_fields(self, direction=direction_of(self.name, self.direction))
        *_, offset = across(self.direction, self.a, self.b)
        gap = abs(offset)
        if gap > meeting_tolerance(self.a, self.b):
            raise BeamdaeError(
                f"{self.name}: the point must lie on the line in the reference drawing, but "
                f"{self.b} is {gap:.6g} m off the line through {self.a}."
            )

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (constant_formula(*across(self.direction, self.a, self.b)[:2]),)


@dataclass(frozen=True, eq=False)
class Prismatic(JointByFormula):
    """A slider on an axis of a body: g = (n . (r_b - r_a) - offset, turn_b - turn_a).

    The axis goes through `a` along `direction`, is fixed to the body of `a` and turns with it; n is
    its left normal. The offset of `b` from the axis is that of the drawing. The reaction F is the
    force on the body of `b` along n, at its point; M the moment on it.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> ram = mech.add(bd.RigidBody("ram", mass=25.0, inertia=0.4, center=(0.5, 0.6)))
    >>> way = bd.Prismatic("way", mech.ground.at(0.0, 0.6), ram.at(0.5, 0.6), direction=(1.0, 0.0))
    """

    direction: tuple[float, float] = (1.0, 0.0)
    multipliers = (Named("normal", "N"), Named("angle", "N m"))
    reactions = ("F", "M")
    _gap = staticmethod(_guided)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        set_fields(self, direction=direction_of(self.name, self.direction))

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (constant_formula(*across(self.direction, self.a, self.b)),)
