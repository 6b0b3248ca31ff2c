"""Differences of the columns of two runs, relative to the ranges of the columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.results.columns import (
    mark_constant_columns,
    mark_resting_columns,
    mark_unresolved_columns,
    measure_amplitudes,
)
from beamdae.results.rounding_limits import rounding_limits
from beamdae.results.run_data import RunData, find_drift

Array = np.ndarray


class ColumnDifferences(NamedTuple):
    """Differences of the columns of two runs, (columns,) each.

    Attributes
    ----------
    scale
        Half the range of a column of the second run or, if the column is constant but for errors,
        its largest magnitude [unit of the column].
    values, others
        Largest magnitude of the extremes at all steps and rows of both runs [unit of the column].
    peaks
        Larger one of the differences of both extremes, relative to `scale` [-].
    rows
        Largest difference at rows, relative to `scale` [-].
    means
        Root mean square of the differences at rows, relative to that of the deviations of the
        column from its mean or, if it is constant, to `scale` [-].
    """

    scale: Array
    values: Array
    others: Array
    peaks: Array
    rows: Array
    means: Array


def compare_columns(run: RunData, other: RunData) -> ColumnDifferences:
    """Compare the observed columns of a run with those of a more accurate one.

    Differences are zero for columns that are rounding errors or violations of constraints in both,
    and not a number for columns with gaps.
    """
    count = min(len(run.t), len(other.t))  # An event may end one of them slightly earlier.
    rows, finer = (_stack(x)[:count] for x in (run, other))
    limits, finer_limits = _find_extremes(run, rows), _find_extremes(other, finer)
    amplitude, is_constant = measure_amplitudes(
        other.equations, finer, run.integrator.get("rtol") or 0.0
    )
    scale = np.where(is_constant, amplitude, 0.5 * np.ptp(finer_limits, axis=0))
    deviation = np.where(is_constant, amplitude, finer.std(axis=0))
    differences = _subtract_rows(rows, finer, scale)
    pairs = (
        (np.abs(limits - finer_limits).max(axis=0), scale),
        (differences.max(axis=0), scale),
        (np.sqrt(np.mean(differences**2, axis=0)), deviation),
    )
    is_noise = _mark_noise(run, other, rows, finer)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = [np.where(is_noise | (x == 0.0), 0.0, x / size) for x, size in pairs]
    sizes = (np.abs(x).max(axis=0) for x in (limits, finer_limits))
    return ColumnDifferences(scale, *sizes, *errors)


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


def _mark_noise(run: RunData, other: RunData, rows: Array, finer: Array) -> Array:
    """Return True for columns that are rounding errors or violations of constraints in both."""
    e, mechanism = run.equations, run._sizes_of_mechanism
    headers, differences = e.observed_headers, np.abs(rows - finer).max(axis=0)
    half_range = 0.5 * np.maximum(np.ptp(rows, axis=0), np.ptp(finer, axis=0))
    is_noise = mark_resting_columns(headers, finer, half_range, e.length, others=mechanism)
    drifts = map(find_drift, (run, other))
    rtol = run.integrator.get("rtol") or 0.0
    is_noise |= mark_unresolved_columns(
        headers, half_range, differences, e.length, rtol, drifts, mechanism
    )
    # Motions of the size of integration errors that the second run does not repeat, such as those
    # that vanish by symmetry in a steady rotation.
    sizes = np.maximum(half_range, 0.5 * differences)
    is_constant = mark_constant_columns(headers, finer, sizes, e.length, rtol)
    is_noise |= is_constant & (differences > 0.5 * half_range)
    rounding = rounding_limits(e, headers, run.trajectory.mean_step)
    return np.asarray(is_noise | (sizes <= rounding))


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
