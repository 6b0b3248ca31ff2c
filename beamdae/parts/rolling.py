"""Rolling without slip, and blades that do not slip sideways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, keep, pair, point, positive
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    require_movable,
    rotate,
)
from beamdae.parts.joints import Joint
from beamdae.parts.part import Part, require_name
from beamdae.symbolic.formulas import Combined, combined_kernel, plain
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    NonholonomicKernel,
    Quantity,
)

# Relative to the radius: what rounding a drawing's numbers by hand may cost.
_TOUCHING = 1e-6


def left_normal(part: str, direction: Any) -> tuple[float, float]:
    """The left unit normal of a direction that is not zero."""
    dx, dy = point(part, "direction", direction)
    length = float(np.hypot(dx, dy))
    if length == 0.0:
        raise BeamdaeError(f"{part}: direction must not be zero.")
    return -dy / length, dx / length


@dataclass(frozen=True)
class _OnLine:
    """Contact and travel of a disk on a line; `size` is of the line's local coordinates."""

    size: int

    def __call__(self, local: Local, a: Any, b: Any, numbers: Callable[[], Any]) -> Any:
        (root, turned), (center, turn) = a(local.q[: self.size]), b(local.q[self.size :])
        nx, ny, height, start = (numbers()[k] for k in range(4))
        normal, arm = rotate(turned, (nx, ny)), center - root
        along = normal[1] * arm[0] - normal[0] * arm[1]
        travel = along - start + height * (turn - turned)
        return ConstraintKernel(local, ca.vertcat(ca.dot(normal, arm) - height, travel))


@dataclass(frozen=True)
class _Apart:
    """Distance of two centers; `size` is of the first one's local coordinates."""

    size: int

    def __call__(self, local: Local, a: Any, b: Any, arms: Callable[[], Any]) -> Any:
        arm = b(local.q[self.size :])[0] - a(local.q[: self.size])[0]
        return ConstraintKernel(local, ca.norm_2(arm) - (arms()[0] - arms()[1]))


@dataclass(frozen=True)
class _OnCircle:
    """Slip at the contact of two circles, which is by `arms` off their centers."""

    size: int

    def __call__(self, local: Local, a: Any, b: Any, arms: Callable[[], Any]) -> Any:
        (root, turned), (center, turn) = a(local.q[: self.size]), b(local.q[self.size :])
        arm = center - root
        rate = local.dot(arm)
        across = (arm[0] * rate[1] - arm[1] * rate[0]) / ca.norm_2(arm)
        slip = across + arms()[1] * local.dot(turn) - arms()[0] * local.dot(turned)
        return NonholonomicKernel(local, slip)


@dataclass(frozen=True, eq=False)
class _Rolling(Joint):
    """What both kinds of rolling have in common."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("normal", "N"), Named("rolling", "N"))

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("Fn", "Ft")

    @property
    def _drawn(self) -> np.ndarray:
        return np.subtract(self.b.point, self.a.point)

    def _statement(
        self, build: Callable[..., Any], held: tuple[Named, ...], *numbers: float
    ) -> ConstraintStatement:
        functions, size = (self.a.moved, self.b.moved, plain(*numbers)), self.a.size + self.b.size
        kernel, data = combined_kernel(build, functions, size, len(held))
        return ConstraintStatement(self.name, kernel, (self.a.piece, self.b.piece), held, data)


@dataclass(frozen=True, eq=False)
class RollingOnLine(_Rolling):
    """A disk with center `b` rolls without slip on the line through `a` along `direction`.

    The line is fixed to the body of `a` and turns with it; n is its left normal, t its direction.
    The disk stays at its distance, n . (r_b - r_a) = h = +-radius as drawn, and in the plane
    rolling is holonomic: t . (r_b - r_a) + h (turn_b - turn_a) stays as it is. Reactions Fn and Ft
    are the components along n and t of the force on the disk at the contact.

    Parameters
    ----------
    name, a, b
        Unique name, a point of the line, and the center of the disk.
    radius
        Of the disk [m].
    direction
        Of the line in the drawing.
    """

    radius: float = 0.0
    direction: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, radius=positive(self.name, "radius", self.radius))
        gap = abs(float(self._drawn @ left_normal(self.name, self.direction)))
        if abs(gap - self.radius) > _TOUCHING * self.radius:
            raise BeamdaeError(
                f"{self.name}: the disk must touch the line in the reference drawing, but its "
                f"center {self.b} is {gap:.6g} m off the line through {self.a}, its radius is "
                f"{self.radius:.6g} m."
            )

    def constraints(self) -> list[ConstraintStatement]:
        """Contact and rolling."""
        nx, ny = left_normal(self.name, self.direction)
        dx, dy = self._drawn.tolist()
        numbers = (nx, ny, nx * dx + ny * dy, ny * dx - nx * dy)
        return [self._statement(_OnLine(self.a.size), self.multipliers, *numbers)]


@dataclass(frozen=True, eq=False)
class RollingOnCircle(_Rolling):
    """A disk with center `b` rolls without slip on a circle around `a`, which turns with its body.

    Outside or inside, as drawn. The centers keep their distance; rolling is a nonholonomic
    constraint: the slip at the contact is zero. Reactions Fn and Ft are the components of the force
    on the disk at the contact along e, which points from `a` to `b`, and to the left of it.

    Parameters
    ----------
    name, a, b
        Unique name, the center of the circle, and the center of the disk.
    radii
        Of the circle and of the disk [m].
    """

    radii: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        radii = pair(self.name, "radii", self.radii, "a pair (of the circle, of the disk)")
        keep(self, radii=tuple(positive(self.name, "radii", radius) for radius in radii))
        _ = self._arms

    @property
    def _arms(self) -> tuple[float, float]:
        """Where the contact is, from each center along e."""
        distance, (circle, disk) = float(np.hypot(*self._drawn)), self.radii
        arms = {
            circle + disk: (circle, -disk),
            circle - disk: (circle, disk),
            disk - circle: (-circle, -disk),
        }
        for apart, found in arms.items():
            if apart > 0.0 and abs(apart - distance) <= _TOUCHING * max(self.radii):
                return found
        raise BeamdaeError(
            f"{self.name}: the disk must touch the circle in the reference drawing, but their "
            f"centers {self.b} and {self.a} are {distance:.6g} m apart, which is neither the sum "
            f"nor the difference of the radii {circle:.6g} m and {disk:.6g} m."
        )

    def constraints(self) -> list[ConstraintStatement]:
        """Contact, and rolling."""
        normal, rolling = self.multipliers
        return [
            self._statement(_Apart(self.a.size), (normal,), *self._arms),
            self._statement(_OnCircle(self.a.size), (rolling,), *self._arms),
        ]


def _skating(local: Local, on: Any, normal: Callable[[], Any]) -> NonholonomicKernel:
    place, turn = on(local.q)
    return NonholonomicKernel(local, ca.dot(rotate(turn, normal()), local.dot(place)))


def _side_force(local: Local) -> SX:
    return -local.lam


@dataclass(frozen=True, eq=False)
class Skate(Part):
    """A blade (knife edge) at `on`: its point does not move across `direction`.

    The direction is given in the drawing and turns with the body; n is its left normal. The
    constraint n . v = 0 is nonholonomic: it takes away a motion, but no place the body can get to.
    The reaction F is the force on the body along n.

    Parameters
    ----------
    name, on
        Unique name, and where the blade is.
    direction
        Of the blade in the drawing.
    """

    name: str
    on: Attachment
    direction: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        keep(self, name=require_name("Skate", self.name))
        require_movable(self.name, require_attachment(self.name, "on", self.on))
        require_angle(self.name, self.on)
        _ = left_normal(self.name, self.direction)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What the constraint holds."""
        return (Named("side", "N"),)

    @property
    def reaction(self) -> Quantity:
        """Force [N] on the body along the left normal of the blade."""
        held, _ = Combined.of(_side_force, ())
        return Quantity((Named("F", "N"),), (), held, joint=self.name)

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        functions = (self.on.moved, plain(*left_normal(self.name, self.direction)))
        kernel, data = combined_kernel(_skating, functions, self.on.size, 1)
        return [ConstraintStatement(self.name, kernel, (self.on.piece,), self.multipliers, data)]
