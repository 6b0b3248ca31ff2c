"""Points of an equilibrium path, and what becomes critical between two of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import brentq

from beamdae.analysis.controls import Control
from beamdae.analysis.corrector import Corrector, Point, StepError
from beamdae.results.outcome import REACHED_END, Status

# Of a stretch: how closely a point is found where Newton's method ends the search, and the
# distances of points by which one is found where it cannot.
_LANDED, _WIDTH = 1e-6, 1e-3

Array = np.ndarray

LIMIT, BRANCH, FLUTTER = "limit point", "branch point", "flutter point"


@dataclass(frozen=True)
class Critical:
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
    """

    points: list[Point] = field(default_factory=list)
    critical: list[Critical] = field(default_factory=list)
    status: Status = REACHED_END
    size: float = np.inf

    @property
    def end(self) -> Point:
        """The last point."""
        return self.points[-1]

    @property
    def branches(self) -> list[Critical]:
        """Where other paths cross."""
        return [one for one in self.critical if one.kind == BRANCH]

    def add(self, stretch: Stretch) -> None:
        """Add the end of a stretch, and before it what is critical on the way there."""
        for found in stretch.critical():
            self.critical.append(Critical(found.kind, len(self.points), found.index))
            self.points.append(found.point)
        self.points.append(stretch.end)


@dataclass(frozen=True)
class Stretch:
    """The path between two of its points, by the control of the step that was made.

    Attributes
    ----------
    values
        Of the control at both points.
    """

    corrector: Corrector
    control: Control
    begin: Point
    end: Point
    values: tuple[float, float]

    def at(self, share: float) -> Point:
        """A point between: 0 is the begin, 1 the end."""
        a, b, (first, last) = self.begin, self.end, self.values
        x, mu = a.x + share * (b.x - a.x), a.mu + share * (b.mu - a.mu)
        return self.corrector.corrected(self.control, first + share * (last - first), x, mu)

    def up_to(self, aim: Control, target: float) -> Stretch | None:
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
        except StepError:
            # Where the aim itself turns nothing is closer.
            end = near
        value = self.control.value(end.x, end.mu)
        return Stretch(self.corrector, self.control, self.begin, end, (self.values[0], value))

    def critical(self) -> list[Found]:
        """What is critical in it, in order."""
        counts = [point.stability.negative for point in (self.begin, self.end)]
        low, high = min(counts), max(counts)
        if low < 0 or low == high:
            return []
        if not len(self.begin.stability.values):
            share = self._changed(counts[0])
            near = self._around(share, None)
            return [replace(near, kind=FLUTTER) if high - low > 1 else near]
        found = []
        for index in range(low, high):
            ends = [point.stability.value(index) for point in (self.begin, self.end)]
            if ends[0] * ends[1] < 0.0:
                share = brentq(
                    lambda share, k=index: self._beside(share).stability.value(k),
                    0.0,
                    1.0,
                    xtol=_WIDTH,
                )
                found.append(self._around(share, index))
        return sorted(found, key=lambda one: one.share)

    def _beside(self, share: float) -> Point:
        """A point between, or close by where paths cross and Newton's method has no hold."""
        for aside in (0.0, _WIDTH, -_WIDTH):
            try:
                return self.at(share + aside)
            except StepError as problem:
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

    def _around(self, share: float, index: int | None) -> Found:
        """The point at which an eigenvalue vanishes, near a share; None: there it is.

        From four points around it: at the point itself, where paths cross, the equations do not
        say how far a point is along the other one.
        """
        shares = share + _WIDTH * np.array([-1.5, -0.5, 0.5, 1.5])
        points = [self._beside(at) for at in shares]
        if index is not None:
            values = [point.stability.value(index) for point in points]
            share = _root(shares, values, share)
        weights = [
            np.prod([(share - b) / (a - b) for b in shares if b != a]) for a in shares.tolist()
        ]
        x = np.einsum("i,ij->j", weights, [point.x for point in points])
        factors = np.array([point.mu for point in points])
        rates = np.diff(factors)
        kind = LIMIT if rates[0] * rates[-1] < 0.0 else BRANCH
        point = Point(self.corrector.system, x, float(weights @ factors))
        return Found(share, point, kind, index or 0)


def _root(places: Array, values: Sequence[float], near: float) -> float:
    """The zero of the polynomial through these values that is nearest to a place."""
    unit = places[1] - places[0]
    roots = np.roots(np.polyfit((places - near) / unit, values, len(places) - 1))
    real = roots[np.abs(roots.imag) < 1e-6].real
    return near + unit * float(real[np.argmin(np.abs(real))]) if len(real) else near


@dataclass(frozen=True)
class Found:
    """A critical point of a stretch: where, what, of which kind, and which eigenvalue vanishes."""

    share: float
    point: Point
    kind: str
    index: int
