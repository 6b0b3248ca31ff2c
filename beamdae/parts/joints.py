"""Joints: holonomic constraints between attachments, refused where the drawing is open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, keep, point
from beamdae.parts.attachments import Attachment, require_angle, require_attachment, rotate
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import Part, require_name
from beamdae.symbolic.formulas import Combined, combined_kernel, plain
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    Quantity,
)

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


def _reaction(local: Local) -> SX:
    return -local.lam


@dataclass(frozen=True, eq=False)
class Joint(Part):
    """Two attachments, `a` and `b`, tied together; reactions are those on the body of `b`.

    A joint states `multipliers`, `reactions` and `constraint`; everything else follows.
    """

    name: str
    a: Attachment
    b: Attachment

    def __post_init__(self) -> None:
        kind = type(self).__name__
        keep(self, name=require_name(kind, self.name))
        require_attachment(self.name, "first attachment", self.a)
        require_attachment(self.name, "second attachment", self.b)
        if self.a.body is self.b.body:
            raise BeamdaeError(f"{self.name}: a joint must connect two bodies, both are {self.a}.")

    @property
    def reaction(self) -> Quantity:
        """Force [N] and moment [N m] of the joint on the body of `b`, as far as it holds them."""
        if len(self.reactions) != len(self.multipliers):
            raise BeamdaeError(
                f"{self.name}: it must have a reaction for each multiplier, got "
                f"{len(self.reactions)} for {len(self.multipliers)}."
            )
        columns = tuple(
            Named(name, held.unit)
            for name, held in zip(self.reactions, self.multipliers, strict=True)
        )
        held, _ = Combined.of(_reaction, ())
        return Quantity(columns, (), held, joint=self.name)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds, and the unit of its multiplier: "N" or "N m"."""
        raise NotImplementedError

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        raise NotImplementedError

    def constraint(self, local: Local, q_a: SX, q_b: SX) -> SX:
        """The constraint g from the local coordinates of both attachments, and from local.time."""
        raise NotImplementedError

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        size = self.a.size
        local = Local(size + self.b.size, 0, len(self.multipliers))
        g = self.constraint(local, local.q[:size], local.q[size:])
        kernel = ConstraintKernel(local, g)
        pieces = (self.a.piece, self.b.piece)
        return [ConstraintStatement(self.name, kernel, pieces, self.multipliers)]


@dataclass(frozen=True)
class _Held:
    """The kernel of a `gap` between two points, the first of so many local coordinates.

    gap: (time, the first moved, the second moved, *further formulas) -> g, a point moved being its
    position and turn.
    """

    size: int
    gap: Callable[..., SX]

    def __call__(self, local: Local, a: Any, b: Any, *own: Any) -> ConstraintKernel:
        moved_a, moved_b = a(local.q[: self.size]), b(local.q[self.size :])
        return ConstraintKernel(local, self.gap(local.time, moved_a, moved_b, *own))


class _ByFormula(Joint):
    """A joint whose constraint is one formula of where its points are: see `_Held.gap`."""

    _gap: ClassVar[Callable[..., SX]]

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        """Further formulas."""
        return ()

    def constraint(self, local: Local, q_a: SX, q_b: SX) -> SX:
        """The constraint from the local coordinates of both attachments."""
        return type(self)._gap(local.time, self.a.moved(q_a), self.b.moved(q_b), *self._own)

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        if type(self).constraint is not _ByFormula.constraint:
            return super().constraints()
        kernel, data = combined_kernel(
            _Held(self.a.size, type(self)._gap),
            (self.a.moved, self.b.moved, *self._own),
            self.a.size + self.b.size,
            len(self.multipliers),
        )
        pieces = (self.a.piece, self.b.piece)
        return [ConstraintStatement(self.name, kernel, pieces, self.multipliers, data)]


def _meeting(time: SX, a: Any, b: Any) -> SX:
    return b[0] - a[0]


def _welded(time: SX, a: Any, b: Any) -> SX:
    return ca.vertcat(b[0] - a[0], b[1] - a[1])


def _driven(time: SX, a: Any, b: Any, law: Callable[[SX], SX]) -> SX:
    return b[1] - a[1] - law(time)


def _on_line(time: SX, a: Any, b: Any, normal: Callable[[], Any]) -> SX:
    return ca.dot(rotate(a[1], normal()), b[0] - a[0])


@dataclass(frozen=True, eq=False)
class Revolute(_ByFormula):
    """Common point of two bodies, free to turn: g = r_b - r_a."""

    _gap = staticmethod(_meeting)

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_meeting(self.name, self.a, self.b)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("x", "N"), Named("y", "N"))

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("Fx", "Fy")


@dataclass(frozen=True, eq=False)
class Weld(_ByFormula):
    """Common point and common turn: g = (r_b - r_a, turn_b - turn_a)."""

    _gap = staticmethod(_welded)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        _require_meeting(self.name, self.a, self.b)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("x", "N"), Named("y", "N"), Named("angle", "N m"))

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("Fx", "Fy", "M")


@dataclass(frozen=True, eq=False)
class Driver(_ByFormula):
    """Prescribed relative angle: g = turn_b - turn_a - law(t), turns since the drawing [rad].

    A law that is not zero at the start turns the bodies out of the drawing before the run, with
    whatever is joined to them; `beamdae check` tells by how much.
    """

    law: Any = None
    _gap = staticmethod(_driven)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        if self.law is None:
            raise BeamdaeError(f"{self.name}: a driver needs law=, the angle [rad] over time.")
        _ = self.laws

    @cached_property
    def laws(self) -> tuple[Law, ...]:
        """The angle over time."""
        return (as_law(self.name, self.law),)

    @property
    def facts(self) -> Mapping[str, float]:
        """By how much it turns the bodies out of the drawing."""
        (law,) = self.laws
        return {"angle at the start, from the drawing [rad]": float(ca.evalf(law(SX.zeros(2))))}

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("angle", "N m"),)

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("M",)

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (self.laws[0].formula,)


@dataclass(frozen=True, eq=False)
class PointOnLine(_ByFormula):
    """Point `b` stays on the line through `a` along `direction`: g = n . (r_b - r_a).

    The line is fixed to the body of `a` and turns with it; n is its left normal. The reaction is
    the force on the body of `b` along n.
    """

    direction: tuple[float, float] = (1.0, 0.0)
    _gap = staticmethod(_on_line)

    def __post_init__(self) -> None:
        super().__post_init__()
        keep(self, direction=point(self.name, "direction", self.direction))
        if np.hypot(*self.direction) == 0.0:
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
    def multipliers(self) -> tuple[Named, ...]:
        """What each constraint holds."""
        return (Named("normal", "N"),)

    @property
    def reactions(self) -> tuple[str, ...]:
        """What each multiplier is called as a reaction."""
        return ("F",)

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        return (plain(*self._normal.tolist()),)
