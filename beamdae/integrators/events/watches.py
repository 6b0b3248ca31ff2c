"""What ends a run, or a step early, although the error test accepts the step.

A watch examines the rows of new steps: arguments that leave tables, contacts and peaks that steps
pass over, and events. The run ends at its first stop, or restarts there, after the actions of an
event, or where the error test sees what the step has passed over.

Adaptive methods pass single kinks of tables without loss of accuracy, because the error test sees
them (see the decisions in the developer pages). The force of a contact that is open at both ends of
a step and closed in between is zero wherever the method evaluates it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import EventTerm, State
from beamdae.equations.watched_terms import SurfaceGapTerm, TableArgumentTerm
from beamdae.integrators.step_history import RunSegment
from beamdae.results.sampled_functions import find_dips, locate_root
from beamdae.results.trajectory import Interval

Array = np.ndarray
# Function of times (rows,) [s] and states in rows that returns values (rows,).
Scalar = Callable[[Array, State], Array]

# Fraction of the first and last step at which scalars are sampled, too, so that dips in these steps
# lie between three samples.
_EDGE_SHARE = 2.5e-4


class Stop(NamedTuple):
    """Time at which a step must end.

    Attributes
    ----------
    t
        The time [s].
    probe
        Time [s] inside the contact or peak that begins at `t`, at which the first step after the
        restart ends at the latest.
    reason
        Reason why the run ends at `t`; empty if it restarts there.
    force
        Name of the force that has a peak; empty for other stops.
    event
        Event at `t`; None for other stops.
    """

    t: float
    probe: float
    reason: str = ""
    force: str = ""
    event: EventTerm | None = None

    @property
    def is_restart(self) -> bool:
        """True if the run restarts at `t` with the same equations."""
        return not self.reason and self.event is None


class Watch(Protocol):
    """Search of the steps for times at which they must end."""

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first stop in the rows of a segment from `row` on, or None."""


def sample_scalars(
    scalars: Sequence[Scalar], interval: Interval, begin: float, inside: Sequence[float] = ()
) -> tuple[Array, list[Array]]:
    """Return times [s] and the values of scalars at the ends of all steps from `begin` [s] on.

    Further samples are those at the fractions `inside` of each step, one near the first and one
    near the last end, and one where a scalar passes zero and returns between two other samples.
    """
    first = int(np.searchsorted(interval.t, begin))
    steps, states = interval.t[first:], [x[first:] for x in interval.state]
    lengths = np.diff(steps)
    edges = [steps[-1] - _EDGE_SHARE * lengths[-1]]
    # At the start of a segment, quantities may be zero.
    if begin > interval.t[0]:
        edges.append(steps[0] + _EDGE_SHARE * lengths[0])
    further = np.append((steps[:-1, None] + lengths[:, None] * np.asarray(inside)).ravel(), edges)

    def sample() -> tuple[Array, list[Array]]:
        t = np.concatenate([steps, further])
        order = np.argsort(t, kind="stable")
        pairs = zip(states, interval.at(further, limited=True), strict=True)
        state = State(*(np.concatenate(pair)[order] for pair in pairs))
        return t[order], [scalar(t[order], state) for scalar in scalars]

    t, values_by_scalar = sample()
    dips = [
        dip
        for scalar, values in zip(scalars, values_by_scalar, strict=True)
        for dip in find_dips(t, values, partial(evaluate_inside, scalar, interval))
    ]
    if not dips:
        return t, values_by_scalar
    further = np.append(further, dips)
    return sample()


def evaluate_inside(scalar: Scalar, interval: Interval, t: Array) -> Array:
    """Return the values of a scalar at times (rows,) [s] inside an interval."""
    return scalar(t, interval.at(t, limited=True))


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
