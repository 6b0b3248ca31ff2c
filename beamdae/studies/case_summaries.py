"""What the case table of a study comes to, by group."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from beamdae.studies.case_table import ACCURACY_COLUMNS, ERROR_COLUMN, WALL_TIME_COLUMN
from beamdae.studies.references import RESOLUTION_FACTOR
from beamdae.studies.run_values import WALL_TIME_RANGE

ERROR_LEVELS = (1e-2, 1e-3, 1e-4, 1e-5)
_COLUMNS = ["group", "what", "at", "answer", "value", "unit", "min", "max", "as fast"]
# What a run that was timed once may have taken longer by chance.
_TIMING_SCATTER = 1.2
# Errors between those of a group at which its series are compared.
_CROSSOVER_LEVELS = 200


def summarize_cases(cases: pd.DataFrame) -> pd.DataFrame:
    """By group: the fastest integrator for each accuracy, observed orders, crossovers.

    Rows whose error the reference cannot resolve count for accuracies it can resolve: their error
    is at most that. Of cases that are not measured there is nothing to say.

    One case is told to be faster than another if its median time is less than the fastest run of
    the other, or, where that ran once, less by a fifth; "as fast" has those that the fastest is not
    told to be faster than.
    """
    lines: list[dict[str, Any]] = []
    told = cases["status"] == ("ok" if ERROR_COLUMN in cases else "")
    for group, rows in cases[told].groupby("group", sort=False):
        measured = rows.dropna(subset=[ERROR_COLUMN])
        resolved = measured[~measured["below resolution"]]
        lines += _find_fastest(str(group), measured)
        lines += _fit_orders(str(group), resolved)
        lines += _find_crossovers(str(group), resolved)
    return pd.DataFrame(lines, columns=_COLUMNS)


def summarize_mesh_study(cases: pd.DataFrame, over: str) -> pd.DataFrame:
    """By group of a mesh study: observed order of the error over the refined parameter."""
    lines = []
    for group, rows in cases[cases["status"] == "ok"].groupby("group", sort=False):
        measured = rows.dropna(subset=[ERROR_COLUMN]).sort_values(over)
        measured = measured[~measured["below resolution"] & (measured[ERROR_COLUMN] > 0.0)]
        size, error = measured[over].to_numpy(float), measured[ERROR_COLUMN].to_numpy()
        for k in range(1, len(measured)):
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


def _least_wall_time(rows: pd.DataFrame) -> pd.Series:
    """The least time each case could be told to take."""
    by_chance = rows[WALL_TIME_COLUMN] / _TIMING_SCATTER
    return rows[WALL_TIME_RANGE[0]].fillna(by_chance) if WALL_TIME_RANGE[0] in rows else by_chance


def _find_fastest(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    lines = []
    # Of an error the reference cannot resolve it is known that it is at most that.
    unresolved = RESOLUTION_FACTOR * rows["reference uncertainty [-]"]
    measured = rows[ERROR_COLUMN].where(~rows["below resolution"], unresolved)
    for level in ERROR_LEVELS:
        enough = rows[measured <= level].sort_values(WALL_TIME_COLUMN)
        if len(enough):
            best = enough.iloc[0]
            near = enough["label"][_least_wall_time(enough) <= best[WALL_TIME_COLUMN]].iloc[1:]
            line = _summary_line(
                group,
                "fastest",
                f"error <= {level:.0e}",
                best["label"],
                best[WALL_TIME_COLUMN],
                "s",
            )
            ends = {
                "min": best.get(WALL_TIME_RANGE[0], np.nan),
                "max": best.get(WALL_TIME_RANGE[1], np.nan),
            }
            lines.append(line | ends | {"as fast": ", ".join(near)})
    return lines


def _fit_orders(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Slope of the error over step or tolerance, fitted to all runs of a series."""
    lines = []
    for series, runs in rows.groupby("series", sort=False):
        error = runs[ERROR_COLUMN].to_numpy()
        for name in ACCURACY_COLUMNS:
            size = runs[name].to_numpy(float)
            if len(np.unique(size)) < 2 or np.isnan(size).any() or np.min(error) <= 0.0:
                continue
            order = float(np.polyfit(np.log(size), np.log(error), 1)[0])
            at = f"{size.max():g} to {size.min():g}"
            lines.append(_summary_line(group, f"order in {name}", at, str(series), order))
    return lines


def _find_crossovers(group: str, rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Errors at which another series becomes the fastest, by interpolation of each series."""
    curves = {}
    for series, runs in rows.groupby("series", sort=False):
        ordered = runs.sort_values(ERROR_COLUMN)
        if len(ordered) > 1 and ordered[ERROR_COLUMN].min() > 0.0:
            curves[str(series)] = np.log(
                [ordered[ERROR_COLUMN], ordered[WALL_TIME_COLUMN], _least_wall_time(ordered)]
            )
    if not curves:
        return []
    ends = np.concatenate([error for error, _, _ in curves.values()])
    levels = np.linspace(ends.max(), ends.min(), _CROSSOVER_LEVELS)
    cost, least = (
        np.array([_interpolate_cost(levels, curve[0], curve[k]) for curve in curves.values()])
        for k in (1, 2)
    )
    names = list(curves)
    return [
        _summary_line(
            group, "crossover", f"{names[a]} to {names[b]}", names[b], np.exp(levels[k]), "error"
        )
        for a, b, k in _find_overtakings(cost, least)
    ]


def _interpolate_cost(levels: np.ndarray, error: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """Cost of errors between those of a series: none for smaller, the cheapest for larger ones."""
    inside = np.interp(levels, error, np.minimum.accumulate(cost))
    return np.where(levels < error[0], np.inf, inside)


def _find_overtakings(cost: np.ndarray, least: np.ndarray) -> list[tuple[int, int, int]]:
    """Which series (rows) another is told to be faster than, and the level from which on."""
    found = []
    now = int(np.argmin(cost[:, 0]))
    for k, fastest in enumerate(np.argmin(cost, axis=0).tolist()):
        if not np.isfinite(cost[now, k]):
            # One that merely ends is not overtaken.
            now = fastest
        elif cost[fastest, k] < least[now, k]:
            slower = np.flatnonzero(cost[fastest, :k] >= cost[now, :k])
            found.append((now, fastest, int(slower[-1]) + 1 if len(slower) else k))
            now = fastest
    return found
