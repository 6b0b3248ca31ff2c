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
_ROOT_TOLERANCE = 1e-8


class Count(NamedTuple):
    """Number of growing motions: without, and with oscillation."""

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
    count: Count
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


def _sample(segment: Segment, position: float) -> _Sample:
    for shift in (0.0, 0.2, -0.2, 0.35, -0.35):
        try:
            moved = position + shift * 2.0 * _RESOLUTION
            point = segment.at(moved)
            return _Sample(moved, point, point.monitor, segment.rate(point))
        except CurveError as problem:
            error = problem
    raise error


def _explain(segment: Segment, low: _Sample, high: _Sample) -> list[CriticalPoint]:
    turns = low.rate * high.rate < 0.0
    change = high.count.divergent - low.count.divergent
    flutter = high.count.oscillating - low.count.oscillating
    if not (turns or change or flutter):
        return []
    width = high.position - low.position
    if abs(change) == 1 and not flutter:
        found = _find_root(segment, low, high)
        if found is not None:
            position, point, mode = found
            return [CriticalPoint(position, LIMIT if turns else BRANCH, point, mode)]
    if width > _RESOLUTION:
        middle = _sample(segment, 0.5 * (low.position + high.position))
        return [
            *_explain(segment, low, middle),
            *_explain(segment, middle, high),
        ]
    point = segment.at(0.5 * (low.position + high.position))
    mode = critical_mode(point)
    position = 0.5 * (low.position + high.position)
    if flutter:
        kinds = [FLUTTER] * abs(flutter)
        if not change or change + 2 * flutter == 0:
            kinds = kinds if change + 2 * flutter else []
    elif change:
        kinds = [BRANCH] * abs(change)
    else:
        kinds = [BRANCH]
    return [CriticalPoint(position, kind, point, mode) for kind in kinds]


def _find_root(segment: Segment, low: _Sample, high: _Sample) -> tuple[float, Point, Array] | None:
    """Return position, point and mode where the Jacobian is singular; None without a sign change.

    The root is that of the bordered test function g: [[J, b], [c^T, 0]] (v, g) = (0, 1).
    """
    border = critical_mode(low.point), critical_mode(high.point)

    def test(point: Point, c: Array) -> tuple[float, Array]:
        factors = point.bordered(c, c, 0.0)
        solution = factors.solve(np.append(np.zeros(len(point.x)), 1.0))
        return float(solution[-1]), solution[:-1]

    for c in border:
        (a, _), (b, mode) = test(low.point, c), test(high.point, c)
        if a * b < 0.0:
            break
    else:
        return None
    left, right, point = low.position, high.position, high.point
    position = right
    for _ in range(60):
        position = left - a * (right - left) / (b - a)
        position = min(max(position, left + 1e-3 * (right - left)), right - 1e-3 * (right - left))
        try:
            point = segment.at(position)
        except CurveError:
            # Next to a crossing, Newton's method is not reliable.
            return position, _between(segment, left, right, position), mode
        value, mode = test(point, c)
        if abs(right - left) < _ROOT_TOLERANCE or value == 0.0:
            break
        if value * a > 0.0:
            left, a, b = position, value, 0.5 * b
        else:
            right, b, a = position, value, 0.5 * a
    return position, point, mode


def _between(segment: Segment, left: float, right: float, position: float) -> Point:
    for side in (left, right):
        try:
            return segment.at(side)
        except CurveError:
            continue
    raise CurveError("points next to a critical point cannot be found")


def critical_mode(point: Point) -> Array:
    """Return the direction in which the Jacobian is smallest, by inverse iteration."""
    size = len(point.x)
    start = np.cos(np.arange(size) ** 2.0) * (point.problem.weights > 0.0)
    factors: Any = point.bordered(start, start, 0.0)
    vector = start
    for _ in range(3):
        vector = factors.solve(np.append(np.zeros(size), 1.0))[:-1]
        vector = vector / np.linalg.norm(vector)
        factors = point.bordered(vector, vector, 0.0)
    return vector
