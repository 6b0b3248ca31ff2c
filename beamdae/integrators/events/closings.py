"""Detection of contacts that steps pass over, and of arguments that leave tables.

Adaptive methods pass single kinks of tables without loss of accuracy, because the error test sees
them (see the decisions in the developer pages). The force of a contact that is open at both ends of
a step and closed in between is zero wherever the method evaluates it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.watched_terms import SurfaceGapTerm, TableArgumentTerm
from beamdae.integrators.events.watches import (
    Scalar,
    Stop,
    evaluate_inside,
    locate_root,
    sample_scalars,
)
from beamdae.integrators.step_history import RunSegment
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Penetrations are rounding errors below this fraction of the characteristic length.
_MIN_DEPTH = 1e-9
# The first restart after the onset is at this fraction of the time that the point would spend
# inside the surface without a force. The error test sees the force there.
_PROBE_SHARE = 0.1


@dataclass(frozen=True)
class ClosingWatch:
    """Watch of gaps that close: the run restarts at an onset, and ends where a table ends.

    Attributes
    ----------
    gaps
        Gaps of all contacts.
    arguments
        Arguments of tables that end a run where it leaves them.
    length
        Characteristic length of the mechanism [m].
    """

    gaps: Sequence[SurfaceGapTerm]
    arguments: Sequence[TableArgumentTerm]
    length: float

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first stop in the rows from `row` on, see `Watch`."""
        tail = segment.tail(row)
        if tail is None:
            return None
        interval, begin = tail
        gaps = [x for x in self.gaps if x.part not in interval.inactive]
        arguments = [x for x in self.arguments if x.part not in interval.inactive]
        clearances = [*(x.distance.values for x in gaps), *(x.clearance for x in arguments)]
        scalars = [partial(_evaluate, x, interval) for x in clearances]
        t, values = sample_scalars(scalars, interval, begin)
        count = len(gaps)
        onsets = zip(scalars[:count], values[:count], strict=True)
        ends = zip(arguments, scalars[count:], values[count:], strict=True)
        stops = [self._find_onset(interval, gap, t, distances) for gap, distances in onsets]
        stops += [_find_end(interval, *end, t) for end in ends]
        return min((x for x in stops if x is not None), default=None)

    def _find_onset(
        self, interval: Interval, gap: Scalar, t: Array, distances: Array
    ) -> Stop | None:
        """Return the beginning of the first contact inside a step, which is open at its ends."""
        is_open, is_closed = distances > 0.0, distances < -_MIN_DEPTH * self.length
        for k in 1 + np.flatnonzero(is_open[:-2] & is_closed[1:-1] & is_open[2:]):
            if t[k] not in interval.t:
                at = partial(evaluate_inside, gap, interval)
                onset, leaving = locate_root(at, t[k - 1], t[k]), locate_root(at, t[k], t[k + 1])
                return Stop(onset, onset + _PROBE_SHARE * (leaving - onset))
        return None


def _find_end(
    interval: Interval, term: TableArgumentTerm, clearance: Scalar, clearances: Array, t: Array
) -> Stop | None:
    """Return the time at which an argument leaves its table, beyond rounding errors."""
    (outside,) = np.nonzero(clearances < -term.rounding)
    if not len(outside):
        return None
    k = max(int(outside[0]), 1)
    at = partial(evaluate_inside, clearance, interval)
    when = locate_root(at, t[k - 1], t[k])
    (value,) = term.argument.values(interval.with_branch(t[k : k + 1]), interval.at(t[k : k + 1]))
    return Stop(when, when, term.describe(float(value)))


def _evaluate(
    values: Callable[[Array, State], Array], interval: Interval, t: Array, state: State
) -> Array:
    return values(interval.with_branch(t), state)
