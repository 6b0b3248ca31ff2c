"""Warnings about fixed steps that are too long for the changes of observed columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from beamdae.errors import format_percent, name_with_others
from beamdae.results.columns import (
    Header,
    largest_of_kind,
    mark_constant_columns,
    mark_resting_columns,
    remove_unit,
)
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
from beamdae.results.diagnostics.suspected_errors import SuspectedError

# Root mean square of the second differences between steps relative to half the range. A vibration
# with an angular frequency w has (w h)^2 / sqrt(2): this limit is reached with 30 steps per period,
# whose error is 2 to 3 % per period. Of 119 runs of 30 mechanisms by `GeneralizedAlpha` (steps of
# 0.3 to 20 ms), 31 are above it, with errors of a column of 7 % of half its range, and above 10 %
# in 30. Short bursts, to which vibrations of less than a tenth of the run belong, may be missed.
_MAX_ROUGHNESS = 0.03
_STEPS_PER_PERIOD = 30  # of a vibration with this roughness
# Positions and works are smoother than velocities and forces, and constraints may prescribe them.
_SMOOTH_UNITS = ("m", "rad", "J")
# Errors of the phase of free vibrations, relative to half the range, by the exact error of the
# period of linear vibrations. Of 446 runs of 62 mechanisms by `GeneralizedAlpha` (steps of 0.1 to
# 20 ms), 110 are above it, with errors of a motion above 10 % in 109 and 6 % in one; 6 runs with
# free vibrations and errors of 10 to 24 % are below it and have no other warning. Of 120 further
# runs, 23 are above it, with errors above 10 % in 19, 8 to 9 % in 3 and 4.5 % in one.
_MAX_PHASE_ERROR = 0.1
_RECOMMENDED_PHASE_ERROR = 0.01
_UNITS_OF_MOTIONS = ("m", "rad", "m/s", "rad/s")  # reactions also contain short transients
# Columns whose half range is smaller, relative to the largest one of their kind, are left out.
_MIN_SHARE = 1e-3
_MIN_STEPS = 50  # half a wave in 10 steps is rough, but its errors do not accumulate


def long_step_warnings(
    extremes: Mapping[str, StepExtremes],
    n_steps: int,
    duration: float,
    length: float,
    period_error: float = 0.0,
    has_free_vibrations: Callable[[], bool] = lambda: False,
) -> Iterator[SuspectedError]:
    """Yield a warning if fixed steps are so long that errors of several percent are likely.

    Parameters
    ----------
    extremes
        Extremes, roughness and delay of the columns, see `measure_step_extremes`.
    n_steps
        Number of steps of the run.
    duration
        Duration of the run [s].
    length
        Length of the mechanism [m].
    period_error
        Relative error of the period of a vibration with the angular frequency w, over (w h)^2, in
        steps h; 0 if it is unknown.
    has_free_vibrations
        Function that returns True if errors of vibrations accumulate.
    """
    names = list(extremes)
    if n_steps < _MIN_STEPS or not names:
        return
    values = np.array([[extremes[x].min, extremes[x].max] for x in names]).T
    half_range = 0.5 * (values[1] - values[0])
    rate = 2.0 * np.pi * n_steps / (_STEPS_PER_PERIOD * duration)
    is_at_rest = mark_resting_columns(names, values, half_range, length, rate)
    is_at_rest |= mark_constant_columns(names, values, half_range, length, 0.0)
    is_at_rest |= half_range <= _MIN_SHARE * largest_of_kind(names, half_range, length)
    units = [Header.of(name).unit for name in names]
    measures = np.array([[extremes[x].roughness, extremes[x].delay] for x in names]).T
    with np.errstate(invalid="ignore", divide="ignore"):
        roughness, delay = np.where(is_at_rest, 0.0, measures / half_range)
    delay[[unit not in _UNITS_OF_MOTIONS for unit in units]] = 0.0
    roughness[[unit in _SMOOTH_UNITS for unit in units]] = 0.0
    error = period_error * delay
    delayed = _order(error > _MAX_PHASE_ERROR, error)
    rough = _order(roughness > _MAX_ROUGHNESS, roughness)
    if delayed and has_free_vibrations():
        largest = float(error[delayed[0]])
        size = f"about {format_percent(largest)}" if largest < 1.0 else "more than 100 %"
        step = duration / n_steps
        shorter = step * (_RECOMMENDED_PHASE_ERROR / largest) ** 0.5
        columns = [names[k] for k in dict.fromkeys([*delayed, *rough])]
        sentence = (
            f"fixed steps of {step:.3g} s change the period of its vibration, and the error that "
            f"accumulates is {size} of half its range; use a step of {shorter:.1g} s, or an "
            "integrator with rtol."
        )
    elif rough:
        columns = [names[k] for k in rough]
        sentence = (
            "the fixed steps are too long for its changes, so errors of several percent of half "
            "its range or more are likely; halve the step and compare, or use an integrator with "
            "rtol."
        )
    else:
        return
    first, *others = map(remove_unit, columns)
    yield SuspectedError(f"{name_with_others(first, others)}: {sentence}", tuple(columns))


def _order(is_selected: np.ndarray, sizes: np.ndarray) -> list[int]:
    """Return the indices of the selected columns, largest first."""
    return [int(k) for k in np.argsort(-sizes, kind="stable") if is_selected[k]]
