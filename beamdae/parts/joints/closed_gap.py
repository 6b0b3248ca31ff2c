"""Gaps that impacts throw back, as joints that hold them closed."""

from __future__ import annotations

from dataclasses import dataclass

from beamdae.parts.attachments import Attachment
from beamdae.parts.part import Part
from beamdae.symbolic.statements import (
    ConstraintKernel,
    ConstraintStatement,
    Local,
    Named,
    Quantity,
)


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
