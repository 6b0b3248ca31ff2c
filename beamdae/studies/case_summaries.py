"""Summary of a study: observed orders, by group."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case_table import ACCURACY_COLUMNS, ERROR_COLUMN

_COLUMNS = ["group", "what", "at", "answer", "value"]


def summarize_cases(cases: pd.DataFrame, over: str | None = None) -> pd.DataFrame:
    """Return the observed orders by group: of steps and tolerances, or of meshes.

    Only successful cases are included, without errors that are zero or that the reference cannot
    resolve. `over` is the header of the refined parameter of a mesh study.
    """
    lines: list[tuple[Any, ...]] = []
    if ERROR_COLUMN in cases:
        resolved = cases[(cases["status"] == "ok") & (cases[ERROR_COLUMN] > 0.0)]
        for group, rows in resolved.groupby("group", sort=False):
            name = str(group)
            lines += _fit_orders(name, rows) if over is None else _compare_meshes(name, rows, over)
    return pd.DataFrame(lines, columns=_COLUMNS)


def _compare_meshes(group: str, rows: pd.DataFrame, over: str) -> list[tuple[Any, ...]]:
    """Return summary lines with the orders of convergence between successive meshes."""
    rows = rows.sort_values(over)
    size, error = rows[over].to_numpy(float), rows[ERROR_COLUMN].to_numpy()
    orders = -np.diff(np.log(error)) / np.diff(np.log(size))
    ends = zip(size[:-1], size[1:], error[1:], orders, strict=True)
    return [
        (group, "order in space", f"{over} {a:g} to {b:g}", f"{e:.2e}", order)
        for a, b, e, order in ends
    ]


def _fit_orders(group: str, rows: pd.DataFrame) -> list[tuple[Any, ...]]:
    """Return summary lines with the order of each series.

    The order is the slope of log(error) over log(step) or log(rtol).
    """
    lines: list[tuple[Any, ...]] = []
    for series, runs in rows.groupby("series", sort=False):
        error = runs[ERROR_COLUMN].to_numpy()
        for name, column in ACCURACY_COLUMNS.items():
            size = runs[column].to_numpy(float)
            if len(np.unique(size)) < 2 or np.isnan(size).any():
                continue
            order = float(np.polyfit(np.log(size), np.log(error), 1)[0])
            at = f"{size.max():g} to {size.min():g}"
            lines.append((group, f"order in {name}", at, str(series), order))
    return lines
