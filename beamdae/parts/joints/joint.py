"""Joints: holonomic constraints between attachments, refused where the drawing is open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_choice, require_name, set_fields
from beamdae.parts.attachments import (
    Attachment,
    largest_distance,
    require_angle,
    require_attachment,
    rotate,
)
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import FormulaExpression, build_formula_kernel
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    Piece,
    Quantity,
)

# Relative to the size of the bodies: what rounding a drawing's numbers by hand may cost.
_MEETING_TOLERANCE = 1e-6


def meeting_tolerance(a: Attachment, b: Attachment) -> float:
    """How far apart two points that meet may be drawn [m]: rounding, by their bodies' size."""
    points = np.concatenate([[a.point, b.point], a.body.outline, b.body.outline])
    return _MEETING_TOLERANCE * (
        largest_distance(points) or max(1.0, float(np.max(np.abs(points))))
    )


def require_meeting(part: str, a: Attachment, b: Attachment) -> None:
    """Refuse two points that do not meet in the drawing."""
    gap = float(np.hypot(*np.subtract(b.point, a.point)))
    if gap > meeting_tolerance(a, b):
        raise BeamdaeError(
            f"{part}: the two points must meet in the reference drawing, but {a} and {b} "
            f"are {gap:.6g} m apart."
        )


def load_columns(at: Attachment) -> tuple[Named, ...]:
    """What a load at an attachment consists of: Fx, Fy and, on what turns, M."""
    return (Named("Fx", "N"), Named("Fy", "N"), Named("M", "N m"))[: 3 if at.has_angle else 2]


def resolve_load(axes: str, turn: SX, force: SX, moment: Any = None) -> SX:
    """A load in inertial axes, or in those of a body that has turned; without moment: a force."""
    seen = rotate(-turn, force) if axes == "body" else force
    return seen if moment is None else ca.vertcat(seen, moment)


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
        set_fields(self, name=require_name(kind, self.name))
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
        held, _ = FormulaExpression.of(_reaction, ())
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
class _Gap:
    """What a joint holds, as a formula of where its points are.

    Attributes
    ----------
    sizes
        Numbers of local coordinates of the points.
    gap
        (time, *points moved, *further formulas) -> g, a point moved being its position and turn.
    """

    sizes: tuple[int, ...]
    gap: Callable[..., SX]

    def points(self, local: Local, functions: Sequence[Any]) -> list[Any]:
        """All points, moved by the first of the functions."""
        ends = np.cumsum([0, *self.sizes]).tolist()
        return [
            on(local.q[first:last])
            for on, (first, last) in zip(functions, pairwise(ends), strict=False)
        ]

    def own(self, functions: Sequence[Any]) -> Sequence[Any]:
        """The further formulas."""
        return functions[len(self.sizes) :]


class _Held(_Gap):
    """The kernel of a gap."""

    def __call__(self, local: Local, *functions: Any) -> ConstraintKernel:
        points = self.points(local, functions)
        return ConstraintKernel(local, self.gap(local.time, *points, *self.own(functions)))


@dataclass(frozen=True)
class _ReactionOn(_Gap):
    """Force and moment at one of the points: what does the work of the multipliers there."""

    which: int
    axes: str
    has_angle: bool

    def __call__(self, local: Local, *functions: Any) -> SX:
        found = self.points(local, functions)
        free = SX.sym("point", 3)
        place, turn = found[self.which]
        moved = [*found[: self.which], (free[:2], free[2]), *found[self.which + 1 :]]
        g = self.gap(local.time, *moved, *self.own(functions))
        load = -ca.jtimes(g, free, local.lam, True)
        load = ca.densify(ca.substitute(load, free, ca.vertcat(place, turn)))
        return resolve_load(self.axes, turn, load[:2], load[2] if self.has_angle else None)


@dataclass(frozen=True)
class Drive(_Gap):
    """What a law of time takes to be followed, and its power.

    Attributes
    ----------
    changes
        Whether events may have it follow another law: then its power is that of how it moves.
    """

    changes: bool

    def __call__(self, local: Local, *functions: Any) -> SX:
        """Reaction and power."""
        g = self.gap(local.time, *self.points(local, functions), *self.own(functions))
        if self.changes:
            rate = -ca.jtimes(g, local.q, local.v)
        else:
            rate = ca.jtimes(g, local.time, SX([1, 0]))
        return ca.vertcat(-local.lam, local.lam * rate)


class JointByFormula(Joint):
    """A joint whose constraint is one formula of where its points are: see `_Gap.gap`."""

    _gap: ClassVar[Callable[..., SX]]

    @property
    def _own(self) -> tuple[Callable[..., Any], ...]:
        """Further formulas."""
        return ()

    @property
    def _points(self) -> dict[str, Attachment]:
        """What it holds, by the names of the fields."""
        return {"a": self.a, "b": self.b}

    @property
    def _pieces(self) -> tuple[Piece, ...]:
        return tuple(place.piece for place in self._points.values())

    @property
    def _sizes(self) -> tuple[int, ...]:
        return tuple(place.size for place in self._points.values())

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        return (*(place.checked_kinematics for place in self._points.values()), *self._own)

    def constraint(self, local: Local, q_a: SX, q_b: SX) -> SX:
        """The constraint from the local coordinates of both attachments."""
        return self._gap(
            local.time, self.a.checked_kinematics(q_a), self.b.checked_kinematics(q_b), *self._own
        )

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        if type(self).constraint is not JointByFormula.constraint:
            return super().constraints()
        sizes = self._sizes
        held = _Held(sizes, self._gap)
        count = len(self.multipliers)
        kernel, data = build_formula_kernel(held, self._functions, sum(sizes), count)
        return [ConstraintStatement(self.name, kernel, self._pieces, self.multipliers, data)]

    def _place(self, place: str, axes: str) -> Attachment:
        """One of its points by name, if there are such axes."""
        points = self._points
        require_choice(self.name, "place", place, tuple(points))
        require_choice(self.name, "axes", axes, ("inertial", "body"))
        return points[place]

    def reaction_on(self, place: str = "b", axes: str = "inertial") -> Quantity:
        """Force Fx, Fy [N] and moment M [N m] of the joint on one of its bodies, at its point.

        Parameters
        ----------
        place
            Which of its points: "a" or "b", or as the joint has them.
        axes
            "inertial", or "body": those of the drawing as the body (or the section of a beam) turns
            them.
        """
        at = self._place(place, axes)
        which = list(self._points).index(place)
        build = _ReactionOn(self._sizes, self._gap, which, axes, at.has_angle)
        values, data = FormulaExpression.of(build, self._functions)
        return Quantity(load_columns(at), self._pieces, values, data, joint=self.name)


def _meeting(time: SX, a: Any, b: Any) -> SX:
    return b[0] - a[0]


def _welded(time: SX, a: Any, b: Any) -> SX:
    return ca.vertcat(b[0] - a[0], b[1] - a[1])


@dataclass(frozen=True, eq=False)
class Revolute(JointByFormula):
    """Common point of two bodies, free to turn: g = r_b - r_a."""

    multipliers = (Named("x", "N"), Named("y", "N"))
    reactions = ("Fx", "Fy")
    _gap = staticmethod(_meeting)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_meeting(self.name, self.a, self.b)


@dataclass(frozen=True, eq=False)
class Weld(JointByFormula):
    """Common point and common turn: g = (r_b - r_a, turn_b - turn_a)."""

    multipliers = (Named("x", "N"), Named("y", "N"), Named("angle", "N m"))
    reactions = ("Fx", "Fy", "M")
    _gap = staticmethod(_welded)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        require_meeting(self.name, self.a, self.b)
