"""Summary of a study: observed orders, by group."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case_table import ACCURACY_COLUMNS, ERROR_COLUMN

_COLUMNS = ["group", "what", "at", "answer", "value"]


def summarize_cases(cases: pd.DataFrame) -> pd.DataFrame:
    """Return the observed orders of the series in steps and tolerances, by group.

    Only successful cases are included, without errors that the reference cannot resolve.
    """
    lines: list[tuple[Any, ...]] = []
    if ERROR_COLUMN in cases:
        resolved = cases[cases["status"] == "ok"].dropna(subset=[ERROR_COLUMN])
        for group, rows in resolved.groupby("group", sort=False):
            lines += _fit_orders(str(group), rows)
    return pd.DataFrame(lines, columns=_COLUMNS)


def summarize_mesh_study(cases: pd.DataFrame, over: str) -> pd.DataFrame:
    """Return the observed orders of convergence between successive meshes, by group.

    Only successful cases are included. Errors that are zero or that the reference cannot resolve
    are omitted. `over` is the name of the refined parameter.
    """
    lines: list[tuple[Any, ...]] = []
    if ERROR_COLUMN in cases:
        resolved = cases[(cases["status"] == "ok") & (cases[ERROR_COLUMN] > 0.0)]
        for group, rows in resolved.sort_values(over).groupby("group", sort=False):
            size, error = rows[over].to_numpy(float), rows[ERROR_COLUMN].to_numpy()
            orders = -np.diff(np.log(error)) / np.diff(np.log(size))
            for k, order in enumerate(orders):
                at = f"{over} {size[k]:g} to {size[k + 1]:g}"
                lines.append((str(group), "order in space", at, f"{error[k + 1]:.2e}", order))
    return pd.DataFrame(lines, columns=_COLUMNS)


def _fit_orders(group: str, rows: pd.DataFrame) -> list[tuple[Any, ...]]:
    """Return summary lines with the order of each series.

    The order is the slope of log(error) over log(step) or log(rtol).
    """
    lines: list[tuple[Any, ...]] = []
    for series, runs in rows.groupby("series", sort=False):
        error = runs[ERROR_COLUMN].to_numpy()
        for name, column in ACCURACY_COLUMNS.items():
            size = runs[column].to_numpy(float)
            if len(np.unique(size)) < 2 or np.isnan(size).any() or np.min(error) <= 0.0:
                continue
            order = float(np.polyfit(np.log(size), np.log(error), 1)[0])
            at = f"{size.max():g} to {size.min():g}"
            lines.append((group, f"order in {name}", at, str(series), order))
    return lines
