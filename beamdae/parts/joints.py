"""Joints: holonomic constraints between attachments, refused where the drawing is open."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, point
from beamdae.parts.bodies import Attachment, require_angle, require_attachment, require_name, rotate
from beamdae.parts.laws import Law, as_law
from beamdae.symbolic.statements import SX, ConstraintKernel, ConstraintStatement, Local, Quantity

# Relative to the size of the bodies: what rounding a drawing's numbers by hand may cost.
_MEETING_TOLERANCE = 1e-6


def _size(a: Attachment, b: Attachment) -> float:
    """Extent of the two bodies and their points in the drawing [m]."""
    points = np.concatenate([[a.point, b.point], a.body.outline, b.body.outline])
    extent = float(np.max(np.ptp(points, axis=0)))
    return extent or max(1.0, float(np.max(np.abs(points))))


def _require_meeting(part: str, a: Attachment, b: Attachment) -> None:
    gap = float(np.hypot(*np.subtract(b.point, a.point)))
    if gap > _MEETING_TOLERANCE * _size(a, b):
        raise BeamdaeError(
            f"{part}: the two points must meet in the reference drawing, but {a} and {b} "
            f"are {gap:.6g} m apart."
        )


def _statement(
    part: str, attachments: tuple[Attachment, ...], names: tuple[str, ...], constraint: Any
) -> ConstraintStatement:
    """Constraint statement of `constraint(local, qs)`, qs the local coordinates by attachment."""
    local = Local(sum(a.size for a in attachments), 0, len(names))
    ends = np.cumsum([0, *(a.size for a in attachments)])
    qs = [local.q[int(i) : int(j)] for i, j in pairwise(ends)]
    kernel = ConstraintKernel(local, constraint(local, qs))
    return ConstraintStatement(part, kernel, tuple(a.piece for a in attachments), names)


@dataclass(frozen=True, eq=False)
class Joint:
    """Two attachments, `a` and `b`, tied together; reactions are those on the body of `b`."""

    name: str
    a: Attachment
    b: Attachment

    def __post_init__(self) -> None:
        kind = type(self).__name__
        require_name(kind, self.name)
        require_attachment(self.name, "first attachment", self.a)
        require_attachment(self.name, "second attachment", self.b)
        if self.a.body is self.b.body:
            raise BeamdaeError(f"{self.name}: a joint must connect two bodies, both are {self.a}.")

    @property
    def reaction(self) -> Quantity:
        """Force [N] and moment [N m] of the joint on the body of `b`, as far as it holds them."""
        size = len(self.reaction_columns)
        return Quantity(self.reaction_columns, (), lambda local: -local.lam[:size], joint=self.name)

    @property
    def reaction_columns(self) -> tuple[tuple[str, str], ...]:
        """Suffix and unit of each reaction."""
        raise NotImplementedError

    def constraint_statement(self) -> ConstraintStatement:
        """The constraints as a local statement."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Revolute(Joint):
    """Common point of two bodies, free to turn: g = r_b - r_a."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_meeting(self.name, self.a, self.b)

    @property
    def reaction_columns(self) -> tuple[tuple[str, str], ...]:
        """Suffix and unit of each reaction."""
        return (("Fx", "N"), ("Fy", "N"))

    def constraint_statement(self) -> ConstraintStatement:
        """The constraints as a local statement."""
        return _statement(
            self.name,
            (self.a, self.b),
            ("x", "y"),
            lambda local, q: self.b.position(q[1]) - self.a.position(q[0]),
        )


@dataclass(frozen=True, eq=False)
class Weld(Joint):
    """Common point and common turn: g = (r_b - r_a, turn_b - turn_a)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        _require_meeting(self.name, self.a, self.b)

    @property
    def reaction_columns(self) -> tuple[tuple[str, str], ...]:
        """Suffix and unit of each reaction."""
        return (("Fx", "N"), ("Fy", "N"), ("M", "N m"))

    def constraint_statement(self) -> ConstraintStatement:
        """The constraints as a local statement."""
        return _statement(
            self.name,
            (self.a, self.b),
            ("x", "y", "angle"),
            lambda local, q: ca.vertcat(
                self.b.position(q[1]) - self.a.position(q[0]), self.b.turn(q[1]) - self.a.turn(q[0])
            ),
        )


@dataclass(frozen=True, eq=False)
class Driver(Joint):
    """Prescribed relative angle: g = turn_b - turn_a - law(t), turns since the drawing [rad]."""

    law: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the angle [rad] over time.")
        object.__setattr__(self, "law", as_law(self.name, self.law))

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws of time of the part."""
        return (self.law,)

    @property
    def reaction_columns(self) -> tuple[tuple[str, str], ...]:
        """Suffix and unit of each reaction."""
        return (("M", "N m"),)

    def constraint_statement(self) -> ConstraintStatement:
        """The constraints as a local statement."""
        return _statement(
            self.name,
            (self.a, self.b),
            ("angle",),
            lambda local, q: self.b.turn(q[1]) - self.a.turn(q[0]) - self.law(local.time),
        )


@dataclass(frozen=True, eq=False)
class PointOnLine(Joint):
    """Point `b` stays on the line through `a` along `direction`: g = n . (r_b - r_a).

    The line is fixed to the body of `a` and turns with it; n is its left normal. The reaction is
    the force on the body of `b` along n.
    """

    direction: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        dx, dy = point(self.name, "direction", self.direction)
        if np.hypot(dx, dy) == 0.0:
            raise BeamdaeError(f"{self.name}: direction must not be zero.")
        gap = abs(float(np.dot(self._normal, np.subtract(self.b.point, self.a.point))))
        if gap > _MEETING_TOLERANCE * _size(self.a, self.b):
            raise BeamdaeError(
                f"{self.name}: the point must lie on the line in the reference drawing, but "
                f"{self.b} is {gap:.6g} m off the line through {self.a}."
            )

    @property
    def _normal(self) -> np.ndarray:
        dx, dy = self.direction
        return np.array([-dy, dx]) / np.hypot(dx, dy)

    @property
    def reaction_columns(self) -> tuple[tuple[str, str], ...]:
        """Suffix and unit of each reaction."""
        return (("F", "N"),)

    def constraint_statement(self) -> ConstraintStatement:
        """The constraints as a local statement."""

        def constraint(local: Local, q: list[SX]) -> SX:
            normal = rotate(self.a.turn(q[0]), self._normal)
            return ca.dot(normal, self.b.position(q[1]) - self.a.position(q[0]))

        return _statement(self.name, (self.a, self.b), ("normal",), constraint)
