"""Constraints that replace joints after events: frozen gaps and closed gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from beamdae.parts.attachments import Attachment, rotate
from beamdae.parts.joints.joint import (
    GapFormula,
    KinematicConstraint,
    list_functions,
)
from beamdae.parts.laws import Law
from beamdae.parts.part import Part, PlacedPoint
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, FormulaExpression
from beamdae.symbolic.signals import with_references
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Quantity,
    Variable,
)

Array = np.ndarray


@dataclass(frozen=True)
class FrozenGap:
    """Gap that a joint keeps after an event activated it with `as_is=True`.

    Attributes
    ----------
    offsets
        Values of the gap function at the event [m or rad]; the first two are components in the axes
        of the `_offset_carrier` of the joint, if there is one.
    event
        Name of the event whose law the joint follows, or "" if the joint keeps its original law.
    since
        Time of the event [s]; 0 if `event` is "".
    """

    offsets: tuple[float, ...]
    event: str = ""
    since: float = 0.0


FrozenGaps = Mapping[str, FrozenGap]  # by name of the joint


def _carrier_index(joint: KinematicConstraint) -> int | None:
    """Return the index of the point whose axes carry the first two offsets, or None."""
    carrier = joint._offset_carrier
    return None if carrier is None else list(joint.points).index(carrier)


@dataclass(frozen=True)
class _OffsetGap:
    """Gap function minus offsets, which are passed after the parameters of the gap.

    Attributes
    ----------
    gap
        Gap function of the joint.
    n_arguments
        Number of points and parameters of the gap function.
    n_offsets
        Number of offsets.
    carrier
        Index of the point whose axes carry the first two offsets; None if offsets are constant.
    """

    gap: Any
    n_arguments: int
    n_offsets: int
    carrier: int | None

    def __call__(self, t: SX, *arguments: Any) -> SX:
        first, last = self.n_arguments, self.n_arguments + self.n_offsets
        offsets = ca.vertcat(*arguments[first:last])
        if self.carrier is not None:
            rotation = arguments[self.carrier].rotation
            offsets = ca.vertcat(rotate(rotation, offsets), offsets[2:])
        return self.gap(t, *arguments[:first], *arguments[last:]) - offsets


@dataclass(frozen=True)
class _GapOffsets:
    """Offsets that close the gap at the current positions."""

    gap: GapFormula
    carrier: int | None

    def __call__(self, local: Local, points: Sequence[PlacedPoint], *functions: Any) -> SX:
        gap = self.gap(local, points, *functions)
        if self.carrier is None:
            return gap
        return ca.vertcat(rotate(-points[self.carrier].rotation, gap), gap[2:])


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _offset_function(expression: FormulaExpression, size: int, n_data: int) -> RowFunction:
    local = Local(size, n_data)
    inputs, values = [local.time, local.q, local.data], with_references(expression(local))
    return RowFunction(ca.Function("offsets", inputs, [ca.densify(values)]))


def evaluate_frozen_gap(
    joint: KinematicConstraint, law: Law | None, time: Array, local: Array
) -> tuple[float, ...]:
    """Return the offsets [m or rad] at which a joint is frozen.

    Parameters
    ----------
    joint
        Joint with a gap function.
    law
        New law of the joint as a function of the time of the run. If None, the joint keeps its
        original laws.
    time
        Time, and the time that selects the piece of each law, (t, branch) [s].
    local
        Local coordinates of the points of the joint.
    """
    assert joint.gap is not None
    parameters, laws = joint.gap_parameters, joint.laws if law is None else (law,)
    build = _GapOffsets(GapFormula(joint.gap), _carrier_index(joint))
    arguments = joint._arguments(build, list_functions(parameters, laws))
    expression, data = FormulaExpression.of(*arguments)
    values = _offset_function(expression, len(local), len(data))(time[None], local[None], data)
    return tuple(values[0].tolist())


@dataclass(frozen=True, eq=False)
class FrozenConstraint(Part):
    """Joint with a frozen gap: keeps the `offsets`; follows `law` or, if None, the joint's laws."""

    joint: KinematicConstraint
    offsets: tuple[float, ...]
    law: Law | None = None

    @property
    def name(self) -> str:  # type: ignore[override]
        """Name of the frozen joint."""
        return self.joint.name

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Attachments of the frozen joint."""
        return self.joint.attachments

    @property
    def laws(self) -> tuple[Law, ...]:
        """Laws of the joint, or the law that replaces them."""
        return self.joint.laws if self.law is None else (self.law,)

    @property
    def multipliers(self) -> tuple[Variable, ...]:
        """Multipliers of the frozen joint."""
        return self.joint.multipliers

    def constraints(self) -> list[ConstraintStatement]:
        """Return the constraints of the joint with the offset gap."""
        joint = self.joint
        parameters, offsets = joint.gap_parameters, self.offsets
        n_arguments = len(joint.points) + len(parameters)
        gap = _OffsetGap(joint.gap, n_arguments, len(offsets), _carrier_index(joint))
        return joint._state_constraints(gap, (*parameters, *offsets), self.laws)


@dataclass(frozen=True, eq=False)
class ClosedGap(Part):
    """Constraint of a gap during an impact: g = -gap, so that positive multipliers open the gap."""

    name: str
    gap: Quantity
    attachments = ()

    def constraints(self) -> list[ConstraintStatement]:
        """Return the constraint on the gap."""
        size = sum(piece.operator.shape[0] for piece in self.gap.pieces)
        local = Local(size, len(self.gap.data), 1)
        unit = {"rad": "N m"}.get(self.gap.columns[0].unit, "N")
        return [
            ConstraintStatement(
                self.name,
                ConstraintKernel(local, -self.gap.expression(local)),
                self.gap.pieces,
                (Variable("gap", unit),),
                self.gap.data[:, None],
            )
        ]
