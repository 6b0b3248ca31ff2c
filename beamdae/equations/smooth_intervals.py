"""Smooth intervals of a run: between breakpoints of laws and short pulses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.singular_laws import PartLaw
from beamdae.errors import BeamdaeError

Array = np.ndarray

SAME_TIME = 1e-12  # relative difference of equal times with different rounding
# Assumed duration of the motion [s] if no end time is given.
_DEFAULT_DURATION = 1.0


def interval_ends(breakpoints: Sequence[float], start: float, end: float) -> tuple[float, ...]:
    """Return the ends [s] of the smooth intervals from `start` to `end`, in ascending order."""
    tolerance = SAME_TIME * max(abs(start), abs(end))
    inner: list[float] = []
    for breakpoint_time in breakpoints:
        previous = inner[-1] if inner else start
        if breakpoint_time - previous > tolerance and end - breakpoint_time > tolerance:
            inner.append(breakpoint_time)
    return (*inner, end)


def branch_time(start: float, end: float) -> float:
    """Return the midpoint of an interval [s], by which laws select their branch."""
    return 0.5 * (start + end)


def time_on_branch(breakpoints: Sequence[float], t: float, end: float | None = None) -> Array:
    """Return (t, branch): `t` and a time inside the smooth interval that starts at `t` [s].

    Parameters
    ----------
    breakpoints
        Breakpoints of the equations [s].
    t
        Time [s].
    end
        End of the motion [s]; defaults to one second after `t`.
    """
    end = t + _DEFAULT_DURATION if end is None else end
    return np.array([t, branch_time(t, interval_ends(breakpoints, t, end)[0])])


# Samples of all intervals together, and at least of each. Before it is zero in floating point, a
# pulse exp(-(t/w)^2) is 27 w wide on each side, so that w from 4e-6 of the run are found. Beside a
# constant, rounding hides it at 6 w, so that w from 2e-5 are found.
_N_SAMPLES, _MIN_SAMPLES = 5001, 51
# More extremes in an interval belong to a vibration, of which only the largest ones may be poles.
_MAX_EXTREMES, _LARGEST_EXTREMES = 100, 10
# Search around an extreme: samples of ever smaller ranges, which shrink by the ratio.
_N_REFINED_SAMPLES, _REFINEMENT_RATIO, _N_REFINEMENTS = 9, 0.25, 13
# Around a pole of order p, values grow by 1024^p from the far to the near distance; a finite peak
# is already resolved at the far distance. Distances are in sample widths.
_FAR_DISTANCE, _NEAR_DISTANCE, _POLE_GROWTH = 4.0**-6, 4.0**-11, 16.0
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
    pulses = find_pulses(equations.laws, tuple(pairwise((start, *ends))))
    if not is_adaptive:
        return ends
    return interval_ends(sorted((*equations.breakpoints, *pulses)), start, end)


class _Extremes(NamedTuple):
    """Times [s] of extremes of sign * law in an interval, their values, and those at samples.

    Of vibrations, they are the largest ones.
    """

    sign: float
    is_vibration: bool
    times: Array
    values: Array
    samples: Array


def find_pulses(
    laws: Iterable[PartLaw], intervals: Sequence[tuple[float, float]]
) -> tuple[float, ...]:
    """Return the times [s] of short pulses of laws within the intervals (start, end) of a run.

    Integrators end a step at these times: where a step begins and ends beside a pulse, the control
    of its error does not notice the pulse.

    Raises
    ------
    BeamdaeError
        If a law becomes infinite; the message names the part and the time.
    """
    found: set[float] = set()
    count = max(_N_SAMPLES // max(len(intervals), 1), _MIN_SAMPLES)
    longest = _MAX_SHARE_OF_RUN * (intervals[-1][1] - intervals[0][0]) if intervals else 0.0
    for law in laws:
        largest, pulses = 0.0, []
        for interval in intervals:
            samples = _evaluate(law, np.linspace(*interval, count)[None], interval)[0]
            largest = max(
                largest, float(np.max(np.abs(samples[np.isfinite(samples)]), initial=0.0))
            )
            for sign in (-1.0, 1.0):
                extremes = _find_extremes(law, sign, samples, interval)
                pole = _find_pole(law, extremes, interval)
                if pole is not None:
                    raise BeamdaeError(
                        f"{law.part}: the law becomes infinite near t = {pole:.6g} s; laws "
                        f"must be finite from t = {intervals[0][0]:g} s to {intervals[-1][1]:g} s."
                    )
                pulses.append(_select_pulses(law, extremes, interval, longest))
        times, heights = np.concatenate(pulses, axis=1)
        is_high = heights > _MIN_HEIGHT * max(largest, np.max(heights, initial=0.0))
        found.update(times[is_high].tolist())
    return tuple(sorted(found))


def _evaluate(law: PartLaw, times: Array, interval: tuple[float, float]) -> Array:
    """Return the values of a law at times (k, j) [s] of an interval; undefined ones become 0."""
    values = law.values(times, np.full(len(times), 0.5 * sum(interval)))
    return np.where(np.isnan(values), 0.0, values)


def _find_extremes(
    law: PartLaw, sign: float, samples: Array, interval: tuple[float, float]
) -> _Extremes:
    """Return the maxima of sign * law, given its values at equidistant times."""
    samples = sign * samples
    before, after = np.append(-np.inf, samples[:-1]), np.append(samples[1:], -np.inf)
    (peaks,) = np.nonzero((samples >= before) & ((samples > after) | np.isinf(after)))
    is_vibration = len(peaks) > _MAX_EXTREMES
    if is_vibration:
        peaks = np.sort(peaks[np.argsort(-samples[peaks])[:_LARGEST_EXTREMES]])
    times, width = np.linspace(*interval, len(samples), retstep=True)
    center, values = times[peaks], samples[peaks]
    around = np.linspace(-1.0, 1.0, _N_REFINED_SAMPLES)
    for k in range(_N_REFINEMENTS if len(peaks) else 0):
        near = np.clip(center[:, None] + width * _REFINEMENT_RATIO**k * around, *interval)
        refined = sign * _evaluate(law, near, interval)
        best = np.argmax(refined, axis=1)[:, None]
        center, values = (np.take_along_axis(x, best, axis=1)[:, 0] for x in (near, refined))
    return _Extremes(sign, is_vibration, center, values, samples)


def _find_pole(law: PartLaw, x: _Extremes, interval: tuple[float, float]) -> float | None:
    """Return the time [s] of an extreme at which a law becomes infinite, or None."""
    if not len(x.times):
        return None
    width = (interval[1] - interval[0]) / (len(x.samples) - 1)
    far, near = (
        np.max(x.sign * _evaluate(law, np.clip(x.times[:, None] + d, *interval), interval), axis=1)
        for d in (width * side * np.array([-1.0, 1.0]) for side in (_FAR_DISTANCE, _NEAR_DISTANCE))
    )
    # Rounding errors near zero can also grow by this factor, but stay below the rest of the law.
    places, sizes = np.linspace(*interval, len(x.samples)), np.abs(x.samples)
    is_elsewhere = np.isfinite(sizes) & (np.abs(places - x.times[:, None]) > 0.5 * width)
    is_largest = near >= np.max(np.where(is_elsewhere, sizes, 0.0), axis=1)
    (poles,) = np.nonzero(np.isinf(x.values) | ((near > _POLE_GROWTH * far) & is_largest))
    return float(x.times[poles[0]]) if len(poles) else None


def _select_pulses(
    law: PartLaw, x: _Extremes, interval: tuple[float, float], longest: float
) -> Array:
    """Return times [s] and heights of pulses that are shorter than `longest` [s], (2, k)."""
    is_inside = (x.times > interval[0]) & (x.times < interval[1])
    center, values = x.times[is_inside], x.values[is_inside]
    if x.is_vibration or not len(center):
        return np.zeros((2, 0))
    places = np.linspace(*interval, len(x.samples))
    edges = np.concatenate([[0], np.searchsorted(places, center), [len(places)]])
    lowest = np.minimum.reduceat(x.samples, np.minimum(edges[:-1], len(places) - 1))
    base = np.maximum(lowest[:-1], lowest[1:])
    others = np.concatenate([[interval[0]], center, [interval[1]]])
    distance = np.minimum(center - others[:-2], others[2:] - center)
    widths = np.minimum(longest, _MAX_SHARE_OF_DISTANCE * distance)
    sides = center[:, None] + 0.5 * np.outer(widths, [-1.0, 1.0])
    at_sides = np.max(x.sign * _evaluate(law, sides, interval), axis=1)
    is_pulse = at_sides - base < 0.5 * (values - base)
    return np.stack([center, values - base])[:, is_pulse]
