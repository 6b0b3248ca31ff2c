"""Figures of a study: comparison over time, work-precision, and mesh convergence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.report.pictures.figures import (
    COLORS,
    DASHES,
    MAX_DRAWABLE,
    Panel,
    characteristic_columns,
    draw_panels,
    mask_huge_values,
    save_figure,
)
from beamdae.results.columns import observed_columns
from beamdae.studies.case_table import ACCURACY_COLUMNS, BOUND_COLUMN, ERROR_COLUMN
from beamdae.studies.deviations import compute_deviations
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.run_values import (
    MAX_WALL_TIME_COLUMN,
    MIN_WALL_TIME_COLUMN,
    WALL_TIME_COLUMN,
)

_MARKERS = "osD^vPX"
_ERROR_LABEL = "error / amplitude [-]"
_MAX_COMPARED_RUNS = 8

Plot = Callable[[], list[Path]]
Style = dict[str, Any]
Line = tuple[Any, Any, Style]


def list_plots(results: StudyResults) -> dict[str, Plot]:
    """Return the functions that draw the figures of a study, by name.

    Each function writes image files and returns their paths; if the study lacks the data for the
    figure, it returns []. The dict is empty if no errors are computed.
    """
    if ERROR_COLUMN not in results.table:
        return {}
    plots: dict[str, Plot] = {"comparison": partial(_draw_comparison, results)}
    if results.study.over is None:
        return plots | {"work_precision": partial(_draw_work_precision, results)}
    return plots | {"mesh_convergence": partial(_draw_mesh_convergence, results)}


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
    panels, styles = _compare_runs(_observed_table(reference.table), runs, reference.uncertainty)
    figure = draw_panels(panels, results.study.cases[0].group, styles)
    return [save_figure(figure, results.folder / "comparison.png")]


def _compare_runs(
    reference: pd.DataFrame,
    runs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame]],
    uncertainty: float,
) -> tuple[list[Panel], dict[str, Style]]:
    """Return panels of characteristic columns and errors of runs over time, and their styles.

    Parameters
    ----------
    reference
        Observed columns of the reference.
    runs
        Observed columns, and errors relative to amplitudes [-] by time, of each run.
    uncertainty
        Uncertainty of the reference [-].
    """
    styles = _assign_styles(runs, with_markers=False)
    entries = {"reference": {"color": "0.8", "lw": 5}} | styles
    panels = []
    for column in characteristic_columns(mask_huge_values(reference)):
        lines: list[Line] = [(reference[TIME], reference[column], entries["reference"])]
        lines += [(x[TIME], x[column], styles[k]) for k, (x, _) in runs.items() if column in x]
        panels.append(Panel("", column, lines))
    errors = {label: error.max(axis=1) for label, (_, error) in runs.items()}
    errors = {label: x.where((x > 0.0) & (x < MAX_DRAWABLE)) for label, x in errors.items()}
    if any(x.notna().any() for x in errors.values()):
        lines = [(x.index, x, styles[label]) for label, x in errors.items()]
        if 0.0 < uncertainty < MAX_DRAWABLE and len(reference):
            entries["reference uncertainty"] = {"color": "0.4", "lw": 1.0, "ls": ":"}
            ends = reference[TIME].to_numpy()[[0, -1]]
            lines.append((ends, np.full(2, uncertainty), entries["reference uncertainty"]))
        panels.append(Panel("", _ERROR_LABEL, lines, scales=("linear", "log")))
    return panels, entries


def _observed_table(table: pd.DataFrame) -> pd.DataFrame:
    return table[observed_columns(table)].reset_index()


def _draw_work_precision(results: StudyResults) -> list[Path]:
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
    if not panels:
        return []
    figure = draw_panels(panels, "", styles, "groups", x_label=None)
    return [save_figure(figure, results.folder / "work_precision.png")]


def _draw_mesh_convergence(results: StudyResults) -> list[Path]:
    """Plot the error over the refined parameter, with one line per group."""
    over = str(results.study.over)
    rows = _select_drawable(results.table, over, ERROR_COLUMN).sort_values(over)
    if rows.empty:
        return []
    styles = _assign_styles(rows["group"])
    lines = [
        (runs[over], runs[ERROR_COLUMN], styles[str(group)])
        for group, runs in rows.groupby("group", sort=False)
    ]
    panel = Panel("", _ERROR_LABEL, lines, (over, _ERROR_LABEL), ("log", "log"))
    figure = draw_panels([panel], "", styles, x_label=None)
    return [save_figure(figure, results.folder / "mesh_convergence.png")]


def _select_drawable(table: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Return the rows of successful runs whose values can be drawn on logarithmic axes."""
    rows = table[table["status"] == "ok"]
    values = rows[list(columns)].astype(float)
    return rows[((values > 0.0) & (values < MAX_DRAWABLE)).all(axis=1)]


def _assign_styles(series: Iterable[str], with_markers: bool = True) -> dict[str, Style]:
    """Return a line style for each series; after the last color, markers and dashes differ."""
    styles: dict[str, Style] = {}
    for k, name in enumerate(dict.fromkeys(map(str, series))):
        cycle, number = divmod(k, len(COLORS))
        styles[name] = {
            "color": COLORS[number],
            "marker": _MARKERS[cycle % len(_MARKERS)] if with_markers else "",
            "ls": DASHES[cycle % len(DASHES)],
            "ms": 4,
            "lw": 1.0,
        }
    return styles
