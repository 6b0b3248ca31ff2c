"""Rolling without slip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_pair, require_positive, set_fields
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.joints.guides import left_normal
from beamdae.parts.joints.joint import JointByFormula, load_columns, resolve_load
from beamdae.symbolic.formulas import FormulaExpression, build_formula_kernel, constant_formula
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


def _on_line(time: SX, a: Any, b: Any, numbers: Callable[[], Any]) -> SX:
    """Contact and travel of a disk on a line."""
    (root, turned), (center, turn) = a, b
    nx, ny, height, start = (numbers()[k] for k in range(4))
    normal, arm = rotate(turned, (nx, ny)), center - root
    along = normal[1] * arm[0] - normal[0] * arm[1]
    travel = along - start + height * (turn - turned)
    return ca.vertcat(ca.dot(normal, arm) - height, travel)


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


@dataclass(frozen=True)
class _CircleReaction:
    """Force and moment on the circle or the disk, at its center; `size` as above.

    They come from the contact, which is by `arms` off the centers.
    """

    size: int
    on_disk: bool
    axes: str

    def __call__(self, local: Local, a: Any, b: Any, arms: Callable[[], Any]) -> SX:
        (root, turned), (center, turn) = a(local.q[: self.size]), b(local.q[self.size :])
        arm = (center - root) / ca.norm_2(center - root)
        push, rub = -local.lam[0], -local.lam[1]
        force = push * arm + rub * ca.vertcat(-arm[1], arm[0])
        if self.on_disk:
            return resolve_load(self.axes, turn, force, arms()[1] * rub)
        return resolve_load(self.axes, turned, -force, -arms()[0] * rub)


@dataclass(frozen=True, eq=False)
class _Rolling(JointByFormula):
    """What both kinds of rolling have in common."""

    multipliers = (Named("normal", "N"), Named("rolling", "N"))
    reactions = ("Fn", "Ft")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)

    @property
    def _drawn(self) -> np.ndarray:
        return np.subtract(self.b.point, self.a.point)


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
    _gap = staticmethod(_on_line)

    def __post_init__(self) -> None:
        super().__post_init__()
        set_fields(self, radius=require_positive(self.name, "radius", self.radius))
        gap = abs(float(self._drawn @ left_normal(self.name, self.direction)))
        if abs(gap - self.radius) > _TOUCHING * self.radius:
            raise BeamdaeError(
                f"{self.name}: the disk must touch the line in the reference drawing, but its "
                f"center {self.b} is {gap:.6g} m off the line through {self.a}, its radius is "
                f"{self.radius:.6g} m."
            )

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        nx, ny = left_normal(self.name, self.direction)
        dx, dy = self._drawn.tolist()
        return (constant_formula(nx, ny, nx * dx + ny * dy, ny * dx - nx * dy),)


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
        radii = require_pair(self.name, "radii", self.radii, "a pair (of the circle, of the disk)")
        set_fields(
            self, radii=tuple(require_positive(self.name, "radii", radius) for radius in radii)
        )
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

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (constant_formula(*self._arms),)

    def constraints(self) -> list[ConstraintStatement]:
        """Contact, and rolling."""
        found = []
        builds: tuple[Callable[..., Any], ...] = (_Apart(self.a.size), _OnCircle(self.a.size))
        for held, build in zip(self.multipliers, builds, strict=True):
            kernel, data = build_formula_kernel(build, self._functions, sum(self._sizes), 1)
            found.append(ConstraintStatement(self.name, kernel, self._pieces, (held,), data))
        return found

    def reaction_on(self, place: str = "b", axes: str = "inertial") -> Quantity:
        """Force Fx, Fy [N] and moment M [N m] on one of the bodies, at its center.

        Parameters
        ----------
        place
            "a", the circle, or "b", the disk.
        axes
            "inertial", or "body": those of the drawing as the body turns them.
        """
        columns = load_columns(self._place(place, axes))
        build = _CircleReaction(self.a.size, place == "b", axes)
        values, data = FormulaExpression.of(build, self._functions)
        return Quantity(columns, self._pieces, values, data, joint=self.name)
