"""Curves of a page from the table of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.results.columns import Header, observed_columns

Array = np.ndarray

# Of all curves of a page together: 2.7 bytes each, a megabyte or so.
_MOST_VALUES = 500_000
_FEWEST_ROWS, _MOST_ROWS = 200, 2000


def rows_a_curve(curves: int) -> int:
    """How many rows each of so many curves of a page may have."""
    return int(np.clip(_MOST_VALUES // max(curves, 1), _FEWEST_ROWS, _MOST_ROWS))


def curves_of(
    columns: Mapping[str, Any],
    most: int,
    error: Array | None = None,
    differences: Mapping[str, Array] | None = None,
) -> dict[str, Any] | None:
    """The curves of a run for `beamdae.report.page.page.write_page`.

    Parameters
    ----------
    columns
        Time and what there is over it, by header: observed columns, energies, drift.
    most
        Every so many rows are left out that these remain.
    error
        The error at each row, NaN where it is not known.
    differences
        By header, columns less those of a reference at each row.

    Returns
    -------
    dict or None
        None where there is no curve to draw.
    """
    t = np.asarray(columns[TIME], float)
    if len(t) < 2:
        return None
    chosen = np.linspace(0, len(t) - 1, min(len(t), most)).round().astype(int)

    def rows(given: Mapping[str, Any], names: Iterable[str]) -> dict[str, Array]:
        return {name: np.asarray(given[name], float)[chosen] for name in names if name in given}

    def parted(given: Mapping[str, Any]) -> dict[str, dict[str, Array]]:
        energies = rows(given, LEDGER_COLUMNS)
        return {
            "observed": rows(given, observed_columns(given)),
            "energy": {Header.of(c).suffix.replace("_", " "): x for c, x in energies.items()},
        }

    position, velocity = DRIFT_COLUMNS
    drift = rows(columns, DRIFT_COLUMNS)
    return {
        "t": t[chosen],
        **parted(columns),
        "position drift": drift.get(position),
        "velocity drift": drift.get(velocity),
        "error": None if error is None else np.asarray(error, float)[chosen],
        "difference": {} if differences is None else parted(differences),
    }
