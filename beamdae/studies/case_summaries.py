"""Summary of a study by group: fastest integrators, observed orders and crossovers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case_table import ACCURACY_COLUMNS, BOUND_COLUMN, ERROR_COLUMN
from beamdae.studies.run_values import (
    MAX_WALL_TIME_COLUMN,
    MIN_WALL_TIME_COLUMN,
    WALL_TIME_COLUMN,
)

_ERROR_LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)
_COLUMNS = ["group", "what", "at", "answer", "value", "unit", "min", "max", "as fast"]
_TIMING_SCATTER = 1.2  # assumed ratio of a single wall time to the shortest one
_CROSSOVER_LEVELS = 200  # errors, equally spaced in the logarithm, at which series are compared


def summarize_cases(cases: pd.DataFrame) -> pd.DataFrame:
    """Return the fastest integrator per error level, observed orders and crossovers by group.

    Only successful cases with a known error are included. To find the fastest integrator, an error
    that the reference cannot resolve is replaced by its bound; orders and crossovers are computed
    without such errors.

    Case A is considered faster than case B only if the median wall time of A is below the shortest
    wall time of B. The shortest wall time of a case with a single run is estimated as its wall time
    / 1.2. The column "as fast" lists the other cases that meet the error level and are not slower
    than the fastest case by this criterion.
    """
    lines: list[dict[str, Any]] = []
    if ERROR_COLUMN in cases:
        for group, rows in cases[cases["status"] == "ok"].groupby("group", sort=False):
            resolved = rows.dropna(subset=[ERROR_COLUMN])
            lines += _find_fastest(str(group), rows.dropna(subset=[BOUND_COLUMN]))
            lines += _fit_orders(str(group), resolved)
            lines += _find_crossovers(str(group), resolved)
    return pd.DataFrame(lines, columns=_COLUMNS)


def summarize_mesh_study(cases: pd.DataFrame, over: str) -> pd.DataFrame:
    """Return the observed orders of convergence between successive meshes, by group.

    Only successful cases are included. Errors that are zero or that the reference cannot resolve
    are omitted. `over` is the name of the refined parameter.
    """
    lines: list[dict[str, Any]] = []
    if ERROR_COLUMN not in cases:
        return pd.DataFrame(lines, columns=_COLUMNS)
    for group, rows in cases[cases["status"] == "ok"].groupby("group", sort=False):
        resolved = rows.dropna(subset=[ERROR_COLUMN]).sort_values(over)
        resolved = resolved[resolved[ERROR_COLUMN] > 0.0]
        size, error = resolved[over].to_numpy(float), resolved[ERROR_COLUMN].to_numpy()
        for k in range(1, len(resolved)):
            order = float(np.log(error[k - 1] / error[k]) / np.log(size[k] / size[k - 1]))
            at = f"{over} {size[k - 1]:g} to {size[k]:g}"
            lines.append(_summary_line(str(group), "order in space", at, f"{error[k]:.2e}", order))
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
        "min": np.nan,
        "max": np.nan,
        "as fast": "",
    }


def _shortest_wall_times(rows: pd.DataFrame) -> pd.Series:
    estimate = rows[WALL_TIME_COLUMN] / _TIMING_SCATTER
    if MIN_WALL_TIME_COLUMN not in rows:
        return estimate
    return rows[MIN_WALL_TIME_COLUMN].fillna(estimate)


def _find_fastest(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    lines = []
    for level in _ERROR_LEVELS:
        accurate = rows[rows[BOUND_COLUMN] <= level].sort_values(WALL_TIME_COLUMN)
        if accurate.empty:
            continue
        fastest = accurate.iloc[0]
        wall_time = fastest[WALL_TIME_COLUMN]
        as_fast = accurate["label"][_shortest_wall_times(accurate) <= wall_time].iloc[1:]
        line = _summary_line(
            group, "fastest", f"error <= {level:.0e}", fastest["label"], wall_time, "s"
        )
        line["min"] = fastest.get(MIN_WALL_TIME_COLUMN, np.nan)
        line["max"] = fastest.get(MAX_WALL_TIME_COLUMN, np.nan)
        line["as fast"] = ", ".join(as_fast)
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


def _find_crossovers(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return summary lines with the error levels below which another series is the fastest.

    Between the runs of a series, log(wall time) is interpolated linearly in log(error).
    """
    errors, costs, shortest = {}, {}, {}
    for series, runs in rows.groupby("series", sort=False):
        ordered = runs.sort_values(ERROR_COLUMN)
        if len(ordered) > 1 and ordered[ERROR_COLUMN].min() > 0.0:
            name = str(series)
            errors[name], costs[name], shortest[name] = np.log(
                [ordered[ERROR_COLUMN], ordered[WALL_TIME_COLUMN], _shortest_wall_times(ordered)]
            )
    if not errors:
        return []
    all_errors = np.concatenate(list(errors.values()))
    levels = np.linspace(all_errors.max(), all_errors.min(), _CROSSOVER_LEVELS)
    overtakings = _find_overtakings(
        np.array([_interpolate_cost(levels, errors[x], costs[x]) for x in errors]),
        np.array([_interpolate_cost(levels, errors[x], shortest[x]) for x in errors]),
    )
    names = list(errors)
    return [
        _summary_line(
            group,
            "crossover",
            f"{names[slower]} to {names[faster]}",
            names[faster],
            np.exp(levels[k]),
            "error",
        )
        for slower, faster, k in overtakings
    ]


def _interpolate_cost(levels: np.ndarray, error: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Interpolate the running minimum of the cost over increasing errors at the error levels.

    The cost is infinite below the smallest error, and equal to the lowest cost above the largest
    error.
    """
    interpolated = np.interp(levels, error, np.minimum.accumulate(cost))
    return np.where(levels < error[0], np.inf, interpolated)


def _find_overtakings(cost: np.ndarray, shortest: np.ndarray) -> list[tuple[int, int, int]]:
    """Return (slower row, faster row, level index) for each change of the fastest series.

    Rows are series and columns are levels of decreasing error. Series A is overtaken by the
    cheapest series B if the cost of B falls below the shortest cost of A. A series that merely
    ends, because it has no runs with smaller errors, is not overtaken.
    """
    overtakings = []
    current = int(np.argmin(cost[:, 0]))
    for k, fastest in enumerate(np.argmin(cost, axis=0).tolist()):
        if not np.isfinite(cost[current, k]):
            current = fastest
        elif cost[fastest, k] < shortest[current, k]:
            slower = np.flatnonzero(cost[fastest, :k] >= cost[current, :k])
            overtakings.append((current, fastest, int(slower[-1]) + 1 if len(slower) else k))
            current = fastest
    return overtakings
