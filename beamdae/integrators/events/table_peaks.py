"""Detection of steps that pass over a peak of a table.

A peak between the places at which the method evaluates the table is not seen by the error test; the
run then restarts where the peak begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.table_arguments import TableArgumentTerm
from beamdae.integrators.events.watches import Stop, locate_root
from beamdae.integrators.step_history import RunSegment
from beamdae.results.trajectory import Interval

Array = np.ndarray

# A step passes over a peak if the values of rows inside the step differ by this fraction of the
# range of all values from those at both ends and in the middle of the step.
_MIN_PEAK = 0.05


@dataclass(frozen=True)
class TablePeakWatch:
    """Watch of peaks of tables that steps passed over.

    Attributes
    ----------
    calls
        Arguments of each call of a table.
    """

    calls: Sequence[Sequence[TableArgumentTerm]]

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first stop in the rows from `row` on, see `Watch`."""
        tail = segment.tail(row)
        if tail is None:
            return None
        interval, begin = tail
        first = int(np.searchsorted(interval.t, begin))
        t, state = interval.t[first:], State(*(x[first:] for x in interval.state))
        active = (x for x in self.calls if x[0].part not in interval.inactive)
        peaks = (_find_peak(x, interval, t, state) for x in active)
        return min((peak for peak in peaks if peak is not None), default=None)


def _find_peak(
    call: Sequence[TableArgumentTerm], interval: Interval, t: Array, state: State
) -> Stop | None:
    """Return the row of a table before the first peak that a step passed over.

    The table is evaluated where the arguments, interpolated linearly, pass its rows, and between
    these places.
    """
    table = call[0].table
    arguments = _evaluate_call(call, interval, t, state)
    knots = table.axes
    if len(knots) == 1:
        (x,) = arguments
        knots = (table.list_rows(float(x.min()), float(x.max()))[0],)
    places = [np.searchsorted(*pair) for pair in zip(knots, arguments, strict=True)]
    passed = np.sum([np.abs(np.diff(place)) for place in places], axis=0)
    # A peak lies between two other rows.
    for k in np.flatnonzero((passed > 1) & (np.diff(t) > 0.0)):
        start, end = float(t[k]), float(t[k + 1])
        shares = [
            (rows[min(place[k : k + 2]) : max(place[k : k + 2])] - x[k]) / (x[k + 1] - x[k])
            for rows, place, x in zip(knots, places, arguments, strict=True)
            if place[k] != place[k + 1]
        ]
        rows = np.unique(np.concatenate([[0.0], *shares, [1.0]]))
        share = np.sort(np.concatenate([rows, 0.5 * (rows[1:] + rows[:-1])]))
        middle = np.array([0.5 * (start + end)])
        at_middle = _evaluate_call(call, interval, middle, interval.at(middle))
        seen = table(
            *(np.append(x[k : k + 2], y) for x, y in zip(arguments, at_middle, strict=True))
        )
        values = table(*(x[k] + share * (x[k + 1] - x[k]) for x in arguments))
        excess = np.maximum(values - seen.max(), seen.min() - values)
        (peaks,) = np.nonzero(excess > _MIN_PEAK * np.ptp(table.values))
        if len(peaks):
            first = int(peaks[0])
            highest = share[first + int(np.argmax(excess[first : first + 2]))]
            term = next(x for x in call if places[x.axis][k] != places[x.axis][k + 1])
            ends = arguments[term.axis][k : k + 2]
            shares_of_stop = [rows[rows < share[first]][-1], highest]
            levels = np.interp(shares_of_stop, [0.0, 1.0], ends).tolist()
            foot, probe = (_locate(term, interval, start, end, level) for level in levels)
            return Stop(foot, probe)
    return None


def _evaluate_call(
    call: Sequence[TableArgumentTerm], interval: Interval, t: Array, state: State
) -> list[Array]:
    """Return all arguments of a call at times `t` [s]."""
    arguments = [np.full(len(t), np.nan if x is None else x) for x in call[0].constants]
    for term in call:
        arguments[term.axis] = term.argument.values(interval.with_branch(t), state)
    return arguments


def _locate(
    term: TableArgumentTerm, interval: Interval, start: float, end: float, level: float
) -> float:
    """Return the time between two times [s] at which an argument passes a level."""

    def difference(t: Array) -> Array:
        return term.argument.values(interval.with_branch(t), interval.at(t)) - level

    return locate_root(difference, start, end)
