"""Points of an equilibrium path, and what becomes critical between two of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import brentq

from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.path_controls import Control, PathDirection
from beamdae.results.outcome import REACHED_END, Status

# Of a stretch: how closely a point is found where Newton's method ends the search, and the
# distances of points by which one is found where it cannot.
_LANDED, _WIDTH = 1e-6, 1e-3
# The same distances for a path that only touches another, of which near points might be; and what
# is left of the eigenvalue, of its size at the ends.
_APART, _TOUCHED = 0.1, 1e-2
# How often one in which several things happen is halved.
_SPLITS = 6

Array = np.ndarray

LIMIT, BRANCH, FLUTTER = "limit point", "branch point", "flutter point"


@dataclass(frozen=True)
class PathCriticalPoint:
    """A point at which the tangent stiffness loses a direction.

    Attributes
    ----------
    kind
        `LIMIT`, where the load factor turns; `BRANCH`, where another path crosses; `FLUTTER`, where
        eigenvalues of forces without a potential become complex.
    place
        Which point of the path it is.
    index
        Which eigenvalue vanishes.
    """

    kind: str
    place: int
    index: int


@dataclass
class Path:
    """Points of a path in the order they are found.

    Attributes
    ----------
    size
        Of the next step.
    stuck
        Whether it ended where no step converges.
    """

    points: list[EquilibriumPoint] = field(default_factory=list)
    critical: list[PathCriticalPoint] = field(default_factory=list)
    status: Status = REACHED_END
    size: float = np.inf
    stuck: bool = False

    @property
    def end(self) -> EquilibriumPoint:
        """The last point."""
        return self.points[-1]

    @property
    def branches(self) -> list[PathCriticalPoint]:
        """Where other paths cross."""
        return [one for one in self.critical if one.kind == BRANCH]

    def add(self, stretch: PathSegment, critical: Sequence[SegmentCriticalPoint]) -> None:
        """Add the end of a stretch, and before it what is critical on the way there."""
        for found in critical:
            self.critical.append(PathCriticalPoint(found.kind, len(self.points), found.index))
            self.points.append(found.point)
        self.points.append(stretch.end)


@dataclass(frozen=True)
class PathSegment:
    """The path between two of its points, by the control of the step that was made.

    Attributes
    ----------
    values
        Of the control at both points.
    ways
        The directions of the path at both points by the control, as far as it tells them.
    """

    corrector: Corrector
    control: Control
    begin: EquilibriumPoint
    end: EquilibriumPoint
    values: tuple[float, float]
    ways: tuple[PathDirection, PathDirection | None]

    def at(self, share: float) -> EquilibriumPoint:
        """A point between: 0 is the begin, 1 the end."""
        a, b, (first, last) = self.begin, self.end, self.values
        x, mu = a.x + share * (b.x - a.x), a.mu + share * (b.mu - a.mu)
        return self.corrector.corrected(self.control, first + share * (last - first), x, mu)

    def up_to(self, aim: Control, target: float) -> PathSegment | None:
        """The part of it up to a value of `aim`; None where that is not reached."""
        off = [aim.value(point.x, point.mu) - target for point in (self.begin, self.end)]
        if off[0] * off[1] > 0.0 or off[0] == 0.0:
            return None
        share = 1.0
        if off[1] != 0.0:

            def missed(share: float) -> float:
                point = self.at(share)
                return aim.value(point.x, point.mu) - target

            share = brentq(missed, 0.0, 1.0, xtol=_LANDED)
        near = self.at(share)
        try:
            end = self.corrector.corrected(aim, target, near.x, near.mu)
        except CorrectorError:
            # Where the aim itself turns nothing is closer.
            end = near
        value = self.control.value(end.x, end.mu)
        after = self.corrector.direction(end, self.control)
        return replace(self, end=end, values=(self.values[0], value), ways=(self.ways[0], after))

    def critical(self, splits: int = _SPLITS) -> list[SegmentCriticalPoint]:
        """What is critical in it, in order."""
        counts = [point.stability.negative for point in (self.begin, self.end)]
        low, high = min(counts), max(counts)
        if low < 0:
            return []
        if not all(len(point.stability.values) for point in (self.begin, self.end)):
            return self._flutter(counts) if low < high else []
        found = [self._lost(index) for index in range(low, high)]
        if low == high and self._turns():
            found = [self._touched()]
            if found[0] is not None and found[0].kind == LIMIT and splits:
                # One direction is lost and one is found again.
                return [one for half in self._halves() for one in half.critical(splits - 1)]
        return sorted(filter(None, found), key=lambda one: one.share)

    def _halves(self) -> tuple[PathSegment, PathSegment]:
        middle, value = self._beside(0.5), 0.5 * sum(self.values)
        way = self.corrector.direction(middle, self.control)
        if way is None:
            raise CorrectorError("paths cross there")
        return (
            replace(self, end=middle, values=(self.values[0], value), ways=(self.ways[0], way)),
            replace(self, begin=middle, values=(value, self.values[1]), ways=(way, self.ways[1])),
        )

    def _flutter(self, counts: Sequence[int]) -> list[SegmentCriticalPoint]:
        """Where the number of unstable directions changes without a potential."""
        near = self._around(self._changed(counts[0]), None)
        return [replace(near, kind=FLUTTER) if abs(counts[1] - counts[0]) > 1 else near]

    def _lost(self, index: int) -> SegmentCriticalPoint | None:
        """Where an eigenvalue changes its sign, if it does."""
        ends = [point.stability.value(index) for point in (self.begin, self.end)]
        if not ends[0] * ends[1] < 0.0:
            return None

        def left(point: EquilibriumPoint) -> float:
            value = point.stability.value(index)
            if np.isnan(value):
                raise CorrectorError("the stability of equilibria changes abruptly")
            return value

        share = brentq(lambda share: left(self._beside(share)), 0.0, 1.0, xtol=_WIDTH)
        return replace(self._around(share, left), index=index)

    def _turns(self) -> bool:
        """Whether the load factor begins to fall or to rise in it."""
        rates = [0.0 if way is None else way.mu for way in self.ways]
        return rates[0] * rates[1] < 0.0

    def _touched(self) -> SegmentCriticalPoint | None:
        """Where the load factor turns and no direction is lost, as on a path that branches off.

        There it crosses the one that it came from, or another, and an eigenvalue touches zero.
        """

        def rate(point: EquilibriumPoint) -> float:
            way = self.corrector.direction(point, self.control)
            return 0.0 if way is None else way.mu

        begin, end = (0.0 if way is None else way.mu for way in self.ways)
        first = self._around(begin / (begin - end), rate, _APART)
        near = self._around(first.share, rate, _APART)
        told = near.point.stability
        place = int(np.argmin(np.abs(told.values)))
        index = place - int(np.sum(told.values < 0.0)) + told.negative
        ends = [abs(point.stability.value(index)) for point in (self.begin, self.end)]
        if not abs(told.values[place]) <= _TOUCHED * max(ends):
            return None
        aside = (self._beside(near.share + far) for far in (-_APART, _APART))
        before, after = (point.stability.negative for point in aside)
        return replace(near, kind=BRANCH if before == after else LIMIT, index=index)

    def _beside(self, share: float) -> EquilibriumPoint:
        """A point between, or close by where paths cross and Newton's method has no hold."""
        for aside in (0.0, _WIDTH, -_WIDTH):
            try:
                return self.at(share + aside)
            except CorrectorError as problem:
                told = problem
        raise told

    def _changed(self, count: int) -> float:
        """Where the number of unstable directions is no longer this one."""
        low, high = 0.0, 1.0
        while high - low > _LANDED:
            between = 0.5 * (low + high)
            same = self._beside(between).stability.negative == count
            low, high = (between, high) if same else (low, between)
        return 0.5 * (low + high)

    def _around(
        self, share: float, left: Callable[[EquilibriumPoint], float] | None, width: float = _WIDTH
    ) -> SegmentCriticalPoint:
        """The point at which something vanishes, near a share; None: there it is.

        From four points around it: at the point itself, where paths cross, the equations do not
        say how far a point is along the other one.
        """
        shares = share + width * np.array([-1.5, -0.5, 0.5, 1.5])
        points = [self._beside(at) for at in shares]
        if left is not None:
            share = _root(shares, [left(point) for point in points], share)
        weights = [
            np.prod([(share - b) / (a - b) for b in shares if b != a]) for a in shares.tolist()
        ]
        x = np.einsum("i,ij->j", weights, [point.x for point in points])
        factors = np.array([point.mu for point in points])
        rates = np.diff(factors)
        kind = LIMIT if rates[0] * rates[-1] < 0.0 else BRANCH
        point = EquilibriumPoint(self.corrector.system, x, float(weights @ factors))
        return SegmentCriticalPoint(share, point, kind, 0)


def _root(places: Array, values: Sequence[float], near: float) -> float:
    """The zero of the polynomial through these values that is nearest to a place."""
    unit = places[1] - places[0]
    roots = np.roots(np.polyfit((places - near) / unit, values, len(places) - 1))
    real = roots[np.abs(roots.imag) < 1e-6].real
    return near + unit * float(real[np.argmin(np.abs(real))]) if len(real) else near


@dataclass(frozen=True)
class SegmentCriticalPoint:
    """A critical point of a stretch: where, what, of which kind, and which eigenvalue vanishes."""

    share: float
    point: EquilibriumPoint
    kind: str
    index: int
