"""Summary of a study by group: fastest integrators and observed orders."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case_table import ACCURACY_COLUMNS, BOUND_COLUMN, ERROR_COLUMN
from beamdae.studies.run_values import WALL_TIME_COLUMN

_ERROR_LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)
_COLUMNS = ["group", "what", "at", "answer", "value", "unit"]


def summarize_cases(cases: pd.DataFrame) -> pd.DataFrame:
    """Return the fastest integrator per error level and the observed orders by group.

    Only successful cases with a known error are included. To find the fastest integrator, an error
    that the reference cannot resolve is replaced by its bound; orders are computed without such
    errors.
    """
    lines: list[dict[str, Any]] = []
    if ERROR_COLUMN in cases:
        for group, rows in cases[cases["status"] == "ok"].groupby("group", sort=False):
            resolved = rows.dropna(subset=[ERROR_COLUMN])
            lines += _find_fastest(str(group), rows.dropna(subset=[BOUND_COLUMN]))
            lines += _fit_orders(str(group), resolved)
    return pd.DataFrame(lines, columns=_COLUMNS)


def summarize_mesh_study(cases: pd.DataFrame, over: str) -> pd.DataFrame:
    """Return the observed orders of convergence between successive meshes, by group.

    Only successful cases are included. Errors that are zero or that the reference cannot resolve
    are omitted. `over` is the name of the refined parameter.
    """
    lines: list[dict[str, Any]] = []
    if ERROR_COLUMN in cases:
        resolved = cases[(cases["status"] == "ok") & (cases[ERROR_COLUMN] > 0.0)]
        for group, rows in resolved.sort_values(over).groupby("group", sort=False):
            size, error = rows[over].to_numpy(float), rows[ERROR_COLUMN].to_numpy()
            orders = -np.diff(np.log(error)) / np.diff(np.log(size))
            for k, order in enumerate(orders):
                at = f"{over} {size[k]:g} to {size[k + 1]:g}"
                answer = f"{error[k + 1]:.2e}"
                lines.append(_summary_line(str(group), "order in space", at, answer, order))
    return pd.DataFrame(lines, columns=_COLUMNS)


def _summary_line(
    group: str, what: str, at: str, answer: str, value: float, unit: str = ""
) -> dict[str, Any]:
    return {
        "group": group,
        "what": what,
        "at": at,
        "answer": answer,
        "value": value,
        "unit": unit,
    }


def _find_fastest(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    lines = []
    for level in _ERROR_LEVELS:
        accurate = rows[rows[BOUND_COLUMN] <= level].sort_values(WALL_TIME_COLUMN)
        if accurate.empty:
            continue
        fastest = accurate.iloc[0]
        wall_time = fastest[WALL_TIME_COLUMN]
        line = _summary_line(
            group, "fastest", f"error <= {level:.0e}", fastest["label"], wall_time, "s"
        )
        lines.append(line)
    return lines


def _fit_orders(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return summary lines with the order of each series.

    The order is the slope of log(error) over log(step) or log(rtol).
    """
    lines = []
    for series, runs in rows.groupby("series", sort=False):
        error = runs[ERROR_COLUMN].to_numpy()
        for name, column in ACCURACY_COLUMNS.items():
            size = runs[column].to_numpy(float)
            if len(np.unique(size)) < 2 or np.isnan(size).any() or np.min(error) <= 0.0:
                continue
            order = float(np.polyfit(np.log(size), np.log(error), 1)[0])
            at = f"{size.max():g} to {size.min():g}"
            lines.append(_summary_line(group, f"order in {name}", at, str(series), order))
    return lines
