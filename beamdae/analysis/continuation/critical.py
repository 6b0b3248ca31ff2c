"""Critical points of curves: bisection until each change is simple, then one root.

At a limit point the Jacobian is singular and the parameter has an extremum, at a branch point
another curve crosses, and at a flutter point an oscillation begins to grow. Along periodic motions,
disturbances that alternate from period to period begin to grow at a period doubling.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.analysis.continuation.engine import (
    REGULAR_DISTANCE,
    CurveError,
    Point,
    Segment,
    interpolate,
    weigh_nodes,
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
# Wider brackets, relative to this distance, are bisected if a point is not found.
_WIDE = 100.0
# Points of narrower parts of a segment are found together, and pairs of points that cancel are not
# sought in them.
_CLUSTER_WIDTH = 1e-2
# Share of a segment at which it is divided, the golden section: critical points at round shares,
# such as those of a load step, are no samples, at which the tangent would be singular.
_SPLIT = 0.381966
# Positions between two points at which interpolated quantities are examined.
_SHARES = np.linspace(0.0, 1.0, 101)
# Largest distance between curves that cross, relative to the sizes of mode and parameter: others
# pass each other.
_MAX_IMPERFECTION = 2e-5


class Determinant(NamedTuple):
    """Sign of a determinant, 0 if it is not known, and the logarithm of its magnitude."""

    sign: int = 0
    log_size: float = 0.0


class Count(NamedTuple):
    """Numbers of growing motions at a point.

    Attributes
    ----------
    divergent, oscillating
        Motions without and with oscillation; -1 if they are not known.
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


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """Critical point at a position of a segment, with the mode that becomes critical."""

    position: float
    kind: str
    point: Point
    mode: Array


class _Sample(NamedTuple):
    """Point of a segment, and the tangent with respect to the control."""

    position: float
    point: Point
    tangent: Array

    @property
    def counts(self) -> Count:
        """Numbers of growing motions."""
        count: Count = self.point.monitor
        return count

    @property
    def rate(self) -> float:
        """Derivative of the parameter by the control."""
        return float(self.tangent[-1])


def explain_counts(segment: Segment, resolution: float = _RESOLUTION) -> list[CriticalPoint]:
    """Return the critical points of a segment, in order; closer ones are one cluster.

    Monitors of points are of type `Count`.

    Raises
    ------
    CurveError
        If counts change abruptly, as on another curve.
    """
    first = _Sample(0.0, segment.begin, segment.begin_tangent)
    return _explain(segment, first, _Sample(1.0, segment.end, segment.tangent), resolution)


def _point_between(
    segment: Segment, low: tuple[float, Point], high: tuple[float, Point], position: float
) -> Point:
    """Return the point at a position between two others."""
    (left, first), (right, last) = low, high
    part = segment.part(first, last, left, right)
    return part.at((position - left) / (right - left))


def _explain(
    segment: Segment, low: _Sample, high: _Sample, resolution: float
) -> list[CriticalPoint]:
    """Return the critical points between two samples: a root, those of parts, or a cluster."""
    width, turns = high.position - low.position, low.rate * high.rate < 0.0
    change, flutter, doublings = np.subtract(high.counts.growing, low.counts.growing).tolist()
    changes = change or flutter or doublings

    def split(share: float) -> list[CriticalPoint]:
        """Return the points of both parts."""
        position = low.position + share * width
        point = _point_between(segment, low[:2], high[:2], position)
        middle = _Sample(position, point, segment.tangent_at(point))
        parts = ((low, middle), (middle, high))
        return [x for one, other in parts for x in _explain(segment, one, other, resolution)]

    if not (turns or changes):
        share = _find_hidden_change(segment, low, high)
        return [] if share is None else split(share)
    count = max(abs(change) + abs(doublings), 1)
    is_simple = not flutter and not (doublings and (turns or change)) and not (turns and count > 1)
    if is_simple and (count == 1 or width <= _CLUSTER_WIDTH):
        kind = DOUBLING if doublings else LIMIT if turns else BRANCH
        roots = _find_roots(segment, low, high, count, bool(doublings))
        if roots:
            located = ((x, point, mode) for x, (point, modes) in roots.items() for mode in modes)
            return [CriticalPoint(x, kind, point, mode) for x, point, mode in located]
    if width > (resolution if changes else _TURN_RESOLUTION):
        return split(_SPLIT)
    if not changes:
        return [_find_turn(segment, low, high)]
    mode = critical_modes(low.point)[:, 0]
    # Growing motions that merge to a growing oscillation, or the reverse, are no critical point.
    growing = abs(change + 2 * flutter)
    limits = int(turns and growing > 0)
    oscillations = min(abs(flutter), (growing - limits) // 2)
    kinds = [LIMIT] * limits + [FLUTTER] * oscillations
    kinds += [BRANCH] * (growing - limits - 2 * oscillations) + [DOUBLING] * abs(doublings)
    point = replace(low.point, beside=_stable_side(low, high))
    return [CriticalPoint(low.position, kind, point, mode) for kind in kinds]


def _stable_side(low: _Sample, high: _Sample) -> Point:
    """Return the point with fewer growing motions, as at the critical point between both."""
    return min(low, high, key=lambda x: x.counts.unstable).point


def _find_hidden_change(segment: Segment, low: _Sample, high: _Sample) -> float | None:
    """Return the share of the way between two samples where counts may differ, or None.

    The parameter reverses where its rate, or motions begin to grow where the determinant has
    another sign than at both samples. They are parabolas with the values at both samples, and with
    the change of the parameter or the determinant halfway, on the cubic through the samples.
    """
    width = high.position - low.position
    if width <= 2.0 * _CLUSTER_WIDTH:
        return None
    way, t = width * segment.reach, _SHARES
    bubble, line = t * (1.0 - t), (1.0 - t) * low.rate + t * high.rate
    move = high.point.minus(low.point)
    share = _find_other_sign(line + 6.0 * (move[-1] / way - line.mean()) * bubble, low.rate)
    first, last = (x.counts.determinant for x in (low, high))
    if share is None and first.sign == last.sign != 0:
        move = 0.5 * move + 0.125 * way * (low.tangent - high.tangent)
        x, p = low.point.x + move[:-1], low.point.p + float(move[-1])
        samples = first, low.point.problem.determinant(x, p), last
        unit = max(x.log_size for x in samples)
        begin, middle, end = (x.sign * np.exp(x.log_size - unit) for x in samples)
        line = (1.0 - t) * begin + t * end
        share = _find_other_sign(line + 4.0 * (middle - line.mean()) * bubble, first.sign)
    is_far = share is not None and width * min(share, 1.0 - share) > _CLUSTER_WIDTH
    return share if is_far else None


def _find_other_sign(values: Array, sign: float) -> float | None:
    """Return the position of the value that is most opposed to a sign, or None."""
    k = int(np.argmin(values * sign))
    return float(_SHARES[k]) if values[k] * sign < 0.0 else None


def _find_turn(segment: Segment, low: _Sample, high: _Sample) -> CriticalPoint:
    """Return the point where the parameter has an extremum, which is a parabola between samples.

    Without known motions, it is a limit point.
    """
    share, width = low.rate / (low.rate - high.rate), high.position - low.position
    move = share * high.point.minus(low.point)
    move[-1] = 0.5 * low.rate * share * width * segment.reach
    point = replace(low.point.plus(move), beside=low.point)
    mode = critical_modes(low.point)[:, 0]
    kind = BRANCH if low.counts.divergent >= 0 else LIMIT
    return CriticalPoint(low.position + share * width, kind, point, mode)


@dataclass(frozen=True, eq=False)
class _Samples:
    """Test functions at points of a segment; one is zero where the Jacobian is singular.

    Attributes
    ----------
    segment
        The segment.
    test
        Function that returns the values (k,) of the test functions at a point, and modes (n, k).
    points, values, modes
        Points, values and modes by position.
    """

    segment: Segment
    test: Callable[[Point], tuple[Array, Array]]
    points: dict[float, Point] = field(default_factory=dict)
    values: dict[float, Array] = field(default_factory=dict)
    modes: dict[float, Array] = field(default_factory=dict)

    def add(self, position: float, point: Point) -> None:
        """Add a point."""
        self.points[position] = point
        self.values[position], self.modes[position] = self.test(point)

    def add_between(self, left: float, right: float, position: float) -> None:
        """Add the point at a position between two others."""
        ends = (left, self.points[left]), (right, self.points[right])
        self.add(position, _point_between(self.segment, *ends, position))

    def find_root(self, k: int) -> tuple[float, float, float] | None:
        """Return the root of test function `k`, and the samples around it.

        The root is interpolated between samples at a distance, because rounding moves points closer
        to a crossing along the critical modes. The result is None if the samples do not suffice.
        """
        for _ in range(_MAX_SAMPLES):
            values = self._select(k)
            right = min(x for x in values if values[x] <= 0.0)
            left = max(x for x in values if x < right)
            root = _interpolate_root(values, left, right)
            # Long steps may pass a critical point at their very beginning.
            distance = REGULAR_DISTANCE * min(1.0, 4.0 * min(root, 1.0 - root) + _RESOLUTION)
            is_left_far, is_right_far = (abs(x - root) > 2.0 * distance for x in (left, right))
            if not (is_left_far or is_right_far):
                self._add_beside(left, right, distance)
                return _interpolate_root(self._select(k), left, right), left, right
            aimed = root - distance if is_left_far else root + distance
            aimed = min(max(aimed, left + 0.5 * distance), right - 0.5 * distance)
            try:
                self.add_between(left, right, aimed)
            except CurveError:
                if right - left <= _WIDE * distance:
                    return root, left, right
                self.add_between(left, right, 0.5 * (left + right))
        return None

    def _select(self, k: int) -> dict[float, float]:
        """Return the values of test function `k` by position."""
        return {position: float(x[k]) for position, x in self.values.items()}

    def _add_beside(self, left: float, right: float, distance: float) -> None:
        """Add a third sample near a root between two, because test functions are not linear."""
        before = max((x for x in self.values if x < left), default=left)
        after = min((x for x in self.values if x > right), default=right)
        with suppress(CurveError):
            if after - right > max(left - before, distance):
                self.add_between(right, after, right + distance)
            elif left - before > distance:
                self.add_between(before, left, left - distance)


def _find_roots(
    segment: Segment, low: _Sample, high: _Sample, count: int, alternates: bool
) -> dict[float, tuple[Point, list[Array]]]:
    """Return the points where the Jacobian is singular, and their modes, by position.

    Of `count` motions, it becomes singular in each; there are no points without a sign change, or
    if samples do not suffice.
    """

    def select(point: Point) -> Point:
        # Motions alternate where the sum of monodromy matrix and identity is singular.
        linear = point.linearization
        return replace(point, linearization=linear.alternating) if alternates else point

    def test(point: Point) -> tuple[Array, Array]:
        # Relative to those at `low`, values fall in the order of their roots.
        singularity, modes = _test_singularity(select(point), border)
        triangle, vectors = la.schur(inverse @ singularity)
        order = np.argsort(np.diag(triangle))
        return np.diag(triangle)[order], modes @ vectors[:, order]

    weights = low.point.problem.mode_weights[:, None]
    border = weights**2 * critical_modes(select(low.point), count)
    found: dict[float, tuple[Point, list[Array]]] = {}
    try:
        inverse = np.linalg.inv(_test_singularity(select(low.point), border)[0])
    except np.linalg.LinAlgError:  # The sample is a critical point.
        return found
    samples = _Samples(segment, test)
    samples.add(*low[:2])
    samples.add(*high[:2])
    if np.any(samples.values[high.position] >= 0.0):
        return found
    beside = _stable_side(low, high)
    for k in range(count):
        bracket = samples.find_root(k)
        if bracket is None:
            return {}
        root, left, right = bracket
        mode, points = samples.modes[right][:, k], samples.points
        nearest = next((x for x in found if abs(x - root) <= _RESOLUTION), None)
        if nearest is not None:
            found[nearest][1].append(mode)
        elif low.rate * high.rate < 0.0:
            part = segment.part(points[left], points[right], left, right)
            point = part.at((root - left) / (right - left))
            found[root] = replace(point, beside=beside), [mode]
        else:
            point = interpolate(points, root)
            largest = max(abs(low.point.p), abs(high.point.p))
            if not alternates and _imperfection(point, border, largest) > _MAX_IMPERFECTION:
                raise CurveError("the stability changes abruptly")
            found[root] = replace(point, beside=beside), [mode]
    return found


def _interpolate_root(values: dict[float, float], left: float, right: float) -> float:
    """Return the position of the value zero between two positions with different signs.

    It is that by the cubic through the four smallest values, or by the line between both positions
    if the cubic leaves them.
    """
    nearest = sorted(values, key=lambda x: abs(values[x]))[:4]
    root = float(weigh_nodes([values[x] for x in nearest], 0.0) @ nearest)
    if left <= root <= right:
        return root
    return left + (right - left) * values[left] / (values[left] - values[right])


def _imperfection(point: Point, border: Array, parameter: float) -> float:
    """Return the distance at which curves pass each other, relative to a size of the parameter.

    Where they cross, the critical modes feel neither the residual nor its derivative by the
    parameter. The derivative grows with the distance, the residual with its square. `point` is
    between points on both sides of the crossing, where the Jacobian is singular.
    """
    linear, weights, (n, count) = point.linearization, point.problem.mode_weights, border.shape
    factors = point.bordered(border, border)
    residual, rate = (
        np.max(np.abs(factors.solve(np.append(x, np.zeros(count)))[n:]))
        for x in (linear.residual, linear.by_parameter)
    )
    sizes = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0.0)
    modes = np.min(np.linalg.norm(sizes[:, None] * border, axis=0))
    whole = float(np.linalg.norm(sizes * linear.by_parameter) / modes)
    if whole * parameter == 0.0:
        return 0.0
    return float(max(rate / whole, np.sqrt(residual / (whole * parameter))))


def critical_modes(point: Point, count: int = 1) -> Array:
    """Return directions (n, count) in which the Jacobian is smallest, by inverse iteration.

    Their largest entries are 1 in sizes that make all parts equally stiff.
    """
    weights = point.problem.mode_weights[:, None]
    modes = np.cos(np.arange(len(weights))[:, None] ** 2.0 * np.arange(1.0, 1.0 + count))
    modes = modes / np.where(weights > 0.0, weights, 1.0)
    for _ in range(3):
        _, modes = _test_singularity(point, weights**2 * modes)
        modes = modes / np.max(np.abs(weights * modes), axis=0)
    return modes


def _test_singularity(point: Point, border: Array) -> tuple[Array, Array]:
    """Return G (k, k) and V (n, k) of [[J, B], [B^T, 0]] (V, G) = (0, 1) for a border B, (n, k).

    G is singular where J is.
    """
    n, count = border.shape
    factors = point.bordered(border, border)
    right = np.pad(np.eye(count), ((0, 0), (n, 0)))
    solution = np.column_stack([factors.solve(x) for x in right])
    if not np.isfinite(solution).all():
        raise CurveError("the tangent is not finite")
    return solution[n:], solution[:n]
