"""Short pulses of time laws, such as blows of a hammer, which steps could pass without a trace."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.singular_laws import PartLaw, require_no_pole
from beamdae.equations.smooth_intervals import interval_ends

Array = np.ndarray

# Samples of all intervals together, and at least of each. Before it is zero in floating point, a
# pulse exp(-(t/w)^2) is 27 w wide on each side, so that w from 4e-6 of the run are found. Beside a
# constant, rounding hides it at 6 w, so that w from 2e-5 are found.
_N_SAMPLES, _MIN_SAMPLES = 5001, 51
# More extremes in an interval belong to a vibration, not to separate pulses.
_MAX_EXTREMES = 100
# Search around an extreme: samples of ever smaller ranges, which shrink by the ratio.
_N_REFINED_SAMPLES, _REFINEMENT_RATIO, _N_REFINEMENTS = 9, 0.25, 9
# A pulse is shorter at half its height than this fraction of the run (the longest default step),
# and of the distances to other extremes and to the ends of its interval, ...
_MAX_SHARE_OF_RUN, _MAX_SHARE_OF_DISTANCE = 0.05, 0.1
# ... and higher than this fraction of the largest value of the law.
_MIN_HEIGHT = 1e-3


def plan_ends(
    equations: EquationsOfMotion, start: float, end: float, is_adaptive: bool
) -> tuple[float, ...]:
    """Return the ends [s] of the intervals of a run: breakpoints, its end and short pulses.

    Fixed steps, which do not become shorter at a pulse, pass it; measured errors state this.

    Raises
    ------
    BeamdaeError
        If a law becomes infinite.
    """
    ends = interval_ends(equations.breakpoints, start, end)
    intervals = tuple(pairwise((start, *ends)))
    require_no_pole(equations.laws, intervals)
    if not is_adaptive:
        return ends
    pulses = find_pulses(equations.laws, intervals)
    return interval_ends(sorted((*equations.breakpoints, *pulses)), start, end)


def find_pulses(
    laws: Iterable[PartLaw], intervals: Sequence[tuple[float, float]]
) -> tuple[float, ...]:
    """Return the times [s] of short pulses of laws within the intervals (start, end) of a run.

    Integrators end a step at these times: where a step begins and ends beside a pulse, the control
    of its error does not notice the pulse.
    """
    found: set[float] = set()
    count = max(_N_SAMPLES // max(len(intervals), 1), _MIN_SAMPLES)
    longest = _MAX_SHARE_OF_RUN * (intervals[-1][1] - intervals[0][0]) if intervals else 0.0
    for law in laws:
        largest, pulses = 0.0, []
        for interval in intervals:
            times = np.linspace(*interval, count)
            samples = _evaluate(law, times[None], interval)[0]
            largest = max(largest, float(np.max(np.abs(samples))))
            pulses += [
                _find_pulses(law, times, sign * samples, sign, interval, longest)
                for sign in (-1.0, 1.0)
            ]
        times, heights = np.concatenate(pulses, axis=1)
        is_high = heights > _MIN_HEIGHT * max(largest, np.max(heights, initial=0.0))
        found.update(times[is_high].tolist())
    return tuple(sorted(found))


def _evaluate(law: PartLaw, times: Array, interval: tuple[float, float]) -> Array:
    """Return the values of a law at times (k, j) [s] of an interval; infinite ones become 0."""
    values = law.values(times, np.full(len(times), 0.5 * sum(interval)))
    return np.where(np.isfinite(values), values, 0.0)


def _find_pulses(
    law: PartLaw,
    times: Array,
    samples: Array,
    sign: float,
    interval: tuple[float, float],
    longest: float,
) -> Array:
    """Return the times [s] and the heights of the pulses of sign * law in an interval, (2, k).

    `samples` are the values of sign * law at equidistant `times` [s]; pulses are shorter than
    `longest` [s].
    """
    inner, before, after = samples[1:-1], samples[:-2], samples[2:]
    (peaks,) = np.nonzero((inner >= before) & (inner > after))
    if not 0 < len(peaks) <= _MAX_EXTREMES:
        return np.zeros((2, 0))
    edges = np.concatenate([[0], peaks + 1, [len(samples)]])
    lowest = np.minimum.reduceat(samples, edges[:-1])
    base = np.maximum(lowest[:-1], lowest[1:])
    center, width = times[peaks + 1], times[1] - times[0]
    around = np.linspace(-1.0, 1.0, _N_REFINED_SAMPLES)
    height = samples[peaks + 1] - base
    for k in range(_N_REFINEMENTS):
        near = np.clip(center[:, None] + width * _REFINEMENT_RATIO**k * around, *interval)
        values = sign * _evaluate(law, near, interval)
        best = np.argmax(values, axis=1)[:, None]
        center = np.take_along_axis(near, best, axis=1)[:, 0]
        height = np.take_along_axis(values, best, axis=1)[:, 0] - base
    others = np.concatenate([[interval[0]], center, [interval[1]]])
    distance = np.minimum(center - others[:-2], others[2:] - center)
    widths = np.minimum(longest, _MAX_SHARE_OF_DISTANCE * distance)
    sides = center[:, None] + 0.5 * np.outer(widths, [-1.0, 1.0])
    at_sides = np.max(sign * _evaluate(law, sides, interval), axis=1)
    is_pulse = at_sides - base < 0.5 * height
    return np.stack([center[is_pulse], height[is_pulse]])
