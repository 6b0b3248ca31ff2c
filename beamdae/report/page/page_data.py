"""Curves of HTML pages, and the encoding of their data."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.results.columns import Header, observed_columns

Array = np.ndarray

_MAX_PAGE_VALUES = 400_000  # in all curves; about 2.1 MB
_MIN_ROWS_PER_CURVE = 200
_MAX_ROWS_PER_CURVE = 2000
_GRAVITY, _GRAVITY_LABEL = "gravity", "gravity from start"


def compute_row_limit(curves: int) -> int:
    """Return the maximum number of rows per curve for a page with the given number of curves."""
    rows = _MAX_PAGE_VALUES // max(curves, 1)
    return int(np.clip(rows, _MIN_ROWS_PER_CURVE, _MAX_ROWS_PER_CURVE))


def sample_evenly(count: int, limit: int) -> set[int]:
    """Return at most `limit` of the numbers below `count`, the first and the last included."""
    return set(np.linspace(0, count - 1, min(count, limit)).round().astype(int).tolist())


def select_curves(
    columns: Mapping[str, Any], max_rows: int, error: Array | None = None
) -> dict[str, Any] | None:
    """Return the curves of a run for the cases of a page.

    Parameters
    ----------
    columns
        Time, observed columns, energies and drift by header, one value per row.
    max_rows
        Longer tables are thinned evenly to this number of rows.
    error
        Error [-] at each row; NaN where the error is unknown.

    Returns
    -------
    dict or None
        Curves by panel, see `page_content`. None if the table has fewer than two rows.
    """
    t = np.asarray(columns[TIME], float)
    if len(t) < 2:
        return None
    rows = np.linspace(0, len(t) - 1, min(len(t), max_rows)).round().astype(int)

    def select(names: Iterable[str]) -> dict[str, Array]:
        return {n: np.asarray(columns[n], float)[rows] for n in names if n in columns}

    energies = {
        Header.of(c).suffix.replace("_", " "): x
        for c, x in select(LEDGER_COLUMNS).items()
        if np.ptp(x) > 0.0
    }
    if _GRAVITY in energies:
        # The potential of all masses, relative to y = 0, often far exceeds its changes.
        potential = energies.pop(_GRAVITY)
        energies[_GRAVITY_LABEL] = potential - potential[0]
    if "imbalance" in energies:
        energies["imbalance"] = np.abs(energies.pop("imbalance"))
    drift = dict(
        zip(("position drift", "velocity drift"), select(DRIFT_COLUMNS).values(), strict=False)
    )
    return {
        "t": t[rows],
        "observed": select(observed_columns(columns)),
        "energy": energies,
        "drift": {name: x for name, x in drift.items() if x.any()},
        "error": {} if error is None else {"error": np.asarray(error, float)[rows]},
    }


def encode(data: Any) -> str:
    """Return plain values and arrays as JSON text for the scripts of pages.

    Arrays are stored as 32-bit numbers in an object without a name. Numbers that are not finite
    are missing.
    """
    return json.dumps(
        _replace_nonfinite(data), default=_encode_array, allow_nan=False, separators=(",", ":")
    )


def _encode_array(values: Any) -> Any:
    if not isinstance(values, np.ndarray):
        return values.item()
    with np.errstate(over="ignore"):
        numbers = values.astype("<f4").ravel()
    return {"": base64.b64encode(numbers.tobytes()).decode()}


def _replace_nonfinite(value: Any) -> Any:
    """Return plain values with None for nan and infinity, which JSON lacks."""
    if isinstance(value, Mapping):
        return {str(name): _replace_nonfinite(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_replace_nonfinite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
