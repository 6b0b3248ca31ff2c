"""Detection of contacts that are closed within a step, but open at both of its ends.

The forces of such a contact are zero wherever the method evaluates them, so that the error test
accepts the step. The run then restarts where the contact begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.surface_gaps import SurfaceGapTerm
from beamdae.integrators.events.watches import Stop, locate_root
from beamdae.integrators.step_history import RunSegment
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Penetrations are rounding errors below this fraction of the characteristic length.
_MIN_DEPTH = 1e-9
# Rates of gaps at the ends of a step are differences over this fraction of the step.
_SLOPE_SHARE = 1e-3
# The smallest gap of a step is located by repeated sampling between the neighbors of the smallest
# sample, to (2 / 16)^5 = 3e-5 of the step.
_SAMPLES = 17
_REFINEMENTS = 5
# The first restart after the onset is at this fraction of the time that the point would spend
# inside the surface without a force. The error test sees the force there.
_PROBE_SHARE = 0.1


@dataclass(frozen=True)
class ContactWatch:
    """Watch of contacts that steps passed over.

    Attributes
    ----------
    gaps
        Gaps of all contacts.
    length
        Characteristic length of the mechanism [m].
    """

    gaps: Sequence[SurfaceGapTerm]
    length: float

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first contact that a step passed over, see `Watch`."""
        tail = segment.tail(row)
        if tail is None:
            return None
        interval, begin = tail
        onsets = [
            onset
            for gap in self.gaps
            if gap.part not in interval.inactive
            and (onset := self._find_onset(gap, interval, begin))
        ]
        return min(onsets, default=None)

    def _find_onset(self, gap: SurfaceGapTerm, interval: Interval, begin: float) -> Stop | None:
        first = int(np.searchsorted(interval.t, begin))
        t, state = interval.t[first:], State(*(x[first:] for x in interval.state))
        values, steps = gap.evaluate(t, interval.branch, state.q), np.diff(t)
        # Changes of the gap over a step due to the largest speed and acceleration of its ends.
        speeds, accelerations = (
            np.maximum(x[1:], x[:-1]) for x in gap.bound_rates(state.v, state.a)
        )
        bend = 0.5 * accelerations * steps**2
        is_open = (values[:-1] > 0.0) & (values[1:] > 0.0)
        (near,) = np.nonzero(is_open & (values[:-1] + values[1:] < speeds * steps + bend))
        if not len(near):
            return None
        start, end, bend = values[near], values[near + 1], bend[near]
        ahead, behind = (
            gap.evaluate(t[rows], interval.branch, state.q[rows] + shift[:, None] * state.v[rows])
            for rows, shift in (
                (near, _SLOPE_SHARE * steps[near]),
                (near + 1, -_SLOPE_SHARE * steps[near]),
            )
        )
        # Along straight paths, distances from circles are convex functions of time. With
        # accelerations of at most A, gap + A (t - start) (t - end) / 2 is convex. It is not larger
        # than the gap, and not less than at the intersection of its tangents at both ends.
        falling = (ahead - start) / _SLOPE_SHARE - bend
        rising = (end - behind) / _SLOPE_SHARE + bend
        with np.errstate(invalid="ignore", divide="ignore"):
            lowest = start + falling * (end - rising - start) / (falling - rising)
        for k in near[(falling < 0.0) & (rising > 0.0) & (lowest < 0.0)]:
            onset = self._locate_onset(gap, interval, float(t[k]), float(t[k + 1]))
            if onset is not None and onset.t > begin:
                return onset
        return None

    def _locate_onset(
        self, gap: SurfaceGapTerm, interval: Interval, start: float, end: float
    ) -> Stop | None:
        """Return the onset between two times [s] at which the gap is open, or None."""

        def evaluate(times: Array) -> Array:
            return gap.evaluate(times, interval.branch, interval.positions_at(times))

        left, right = start, end
        for _ in range(_REFINEMENTS):
            times = np.linspace(left, right, _SAMPLES)
            values = evaluate(times)
            lowest = int(np.argmin(values))
            left, right = times[max(lowest - 1, 0)], times[min(lowest + 1, _SAMPLES - 1)]
        inside = float(times[lowest])
        if not values[lowest] < -_MIN_DEPTH * self.length:
            return None
        onset, leaving = locate_root(evaluate, start, inside), locate_root(evaluate, inside, end)
        return Stop(onset, onset + _PROBE_SHARE * (leaving - onset))
