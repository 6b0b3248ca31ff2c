"""Critical points of curves: bisection until each change is simple, then one root.

At a limit point the Jacobian is singular and the parameter has an extremum, at a branch point
another curve crosses, and at a flutter point an oscillation begins to grow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.continuation.engine import CurveError, Point, Segment

Array = np.ndarray

LIMIT, BRANCH, FLUTTER = "limit point", "branch point", "flutter point"

# Positions in a segment run from 0 to 1; closer points are one cluster.
_RESOLUTION = 1e-7
_ROOT_TOLERANCE = 1e-9
# Smallest share of a bracket in which a root is sought.
_MIN_SHARE = 1e-3


class Count(NamedTuple):
    """Numbers of growing motions: without, and with oscillation."""

    divergent: int
    oscillating: int


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """Critical point at a position of a segment, with the mode that becomes critical."""

    position: float
    kind: str
    point: Point
    mode: Array


class _Sample(NamedTuple):
    position: float
    point: Point
    counts: Any
    rate: float


def explain_counts(segment: Segment) -> list[CriticalPoint]:
    """Return the critical points of a segment, in order; monitors of points are `Count`.

    Raises
    ------
    CurveError
        If counts change abruptly, as on another curve.
    """
    first, last = (
        _Sample(position, point, point.monitor, segment.rate(point))
        for position, point in ((0.0, segment.begin), (1.0, segment.end))
    )
    return _explain(segment, first, last)


def _sample(segment: Segment, low: _Sample, high: _Sample, share: float) -> _Sample:
    """Return a sample between two others, or nearby if Newton's method fails there."""
    part = segment.part(low.point, high.point, low.position, high.position)
    for shift in (0.0, 0.2, -0.2, 0.35, -0.35):
        try:
            point = part.at(share + shift * min(share, 1.0 - share))
            position = low.position + (share + shift * min(share, 1.0 - share)) * (
                high.position - low.position
            )
            return _Sample(position, point, point.monitor, segment.rate(point))
        except CurveError as problem:
            error = problem
    raise error


def _explain(segment: Segment, low: _Sample, high: _Sample) -> list[CriticalPoint]:
    turns = low.rate * high.rate < 0.0
    change = high.counts.divergent - low.counts.divergent
    flutter = high.counts.oscillating - low.counts.oscillating
    if not (turns or change or flutter):
        return []
    if abs(change) == 1 and not flutter:
        found = _find_root(segment, low, high)
        if found is not None:
            position, point, mode = found
            return [CriticalPoint(position, LIMIT if turns else BRANCH, point, mode)]
    if high.position - low.position > _RESOLUTION:
        middle = _sample(segment, low, high, 0.5)
        return [*_explain(segment, low, middle), *_explain(segment, middle, high)]
    mode = critical_mode(low.point)
    if flutter:
        kinds = [FLUTTER] * abs(flutter)
        if not change or change + 2 * flutter == 0:
            kinds = kinds if change + 2 * flutter else []
    else:
        kinds = [BRANCH] * max(abs(change), 1)
    return [CriticalPoint(low.position, kind, low.point, mode) for kind in kinds]


def _find_root(segment: Segment, low: _Sample, high: _Sample) -> tuple[float, Point, Array] | None:
    """Return position, point and mode where the Jacobian is singular; None without a sign change.

    The root is that of the bordered test function g: [[J, b], [b^T, 0]] (v, g) = (0, 1).
    """

    def test(point: Point) -> tuple[float, Array]:
        factors = point.bordered(border, border, 0.0)
        solution = factors.solve(np.append(np.zeros(len(point.x)), 1.0))
        return float(solution[-1]), solution[:-1]

    weights = segment.begin.problem.weights
    for end in (low.point, high.point):
        border = weights**2 * critical_mode(end)
        (a, _), (b, _) = test(low.point), test(high.point)
        if a * b < 0.0:
            break
    else:
        return None
    (left, first), (right, last) = low[:2], high[:2]
    largest = max(abs(a), abs(b))
    turns = low.rate * high.rate < 0.0
    while True:
        share = min(max(a / (a - b), _MIN_SHARE), 1.0 - _MIN_SHARE)
        part = segment.part(first, last, left, right)
        try:
            point = part.at(share) if turns else part.unfold(share, border)
        except CurveError:
            return None
        position = left + share * (right - left)
        value, mode = test(point)
        if abs(value) > largest:
            # The sign changes at a pole of g, where the bordered matrix is singular.
            return None
        if right - left < _ROOT_TOLERANCE or value == 0.0:
            return position, point, mode
        # Of the end that stays, the value is halved: the Illinois method.
        if value * a > 0.0:
            left, first, a, b = position, point, value, 0.5 * b
        else:
            right, last, b, a = position, point, value, 0.5 * a


def critical_mode(point: Point) -> Array:
    """Return the direction in which the Jacobian is smallest, by inverse iteration.

    Its largest entry is 1 in natural sizes.
    """
    size, weights = len(point.x), point.problem.weights
    mode = np.cos(np.arange(size) ** 2.0) / np.where(weights > 0.0, weights, 1.0)
    for _ in range(3):
        border = weights**2 * mode
        factors = point.bordered(border, border, 0.0)
        mode = factors.solve(np.append(np.zeros(size), 1.0))[:-1]
        mode = mode / np.max(np.abs(weights * mode))
    return mode
