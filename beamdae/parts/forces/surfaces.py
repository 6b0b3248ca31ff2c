"""Contact surfaces: straight lines and circles, fixed to the ground or to a body."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from beamdae.errors import (
    choice_of,
    convert_fields,
    require_positive,
)
from beamdae.parts.attachments import (
    Attachment,
    left_normal,
    require_angle,
    require_attachment,
    require_direction,
    rotate,
)
from beamdae.parts.point_parts import PlacedPoint, observe_points
from beamdae.symbolic.formula import constant_formula
from beamdae.symbolic.statements import SX, Local, Quantity, Variable, rebuilt_for_mesh

# Length added under the square root of the distance from the center, relative to the radius. It
# makes the distance differentiable at the center.
_CENTER_RATIO = 1e-8


def perpendicular(vector: SX) -> SX:
    """Return the vector rotated counter-clockwise by 90 degrees."""
    return ca.vertcat(-vector[1], vector[0])


def _line_gap(rotation: SX, arm: SX, numbers: Any) -> tuple[SX, SX]:
    """Return the gap and the tangent of a line; `numbers` are the components of its unit normal.

    `arm` is the vector from a point of the line to the contact point.
    """
    normal = rotate(rotation, ca.vertcat(numbers[0], numbers[1]))
    return ca.dot(normal, arm), -perpendicular(normal)


def _circle_gap(rotation: SX, arm: SX, numbers: Any) -> tuple[SX, SX]:
    """Return the gap and the tangent of a circle.

    `arm` is the vector from the center to the contact point; `numbers` are the radius and the
    allowed side, 1 for outside and -1 for inside.
    """
    distance = ca.sqrt(ca.sumsqr(arm) + (_CENTER_RATIO * numbers[0]) ** 2)
    return numbers[1] * (distance - numbers[0]), perpendicular(arm) / distance


@dataclass(frozen=True)
class _SurfaceGap:
    """Smallest distance from a surface, to which the last point belongs, to the other points."""

    surface: Callable[..., tuple[SX, SX]]

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], numbers: Callable[[], Any]
    ) -> SX:
        *others, (root, rotation) = points
        gaps = [self.surface(rotation, x.position - root, numbers())[0] for x in others]
        return ca.mmin(ca.vertcat(*gaps))


class _Surface:
    """Surface fixed to an attachment; the function `kind` returns gap and tangent."""

    on: Attachment
    kind: ClassVar[Callable[..., tuple[SX, SX]]]

    @property
    def numbers(self) -> tuple[float, ...]:
        """Parameters of the surface, passed to the kernel as data."""
        raise NotImplementedError

    @property
    def size(self) -> float:
        """Radius [m]; infinite for a line."""
        return math.inf

    @rebuilt_for_mesh
    def gap(self, point: Attachment) -> Quantity:
        """Return the distance of a point from the surface [m], negative during penetration.

        Parameters
        ----------
        point
            Attachment in contact.

        Returns
        -------
        Quantity
            One column, for observables, events and `impact`.

        Raises
        ------
        BeamdaeError
            If `point` is not an attachment.
        """
        return self.smallest_gap([require_attachment("gap", "point", point)])

    def smallest_gap(self, points: Sequence[Attachment]) -> Quantity:
        """Return the smallest distance of points from the surface [m]."""
        functions, columns = [constant_formula(*self.numbers)], (Variable("", "m"),)
        build, is_smallest = _SurfaceGap(type(self).kind), len(points) > 1
        return observe_points(
            [*points, self.on], build, columns, functions, is_magnitude=is_smallest
        )


@dataclass(frozen=True, eq=False)
class LineSurface(_Surface):
    """Straight line through `on` along `direction`; contact points stay on the left side.

    `bd.LineSurface(mech.ground.at(0, 0))` is a horizontal floor.

    Parameters
    ----------
    on
        Attachment to which the line is fixed; must not be a particle.
    direction
        Direction (x, y) in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `on` is not an attachment or is a particle, or `direction` is not a nonzero vector.
    """

    on: Attachment
    direction: tuple[float, float] = (1.0, 0.0)

    kind: ClassVar[Callable[..., tuple[SX, SX]]] = _line_gap

    def __post_init__(self) -> None:
        convert_fields(self, on=require_attachment, direction=require_direction)
        require_angle("LineSurface", self.on)

    @property
    def remedy(self) -> str:
        """Clause of a message that explains how to avoid a penetration at the start."""
        x, y = (0.0 - component for component in self.direction)
        return (
            "move the point to the left side of the line, or turn the direction of the line to "
            f"({x:g}, {y:g})"
        )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Left unit normal of the line in the reference configuration."""
        return left_normal(self.direction)


@dataclass(frozen=True, eq=False)
class CircleSurface(_Surface):
    """Circle centered at `on`; contact points stay outside or inside.

    Parameters
    ----------
    on
        Attachment at the center of the circle.
    radius
        Radius [m].
    side
        Allowed side of the contact points: "outside" (default) or "inside".

    Raises
    ------
    BeamdaeError
        If `on` is not an attachment, `radius` is not positive, or `side` is unknown.
    """

    on: Attachment
    radius: float
    side: str = "outside"

    kind: ClassVar[Callable[..., tuple[SX, SX]]] = _circle_gap

    def __post_init__(self) -> None:
        side = choice_of("outside", "inside")
        convert_fields(self, on=require_attachment, radius=require_positive, side=side)

    @property
    def size(self) -> float:
        """Radius [m]."""
        return self.radius

    @property
    def remedy(self) -> str:
        """Clause of a message that explains how to avoid a penetration at the start."""
        other_side = "inside" if self.side == "outside" else "outside"
        return (
            "move the point to where the distance from the center is "
            f"{'more' if self.side == 'outside' else 'less'} than {self.radius:g} m, or set "
            f'side="{other_side}"'
        )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Radius [m], and the allowed side: 1 for outside, -1 for inside."""
        return (self.radius, 1.0 if self.side == "outside" else -1.0)
