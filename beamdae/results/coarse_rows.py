"""Warnings about output rows that are too far apart for the vibrations of observed columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from beamdae.errors import name_with_others
from beamdae.results.columns import (
    NO_OTHERS,
    UNITS_OF_TRANSLATIONS,
    Header,
    drift_limits,
    integration_error_limits,
    largest_by,
    mark_constant_columns,
    mark_minor_rates,
    remove_unit,
)

Array = np.ndarray

# Runs with fewer rows are not curves; their rows are the times that the user needs.
_MIN_ROWS = 100
_SAMPLES = 100  # gaps between rows, in which columns are evaluated
# Positions in the gaps, whose differences show vibrations of a whole number of periods per gap.
_POSITIONS = 0.2 + 0.6 * (0.618 * np.arange(_SAMPLES) % 1.0)
# Vibrations with up to 5 rows per period exceed the values at both ends of a tenth of the gaps by
# more than this share of their amplitude, those with 6 rows in half of the cases, with 10 in none.
_MIN_EXCESS = 0.05
_MIN_SHARE_OF_GAPS = 0.1
# Smaller half ranges, relative to the largest of this kind (of positions: to the length of the
# mechanism, of others: to the largest value), are errors of directions in which nothing moves; ...
_MIN_HALF_RANGE = 1e-6
_ERROR_PER_RTOL = 0.03  # ... smaller ones, relative to rtol as well, are errors of constraints; ...
_ROUNDING = 1e-12  # ... and so are those relative to the length of the mechanism and the duration.
_ROWS_PER_PERIOD = 20
_MAX_PRACTICAL_ROWS = 1e5  # of a run; tables with more rows are slow, or exceed the memory
_MAX_ROWS_OF_COARSE_PERIOD = 6.0  # see above; limits estimates for fast parts of slow motions
_MIN_SHARE_OF_CHANGES = 0.5  # of these gaps; values that change in fewer ones are held
_STEP_OF_RATE = 1e-3  # relative to a gap


def coarse_row_warnings(
    t: Array,
    columns: Mapping[str, Array],
    evaluate: Callable[[Array], Array],
    length: float,
    rtol: float = 0.0,
    find_drift: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0),
    rounding: Array | float = 0.0,
    mechanism: Mapping[str, float] = NO_OTHERS,
) -> Iterator[str]:
    """Yield a warning if columns vibrate with fewer than about six output rows per period.

    Such rows miss amplitudes, show false beats, and count too few cycles. Jumps and values that
    controllers hold are not vibrations: only values between two rows that are larger or smaller
    than both count.

    Parameters
    ----------
    t
        Output times (k,) [s].
    columns
        Observed columns (k,) at the output times, by header.
    evaluate
        Function that returns the columns (j, columns) at ascending times (j,) [s] of the run.
    length
        Length of the mechanism [m].
    rtol
        Tolerance of the run; 0 for fixed steps.
    find_drift
        Function that returns the drift of the constraints in positions [m] and velocities [m/s].
    rounding
        Half ranges of the columns up to which they are rounding errors, see `rounding_limits`.
    mechanism
        Sizes of the rates and the reactions of all parts, see `measure_mechanism`.
    """
    if len(t) < _MIN_ROWS or not columns:
        return
    headers = list(columns)
    rows = np.column_stack(list(columns.values()))
    gaps = np.unique(np.linspace(0, len(t) - 2, _SAMPLES).astype(int))
    between = t[gaps] + _POSITIONS[: len(gaps)] * (t[gaps + 1] - t[gaps])
    inside = evaluate(between)
    is_finite = np.isfinite(rows).all(axis=0) & np.isfinite(inside).all(axis=0)
    rows, inside = np.where(is_finite, rows, 0.0), np.where(is_finite, inside, 0.0)
    half_range = 0.5 * np.ptp(np.vstack([rows, inside]), axis=0)
    magnitude = np.max(np.abs(rows), axis=0)
    min_half_range = max(_MIN_HALF_RANGE, _ERROR_PER_RTOL * rtol)
    duration = float(t[-1] - t[0])
    moves = _find_moving(headers, half_range, magnitude, length, duration, min_half_range)
    moves &= ~mark_constant_columns(headers, rows, half_range, length, rtol)
    moves &= ~mark_minor_rates(headers, half_range, length)
    moves &= half_range > rounding
    moves &= half_range > integration_error_limits(headers, half_range, length, rtol, mechanism)
    left, right = rows[gaps], rows[gaps + 1]
    excess = np.maximum(inside - np.maximum(left, right), np.minimum(left, right) - inside)
    exceeds = excess > _MIN_EXCESS * half_range
    (coarse,) = np.nonzero(moves & (np.mean(exceeds, axis=0) > _MIN_SHARE_OF_GAPS))
    if len(coarse):
        coarse = coarse[(half_range > drift_limits(headers, length, *find_drift()))[coarse]]
    if not len(coarse):
        return
    widths = t[gaps + 1] - t[gaps]
    step = _STEP_OF_RATE * float(np.min(widths))
    changes = evaluate(between + step) - inside
    share_of_changes = np.sum(exceeds & (changes != 0.0), axis=0) / np.sum(exceeds, axis=0).clip(1)
    coarse = coarse[share_of_changes[coarse] > _MIN_SHARE_OF_CHANGES]
    if not len(coarse):
        return
    rates = np.sqrt(np.mean(changes[:, coarse] ** 2, axis=0)) / step
    periods = 2.0 * np.pi * np.std(np.vstack([left, inside])[:, coarse], axis=0) / rates
    longest = _MAX_ROWS_OF_COARSE_PERIOD * float(np.median(widths))
    coarse = coarse[np.argsort(periods, kind="stable")]
    first, *others = (remove_unit(headers[k]) for k in coarse)
    period = min(float(np.min(periods)), longest)
    step = period / _ROWS_PER_PERIOD
    remedy = f"use output_step={step:.0e}"
    if not is_practical_step(step, duration):
        remedy = "read its extremes and root mean square from step_extremes, or shorten the run"
    yield (
        f"{name_with_others(first, others)}: "
        "the output rows are too far apart for its vibration, with a period of "
        f"at most about {period:.1g} s; {remedy}."
    )


def is_practical_step(step: float, duration: float) -> bool:
    """Return True if an output step [s] is long enough for the table of a run."""
    return duration <= _MAX_PRACTICAL_ROWS * step


def _find_moving(
    headers: list[str],
    half_range: Array,
    magnitude: Array,
    length: float,
    duration: float,
    min_half_range: float,
) -> Array:
    """Return the mask of the columns that are not at rest but for errors."""
    units = [Header.of(header).unit for header in headers]
    translations = (UNITS_OF_TRANSLATIONS.get(unit, (unit, 0)) for unit in units)
    kinds, powers = zip(*translations, strict=True)
    per_unit = np.power(length, powers)
    sizes = half_range * per_unit
    speed = length / duration
    smallest = {"m": length, "m/s": speed, "m/s^2": speed / duration, "-": 1.0}
    largest = largest_by(kinds, sizes.tolist())
    values = largest_by(kinds, (magnitude * per_unit).tolist())
    values["m"] = length  # positions depend on the origin
    rounding = {kind: min_half_range * value for kind, value in values.items()}
    rounding |= {kind: _ROUNDING * value for kind, value in smallest.items()}
    limits = [max(min_half_range * largest[k], rounding[k]) for k in kinds]
    return np.asarray(sizes > limits)
