"""Errors of the columns of a run, relative to the ranges of the columns."""

from __future__ import annotations

import numpy as np

from beamdae.accuracy.errors import FACTOR, Errors, Refined
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import ObservedRows
from beamdae.results.columns import Header, is_position
from beamdae.results.noise import MAX_ERROR_TO_VALUE_RATIO, constant_limits, mark_noise
from beamdae.results.run_data import RunData

Array = np.ndarray

_ROUNDING = 1e-12  # of displacements, relative to the largest position


def compare_columns(
    run: RunData, other: RunData, refined: Refined, factor: float = FACTOR, has_phase: bool = True
) -> Errors:
    """Return the errors of the observed columns of a run beside a more accurate one.

    Values are the largest magnitudes of the extremes at all steps and rows. Errors are the larger
    one of the differences of the extremes, relative to half the range of the column, and of the
    root mean square of the differences at rows, relative to that of the deviations from the mean;
    of columns that are constant but for errors, relative to their largest magnitude. They are zero
    for columns that are rounding errors or violations of constraints in both runs, and not a number
    for columns with gaps.

    Parameters
    ----------
    run, other
        The runs.
    refined
        What the second run refines.
    factor
        Ratio of errors and differences.
    has_phase
        False to compare extremes only, because the times of the rows differ.
    """
    headers = tuple(run.columns)
    count = min(len(run.t), len(other.t))  # An event may end one of them slightly earlier.
    rows, finer = (_stack(x)[:count] for x in (run, other))
    limits, finer_limits = _find_extremes(run, rows), _find_extremes(other, finer)
    rtol = max(x.integrator.get("rtol") or 0.0 for x in (run, other))
    amplitude, is_constant = _measure_amplitudes(other.equations, finer, rtol)
    scale = np.where(is_constant, amplitude, 0.5 * np.ptp(finer_limits, axis=0))
    deviation = np.where(is_constant, amplitude, finer.std(axis=0))
    differences = _subtract_rows(rows, finer, scale)
    pairs = (
        (np.abs(limits - finer_limits).max(axis=0), scale),
        (differences.max(axis=0), scale),
        (np.sqrt(np.mean(differences**2, axis=0)), deviation),
    )
    half_range = 0.5 * np.maximum(np.ptp(rows, axis=0), np.ptp(finer, axis=0))
    is_noise = mark_noise(run, finer, half_range, np.abs(rows - finer).max(axis=0), other)
    with np.errstate(divide="ignore", invalid="ignore"):
        peaks, largest, means = (
            np.where(is_noise | (x == 0.0), 0.0, x / size) for x, size in pairs
        )
    values, others = (np.abs(x).max(axis=0) for x in (limits, finer_limits))
    relative_to = tuple("its value" if x else "half its range" for x in is_constant)
    total, at_rows = peaks, np.full(len(headers), np.nan)
    if has_phase:
        total, at_rows = np.maximum(peaks, means), largest
    return Errors(headers, values, others, factor * total, at_rows, refined, relative_to)


def _subtract_rows(rows: Array, finer: Array, scale: Array) -> Array:
    """Return the magnitudes of the differences at rows.

    Where a column changes by half its scale or more between two rows, they do not resolve when: the
    difference is that from the interval between the neighbors.
    """
    low, high = finer.copy(), finer.copy()
    jumps = np.abs(np.diff(finer, axis=0)) > 0.5 * scale
    for of_row, neighbors in ((slice(1, None), finer[:-1]), (slice(None, -1), finer[1:])):
        low[of_row] = np.where(jumps, np.minimum(low[of_row], neighbors), low[of_row])
        high[of_row] = np.where(jumps, np.maximum(high[of_row], neighbors), high[of_row])
    return np.maximum(np.maximum(rows - high, low - rows), 0.0)


def _measure_amplitudes(
    equations: EquationsOfMotion, rows: Array, rtol: float
) -> tuple[Array, Array]:
    """Return the amplitude of each column, to which errors are relative, and a mask.

    The amplitude is half the range or, for columns that are constant but for errors, such as the
    stress in a steady rotation, the largest magnitude. The mask is True for these columns. The
    magnitude of positions and angles is that of the displacement from the drawing, which does not
    depend on the origin, and at most the size of the mechanism, or 1 rad. Columns that vary by more
    than a thousandth of their magnitude, such as small deflections from zero, are not constant.

    Parameters
    ----------
    equations
        The equations of motion.
    rows
        Values of the observed columns (k, columns).
    rtol
        Tolerance of the columns.
    """
    headers, length = equations.observed_headers, equations.length
    half_range = 0.5 * np.ptp(rows, axis=0)
    sizes = {"m": length, "rad": 1.0}
    limits = np.array([sizes.get(Header.of(header).unit, np.inf) for header in headers])
    largest = np.minimum(np.max(np.abs(_subtract_drawing(equations, rows)), axis=0), limits)
    is_constant = half_range <= constant_limits(headers, rows, length, rtol)
    is_constant &= (half_range <= MAX_ERROR_TO_VALUE_RATIO * largest) & (largest > 0.0)
    return np.where(is_constant, largest, half_range), is_constant


def _subtract_drawing(equations: EquationsOfMotion, rows: Array) -> Array:
    """Return observed columns (k, columns), with displacements for positions and angles.

    Displacements are those from the drawing. They do not depend on the origin, of which their
    rounding errors are removed.
    """
    is_placement = [is_position(x) for x in equations.observed_headers]
    if not any(is_placement):
        return rows
    mechanism, q, zero = equations.mechanism, equations.q0, np.zeros((1, equations.n))
    if mechanism is not None:
        q = np.concatenate([part.initial_position for part in mechanism.parts.values()])
    time, lam = np.zeros((1, 2)), np.zeros((1, equations.m))
    displacements = rows - ObservedRows(equations)(time, q[None], zero, zero, lam)[0]
    is_rounding = np.abs(displacements) <= _ROUNDING * np.max(np.abs(rows), axis=0)
    return np.where(is_placement, np.where(is_rounding, 0.0, displacements), rows)


def _stack(run: RunData) -> Array:
    """Return the columns (k, columns), with gaps throughout columns that are not finite."""
    rows = np.stack(list(run.columns.values()), axis=1)
    return np.where(np.isfinite(rows).all(axis=0), rows, np.nan)


def _find_extremes(run: RunData, rows: Array) -> Array:
    """Return the extremes (2, columns) at rows and, if they are known, at steps."""
    limits = np.stack([rows.min(axis=0), rows.max(axis=0)])
    for k, header in enumerate(run.columns):
        if header in run.step_extremes:
            at_steps = run.step_extremes[header]
            limits[:, k] = min(limits[0, k], at_steps.min), max(limits[1, k], at_steps.max)
    return limits
