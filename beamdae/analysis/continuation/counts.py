"""Counts of growing motions at points of a curve, and their changes between two points."""

from __future__ import annotations

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
    spectrum
        Complex numbers in pairs l, -l or conjugate ones. Motions grow if Re l > 0; where their
        number changes, two of these numbers meet, or have no real part.
    log_unit
        Logarithm of the unit of these numbers: determinants exceed the range of numbers.
    """

    divergent: int
    oscillating: int
    alternating: int = 0
    free: int = 0
    spectrum: Array = np.zeros(0)
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
    """Count beside a point, at a distance relative to that of the ends."""

    counts: Count
    distance: float


def find_growth_change(first: Count, last: Count) -> float:
    """Return a position from 0 to 1 that brackets the change of growing motions closely."""
    pairs = _pair_neighbors(first, last)
    if pairs is None:
        return 0.5
    begin, end = pairs
    growing = _count_growing(begin + (end - begin) * _SHARES[:, None], 0.0)
    firsts = np.argmax(growing != growing[0], axis=0)[growing[0] != growing[-1]]
    # Neighbors of those that meet seem to change at one of the ends.
    inner = firsts[(firsts > 2) & (firsts < len(_SHARES) - 2)]
    if not len(inner):
        return 0.5
    return float(_SHARES[inner[0] + 1 if inner[0] < len(_SHARES) // 2 else inner[0] - 2])


def find_hidden_growth(
    first: Count, first_beside: Neighbor, last: Count, last_beside: Neighbor
) -> float | None:
    """Return a position from 0 to 1 where other motions may grow than at both ends, or None.

    Mean and difference of neighboring eigenvalues, (l1 - l2)^2, are smooth where the eigenvalues
    meet. They are interpolated by cubic polynomials, with the derivatives at both ends.
    """
    pairs = _pair_neighbors(first, first_beside.counts, last, last_beside.counts)
    if pairs is None:
        return None
    begin, begin_near, end, end_near = pairs
    begin_rate = (begin_near - begin) / first_beside.distance
    end_rate = (end_near - end) / last_beside.distance
    t, change = _SHARES[:, None], end - begin
    bend = t * (1.0 - t) * ((begin_rate - change) * (1.0 - t) - (end_rate - change) * t)
    growing = _count_growing(begin + change * t + bend, _MIN_GROWTH)
    # Pairs of other eigenvalues at the end do not follow from the rates.
    error, size = np.abs(change - 0.5 * (begin_rate + end_rate)), np.abs(begin) + np.abs(end)
    largest = np.maximum(np.abs(begin_rate), np.abs(end_rate))
    is_same = (error <= _MAX_RATE_ERROR * largest + _MIN_CHANGE * size).all(axis=(0, 1))
    differs = (growing != growing[0]) & (growing[0] == growing[-1]) & is_same
    return _middle_of(differs.any(axis=1))


def _pair_neighbors(*counts: Count) -> Array | None:
    """Return mean and (l1 - l2)^2 / 4 of neighbors among the slowest eigenvalues.

    They are those of each count in one unit, (counts, 2, 1, k); None if there are no pairs.
    """
    size, unit = min(len(x.spectrum) for x in counts), max(x.log_unit for x in counts)
    if size < 2:
        return None
    pairs = []
    for count in counts:
        values = count.spectrum.astype(complex) * np.exp(count.log_unit - unit)
        values = values[np.lexsort((values.real, values.imag))]
        cut = (len(values) - size) // 2
        lower, upper = values[cut : cut + size - 1], values[cut + 1 : cut + size]
        pairs.append([0.5 * (upper + lower), 0.25 * (upper - lower) ** 2])
    return np.array(pairs)[:, :, None]


def _count_growing(pairs: Array, min_growth: float) -> Array:
    """Return the number of eigenvalues that grow in pairs (2, positions, k), (positions, k)."""
    mean, root = pairs[0], np.sqrt(pairs[1])
    values = np.array([mean + root, mean - root])
    return np.asarray((values.real > min_growth * np.abs(values)).sum(axis=0))


def find_hidden_turn(change: float, begin_rate: float, end_rate: float) -> float | None:
    """Return a position from 0 to 1 where a quantity may reverse that changes by `change`."""
    if begin_rate * end_rate <= 0.0:
        return None
    line = begin_rate + (end_rate - begin_rate) * _SHARES
    bend = 6.0 * (change - 0.5 * (begin_rate + end_rate)) * _SHARES * (1.0 - _SHARES)
    return _middle_of((line + bend) * begin_rate < 0.0)


def _middle_of(mask: Array) -> float | None:
    """Return the middle of the positions with this mask, or None."""
    selected = np.flatnonzero(mask)
    return float(_SHARES[selected[len(selected) // 2]]) if len(selected) else None
