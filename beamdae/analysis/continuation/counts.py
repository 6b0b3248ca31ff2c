"""Counts of growing motions at points of a curve."""

from __future__ import annotations

from typing import NamedTuple


class Determinant(NamedTuple):
    """Sign of a determinant, 0 if it is not known, and the logarithm of its magnitude."""

    sign: int = 0
    log_size: float = 0.0


class Count(NamedTuple):
    """Numbers of growing motions at a point.

    Attributes
    ----------
    divergent, oscillating
        Motions without and with oscillation.
    alternating
        Motions that alternate from period to period.
    free
        Motions without stiffness.
    determinant
        Determinant that vanishes at critical points.
    """

    divergent: int
    oscillating: int
    alternating: int = 0
    free: int = 0
    determinant: Determinant = Determinant()

    @property
    def growing(self) -> tuple[int, int, int]:
        """Numbers of growing motions of each kind."""
        return self.divergent, self.oscillating, self.alternating

    @property
    def unstable(self) -> int:
        """Number of unstable directions, in which an oscillation counts twice."""
        return self.divergent + 2 * self.oscillating
