"""Counts of growing motions at points of a curve, and their changes between two points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Positions between two points at which an interpolated determinant is examined.
_SHARES = np.linspace(0.0, 1.0, 101)


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
    sign, log_size
        Sign of a determinant that vanishes at critical points, 0 if it is not known, and the
        logarithm of its magnitude, which exceeds the range of numbers.
    """

    divergent: int
    oscillating: int
    alternating: int = 0
    free: int = 0
    sign: int = 0
    log_size: float = 0.0

    @property
    def growing(self) -> tuple[int, int, int]:
        """Numbers of growing motions of each kind."""
        return self.divergent, self.oscillating, self.alternating

    @property
    def unstable(self) -> int:
        """Number of unstable directions, in which an oscillation counts twice."""
        return self.divergent + 2 * self.oscillating


class Neighbor(NamedTuple):
    """Count beside a point, at a distance along the curve relative to that of the ends."""

    counts: Count
    distance: float


def find_hidden_growth(
    first: Count, first_beside: Neighbor, last: Count, last_beside: Neighbor
) -> float | None:
    """Return a position from 0 to 1 where the determinant may have another sign than at both ends.

    It is a cubic polynomial with the values and derivatives at both ends. The result is None if the
    polynomial has one sign.
    """
    counts = first, first_beside.counts, last, last_beside.counts
    unit = max(x.log_size for x in counts)
    begin, begin_near, end, end_near = (x.sign * np.exp(x.log_size - unit) for x in counts)
    begin_rate = (begin_near - begin) / first_beside.distance
    end_rate = (end_near - end) / last_beside.distance
    if begin * (begin + begin_rate / 3.0) > 0.0 and begin * (end - end_rate / 3.0) > 0.0:
        # Polynomials remain between their control points.
        return None
    t, change = _SHARES, end - begin
    bend = t * (1.0 - t) * ((begin_rate - change) * (1.0 - t) - (end_rate - change) * t)
    (selected,) = np.nonzero(begin * (begin + change * t + bend) < 0.0)
    return float(_SHARES[selected[len(selected) // 2]]) if len(selected) else None


def find_hidden_turn(change: float, begin_rate: float, end_rate: float) -> float | None:
    """Return a position from 0 to 1 where a quantity may reverse that changes by `change`.

    Its rate is a parabola with these values at both ends and this mean; it has no sign change if
    its control points have one sign.
    """
    middle = 3.0 * change - begin_rate - end_rate
    product = begin_rate * end_rate
    if product <= 0.0 or middle * begin_rate >= 0.0 or middle**2 <= product:
        return None
    return (begin_rate - middle) / (begin_rate - 2.0 * middle + end_rate)
