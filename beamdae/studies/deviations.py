"""Errors of observed columns against a reference, relative to their amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, require_iterable, short_repr, suggest
from beamdae.results.columns import Header, observed_columns, select_columns

# Columns that move less than this share of the largest motion in their unit are held by a joint.
_AT_REST = 1e-6
_SAME_TIME = 1e-12
_POSITIONS, _REACTIONS = ("m", "rad"), ("N", "N m")


def require_column_names(part: str, value: Any) -> tuple[str, ...]:
    """Return names of columns as a tuple, or say that they are none."""
    what = "a list of names of observed columns"
    found = require_iterable(part, "columns", value, what)
    if isinstance(value, (str, bytes)) or not all(isinstance(name, str) for name in found):
        raise BeamdaeError(f"{part}: columns must be {what}, got {short_repr(value)}.")
    return tuple(found)


def select_observed_columns(part: str, names: Sequence[str], present: Sequence[str]) -> list[str]:
    """The observed columns of such names, see `select_columns`; refuses what is not observed."""
    found: dict[str, None] = {}
    for name in names:
        try:
            found |= dict.fromkeys(select_columns(present, name))
        except BeamdaeError:
            known = [*present, *(header.rpartition(" [")[0] for header in present)]
            raise BeamdaeError(
                f"{part}: no observed column {short_repr(name)}{suggest(name, known)}, "
                f"the columns are {', '.join(present) or 'none'}."
            ) from None
    return list(found)


def select_error_columns(reference: pd.DataFrame, columns: Sequence[str] = ()) -> list[str]:
    """The observed columns errors are taken over.

    `columns` if given; otherwise all in m and rad, or all there are if none has such a unit, that
    move by more than 1e-6 of the largest motion in the same unit.

    Raises
    ------
    BeamdaeError
        If a column does not exist or does not move.
    """
    present = observed_columns(reference)
    candidates = (
        select_observed_columns("compare", columns, present)
        or [c for c in present if Header.of(c).unit in _POSITIONS]
        or present
    )
    if not candidates:
        raise BeamdaeError("compare: the model must observe something, see Mechanism.observe.")
    moving = _select_moving_columns(reference, candidates, 0.0 if columns else _AT_REST)
    still = [c for c in candidates if c not in moving]
    if not moving or (columns and still):
        raise BeamdaeError(
            f"compare: {', '.join(still)} must move in the reference to measure errors by."
        )
    return moving


def select_reaction_columns(reference: pd.DataFrame) -> list[str]:
    """The forces and moments that are not zero throughout."""
    forces = [c for c in observed_columns(reference) if Header.of(c).unit in _REACTIONS]
    return _select_moving_columns(reference, forces, _AT_REST)


def _select_moving_columns(table: pd.DataFrame, columns: Sequence[str], least: float) -> list[str]:
    amplitude = pd.Series(np.ptp(table[list(columns)].to_numpy(), axis=0), list(columns))
    largest = amplitude.groupby(lambda name: Header.of(name).unit).transform("max")
    return [str(c) for c in amplitude.index[amplitude > least * largest]]


def compute_amplitudes(reference: pd.DataFrame, columns: Sequence[str]) -> np.ndarray:
    """Half the range of each column."""
    return 0.5 * np.ptp(reference[list(columns)].to_numpy(), axis=0)


def count_common_rows(table: pd.DataFrame, other: pd.DataFrame) -> int:
    """How many rows, from the start on, are of the same times."""
    rows = min(len(table), len(other))
    t, others = (x.index.to_numpy()[:rows] for x in (table, other))
    differs = np.abs(t - others) > _SAME_TIME * np.abs(others)
    return int(np.argmax(differs)) if differs.any() else rows


def compute_deviations(
    table: pd.DataFrame, reference: pd.DataFrame, columns: Sequence[str]
) -> pd.DataFrame:
    """|x - x_ref| over half the range of x_ref by time, as far as both have got.

    Both have rows of the same output times from the start on; a row of where an event ended one of
    them has no other to be compared with.

    Raises
    ------
    BeamdaeError
        If a column is not observed in `table`.
    """
    missing = [name for name in columns if name not in table]
    if missing:
        raise BeamdaeError(f"compare: {missing[0]} of the reference is not observed in a case.")
    rows = count_common_rows(table, reference)
    found = table[list(columns)].to_numpy()[:rows]
    truth = reference[list(columns)].to_numpy()[:rows]
    error = np.abs(found - truth) / compute_amplitudes(reference, columns)
    return pd.DataFrame(error, columns=list(columns), index=table.index[:rows])
