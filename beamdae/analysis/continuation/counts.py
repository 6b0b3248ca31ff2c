"""Counts of growing motions at points of a curve, and their changes between two points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

Array = np.ndarray

# Positions between two points at which interpolated motions are examined.
_SHARES = np.linspace(0.0, 1.0, 101)
# Real parts up to this fraction of an eigenvalue between points are interpolation errors.
_MIN_GROWTH = 1e-5
# Largest deviation of a change from the mean rate, relative to the largest rate, of a pair of
# eigenvalues; changes below a fraction of their sizes are none.
_MAX_RATE_ERROR, _MIN_CHANGE = 0.5, 1e-6


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
    pairs
        Mean (l1 + l2) / 2 and (l1 - l2)^2 / 4 of neighboring eigenvalues, (2, k). Both are smooth
        functions along a curve, also where the eigenvalues meet.
    log_unit
        Logarithm of the unit of eigenvalues: determinants exceed the range of numbers.
    """

    divergent: int
    oscillating: int
    alternating: int = 0
    free: int = 0
    pairs: Array = np.zeros((2, 0))
    log_unit: float = 0.0

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


def pair_neighbors(values: Array) -> Array:
    """Return `Count.pairs` of eigenvalues in pairs l, -l or conjugate ones."""
    values = values[np.lexsort((values.real, values.imag))]
    lower, upper = values[:-1], values[1:]
    return np.array([0.5 * (upper + lower), 0.25 * (upper - lower) ** 2])


def find_hidden_growth(
    first: Count, first_beside: Neighbor, last: Count, last_beside: Neighbor
) -> float | None:
    """Return a position from 0 to 1 where other motions may grow than at both ends, or None.

    Pairs are interpolated by cubic polynomials, with the derivatives at both ends.
    """
    counts = first, first_beside.counts, last, last_beside.counts
    begin, begin_near, end, end_near = _match_pairs(*counts)
    begin_rate = (begin_near - begin) / first_beside.distance
    end_rate = (end_near - end) / last_beside.distance
    squares = np.array([begin, begin + begin_rate / 3.0, end - end_rate / 3.0, end])[:, 1]
    if not begin[0].any() and np.ptp(np.sign(squares), axis=0).max(initial=0.0) == 0.0:
        # Polynomials remain between their control points.
        return None
    t, change = _SHARES[:, None], end - begin
    bend = t * (1.0 - t) * ((begin_rate - change) * (1.0 - t) - (end_rate - change) * t)
    mean, squared = begin + change * t + bend
    values = mean + np.array([1.0, -1.0])[:, None, None] * np.sqrt(squared)
    growing = (values.real > _MIN_GROWTH * np.abs(values)).sum(axis=0)
    # Pairs of other eigenvalues at the end do not follow from the rates.
    error, size = np.abs(change - 0.5 * (begin_rate + end_rate)), np.abs(begin) + np.abs(end)
    largest = np.maximum(np.abs(begin_rate), np.abs(end_rate))
    is_same = (error <= _MAX_RATE_ERROR * largest + _MIN_CHANGE * size).all(axis=(0, 1))
    differs = (growing != growing[0]) & (growing[0] == growing[-1]) & is_same
    (selected,) = np.nonzero(differs.any(axis=1))
    return float(_SHARES[selected[len(selected) // 2]]) if len(selected) else None


def _match_pairs(*counts: Count) -> Array:
    """Return the pairs of the slowest eigenvalues of each count in one unit, (counts, 2, 1, k)."""
    size, unit = min(x.pairs.shape[1] for x in counts), max(x.log_unit for x in counts)
    matched = np.empty((len(counts), 2, 1, size), complex)
    for k, count in enumerate(counts):
        cut, factor = (count.pairs.shape[1] - size) // 2, math.exp(count.log_unit - unit)
        matched[k, 0] = factor * count.pairs[0, cut : cut + size]
        matched[k, 1] = factor**2 * count.pairs[1, cut : cut + size]
    return matched


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
