"""Errors of observed columns against a reference, relative to their amplitude."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.results.columns import Header, observed_columns, select_observed_columns

RELATIVE_TIME_TOLERANCE = 1e-12  # output times within it are considered equal
# Ratio of ranges in the same unit; points that joints hold fixed move by less.
_MIN_RELATIVE_MOTION = 1e-6
_POSITION_UNITS = ("m", "rad")


def select_error_columns(reference: pd.DataFrame, columns: Sequence[str] = ()) -> list[str]:
    """Return the observed columns used for the errors.

    Defaults to the columns in m and rad (or all columns, if no column has these units) whose range
    exceeds 1e-6 of the largest range in the same unit.

    Raises
    ------
    BeamdaeError
        If a requested column does not exist or is constant, or none of the default columns varies.
    """
    present = observed_columns(reference)
    candidates = (
        select_observed_columns("compare", columns, present)
        or [c for c in present if Header.of(c).unit in _POSITION_UNITS]
        or present
    )
    if not candidates:
        raise BeamdaeError(
            "compare: the model observes nothing to compare; add observed columns to the model."
        )
    moving = _select_moving_columns(reference, candidates, 0.0 if columns else _MIN_RELATIVE_MOTION)
    constant = [c for c in candidates if c not in moving]
    if not moving or (columns and constant):
        raise BeamdaeError(
            "compare: errors are relative to the range of a column, but the reference is "
            f"constant in {', '.join(constant)}; observe or select columns that vary."
        )
    return moving


def _select_moving_columns(
    table: pd.DataFrame, columns: Sequence[str], min_relative_motion: float
) -> list[str]:
    ranges = pd.Series(np.ptp(table[list(columns)].to_numpy(), axis=0), list(columns))
    largest = ranges.groupby(lambda name: Header.of(name).unit).transform("max")
    return [str(c) for c in ranges.index[ranges > min_relative_motion * largest]]


def compute_amplitudes(reference: pd.DataFrame, columns: Sequence[str]) -> np.ndarray:
    """Return half the range of each column, (columns,)."""
    return 0.5 * np.ptp(reference[list(columns)].to_numpy(), axis=0)


def count_common_rows(table: pd.DataFrame, other: pd.DataFrame) -> int:
    """Return the number of leading rows with the same times in both tables."""
    rows = min(len(table), len(other))
    times, other_times = (x.index.to_numpy()[:rows] for x in (table, other))
    differs = np.abs(times - other_times) > RELATIVE_TIME_TOLERANCE * np.abs(other_times)
    return int(np.argmax(differs)) if differs.any() else rows


def compute_deviations(
    table: pd.DataFrame, reference: pd.DataFrame, columns: Sequence[str]
) -> pd.DataFrame:
    """Return |x - x_ref| / (half the range of x_ref) at the times common to both tables.

    Both tables start with the same output times. If an event or a failure ends one of the runs, the
    times differ from a certain row on; this row and all later rows are omitted.

    Raises
    ------
    BeamdaeError
        If a column is not observed in `table`.
    """
    missing = [name for name in columns if name not in table]
    if missing:
        raise BeamdaeError(
            f"compare: a case does not observe the column {missing[0]} of the reference; "
            "observe this column in every case."
        )
    rows = count_common_rows(table, reference)
    values = table[list(columns)].to_numpy()[:rows]
    reference_values = reference[list(columns)].to_numpy()[:rows]
    error = np.abs(values - reference_values) / compute_amplitudes(reference, columns)
    return pd.DataFrame(error, columns=list(columns), index=table.index[:rows])
