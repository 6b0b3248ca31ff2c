"""Surfaces that points touch: straight lines and circles, on the ground or on a body."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from beamdae.errors import BeamdaeError, require_choice, require_point, require_positive, set_fields
from beamdae.parts.attachments import Attachment, require_angle, require_attachment, rotate
from beamdae.symbolic.formulas import FormulaExpression, constant_formula
from beamdae.symbolic.statements import SX, Local, Named, Quantity

# Of the radius: the center has no nearest point of the circle, this much under the root gives one.
_CENTER_RATIO = 1e-8


def perpendicular(vector: SX) -> SX:
    """The vector turned by 90 degrees."""
    return ca.vertcat(-vector[1], vector[0])


def _line(turn: SX, way: SX, numbers: Any) -> tuple[SX, SX]:
    """Gap and tangent, of a point this way from one on the line; numbers: the normal."""
    normal = rotate(turn, ca.vertcat(numbers[0], numbers[1]))
    return ca.dot(normal, way), -perpendicular(normal)


def _circle(turn: SX, way: SX, numbers: Any) -> tuple[SX, SX]:
    """As `_line`, from the center; numbers: the radius, 1 outside and -1 inside."""
    distance = ca.sqrt(ca.sumsqr(way) + (_CENTER_RATIO * numbers[0]) ** 2)
    return numbers[1] * (distance - numbers[0]), perpendicular(way) / distance


@dataclass(frozen=True)
class _SurfaceGap:
    """Distance from a surface of some kind; `size` is of the point's local coordinates."""

    size: int
    surface: Callable[..., tuple[SX, SX]]

    def __call__(self, local: Local, a: Any, b: Any, drawn: Any) -> SX:
        place, _ = a(local.q[: self.size])
        root, turn = b(local.q[self.size :])
        return self.surface(SX(turn), place - root, drawn())[0]


class _Surface:
    """What surfaces have in common."""

    on: Attachment
    kind: ClassVar[Callable[..., tuple[SX, SX]]]

    @property
    def numbers(self) -> tuple[float, ...]:
        """Those of its kind."""
        raise NotImplementedError

    def gap(self, point: Attachment) -> Quantity:
        """Distance of a point from the surface [m], negative where it penetrates."""
        require_attachment("gap", "point", point)
        functions = (
            point.checked_kinematics,
            self.on.checked_kinematics,
            constant_formula(*self.numbers),
        )
        values, data = FormulaExpression.of(_SurfaceGap(point.size, type(self).kind), functions)
        return Quantity((Named("", "m"),), (point.piece, self.on.piece), values, data)


@dataclass(frozen=True, eq=False)
class LineSurface(_Surface):
    """A straight line through `on` along `direction`, what it touches lies on its left.

    It is fixed to the body of `on`; `bd.LineSurface(mech.ground.at(0, 0))` is the level ground.
    The direction (x, y) is that of the drawing.
    """

    on: Attachment
    direction: tuple[float, float] = (1.0, 0.0)

    kind: ClassVar[Callable[..., tuple[SX, SX]]] = _line

    def __post_init__(self) -> None:
        require_attachment("LineSurface", "on", self.on)
        set_fields(self, direction=require_point("LineSurface", "direction", self.direction))
        if not math.hypot(*self.direction) > 0.0:
            raise BeamdaeError("LineSurface: direction must have a length, got (0, 0).")
        require_angle("LineSurface", self.on)

    @property
    def numbers(self) -> tuple[float, ...]:
        """The normal."""
        x, y = self.direction
        length = math.hypot(x, y)
        return (-y / length, x / length)


@dataclass(frozen=True, eq=False)
class CircleSurface(_Surface):
    """A circle of `radius` [m] about `on`; what it touches is "outside" or "inside" of it."""

    on: Attachment
    radius: float
    side: str = "outside"

    kind: ClassVar[Callable[..., tuple[SX, SX]]] = _circle

    def __post_init__(self) -> None:
        require_attachment("CircleSurface", "on", self.on)
        set_fields(
            self,
            radius=require_positive("CircleSurface", "radius", self.radius),
            side=require_choice("CircleSurface", "side", self.side, ("outside", "inside")),
        )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Radius and side."""
        return (self.radius, 1.0 if self.side == "outside" else -1.0)
