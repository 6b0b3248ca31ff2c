"""Joints that hold what an event finds, in place of what is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.joints.joint import JointByFormula, Revolute, Weld, _Gap, _Held
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formulas import (
    MAX_SHARED_KERNELS,
    FormulaExpression,
    build_formula_kernel,
    constant_formula,
)
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    Quantity,
)

Array = np.ndarray


@dataclass(frozen=True)
class FrozenGap:
    """What a joint holds since an event had it hold what it found.

    Attributes
    ----------
    found
        By how much what it holds is off its own formula.
    event, since
        The event whose law it follows, if one gave it another than its own, and when that was [s].
    """

    found: tuple[float, ...]
    event: str = ""
    since: float = 0.0


def _carrier(joint: JointByFormula) -> int | None:
    """Which of its points carries the first two numbers in axes that turn with it, if one does."""
    if not isinstance(joint, (Revolute, Weld)):
        return None
    return 0 if joint.a.has_angle else 1


@dataclass(frozen=True)
class _OffsetGap:
    """A gap less so many numbers, the first two in axes of the point `carrier`, if there is one."""

    gap: Any
    carrier: int | None
    count: int

    def __call__(self, time: SX, *given: Any) -> SX:
        *own, numbers = given
        found = ca.vertcat(*(numbers()[k] for k in range(self.count)))
        if self.carrier is not None:
            found = ca.vertcat(rotate(own[self.carrier][1], found), found[2:])
        return self.gap(time, *own) - found


@dataclass(frozen=True)
class _GapOffsets(_Gap):
    """The numbers at which the shifted gap is closed."""

    carrier: int | None

    def __call__(self, local: Local, *functions: Any) -> SX:
        points = self.points(local, functions)
        gap = self.gap(local.time, *points, *self.own(functions))
        if self.carrier is None:
            return gap
        return ca.vertcat(rotate(-points[self.carrier][1], gap), gap[2:])


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _offset_function(found: FormulaExpression, size: int, n_data: int) -> RowFunction:
    local = Local(size, n_data)
    inputs = [local.time, local.q, local.data]
    return RowFunction(ca.Function("found", inputs, [ca.densify(found(local))]))


def evaluate_frozen_gap(
    joint: JointByFormula, law: Law | None, time: Array, local: Array
) -> tuple[float, ...]:
    """What a joint finds at time = (t, branch) and the local coordinates of its points.

    `law` is what it is to follow from there on, if that is not its own.
    """
    combined, data = FormulaExpression.of(
        _GapOffsets(joint._sizes, joint._gap, _carrier(joint)), _functions(joint, law)
    )
    values = _offset_function(combined, len(local), len(data))(time[None], local[None], data)
    return tuple(values[0].tolist())


def _functions(joint: JointByFormula, law: Law | None) -> tuple[Any, ...]:
    """The formulas of a joint; the law of a driver is the last of them."""
    own = joint._functions
    return own if law is None else (*own[:-1], law.formula)


@dataclass(frozen=True, eq=False)
class FrozenConstraint(Part):
    """A joint that holds what was `found`, by a `law` that is not its own if there is one."""

    joint: JointByFormula
    found: tuple[float, ...]
    law: Law | None = None

    @property
    def name(self) -> str:  # type: ignore[override]
        """That of the joint."""
        return self.joint.name

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Those of the joint."""
        return self.joint.attachments

    @property
    def laws(self) -> tuple[Law, ...]:
        """Those of the joint."""
        return self.joint.laws if self.law is None else (self.law,)

    @property
    def multipliers(self) -> tuple[Named, ...]:
        """Those of the joint."""
        return self.joint.multipliers

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        joint, sizes = self.joint, self.joint._sizes
        shifted = _OffsetGap(joint._gap, _carrier(joint), len(self.found))
        functions = [*_functions(joint, self.law), constant_formula(*self.found)]
        kernel, data = build_formula_kernel(
            _Held(sizes, shifted), functions, sum(sizes), len(self.multipliers)
        )
        return [ConstraintStatement(self.name, kernel, joint._pieces, self.multipliers, data)]


@dataclass(frozen=True, eq=False)
class ClosedGap(Part):
    """A gap that is held closed: g = -gap, so that multipliers that push it open are positive."""

    name: str
    gap: Quantity

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """None of its own: the quantity says where it is."""
        return ()

    def constraints(self) -> list[ConstraintStatement]:
        """The constraint as a local statement."""
        size = sum(piece.operator.shape[0] for piece in self.gap.pieces)
        local = Local(size, len(self.gap.data), 1)
        unit = {"rad": "N m"}.get(self.gap.columns[0].unit, "N")
        return [
            ConstraintStatement(
                self.name,
                ConstraintKernel(local, -self.gap.expression(local)),
                self.gap.pieces,
                (Named("gap", unit),),
                self.gap.data[:, None],
            )
        ]
