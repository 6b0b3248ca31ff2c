"""Work-precision and cost-scaling plots of a study."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.report.pictures import figures as pictures
from beamdae.report.pictures.time_plots import save_comparison_figure
from beamdae.results.columns import observed_columns
from beamdae.studies.case_table import ACCURACY_COLUMNS, ERROR_COLUMN, WALL_TIME_COLUMN
from beamdae.studies.deviations import compute_deviations
from beamdae.studies.execution.study_run import StudyResults
from beamdae.studies.run_values import WALL_TIME_RANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_MARKERS = "osD^vPX"
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)))
_MAX_COMPARED_RUNS = 8
# More panels than these take minutes to draw, and nobody looks at them.
_MAX_PANELS = 24
_MAX_TICKS = 8
# Letters of a line of the title of a panel.
_MAX_TITLE_LINE = 54
# What axes of powers have room for.
_LEAST, _MOST = 1e-300, 1e300

Plot = Callable[[], list[Path]]


def list_plots(results: StudyResults) -> dict[str, Plot]:
    """What draws the plots a study may have data for, by name.

    Each writes PNG and SVG and returns their paths: none where there is nothing to draw.
    """
    if ERROR_COLUMN not in results.table:
        return {}
    found: dict[str, Plot] = {"comparison": partial(_draw_comparison, results)}
    if results.study.over is not None:
        return found | {"mesh_convergence": partial(_draw_mesh_convergence, results)}
    return found | {
        "work_precision": partial(_draw_work_precision, results),
        "cost_scaling": partial(_draw_cost_scaling, results),
    }


def _draw_comparison(results: StudyResults) -> list[Path]:
    """What the runs of a single group say of the same columns, and their errors over time."""
    groups = set(results.table["group"])
    if len(groups) != 1 or len(results.study.cases) > _MAX_COMPARED_RUNS:
        return []
    reference = results.references[groups.pop()]
    truth, columns, uncertainty = reference.table, reference.columns, reference.uncertainty
    if truth is None:
        return []
    runs = {}
    for case in results.study.cases:
        table = results.outcome(case).table
        if table is not None and set(columns) <= set(table):
            label = results.study.tag(case)
            runs[label] = (_observed_table(table), compute_deviations(table, truth, columns))
    if not runs:
        return []
    path = results.folder / "comparison.png"
    title = results.study.cases[0].group
    return [save_comparison_figure(path, _observed_table(truth), runs, uncertainty, title)]


def _observed_table(table: pd.DataFrame) -> pd.DataFrame:
    return table[observed_columns(table)].reset_index()


def _draw_work_precision(results: StudyResults) -> list[Path]:
    """Error over wall time, a panel a group; hollow where the reference cannot tell.

    Thin lines go from the fastest to the slowest of repeated runs.
    """
    rows = _select_measured_rows(results)
    styles = _assign_styles(rows["series"], [""] * len(rows))
    figure, axes = _create_panels(list(rows["group"].unique()))
    for group, axis in axes.items():
        here = rows[rows["group"] == group]
        for series, runs in here.groupby("series", sort=False):
            style = styles[str(series), ""]
            # A run that is faster by chance stays between its neighbors.
            runs = runs.sort_values(list(ACCURACY_COLUMNS), ascending=False)
            told, hidden = runs[~runs["hidden"]], runs[runs["hidden"]]
            axis.loglog(told[WALL_TIME_COLUMN], told["height"], **style)
            axis.loglog(
                hidden[WALL_TIME_COLUMN], hidden["height"], **style | {"mfc": "none", "ls": "none"}
            )
            least, most = WALL_TIME_RANGE
            wide = runs[runs[least] < runs[most]]
            if len(wide):
                axis.hlines(wide["height"], wide[least], wide[most], colors=style["color"], lw=0.7)
        low, high = _pad_limits(here["height"])
        resolved = results.references[group].resolution
        if low / 10.0 < resolved < high:
            low = min(low, resolved / 2.0)
            axis.axhspan(low, resolved, color="0.92", zorder=0)
        times = pd.concat([here[name] for name in (WALL_TIME_COLUMN, *WALL_TIME_RANGE)])
        _format_log_axes(axis, times, "wall time [s]", (low, high), "error / amplitude [-]")
    return _save_figure(figure, styles, results.folder / "work_precision")


def _select_measured_rows(results: StudyResults) -> pd.DataFrame:
    """The rows that can be drawn, the height at which each is, and whether that is a limit."""
    table = results.table
    rows = table[table["status"] == "ok"]
    hidden = rows["below resolution"]
    limits = rows["group"].map({g: r.resolution for g, r in results.references.items()})
    height = rows[ERROR_COLUMN].where(~hidden, limits)
    rows = rows.assign(hidden=hidden, height=height.astype(float))
    rows = rows.assign(**{end: rows.get(end, rows[WALL_TIME_COLUMN]) for end in WALL_TIME_RANGE})
    return rows[_positive(rows[WALL_TIME_COLUMN]) & _positive(rows["height"])]


def _positive(values: pd.Series) -> pd.Series:
    """Whether numbers have a place on an axis of powers."""
    return values.astype(float).between(_LEAST, _MOST)


def _draw_mesh_convergence(results: StudyResults) -> list[Path]:
    """Error over the refined parameter, one curve a group."""
    table, over = results.table, str(results.study.over)
    rows = table[(table["status"] == "ok") & _positive(table[ERROR_COLUMN])].sort_values(over)
    styles = _assign_styles(rows["group"], [""] * len(rows))
    figure, axes = _create_panels([""] if len(rows) else [])
    for axis in axes.values():
        for group, runs in rows.groupby("group", sort=False):
            axis.loglog(runs[over], runs[ERROR_COLUMN], **styles[str(group), ""])
        _format_log_axes(
            axis, rows[over], over, _pad_limits(rows[ERROR_COLUMN]), "error / amplitude [-]"
        )
        _set_size_ticks(axis, rows[over])
    return _save_figure(figure, styles, results.folder / "mesh_convergence")


def _draw_cost_scaling(results: StudyResults) -> list[Path]:
    """Wall time over the size of the model, a panel for each choice of the other parameters."""
    table = results.table
    parameters = [str(c) for c in table][1 : list(table).index("group")]
    sizes = [c for c in ("elements", "bodies") if c in parameters and table[c].nunique() > 1]
    if not sizes or not pd.api.types.is_numeric_dtype(table[sizes[0]]):
        return []
    size, others = sizes[0], [c for c in parameters if c != sizes[0]]
    rows = table[
        (table["status"] == "ok") & _positive(table[WALL_TIME_COLUMN]) & _positive(table[size])
    ]
    chosen = [", ".join(f"{c}={row[c]}" for c in others) for _, row in rows.iterrows()]
    rows = rows.assign(chosen=chosen)
    styles = _assign_styles(rows["series"], rows["label"])
    figure, axes = _create_panels(list(dict.fromkeys(chosen)))
    for title, axis in axes.items():
        here = rows[rows["chosen"] == title]
        for (series, label), runs in here.groupby(["series", "label"], sort=False):
            cost = runs.groupby(size)[WALL_TIME_COLUMN].median()
            axis.loglog(cost.index, cost.to_numpy(), **styles[str(series), str(label)])
        _format_log_axes(
            axis, here[size], size, _pad_limits(here[WALL_TIME_COLUMN]), "wall time [s]"
        )
        _set_size_ticks(axis, here[size])
    return _save_figure(figure, styles, results.folder / "cost_scaling")


def _assign_styles(
    series: Sequence[str] | pd.Series, labels: Sequence[str] | pd.Series
) -> dict[tuple[str, str], dict[str, Any]]:
    """By series and label: the series has the color, the label the marker in it."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    known: dict[str, list[str]] = {}
    for name, label in zip(map(str, series), map(str, labels), strict=True):
        known.setdefault(name, [])
        if label in known[name]:
            continue
        known[name].append(label)
        k, turn = list(known).index(name), len(known[name]) - 1
        around = k // len(pictures.COLORS)
        found[name, label] = {
            "color": pictures.COLORS[k % len(pictures.COLORS)],
            "marker": _MARKERS[(around + turn) % len(_MARKERS)],
            "ls": _DASHES[around % len(_DASHES)],
            "ms": 4,
            "lw": 1.0,
        }
    return found


def _create_panels(titles: list[str]) -> tuple[Figure, dict[str, Axes]]:
    """A figure with a panel each; of many it says that they are the first ones."""
    from matplotlib.figure import Figure

    total, titles = len(titles), titles[:_MAX_PANELS]
    columns = max(min(len(titles), 4), 1)
    rows = max(math.ceil(len(titles) / columns), 1)
    figure = Figure(figsize=(4.2 * columns + 1.0, 3.2 * rows + 0.6), layout="constrained")
    if total > len(titles):
        figure.suptitle(f"the first {len(titles)} of {total}", fontsize=9)
    axes = {}
    for k, title in enumerate(titles):
        axis = figure.add_subplot(rows, columns, k + 1)
        axis.set_title(pictures.wrap_title(title, _MAX_TITLE_LINE), fontsize=9)
        axis.grid(color="0.9", lw=0.6, which="both")
        axes[title] = axis
    return figure, axes


def _pad_limits(values: pd.Series) -> tuple[float, float]:
    """Ends of an axis of powers with room beside the values, half a decade at least."""
    low, high = float(values.min()), float(values.max())
    more = max((high / low) ** 0.08, 10.0**0.25 / math.sqrt(high / low), 1.1)
    return max(low / more, _LEAST), min(high * more, _MOST)


def _format_log_axes(
    axis: Axes, x: pd.Series, xlabel: str, y: tuple[float, float], ylabel: str
) -> None:
    """Both axes by powers, their ends, ticks and names."""
    for one, (low, high) in ((axis.xaxis, _pad_limits(x)), (axis.yaxis, y)):
        _set_plain_ticks(one, low, high)
    axis.set_xlim(_pad_limits(x))
    axis.set_ylim(y)
    axis.set_xlabel(xlabel, fontsize=9)
    axis.set_ylabel(ylabel, fontsize=9)
    axis.tick_params(labelsize=8, which="both")


def _set_plain_ticks(axis: Axis, low: float, high: float) -> None:
    """Plain numbers at 1, 2 and 5 of each decade where there are but one or two of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    decades = math.log10(high / low)
    axis.set_minor_formatter(NullFormatter())
    if decades < 2.5:
        axis.set_major_locator(
            LogLocator(subs=(1.0, 2.0, 3.0, 5.0) if decades < 1.2 else (1.0, 2.0, 5.0))
        )
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _set_size_ticks(axis: Axes, values: pd.Series) -> None:
    """Ticks at the sizes there are."""
    sizes = np.unique(values)
    shown = sizes[np.unique(np.linspace(0, len(sizes) - 1, _MAX_TICKS).round().astype(int))]
    axis.set_xticks(shown, [f"{size:g}" for size in shown])
    axis.minorticks_off()


def _save_figure(
    figure: Figure, styles: dict[tuple[str, str], dict[str, Any]], path: Path
) -> list[Path]:
    """The files of a figure, if it has panels."""
    if not figure.axes:
        return []
    pictures.add_legend(
        figure, {label or series: style for (series, label), style in styles.items()}
    )
    return [pictures.save_figure(figure, path.with_suffix(suffix)) for suffix in (".png", ".svg")]
