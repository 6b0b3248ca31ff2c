"""Critical points of curves: bisection until each change is simple, then one root.

At a limit point the Jacobian is singular and the parameter has an extremum, at a branch point
another curve crosses, and at a flutter point an oscillation begins to grow. Along periodic motions,
disturbances that alternate from period to period begin to grow at a period doubling.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.continuation.counts import (
    Count,
    Neighbor,
    find_growth_change,
    find_hidden_growth,
    find_hidden_turn,
)
from beamdae.analysis.continuation.engine import (
    REGULAR_DISTANCE,
    CurveError,
    Point,
    Segment,
    Tangent,
    interpolate,
)

Array = np.ndarray

LIMIT, BRANCH, FLUTTER = "limit point", "branch point", "flutter point"
DOUBLING = "period doubling"

# Positions in a segment run from 0 to 1; closer points are one cluster.
_RESOLUTION = 1e-6
# Where a curve branches off another one, its parameter turns and an eigenvalue touches zero: closer
# to this point, rounding decides the sign of the eigenvalue.
_TURN_RESOLUTION = 1e-2
# Largest number of samples for a root.
_MAX_SAMPLES = 60
# Wider brackets, relative to this distance, are bisected at times.
_WIDE = 100.0
# Pairs of critical points that cancel are sought in parts of a segment down to this width, and the
# derivatives of eigenvalues are differences over this share of the part.
_HIDDEN_WIDTH, _NEIGHBOR_DISTANCE = 1e-2, 1e-3
# Largest share of the derivative by the parameter along the critical mode where curves cross: it is
# larger between two curves that pass each other.
_MAX_IMPERFECTION = 1e-5


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """Critical point at a position of a segment, with the mode that becomes critical."""

    position: float
    kind: str
    point: Point
    mode: Array


class _Sample(NamedTuple):
    """Point of a segment, with its tangent with respect to the control."""

    position: float
    point: Point
    counts: Count
    tangent: Tangent

    @property
    def rate(self) -> float:
        """Derivative of the parameter by the control."""
        return self.tangent.p


def explain_counts(segment: Segment, resolution: float = _RESOLUTION) -> list[CriticalPoint]:
    """Return the critical points of a segment, in order; closer ones are one cluster.

    Monitors of points are of type `Count`.

    Raises
    ------
    CurveError
        If counts change abruptly, as on another curve.
    """
    first, last = (
        _Sample(position, point, point.monitor, segment.tangent_at(point))
        for position, point in ((0.0, segment.begin), (1.0, segment.end))
    )
    return _explain(segment, first, last, resolution)


def _sample(segment: Segment, low: _Sample, high: _Sample, share: float) -> _Sample:
    """Return a sample between two others, see `_point_between`."""
    position, point = _point_between(segment, low[:2], high[:2], share)
    return _Sample(position, point, point.monitor, segment.tangent_at(point))


def _point_between(
    segment: Segment, low: tuple[float, Point], high: tuple[float, Point], share: float
) -> tuple[float, Point]:
    """Return a position and point between two others, or nearby if Newton's method fails there."""
    (left, first), (right, last) = low, high
    part = segment.part(first, last, left, right)
    for shift in (0.0, 0.2, -0.2, 0.35, -0.35):
        shifted = share + shift * min(share, 1.0 - share)
        try:
            return left + shifted * (right - left), part.at(shifted)
        except CurveError as problem:
            error = problem
    raise error


def _explain(
    segment: Segment, low: _Sample, high: _Sample, resolution: float
) -> list[CriticalPoint]:
    """Return the critical points between two samples: a root, those of halves, or a cluster."""
    turns = low.rate * high.rate < 0.0
    change, flutter, doublings = np.subtract(high.counts.growing, low.counts.growing).tolist()
    if not (turns or change or flutter or doublings):
        share = _find_hidden_change(segment, low, high)
        if share is None:
            return []
        middle = _sample(segment, low, high, share)
        return [
            *_explain(segment, low, middle, resolution),
            *_explain(segment, middle, high, resolution),
        ]
    is_turn = not (change or flutter or doublings)
    # The critical motion itself does not grow.
    stable = min(low, high, key=lambda x: x.counts.unstable).point
    is_single = abs(change) + abs(doublings) == 1 and not flutter and not (doublings and turns)
    if is_single or is_turn:
        found = _find_root(segment, low, high, bool(doublings))
        if found is not None:
            position, point, mode = found
            kind = DOUBLING if doublings else LIMIT if turns else BRANCH
            return [CriticalPoint(position, kind, replace(point, beside=stable), mode)]
    width = high.position - low.position
    if width > (_TURN_RESOLUTION if is_turn else resolution):
        share = 0.5 if is_turn else find_growth_change(low.counts, high.counts)
        middle = _sample(segment, low, high, share)
        # Beside clusters, rounding lets counts change back and forth.
        if width > REGULAR_DISTANCE or _is_between(middle.counts, low.counts, high.counts):
            return [
                *_explain(segment, low, middle, resolution),
                *_explain(segment, middle, high, resolution),
            ]
    if is_turn:
        return [_find_turn(segment, low, high)]
    mode = critical_mode(low.point)
    # Growing motions that merge to a growing oscillation, or the reverse, are no critical point.
    growing = abs(change + 2 * flutter)
    limits = int(turns and growing > 0)
    oscillations = min(abs(flutter), (growing - limits) // 2)
    kinds = [LIMIT] * limits + [FLUTTER] * oscillations
    kinds += [BRANCH] * (growing - limits - 2 * oscillations) + [DOUBLING] * abs(doublings)
    point = replace(low.point, beside=stable)
    return [CriticalPoint(low.position, kind, point, mode) for kind in kinds]


def _find_hidden_change(segment: Segment, low: _Sample, high: _Sample) -> float | None:
    """Return the share of the way between two samples where counts may differ, or None."""
    width = high.position - low.position
    if width <= 2.0 * _HIDDEN_WIDTH:
        return None
    way = width * (segment.values[1] - segment.values[0])
    change = high.point.p - low.point.p
    share = find_hidden_turn(change, way * low.rate, way * high.rate)
    if share is None and low.counts.pairs.size:
        try:
            neighbors = [_find_neighbor(x, way) for x in (low, high)]
        except CurveError:
            return None
        share = find_hidden_growth(low.counts, neighbors[0], high.counts, neighbors[1])
    is_far = share is not None and width * min(share, 1.0 - share) > _HIDDEN_WIDTH
    return share if is_far else None


def _find_neighbor(sample: _Sample, way: float) -> Neighbor:
    """Return the count beside a sample, at a distance relative to a change of the control."""
    problem = sample.point.problem
    tangent = sample.tangent.scale(way)
    move, count = sample.point.neighbor(tangent.scale(_NEIGHBOR_DISTANCE))
    one, other = (np.append(x.x * problem.weights, x.p) for x in (move, tangent))
    return Neighbor(count, float(one @ other) / float(other @ other))


def _is_between(counts: Count, first: Count, last: Count) -> bool:
    triples = zip(counts.growing, first.growing, last.growing, strict=True)
    return all(min(pair) <= x <= max(pair) for x, *pair in triples)


def _find_turn(segment: Segment, low: _Sample, high: _Sample) -> CriticalPoint:
    """Return the point where the parameter has an extremum, which is a parabola between samples."""
    share = low.rate / (low.rate - high.rate)
    begin, end = segment.values
    width = (high.position - low.position) * (end - begin)
    x, _ = low.point.between(high.point, share)
    p = low.point.p + 0.5 * low.rate * share * width
    problem = low.point.problem
    point = Point(problem, x, p, problem.linearize(x, p), beside=low.point)
    position = low.position + share * (high.position - low.position)
    return CriticalPoint(position, BRANCH, point, critical_mode(low.point))


class _Test(NamedTuple):
    """Bordered test function g: [[J, b], [b^T, 0]] (v, g) = (0, 1), zero where J is singular.

    For motions that alternate, J is that of the sum of monodromy matrix and identity.
    """

    border: Array
    alternates: bool

    @classmethod
    def at(cls, point: Point, alternates: bool) -> _Test:
        """Return the function with the critical mode of a point as its border."""
        mode = critical_mode(_select_matrix(point, alternates))
        return cls(point.problem.mode_weights**2 * mode, alternates)

    def __call__(self, point: Point) -> tuple[float, Array]:
        """Return g and the mode v."""
        matrix = _select_matrix(point, self.alternates)
        factors = matrix.bordered(self.border, self.border, 0.0)
        solution = factors.solve(np.append(np.zeros(len(point.x)), 1.0))
        return float(solution[-1]), solution[:-1]


def _select_matrix(point: Point, alternates: bool) -> Point:
    linear: Any = point.linearization
    return replace(point, linearization=linear.alternating) if alternates else point


class _Root:
    """Samples of a test function in a segment, and the two with different signs.

    Attributes
    ----------
    segment, test
        Segment and test function.
    ends
        Positions and points on both sides of the root.
    first, largest
        Value at the first sample, and largest value at the first ends.
    has_change
        True if the signs differ.
    positions, points
        Positions of samples by value, and points by position.
    mode
        Mode of the last sample.
    """

    def __init__(self, segment: Segment, test: _Test, low: _Sample, high: _Sample) -> None:
        self.segment, self.test, self.ends = segment, test, [low[:2], high[:2]]
        (self.first, _), (last, self.mode) = test(low.point), test(high.point)
        self.largest = max(abs(self.first), abs(last))
        self.has_change = self.first * last < 0.0
        self.positions = {self.first: low.position, last: high.position}
        self.points = dict(self.ends)

    @property
    def bounds(self) -> tuple[float, float]:
        """Positions on both sides of the root."""
        return self.ends[0][0], self.ends[1][0]

    def estimate(self) -> float:
        """Return the position of the root by interpolation."""
        left, right = self.bounds
        return min(max(_interpolate_inversely(self.positions), left), right)

    def sample(self, share: float) -> bool:
        """Add a sample between both ends, which it narrows; return False at a pole."""
        position, point = _point_between(self.segment, self.ends[0], self.ends[1], share)
        value, self.mode = self.test(point)
        self.ends[0 if value * self.first > 0.0 else 1] = position, point
        self.positions[value], self.points[position] = position, point
        return abs(value) <= self.largest

    def sample_beside(
        self, first: tuple[float, Point], last: tuple[float, Point], at: float
    ) -> None:
        """Add a sample between two points beside the root, if there is space."""
        if first[0] < at < last[0]:
            share = (at - first[0]) / (last[0] - first[0])
            position, point = _point_between(self.segment, first, last, share)
            self.positions[self.test(point)[0]], self.points[position] = position, point

    def narrow(self) -> float | None:
        """Narrow the ends down to where rounding moves points; return half their distance.

        Return None at a pole, or if the samples do not suffice.
        """
        for k in range(_MAX_SAMPLES):
            (left, right), root = self.bounds, self.estimate()
            # Long steps may pass a critical point at their very beginning.
            tolerance = REGULAR_DISTANCE * min(1.0, 4.0 * min(root, 1.0 - root) + _RESOLUTION)
            # Closer to a crossing, rounding moves points along the critical mode.
            is_left_far, is_right_far = (
                root - left > 2.0 * tolerance,
                right - root > 2.0 * tolerance,
            )
            if not (is_left_far or is_right_far):
                return tolerance
            aimed = root - tolerance if is_left_far else root + tolerance
            is_wide = right - left > _WIDE * tolerance
            if k % 3 == 2 and is_wide:
                aimed = 0.5 * (left + right)  # interpolation may converge slowly
            aimed = min(max(aimed, left + 0.5 * tolerance), right - 0.5 * tolerance)
            try:
                is_regular = self.sample((aimed - left) / (right - left))
            except CurveError:
                if not is_wide:
                    return tolerance
                is_regular = self.sample(0.5)
            if not is_regular:
                return None
        return None


def _find_root(
    segment: Segment, low: _Sample, high: _Sample, alternates: bool
) -> tuple[float, Point, Array] | None:
    """Return position, point and mode where the Jacobian is singular.

    Return None without a sign change, at a pole, or if the samples do not suffice.
    """
    for end in (low.point, high.point):
        test = _Test.at(end, alternates)
        root = _Root(segment, test, low, high)
        if root.has_change:
            break
    else:
        return None
    tolerance = root.narrow()
    if tolerance is None:
        return None
    # Samples on both sides, so that the cubic is that of the neighborhood.
    (left, first), (right, last) = ends = tuple(root.ends)
    root.sample_beside(low[:2], ends[0], left - 2.0 * tolerance)
    root.sample_beside(ends[1], high[:2], right + 2.0 * tolerance)
    position = root.estimate()
    if low.rate * high.rate < 0.0:
        share = (position - left) / (right - left)
        return position, segment.part(first, last, left, right).at(share), root.mode
    point = interpolate(root.points, position)
    if not alternates and _opposes(point, test.border) > _MAX_IMPERFECTION:
        raise CurveError("the stability changes abruptly")
    return position, point, root.mode


def _interpolate_inversely(samples: dict[float, float]) -> float:
    """Return the position of the value zero by the cubic through the four smallest values.

    It is that of the line through the values next to zero if the cubic leaves their interval.
    """
    values = sorted(samples, key=abs)[:4]
    weights = (np.prod([y / (y - x) for y in values if y != x]) for x in values)
    root = sum(float(w) * samples[x] for w, x in zip(weights, values, strict=True))
    below, above = max(x for x in samples if x < 0.0), min(x for x in samples if x >= 0.0)
    first, last = samples[below], samples[above]
    if min(first, last) <= root <= max(first, last):
        return root
    return first + (last - first) * below / (below - above)


def _opposes(point: Point, border: Array) -> float:
    """Return the share of the derivative by the parameter that a singular Jacobian cannot balance.

    It vanishes where curves cross. Elsewhere, a curve turns where its Jacobian is singular.
    """
    by_parameter, weights = point.linearization.by_parameter, point.problem.mode_weights
    right = np.append(by_parameter, 0.0)
    share = point.bordered(border, border, 0.0).solve(right)[-1]
    sizes = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0.0)
    whole = float(np.linalg.norm(sizes * by_parameter))
    return abs(share) * float(np.linalg.norm(sizes * border)) / whole if whole else 0.0


def critical_mode(point: Point) -> Array:
    """Return the direction in which the Jacobian is smallest, by inverse iteration.

    Its largest entry is 1 in sizes that make all parts equally stiff.
    """
    size, weights = len(point.x), point.problem.mode_weights
    mode = np.cos(np.arange(size) ** 2.0) / np.where(weights > 0.0, weights, 1.0)
    for _ in range(3):
        border = weights**2 * mode
        factors = point.bordered(border, border, 0.0)
        mode = factors.solve(np.append(np.zeros(size), 1.0))[:-1]
        mode = mode / np.max(np.abs(weights * mode))
    return mode
