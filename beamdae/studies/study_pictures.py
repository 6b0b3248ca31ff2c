"""Figures of a study: comparison over time, work-precision, mesh convergence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.report.pictures import figures as pictures
from beamdae.report.pictures.time_plots import save_comparison_figure
from beamdae.results.columns import observed_columns
from beamdae.studies.case_table import ACCURACY_COLUMNS, BOUND_COLUMN, ERROR_COLUMN
from beamdae.studies.deviations import compute_deviations
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.run_values import (
    MAX_WALL_TIME_COLUMN,
    MIN_WALL_TIME_COLUMN,
    WALL_TIME_COLUMN,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_MARKERS = "osD^vPX"
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)))
_ERROR_LABEL = "error / amplitude [-]"

_MAX_COMPARED_RUNS = 8
_MAX_PANELS = 24  # more take minutes to draw
_MAX_TICKS = 8
_TITLE_WIDTH = 54  # characters per line
_PANELS_PER_ROW = 4
_PANEL_WIDTH = 4.2  # inches
_PANEL_HEIGHT = 3.2  # inches
_LEGEND_WIDTH = 1.0  # inches
_HEADING_HEIGHT = 0.6  # inches

# Range of values on logarithmic axes; Matplotlib overflows beyond it.
_MIN_LOG_VALUE = 1e-300
_MAX_LOG_VALUE = 1e300
_PADDING = 0.08  # on each side of a logarithmic axis, relative to its decades
_MIN_DECADES = 0.5  # of an axis
# Axes that span fewer decades have plain numbers at 1, 2, 5 of each decade.
_MAX_PLAIN_DECADES = 2.5
_PLAIN_TICKS = (1.0, 2.0, 5.0)
# The band of unresolved errors is drawn if it begins less than a decade below the errors.
_BAND_DISTANCE = 10.0
_BAND_HEIGHT = 2.0

Plot = Callable[[], list[Path]]
Style = dict[str, Any]


def list_plots(results: StudyResults) -> dict[str, Plot]:
    """Return the functions that draw the figures of a study, by name.

    Each function writes image files and returns their paths; if the study lacks the data for the
    figure, it returns []. The dict is empty if no errors are computed.
    """
    if ERROR_COLUMN not in results.table:
        return {}
    plots: dict[str, Plot] = {"comparison": partial(_draw_comparison, results)}
    if results.study.over is not None:
        plots["mesh_convergence"] = partial(_draw_mesh_convergence, results)
    else:
        plots["work_precision"] = partial(_draw_work_precision, results)
    return plots


def _draw_comparison(results: StudyResults) -> list[Path]:
    groups = set(results.table["group"])
    if len(groups) != 1 or len(results.study.cases) > _MAX_COMPARED_RUNS:
        return []
    reference = results.references[groups.pop()]
    if reference.table is None:
        return []
    runs = {}
    for case in results.study.cases:
        table = results.outcome(case).table
        if table is not None and set(reference.columns) <= set(table):
            errors = compute_deviations(table, reference.table, reference.columns)
            runs[results.study.tag(case)] = (_observed_table(table), errors)
    if not runs:
        return []
    path = save_comparison_figure(
        results.folder / "comparison.png",
        _observed_table(reference.table),
        runs,
        reference.uncertainty,
        results.study.cases[0].group,
    )
    return [path]


def _observed_table(table: pd.DataFrame) -> pd.DataFrame:
    return table[observed_columns(table)].reset_index()


def _draw_work_precision(results: StudyResults) -> list[Path]:
    """Plot the error over the wall time, with one panel per group.

    Hollow markers are upper bounds of errors that the reference cannot resolve. Thin lines extend
    from the shortest to the longest wall time of repeated runs.
    """
    rows = _select_rows_with_error(results)
    styles = _assign_styles(rows["series"])
    figure, axes = _create_panels(list(rows["group"].unique()))
    for group, axis in axes.items():
        panel_rows = rows[rows["group"] == group]
        for series, runs in panel_rows.groupby("series", sort=False):
            style = styles[str(series)]
            # Sort by setting: wall times scatter, so sorting by wall time would tangle the lines.
            runs = runs.sort_values(list(ACCURACY_COLUMNS.values()), ascending=False)
            is_bound = runs["below resolution"]
            resolved, bounds = runs[~is_bound], runs[is_bound]
            axis.loglog(resolved[WALL_TIME_COLUMN], resolved[ERROR_COLUMN], **style)
            axis.loglog(
                bounds[WALL_TIME_COLUMN],
                bounds[BOUND_COLUMN],
                **style | {"mfc": "none", "ls": "none"},
            )
            repeated = runs[runs[MIN_WALL_TIME_COLUMN] < runs[MAX_WALL_TIME_COLUMN]]
            if len(repeated):
                axis.hlines(
                    repeated[BOUND_COLUMN],
                    repeated[MIN_WALL_TIME_COLUMN],
                    repeated[MAX_WALL_TIME_COLUMN],
                    colors=style["color"],
                    lw=0.7,
                )
        low, high = _pad_limits(panel_rows[BOUND_COLUMN])
        resolution = results.references[group].resolution
        if low / _BAND_DISTANCE < resolution < high:
            low = min(low, resolution / _BAND_HEIGHT)
            axis.axhspan(low, resolution, color="0.92", zorder=0)
        times = pd.concat(
            [
                panel_rows[name]
                for name in (WALL_TIME_COLUMN, MIN_WALL_TIME_COLUMN, MAX_WALL_TIME_COLUMN)
            ]
        )
        _format_log_axes(axis, times, WALL_TIME_COLUMN, (low, high), _ERROR_LABEL)
    return _save_figure(figure, styles, results.folder / "work_precision")


def _select_rows_with_error(results: StudyResults) -> pd.DataFrame:
    """Return the rows whose wall time and bound of the error can be drawn."""
    table = results.table
    rows = table[table["status"] == "ok"]
    for column in (MIN_WALL_TIME_COLUMN, MAX_WALL_TIME_COLUMN):
        rows[column] = rows.get(column, rows[WALL_TIME_COLUMN])
    return rows[_is_drawable(rows[WALL_TIME_COLUMN]) & _is_drawable(rows[BOUND_COLUMN])]


def _is_drawable(values: pd.Series) -> pd.Series:
    return values.astype(float).between(_MIN_LOG_VALUE, _MAX_LOG_VALUE)


def _draw_mesh_convergence(results: StudyResults) -> list[Path]:
    table, over = results.table, str(results.study.over)
    rows = table[(table["status"] == "ok") & _is_drawable(table[ERROR_COLUMN])].sort_values(over)
    styles = _assign_styles(rows["group"])
    figure, axes = _create_panels([""] if len(rows) else [])
    for axis in axes.values():
        for group, runs in rows.groupby("group", sort=False):
            axis.loglog(runs[over], runs[ERROR_COLUMN], **styles[str(group)])
        _format_log_axes(axis, rows[over], over, _pad_limits(rows[ERROR_COLUMN]), _ERROR_LABEL)
        _set_size_ticks(axis, rows[over])
    return _save_figure(figure, styles, results.folder / "mesh_convergence")


def _assign_styles(series: Iterable[str]) -> dict[str, Style]:
    """Return a line style for each series; after the last color, markers and dashes differ."""
    styles: dict[str, Style] = {}
    for k, name in enumerate(dict.fromkeys(map(str, series))):
        cycle = k // len(pictures.COLORS)
        styles[name] = {
            "color": pictures.COLORS[k % len(pictures.COLORS)],
            "marker": _MARKERS[cycle % len(_MARKERS)],
            "ls": _DASHES[cycle % len(_DASHES)],
            "ms": 4,
            "lw": 1.0,
        }
    return styles


def _create_panels(titles: list[str]) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure and its axes by title; a heading states if panels were omitted."""
    from matplotlib.figure import Figure

    total, titles = len(titles), titles[:_MAX_PANELS]
    columns = max(min(len(titles), _PANELS_PER_ROW), 1)
    rows = max(math.ceil(len(titles) / columns), 1)
    size = _PANEL_WIDTH * columns + _LEGEND_WIDTH, _PANEL_HEIGHT * rows + _HEADING_HEIGHT
    figure = Figure(figsize=size, layout="constrained")
    if total > len(titles):
        figure.suptitle(f"the first {len(titles)} of {total}", fontsize=9)
    axes = {}
    for k, title in enumerate(titles):
        axis = figure.add_subplot(rows, columns, k + 1)
        axis.set_title(pictures.wrap_title(title, _TITLE_WIDTH), fontsize=9)
        axis.grid(color="0.9", lw=0.6, which="both")
        axes[title] = axis
    return figure, axes


def _pad_limits(values: pd.Series) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    factor = max((high / low) ** _PADDING, 10.0 ** (0.5 * _MIN_DECADES) / math.sqrt(high / low))
    return max(low / factor, _MIN_LOG_VALUE), min(high * factor, _MAX_LOG_VALUE)


def _format_log_axes(
    axis: Axes, x: pd.Series, xlabel: str, y_limits: tuple[float, float], ylabel: str
) -> None:
    x_limits = _pad_limits(x)
    _set_plain_ticks(axis.xaxis, *x_limits)
    _set_plain_ticks(axis.yaxis, *y_limits)
    axis.set_xlim(x_limits)
    axis.set_ylim(y_limits)
    axis.set_xlabel(xlabel, fontsize=9)
    axis.set_ylabel(ylabel, fontsize=9)
    axis.tick_params(labelsize=8, which="both")


def _set_plain_ticks(axis: Axis, low: float, high: float) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    from beamdae.report.pictures.tick_labels import format_ticks

    format_ticks(axis)
    axis.set_minor_formatter(NullFormatter())
    if math.log10(high / low) < _MAX_PLAIN_DECADES:
        axis.set_major_locator(LogLocator(subs=_PLAIN_TICKS))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _set_size_ticks(axis: Axes, values: pd.Series) -> None:
    sizes = np.unique(values)
    indices = np.unique(np.linspace(0, len(sizes) - 1, _MAX_TICKS).round().astype(int))
    axis.set_xticks(sizes[indices], [f"{size:g}" for size in sizes[indices]])
    axis.minorticks_off()


def _save_figure(figure: Figure, styles: dict[str, Style], path: Path) -> list[Path]:
    """Write a figure as PNG and SVG and return the paths; skip a figure without panels."""
    if not figure.axes:
        return []
    pictures.add_legend(figure, styles)
    return [pictures.save_figure(figure, path.with_suffix(suffix)) for suffix in (".png", ".svg")]
