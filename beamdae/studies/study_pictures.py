"""Figures of a study: work-precision, and mesh convergence."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.report.pictures.figures import (
    COLORS,
    DASHES,
    MAX_DRAWABLE,
    Panel,
    draw_panels,
)
from beamdae.studies.case_table import ACCURACY_COLUMNS, BOUND_COLUMN, ERROR_COLUMN
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.run_values import (
    MAX_WALL_TIME_COLUMN,
    MIN_WALL_TIME_COLUMN,
    WALL_TIME_COLUMN,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKERS = "osD^vPX"
_ERROR_LABEL = "error / amplitude [-]"

Style = dict[str, Any]
Line = tuple[Any, Any, Style]


def list_plots(results: StudyResults) -> dict[str, Callable[[], Figure | None]]:
    """Return the functions that create the figures of a study, by file name.

    They return None if the study lacks the data for the figure. The dict is empty if no errors are
    computed.
    """
    if ERROR_COLUMN not in results.table:
        return {}
    if results.study.over is None:
        return {"work_precision.png": partial(_draw_work_precision, results)}
    return {"mesh_convergence.png": partial(_draw_mesh_convergence, results)}


def _draw_work_precision(results: StudyResults) -> Figure | None:
    """Plot the error over the wall time, with one panel per group.

    Markers of errors that the reference does not resolve are hollow, at its dotted line. Thin lines
    extend from the shortest to the longest wall time of repeated runs.
    """
    rows = _select_drawable(results.table, WALL_TIME_COLUMN, BOUND_COLUMN)
    styles, panels = _assign_styles(rows["series"]), []
    for group, members in rows.groupby("group", sort=False):
        lines: list[Line] = []
        for series, runs in members.groupby("series", sort=False):
            style = styles[str(series)]
            # Sort by setting: wall times scatter, so sorting by wall time would tangle the lines.
            runs = runs.sort_values(list(ACCURACY_COLUMNS.values()), ascending=False)
            resolved, bounds = runs[~runs["below resolution"]], runs[runs["below resolution"]]
            hollow = style | {"mfc": "none", "ls": "none"}
            lines.append((resolved[WALL_TIME_COLUMN], resolved[ERROR_COLUMN], style))
            lines.append((bounds[WALL_TIME_COLUMN], bounds[BOUND_COLUMN], hollow))
            span = runs.reindex(columns=[MIN_WALL_TIME_COLUMN, MAX_WALL_TIME_COLUMN, BOUND_COLUMN])
            thin = {"color": style["color"], "lw": 0.7}
            lines += [(x[:2], np.full(2, x[2]), thin) for x in span.dropna().to_numpy(float)]
        resolution = results.references[str(group)].resolution
        times = members[WALL_TIME_COLUMN].agg(["min", "max"]).to_numpy()
        lines.append((times, np.full(2, resolution), {"color": "0.4", "lw": 1.0, "ls": ":"}))
        # Equal errors have no range.
        low, high = members[BOUND_COLUMN].agg(["min", "max"])
        lines.append((times, np.array([0.3 * low, 3.0 * high]), {"ls": ""}))
        axes = WALL_TIME_COLUMN, _ERROR_LABEL
        panels.append(Panel(str(group), _ERROR_LABEL, lines, axes, ("log", "log")))
    return draw_panels(panels, "", styles, "groups", x_label=None) if panels else None


def _draw_mesh_convergence(results: StudyResults) -> Figure | None:
    """Plot the error over the refined parameter, with one line per group."""
    over = str(results.study.over_header)
    rows = _select_drawable(results.table, over, ERROR_COLUMN).sort_values(over)
    if rows.empty:
        return None
    styles = _assign_styles(rows["group"])
    lines = [
        (runs[over], runs[ERROR_COLUMN], styles[str(group)])
        for group, runs in rows.groupby("group", sort=False)
    ]
    panel = Panel("", _ERROR_LABEL, lines, (over, _ERROR_LABEL), ("log", "log"))
    return draw_panels([panel], "", styles, x_label=None)


def _select_drawable(table: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Return the rows of successful runs whose values can be drawn on logarithmic axes."""
    rows = table[table["status"] == "ok"]
    values = rows[list(columns)].astype(float)
    return rows[((values > 0.0) & (values < MAX_DRAWABLE)).all(axis=1)]


def _assign_styles(series: Iterable[str]) -> dict[str, Style]:
    """Return a line style for each series; after the last color, markers and dashes differ."""
    styles: dict[str, Style] = {}
    for k, name in enumerate(dict.fromkeys(map(str, series))):
        cycle, number = divmod(k, len(COLORS))
        styles[name] = {
            "color": COLORS[number],
            "marker": _MARKERS[cycle % len(_MARKERS)],
            "ls": DASHES[cycle % len(DASHES)],
            "ms": 4,
            "lw": 1.0,
        }
    return styles
