"""Warnings about fixed steps that are too long for the changes of observed columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from beamdae.errors import list_first
from beamdae.results.columns import (
    Header,
    largest_of_kind,
    mark_constant_columns,
    mark_resting_columns,
    remove_unit,
)
from beamdae.results.diagnostics.missed_peaks import StepExtremes
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
# Columns whose half range is smaller, relative to the largest one of their kind, are left out.
_MIN_SHARE = 1e-3
_MIN_STEPS = 50  # half a wave in 10 steps is rough, but its errors do not accumulate
_MAX_NAMES = 3  # of further columns in a warning


def long_step_warnings(
    extremes: Mapping[str, StepExtremes], n_steps: int, duration: float, length: float
) -> Iterator[SuspectedError]:
    """Yield a warning if fixed steps are so long that errors of several percent are likely.

    Parameters
    ----------
    extremes
        Extremes and roughness of the columns, see `measure_step_extremes`.
    n_steps
        Number of steps of the run.
    duration
        Duration of the run [s].
    length
        Length of the mechanism [m].
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
    is_at_rest |= np.array([Header.of(name).unit in _SMOOTH_UNITS for name in names])
    roughness = np.array([extremes[x].roughness for x in names])
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(is_at_rest, 0.0, roughness / half_range)
    rough = [int(k) for k in np.argsort(-ratio, kind="stable") if ratio[k] > _MAX_ROUGHNESS]
    if not rough:
        return
    first, *others = (remove_unit(names[k]) for k in rough)
    also = f" (also {list_first(others, _MAX_NAMES)})" if others else ""
    yield SuspectedError(
        f"{first}{also}: the fixed steps are too long for its changes, so errors of several "
        "percent of half its range or more are likely; halve the step and compare, or use an "
        "integrator with rtol.",
        tuple(names[k] for k in rough),
    )
