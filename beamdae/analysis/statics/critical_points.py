"""Location of critical points between two points of an equilibrium path.

At a limit point, the tangent stiffness is singular and the load factor has an extremum. At a branch
point (bifurcation), the tangent stiffness is singular and another path crosses. At a flutter point,
which occurs only with forces without a potential, an oscillation begins to grow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.newton_loop import CORRECTION_ROUNDING
from beamdae.analysis.statics.null_vectors import SingularityTest
from beamdae.analysis.statics.path_controls import Control, PathDirection
from beamdae.analysis.statics.stability import Stability

Array = np.ndarray

LIMIT, BRANCH, FLUTTER = "limit point", "branch point", "flutter point"

# Positions in a segment run from 0 to 1. Tolerance of a search if Newton's method converges up to
# the critical point.
_POSITION_TOLERANCE = 1e-6
# Newton's method may not converge at the critical point, which is therefore interpolated from four
# points at this distance from each other. If the eigenvalue of the interpolated point exceeds the
# first fraction of its value at that distance, or the load factor varies by more than the second
# fraction, many critical points are close to each other, and the next smaller distance is used.
_SAMPLE_DISTANCE = 1e-3
_SAMPLE_DISTANCES = (_SAMPLE_DISTANCE, 1e-4, 1e-5, 1e-6, 1e-7)
_ZERO_RATIO = 1e-2
_MAX_LOAD_SPREAD = 0.05
# If the eigenvalue changes this many times as fast between the two samples next to the point as
# between the others, these lie on different paths.
_JUMP_RATIO = 10.0
# Where the corrector fails at a sample, it is moved by this fraction of the distance.
_RETRY_RATIO = 0.25
# Eigenvalues of the points are at least about this multiple of those that are zero up to rounding.
_UNDECIDED_MULTIPLE = 4.0
# Up to this multiple, the rate of the load factor may have the wrong sign: 2 to 10 were measured
# just after branch points of columns.
_DECIDED_MULTIPLE = 30.0
# The point is interpolated from points at this multiple of the distance at which rounding decides,
# up to the second number: next to that distance, rounding moves points along the critical mode.
_UNDECIDED_SPACING = 10.0
_MAX_UNDECIDED_SPACING = 5e-2
# Two eigenvalues that vanish at nearly equal positions change their order there. The derivatives of
# the ordered eigenvalues before and after it then have a ratio below this number.
_KINK_RATIO = 0.5
# Distance from the segment up to which an interpolated point is accepted if rounding decides.
_MAX_OUTSIDE = 0.5
# Distances from the onset of growth at which a singular tangent is sought; its samples are at this
# fraction of the distance.
_SEARCH_OFFSETS = tuple(_SAMPLE_DISTANCE * 2.0 ** np.arange(10.0))
_SAMPLE_RATIO = 0.1
# Distance from the segment up to which this tangent may lie because of rounding; in rings and
# columns with L/h = 1e5, both positions differ by up to 1e-3 (measured).
_MAX_SHIFT = 5e-2
# Distance used instead if an eigenvalue touches zero without a sign change: closer points might lie
# on the crossing path.
_TOUCH_SAMPLE_DISTANCE = 0.1
# An eigenvalue touches zero if it falls below this fraction of its size at the ends of the segment.
_TOUCH_RATIO = 1e-2
# Rates of the load factor below this fraction of those at the ends of the segment may be rounding
# errors. They are then computed at this distance from the point.
_MIN_RATE_RATIO = 1e-2
_WIDE_DISTANCE = 5e-2
# Range of load factors, relative to them, in which a number of growing modes that rises and falls
# does so by rounding errors or by the asymmetry of a coarse mesh, which separates or mixes modes
# that begin to grow at the same load. Ranges of rings are up to 2e-4 at L/h = 1e5 (measured).
_SAME_LOAD_RATIO = 1e-3
# A step back returns to the begin if the distance is below this fraction of the motion.
_MAX_RETURN_RATIO = 0.1
# Maximum number of bisections of a segment that may contain several critical points.
_MAX_SPLITS = 6
# Roots of the interpolating polynomial with a smaller imaginary part are real.
_REAL_ROOT_TOLERANCE = 1e-6


class PathJumpError(CorrectorError):
    """Raised if samples on both sides of a point lie on different paths."""


@dataclass(frozen=True)
class SegmentCriticalPoint:
    """Critical point inside a segment of a path.

    Attributes
    ----------
    position
        Position in the segment, from 0 to 1.
    point
        Interpolated equilibrium.
    kind
        `LIMIT`, `BRANCH` or `FLUTTER`.
    mode
        Shape (n,) of the critical mode.
    distance
        Distance between the positions of the points from which it is interpolated.
    change
        Change of the number of growing modes; 0 if the forces have a potential.
    loads
        First and last load factor of the range in which the point lies, if the number of growing
        modes rises and falls there; otherwise None.
    """

    position: float
    point: EquilibriumPoint
    kind: str
    mode: Array
    distance: float
    change: int = 0
    loads: tuple[float, float] | None = None


@dataclass(frozen=True)
class PathSegment:
    """Segment of a path between two points, parametrized by the control of the step.

    Attributes
    ----------
    corrector, control
        Corrector and control that compute points inside the segment.
    begin, end
        First and last point.
    control_values
        Values of the control at both points.
    directions
        Tangents of the path at both points; the second is None if it is undefined.
    """

    corrector: Corrector
    control: Control
    begin: EquilibriumPoint
    end: EquilibriumPoint
    control_values: tuple[float, float]
    directions: tuple[PathDirection, PathDirection | None]

    def point_at(self, position: float) -> EquilibriumPoint:
        """Return the equilibrium at a position from 0 (begin) to 1 (end)."""
        a, b, (first, last) = self.begin, self.end, self.control_values
        x = self.corrector.interpolate(a.x, b.x, position)
        mu = a.mu + position * (b.mu - a.mu)
        return self.corrector.correct(self.control, first + position * (last - first), x, mu)

    def require_return(self) -> None:
        """Require that a step back from the end leads to the begin.

        Where paths cross, a step may end on another path.

        Raises
        ------
        CorrectorError
            If it leads to another point, or fails.
        """
        (first, last), back = self.control_values, self.directions[1]
        assert back is not None
        step = back.scale(first - last)
        point, _ = self.corrector.follow(self.control, first, self.end, step)
        n, farthest = point.system.equations.n, self.corrector.displacement_measure.farthest
        deviation, motion = (farthest((x - self.begin.x)[:n]) for x in (point.x, self.end.x))
        if deviation > _MAX_RETURN_RATIO * motion + CORRECTION_ROUNDING:
            raise CorrectorError("paths cross within the step")

    def truncate(self, quantity: Control, target: float) -> PathSegment | None:
        """Return the segment up to `quantity` = `target`.

        Returns None if the segment begins at the target or does not reach it.
        """
        off = [quantity.value(point.x, point.mu) - target for point in (self.begin, self.end)]
        if off[0] * off[1] > 0.0 or off[0] == 0.0:
            return None
        position = 1.0
        if off[1] != 0.0:

            def deviation(position: float) -> float:
                point = self.point_at(position)
                return quantity.value(point.x, point.mu) - target

            position = _find_sign_change(deviation, off, _POSITION_TOLERANCE)
        near = self.point_at(position)
        try:
            end = self.corrector.correct(quantity, target, near.x, near.mu)
        except CorrectorError:
            # The quantity has an extremum at this point, so that the search cannot be more
            # accurate.
            end = near
        value = self.control.value(end.x, end.mu)
        after = self.corrector.try_path_tangent(end, self.control)
        return replace(
            self,
            end=end,
            control_values=(self.control_values[0], value),
            directions=(self.directions[0], after),
        )

    def locate_critical_points(self, splits: int = _MAX_SPLITS) -> list[SegmentCriticalPoint]:
        """Return the critical points in the segment, in order along the path.

        There is a point for each direction that becomes unstable or stable; the two directions of
        an oscillation share a point. A branch point at which an eigenvalue touches zero without a
        sign change is also found if the load factor has an extremum there. The list is empty if the
        stability at an end is unknown. `splits` is the number of bisections allowed.

        Raises
        ------
        CorrectorError
            If points in the segment cannot be computed, or the segment is too long to separate its
            critical points.
        """
        counts = [point.negative_count for point in (self.begin, self.end)]
        low, high = min(counts), max(counts)
        if low < 0:
            return []
        if not (self.begin.has_potential and self.end.has_potential):
            growth = self._locate_growth(0.0, self.begin.stability, 1.0, self.end.stability)
            return _cancel_opposite_changes(sorted(growth, key=lambda one: one.position))
        points = [self._locate_zero(k) for k in range(low, high)]
        # Rounding decides in which of two steps an eigenvalue changes sign if it is zero between
        # them; the load factor may have its extremum in the other step. Beside a branch point, it
        # decides the sign of the rate of the load.
        if low == high and self._load_turns() and all(map(_is_decided, (self.begin, self.end))):
            touch = self._locate_touch()
            if touch.kind == BRANCH:
                return [touch]
            if not splits:
                raise CorrectorError("the load has several extrema within the step")
            # An eigenvalue becomes negative and then positive again: each half has one sign change.
            return [
                one for half in self._halves() for one in half.locate_critical_points(splits - 1)
            ]
        points = sorted(points, key=lambda one: one.position)
        self._require_continuity(points, counts)
        return points

    def _require_continuity(
        self, points: Sequence[SegmentCriticalPoint], counts: Sequence[int]
    ) -> None:
        """Require that the number of unstable directions changes by one at each point.

        This rejects a step that leaves the path and would be connected to it by critical points
        that do not exist. `counts` are the numbers at the ends of the segment. Points that are
        close to each other are not checked.

        Raises
        ------
        CorrectorError
            If the number before a point differs from the expected one.
        """
        sign = 1 if counts[1] > counts[0] else -1
        for k, one in enumerate(points):
            margin = 2.0 * max(one.distance, _SAMPLE_DISTANCE)
            nearest = points[k - 1].position if k else -np.inf
            if one.position - nearest > 2.0 * margin:
                before = self._point_near(one.position - margin).negative_count
                if before != counts[0] + sign * k:
                    raise CorrectorError("the stability of equilibria changes abruptly")

    def _halves(self) -> tuple[PathSegment, PathSegment]:
        first, last = self.control_values
        middle, value = self._point_near(0.5), 0.5 * (first + last)
        direction = self.corrector.try_path_tangent(middle, self.control)
        if direction is None:
            raise CorrectorError("paths cross within the step")
        before, after = self.directions
        return (
            replace(
                self, end=middle, control_values=(first, value), directions=(before, direction)
            ),
            replace(
                self, begin=middle, control_values=(value, last), directions=(direction, after)
            ),
        )

    def _locate_growth(
        self, low: float, before: Stability, high: float, after: Stability
    ) -> list[SegmentCriticalPoint]:
        """Return the points between two positions where growing modes appear or vanish."""
        counts = [_growth_counts(stability) for stability in (before, after)]
        if counts[0] == counts[1]:
            return []
        if high - low > _POSITION_TOLERANCE:
            middle = 0.5 * (low + high)
            between = self._point_near(middle).stability
            if between.negative_count < 0:
                raise CorrectorError("the stability of an equilibrium within the step is unknown")
            return [
                *self._locate_growth(low, before, middle, between),
                *self._locate_growth(middle, between, high, after),
            ]
        (divergence, flutter), (later_divergence, later_flutter) = counts
        total = later_divergence + 2 * later_flutter - divergence - 2 * flutter
        if not total:
            # A growing oscillation becomes two growing modes without oscillation, or the reverse.
            return []
        unstable = after if after.negative_count > before.negative_count else before
        near = self._interpolate(0.5 * (low + high), None)
        oscillates = unstable.growth.imag > 0.0
        found = []
        if abs(total) == 1:
            # Also if the new mode and another one become an oscillation next to this point.
            return [replace(self._locate_divergence(near.position), change=total)]
        for kind, selected, number, size in (
            (FLUTTER, oscillates, later_flutter - flutter, 2),
            (near.kind, ~oscillates, later_divergence - divergence, 1),
        ):
            # The modes that have just begun to grow are the slowest.
            order = np.flatnonzero(selected)[np.argsort(unstable.growth[selected].real)]
            modes = unstable.growing_modes[:, order[: abs(number)]].T
            change = size if number > 0 else -size
            point = near
            if kind == FLUTTER and abs(number) == 1 and len(unstable.squares):
                point = self._locate_coalescence(near, complex(unstable.growth[order[0]]) ** 2)
            found += [replace(point, kind=kind, mode=mode, change=change) for mode in modes]
        return found

    def _locate_coalescence(
        self, near: SegmentCriticalPoint, square: complex
    ) -> SegmentCriticalPoint:
        """Return the point close to `near` at which two undamped vibrations coincide.

        Their squared eigenvalues are near `square`. In thin structures, growth exceeds rounding
        errors only beyond this point. The discriminant of the squared eigenvalues, which changes
        sign there, is interpolated from points at which rounding errors do not decide its sign.
        """

        def discriminant(point: EquilibriumPoint) -> float:
            return point.stability.discriminant(square)

        for distance in _SEARCH_OFFSETS:
            with suppress(CorrectorError):
                before, after = (
                    discriminant(self._point_near(near.position + side * distance))
                    for side in (-0.5, 0.5)
                )
                if before * after < 0.0:
                    point = self._interpolate(near.position, discriminant, distance)
                    is_close = abs(point.position - near.position) <= distance
                    return point if is_close else near
        return near

    def _locate_divergence(self, position: float) -> SegmentCriticalPoint:
        """Return the point near `position` at which the tangent is singular.

        Modes grow perceptibly only beyond this point, so that the search for them is less accurate.

        Raises
        ------
        CorrectorError
            If the tangent is regular in the segment, which contradicts the change of the number of
            growing modes.
        """
        near = self._point_near(position)
        test = SingularityTest.near(near.system, near.x, near.mu)

        def singularity(point: EquilibriumPoint) -> float:
            return test.value(point.system, point.x, point.mu)

        position, distance = self._search_singularity(position, near, singularity)
        # The kind follows from samples on both sides, which must be close to the point.
        point = self._interpolate(position, singularity, distance)
        point = self._interpolate(point.position, singularity, distance)
        if not -_MAX_SHIFT <= point.position <= 1.0 + _MAX_SHIFT:
            raise CorrectorError("the stability of equilibria changes abruptly")
        n = near.system.equations.n
        mode = test.mode[:n] / np.max(np.abs(test.mode[:n] / near.system.equations.position_scales))
        return replace(point, mode=mode)

    def _search_singularity(
        self,
        position: float,
        near: EquilibriumPoint,
        singularity: Callable[[EquilibriumPoint], float],
    ) -> tuple[float, float]:
        """Return the zero of `singularity` closest to `position`, and the distance of its samples.

        In thin structures, modes seem to grow up to 3 % of the load before or after this point, and
        samples that are close compared with this distance would differ by rounding only.

        Raises
        ------
        CorrectorError
            If `singularity` does not change its sign.
        """
        value = singularity(near)
        for offset in _SEARCH_OFFSETS:
            for side in (position - offset, position + offset):
                with suppress(CorrectorError):
                    other = singularity(self._point_near(side))
                    if value * other < 0.0:
                        root = position + (side - position) * value / (value - other)
                        return root, max(_SAMPLE_DISTANCE, _SAMPLE_RATIO * offset)
        raise CorrectorError("the stability of equilibria changes abruptly")

    def _locate_zero(self, index: int) -> SegmentCriticalPoint:
        """Return the point where eigenvalue `index` (from 0) changes sign."""
        ends = [point.stability.eigenvalue(index) for point in (self.begin, self.end)]
        if not ends[0] * ends[1] < 0.0:
            raise CorrectorError("the stability of equilibria changes abruptly")

        def eigenvalue(point: EquilibriumPoint) -> float:
            value = point.stability.eigenvalue(index)
            if np.isnan(value):
                raise CorrectorError("the stability of equilibria changes abruptly")
            return value

        # Closer to the zero, rounding moves points of a thin structure along the critical mode.
        zero = self.begin.stability.zero_tolerance
        undecided = _UNDECIDED_MULTIPLE * zero / abs(ends[1] - ends[0])
        distances = [distance for distance in _SAMPLE_DISTANCES if distance > undecided]
        if not distances:
            return self._locate_undecided(index, eigenvalue, ends, undecided)
        for distance in distances:
            position = self._search_zero(eigenvalue, ends, distance)
            try:
                near = self._interpolate(position, eigenvalue, distance, _continuous_root)
            except PathJumpError:
                continue
            sample = self._point_near(near.position + 1.5 * distance)
            # The step in load between the samples bounds the error of the load factor.
            is_fine = abs(sample.mu - near.point.mu) <= _MAX_LOAD_SPREAD * abs(near.point.mu)
            error = max(abs(eigenvalue(near.point)) - near.point.stability.zero_tolerance, 0.0)
            is_fine |= distance == distances[-1]
            if is_fine and error <= _ZERO_RATIO * abs(eigenvalue(sample)):
                return replace(near, mode=near.point.stability.mode(index))
        raise CorrectorError("the stability of equilibria changes abruptly")

    def _locate_undecided(
        self,
        index: int,
        eigenvalue: Callable[[EquilibriumPoint], float],
        ends: Sequence[float],
        distance: float,
    ) -> SegmentCriticalPoint:
        """Return the point where eigenvalue `index` changes sign, up to rounding.

        Eigenvalues at positions that are closer than `distance` to the point are rounding errors.
        """
        position = self._search_zero(eigenvalue, ends, distance)
        spacing = max(min(_UNDECIDED_SPACING * distance, _MAX_UNDECIDED_SPACING), distance)
        near = self._interpolate(position, eigenvalue, spacing, _kinked_root)
        position = min(max(near.position, 0.0), 1.0)
        if abs(near.position - position) > _MAX_OUTSIDE:
            raise CorrectorError("the stability of equilibria changes abruptly")
        point = near.point
        # Within the segment, the interpolated point is kept: rounding would move a corrected one
        # along the critical mode. Newton's method may also fail at a branch point.
        if position != near.position:
            with suppress(CorrectorError):
                point = self.point_at(position)
        mode = point.stability.mode(index)
        return replace(near, position=position, point=point, mode=mode)

    def _search_zero(
        self,
        function: Callable[[EquilibriumPoint], float],
        ends: Sequence[float],
        distance: float,
    ) -> float:
        """Return a position near a sign change of `function`, up to `distance`.

        Where Newton's method does not converge, the function is assumed to be zero.
        """

        def value(position: float) -> float:
            try:
                return function(self._point_near(position))
            except CorrectorError:
                return 0.0

        return _find_sign_change(value, ends, distance)

    def _load_turns(self) -> bool:
        rates = [0.0 if direction is None else direction.mu for direction in self.directions]
        return rates[0] * rates[1] < 0.0

    def _locate_touch(self) -> SegmentCriticalPoint:
        """Return the extremum of the load factor, where an eigenvalue is nearly zero.

        A path that branches off another one has such an extremum where both cross; there, the
        eigenvalue touches zero (`BRANCH`). If the eigenvalue changes sign instead, the point is a
        `LIMIT`.

        Raises
        ------
        CorrectorError
            If no eigenvalue is nearly zero, which indicates that the segment leaves the path.
        """

        def load_rate(point: EquilibriumPoint) -> float:
            direction = self.corrector.try_path_tangent(point, self.control)
            return 0.0 if direction is None else direction.mu

        begin, end = (0.0 if direction is None else direction.mu for direction in self.directions)
        first = self._interpolate(begin / (begin - end), load_rate, _TOUCH_SAMPLE_DISTANCE)
        near = self._interpolate(first.position, load_rate, _TOUCH_SAMPLE_DISTANCE)
        stability = near.point.stability
        closest = int(np.argmin(np.abs(stability.eigenvalues)))
        smaller = int(np.sum(stability.eigenvalues < 0.0))
        index = closest - smaller + stability.negative_count
        ends = [abs(point.stability.eigenvalue(index)) for point in (self.begin, self.end)]
        if not abs(stability.eigenvalues[closest]) <= _TOUCH_RATIO * max(ends):
            raise CorrectorError("the load has an extremum without a critical mode")
        distances = (-_TOUCH_SAMPLE_DISTANCE, _TOUCH_SAMPLE_DISTANCE)
        neighbors = (self._point_near(near.position + distance) for distance in distances)
        before, after = (point.negative_count for point in neighbors)
        kind = BRANCH if before == after else LIMIT
        return replace(near, kind=kind, mode=stability.modes[:, closest])

    def _point_near(self, position: float) -> EquilibriumPoint:
        """Return the point at a position, or nearby if the corrector fails there."""
        return self._sample_near(position, _SAMPLE_DISTANCE)[1]

    def _sample_near(self, position: float, distance: float) -> tuple[float, EquilibriumPoint]:
        """Return a position and its point, `distance` away if the corrector fails there."""
        for offset in (0.0, distance, -distance):
            try:
                return position + offset, self.point_at(position + offset)
            except CorrectorError as error:
                last_error = error
        raise last_error

    def _load_rates(self, first: EquilibriumPoint, last: EquilibriumPoint) -> Array:
        """Return the rates of the load factor along the path at two points.

        Where a tangent is undefined, both are the mean rate between the points.
        """
        tangents = [self.corrector.try_path_tangent(one, self.control) for one in (first, last)]
        rates = [tangent.mu for tangent in tangents if tangent is not None]
        return np.array(rates if len(rates) == 2 else [last.mu - first.mu] * 2)

    def _interpolate(
        self,
        position: float,
        function: Callable[[EquilibriumPoint], float] | None,
        distance: float = _SAMPLE_DISTANCE,
        find_root: Callable[[Array, Sequence[float], float], float] | None = None,
    ) -> SegmentCriticalPoint:
        """Return the point near `position` at which `function` vanishes.

        If `function` is None, the point is at `position`. `find_root` defaults to `_nearest_root`.
        The point is interpolated from four
        others, because Newton's method does not converge at branch points, where even the bordered
        tangent is singular.
        """
        offsets = distance * np.array([-1.5, -0.5, 0.5, 1.5])
        # Different samples remain different if the corrector fails at one of them.
        samples = [
            self._sample_near(position + offset, _RETRY_RATIO * distance)
            for offset in offsets.tolist()
        ]
        positions, points = np.array([one for one, _ in samples]), [one for _, one in samples]
        if function is not None:
            values = [function(point) for point in points]
            position = (find_root or _nearest_root)(positions, values, position)
        # Values of the Lagrange polynomials at the position.
        weights = [
            np.prod([(position - b) / (a - b) for b in positions if b != a])
            for a in positions.tolist()
        ]
        x = self.corrector.combine([point.x for point in points], weights)
        factors = np.array([point.mu for point in points])
        changes = self._load_rates(points[0], points[-1])
        ends = self._load_rates(self.begin, self.end)
        if np.min(np.abs(changes)) < _MIN_RATE_RATIO * np.max(np.abs(ends)):
            # Near the extremum of a thin beam's load, rounding determines the signs of its rates.
            wide = position + max(_WIDE_DISTANCE, 1.5 * distance) * np.array([-1.0, 1.0])
            changes = self._load_rates(*(self._point_near(x) for x in np.clip(wide, 0.0, 1.0)))
        kind = LIMIT if changes[0] * changes[1] < 0.0 else BRANCH
        point = EquilibriumPoint(self.corrector.system, x, float(weights @ factors))
        return SegmentCriticalPoint(position, point, kind, np.zeros(0), distance)


def _cancel_opposite_changes(
    points: Sequence[SegmentCriticalPoint],
) -> list[SegmentCriticalPoint]:
    """Return the points without those at nearly equal loads whose changes cancel each other.

    Of the points of a group with the sign of its total change, those in the middle remain whose
    changes reach the total, with the `loads` of the group.
    """
    groups: list[list[SegmentCriticalPoint]] = []
    for one in points:
        last = groups[-1][-1].point.mu if groups else np.nan
        if abs(one.point.mu - last) <= _SAME_LOAD_RATIO * abs(last):
            groups[-1].append(one)
        else:
            groups.append([one])
    remaining = []
    for group in groups:
        total = sum(one.change for one in group)
        same = [one for one in group if one.change * total > 0]
        if len(same) < len(group):
            factors = [one.point.mu for one in group]
            same = [replace(one, loads=(min(factors), max(factors))) for one in same]
        while same:
            removed = -1 if len(same) % 2 else 0
            if abs(sum(one.change for one in same) - same[removed].change) < abs(total):
                break
            same.pop(removed)
        remaining += same
    return remaining


def _growth_counts(stability: Stability) -> tuple[int, int]:
    """Return the numbers of growing modes without oscillation and of growing oscillations."""
    oscillations = stability.oscillation_count
    return stability.negative_count - 2 * oscillations, oscillations


def _is_decided(point: EquilibriumPoint) -> bool:
    """Return False if an eigenvalue is zero up to rounding errors."""
    stability = point.stability
    limit = _DECIDED_MULTIPLE * stability.zero_tolerance
    return not point.free_count and bool(np.all(np.abs(stability.eigenvalues) > limit))


def _find_sign_change(
    function: Callable[[float], float], ends: Sequence[float], tolerance: float
) -> float:
    """Return a position from 0 to 1 where `function` changes sign; `ends` are its end values.

    The end values are given because points computed again may differ in the last digits.
    """
    known = dict(zip((0.0, 1.0), ends, strict=True))

    def value(position: float) -> float:
        return known[position] if position in known else function(position)

    # Imported here because it takes longer than most equilibria.
    from scipy.optimize import brentq

    return float(brentq(value, 0.0, 1.0, xtol=tolerance))


def _nearest_root(positions: Array, values: Sequence[float], near: float) -> float:
    """Return the root nearest to `near` of the interpolating polynomial; `near` if none is real."""
    unit = positions[1] - positions[0]
    roots = np.roots(np.polyfit((positions - near) / unit, values, len(positions) - 1))
    real = roots[np.abs(roots.imag) < _REAL_ROOT_TOLERANCE].real
    return near + unit * float(real[np.argmin(np.abs(real))]) if len(real) else near


def _continuous_root(positions: Array, values: Sequence[float], near: float) -> float:
    """Return the result of `_nearest_root`.

    Raises
    ------
    PathJumpError
        If the values jump between the two samples in the middle.
    """
    first, middle, last = np.abs(np.diff(values) / np.diff(positions))
    if middle > _JUMP_RATIO * max(first, last):
        raise PathJumpError("the stability of equilibria changes abruptly")
    return _nearest_root(positions, values, near)


def _kinked_root(positions: Array, values: Sequence[float], near: float) -> float:
    """Return the root near `near` of a function that may have a kink there, from four samples.

    With a kink, the function is the smaller or the larger one of the lines through the first and
    the last two samples; otherwise, the result is that of `_nearest_root`.
    """
    starts, ends = np.asarray(values)[::2], np.asarray(values)[1::2]
    first, last = (ends - starts) / (positions[1::2] - positions[::2])
    small, large = sorted((first, last), key=abs)
    if not 0.0 < small * large < _KINK_RATIO * large**2:
        return _nearest_root(positions, values, near)
    roots = positions[::2] - starts / np.array([first, last])
    is_smaller_line = last < first
    return float(np.min(roots) if is_smaller_line == (first < 0.0) else np.max(roots))
