"""Detection of arguments that leave a table, and of steps that pass over a peak of a table.

Adaptive methods pass single kinks of tables without loss of accuracy, because the error test sees
them (see the decisions in the developer pages). A peak between the places at which the method
evaluates the table is not seen; the run then restarts where the peak begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.table_arguments import TableArgumentTerm
from beamdae.integrators.events.stop import Stop
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Relative tolerance of the time at which an argument passes a row.
_TIME_TOLERANCE = 1e-14
# A step passes over a peak if the values of rows inside the step differ by this fraction of the
# range of all values from those at both ends and in the middle of the step.
_MIN_PEAK = 0.05


@dataclass(frozen=True)
class TableWatch:
    """Watch of arguments that leave tables, and of steps that pass over their peaks.

    Attributes
    ----------
    terms
        Arguments of the tables in force formulas.
    finds_peaks
        True to detect peaks that a step passes over, for adaptive methods: their error test does
        not see a peak between the places at which they evaluate the table.
    grids
        Arguments of each call of a table of two arguments, for peaks.
    """

    terms: Sequence[TableArgumentTerm]
    finds_peaks: bool
    grids: Sequence[Sequence[TableArgumentTerm]] = ()
    spacing: ClassVar[float] = 0.0

    def find_first(self, interval: Interval, begin: float) -> Stop | None:
        """Return the first stop in the steps after `begin` [s], or None."""
        first = int(np.searchsorted(interval.t, begin))
        t, state = interval.t[first:], State(*(x[first:] for x in interval.state))
        stops = []
        for term in self.terms if len(t) > 1 else ():
            if term.part in interval.inactive:
                continue
            values = term.evaluate(t, interval.branch, state)
            if term.is_limited:
                stops.append(_find_end(term, interval, t, values))
            if self.finds_peaks and len(term.table.axes) == 1:
                stops.append(_find_peak(term, interval, t, values))
        if self.finds_peaks and len(t) > 1:
            grids = (grid for grid in self.grids if grid[0].part not in interval.inactive)
            stops += [_find_peak_of_grid(grid, interval, t, state) for grid in grids]
        return min((stop for stop in stops if stop is not None), default=None)


def _find_end(term: TableArgumentTerm, interval: Interval, t: Array, values: Array) -> Stop | None:
    (outside,) = np.nonzero(term.distance_outside(values) > 0.0)
    if not len(outside):
        return None
    k = max(int(outside[0]), 1)
    level = term.limits[int(values[k] > term.limits[0])]
    when = _locate(term, interval, float(t[k - 1]), float(t[k]), level)
    return Stop(when, when, term.describe(float(values[k])))


def _find_peak(term: TableArgumentTerm, interval: Interval, t: Array, values: Array) -> Stop | None:
    """Return the first row of the first peak that a step passed over; tables of one argument."""
    knots, heights = term.table.list_rows(float(values.min()), float(values.max()))
    place = np.searchsorted(knots, values)
    # A peak lies between two other rows.
    for k in np.flatnonzero((np.abs(np.diff(place)) > 1) & (np.diff(t) > 0.0)):
        start, end = float(t[k]), float(t[k + 1])
        ascends = place[k + 1] > place[k]
        rows = np.arange(min(place[k : k + 2]), max(place[k : k + 2]))[:: 1 if ascends else -1]
        middle = _evaluate(term, interval, 0.5 * (start + end))
        seen = term.table(np.array([values[k], middle, values[k + 1]]))
        excess = np.maximum(heights[rows] - seen.max(), seen.min() - heights[rows])
        (peaks,) = np.nonzero(excess > _MIN_PEAK * np.ptp(heights))
        if not len(peaks):
            continue
        peak = int(peaks[0])
        probe = _locate(term, interval, start, end, float(knots[rows[peak]]))
        foot = (
            start
            if peak == 0
            else _locate(term, interval, start, probe, float(knots[rows[peak - 1]]))
        )
        return Stop(foot, probe)
    return None


def _find_peak_of_grid(
    grid: Sequence[TableArgumentTerm], interval: Interval, t: Array, state: State
) -> Stop | None:
    """Return the first peak of a table of two arguments that a step passed over.

    The table is evaluated where the arguments, interpolated linearly, pass its rows, and between
    these places.
    """
    table = grid[0].table
    arguments = _evaluate_grid(grid, interval, t, state)
    places = [np.searchsorted(*pair) for pair in zip(table.axes, arguments, strict=True)]
    passed = sum(np.abs(np.diff(place)) for place in places)
    for k in np.flatnonzero((passed > 1) & (np.diff(t) > 0.0)):
        shares = [
            (knots[min(place[k : k + 2]) : max(place[k : k + 2])] - x[k]) / (x[k + 1] - x[k])
            for knots, place, x in zip(table.axes, places, arguments, strict=True)
            if place[k] != place[k + 1]
        ]
        rows = np.unique(np.concatenate([[0.0], *shares, [1.0]]))
        share = np.sort(np.concatenate([rows, 0.5 * (rows[1:] + rows[:-1]), [0.5]]))
        times = t[k] + share * (t[k + 1] - t[k])
        values = table(*_evaluate_grid(grid, interval, times, interval.at(times)))
        sampled = values[[0, int(np.searchsorted(share, 0.5)), -1]]
        excess = np.maximum(values - sampled.max(), sampled.min() - values)
        (peaks,) = np.nonzero(excess > _MIN_PEAK * np.ptp(table.values))
        if len(peaks):
            first = int(peaks[0])
            foot = float(t[k] + rows[rows < share[first]][-1] * (t[k + 1] - t[k]))
            probe = float(times[first + int(np.argmax(excess[first : first + 2]))])
            return Stop(foot, probe)
    return None


def _evaluate_grid(
    grid: Sequence[TableArgumentTerm], interval: Interval, t: Array, state: State
) -> list[Array]:
    """Return all arguments of a call at times `t` [s]."""
    arguments = [np.full(len(t), np.nan if x is None else x) for x in grid[0].constants]
    for term in grid:
        arguments[term.axis] = term.evaluate(t, interval.branch, state)
    return arguments


def _evaluate(term: TableArgumentTerm, interval: Interval, t: float) -> float:
    times = np.array([t])
    return float(term.evaluate(times, interval.branch, interval.at(times))[0])


def _locate(
    term: TableArgumentTerm, interval: Interval, start: float, end: float, level: float
) -> float:
    """Return the time between two times [s] at which an argument passes a level."""
    # Imported here because the import takes as long as a short run.
    from scipy.optimize import brentq

    def difference(t: float) -> float:
        return _evaluate(term, interval, t) - level

    if difference(start) * difference(end) >= 0.0:
        return end if abs(difference(end)) < abs(difference(start)) else start
    return float(brentq(difference, start, end, rtol=_TIME_TOLERANCE))
