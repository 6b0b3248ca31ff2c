"""Work-precision and cost-scaling plots of a study."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from beamdae.report import pictures
from beamdae.results.headers import observed_columns
from beamdae.studies.deviations import deviations
from beamdae.studies.engine import Results
from beamdae.studies.tables import COST, ERROR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = "osD^vPX"
_MOST_RUNS = 8


def draw(results: Results) -> list[Path]:
    """Draw the plots a study has data for, PNG and SVG; returns the paths."""
    table = results.table
    paths = _of_one_group(results)
    if results.study.over is not None:
        paths += _saved(_mesh(results), results.folder / "mesh_convergence")
    elif table[ERROR].notna().any():
        paths += _saved(_work_precision(results), results.folder / "work_precision")
    sizes = [c for c in ("elements", "bodies") if c in table and table[c].nunique() > 1]
    if sizes and results.study.over is None:
        paths += _saved(_cost_scaling(table, sizes[0]), results.folder / "cost_scaling")
    return paths


def _of_one_group(results: Results) -> list[Path]:
    """What the runs of a single group say of the same columns, and their errors over time."""
    agreed = [r for r in results.references.values() if r.table is not None]
    if len(results.references) != 1 or not agreed or len(results.study.cases) > _MOST_RUNS:
        return []
    truth, columns, uncertainty = agreed[0].table, agreed[0].columns, agreed[0].uncertainty
    assert truth is not None
    runs = {}
    for case in results.study.cases:
        table = results.outcome(case).table
        if table is not None and set(columns) <= set(table):
            label = results.study.tag(case)
            runs[label] = (_columns(table), deviations(table, truth, columns))
    path = results.folder / "comparison.png"
    title = results.study.cases[0].group
    return [pictures.picture_of_comparison(path, _columns(truth), runs, uncertainty, title)]


def _columns(table: pd.DataFrame) -> pd.DataFrame:
    return table[observed_columns(table)].reset_index()


def _work_precision(results: Results) -> Figure:
    """Error over wall time, a panel a group; a bar where the reference cannot tell."""
    table = results.table
    styles = _styles(table)
    figure, axes = _panels(list(table["group"].unique()))
    for group, axis in axes.items():
        rows = table[(table["group"] == group) & (table["status"] == "ok")].dropna(subset=[ERROR])
        for series, runs in rows.groupby("series", sort=False):
            told = runs[~runs["below resolution"]].sort_values(COST)
            axis.loglog(told[COST], told[ERROR], **styles[str(series)])
            hidden = runs[runs["below resolution"]]
            limit = results.references[str(group)].resolves if len(hidden) else math.nan
            for cost in hidden[COST]:
                axis.plot(cost, limit, **(styles[str(series)] | {"mfc": "none", "ls": "none"}))
        reference = results.references.get(str(group))
        if reference is not None and reference.resolves > 0.0:
            axis.axhspan(0.0, reference.resolves, color="0.92", zorder=0)
        _log_ticks(axis)
        axis.set_xlabel("wall time [s]", fontsize=9)
        axis.set_ylabel("error / amplitude [-]", fontsize=9)
    return _with_legend(figure, styles)


def _log_ticks(axis: Axes) -> None:
    """Ticks at 1, 2 and 5 of each decade: the times of a study span but one or two."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _mesh(results: Results) -> Figure:
    """Error over the refined parameter, one curve a group."""
    table, over = results.table, str(results.study.over)
    groups = [str(g) for g in table["group"].unique()]
    styles = {g: _style(k) for k, g in enumerate(groups)}
    figure, axes = _panels([""])
    for group in groups:
        rows = table[(table["group"] == group) & (table["status"] == "ok")].sort_values(over)
        axes[""].loglog(rows[over], rows[ERROR].where(rows[ERROR] > 0.0), **styles[group])
    axes[""].set_xlabel(over, fontsize=9)
    axes[""].set_ylabel("error / amplitude [-]", fontsize=9)
    return _with_legend(figure, styles)


def _cost_scaling(table: pd.DataFrame, size: str) -> Figure:
    """Wall time over the size of the model, a panel for each choice of the other parameters."""
    ok = table[table["status"] == "ok"]
    others = [c for c in _parameters(table) if c != size]
    chosen = [", ".join(f"{c}={row[c]}" for c in others) for _, row in ok.iterrows()]
    styles = {str(label): _style(k) for k, label in enumerate(ok["label"].unique())}
    figure, axes = _panels(list(dict.fromkeys(chosen)))
    for (title, label), runs in ok.groupby([chosen, "label"], sort=False):
        cost = runs.groupby(size)[COST].median()
        axes[str(title)].loglog(cost.index, cost.to_numpy(), **styles[str(label)])
    sizes = sorted(ok[size].unique())
    for axis in axes.values():
        axis.set_xticks(sizes, list(map(str, sizes)))
        axis.xaxis.minorticks_off()
        axis.set_xlabel(size, fontsize=9)
        axis.set_ylabel("wall time [s]", fontsize=9)
    return _with_legend(figure, styles)


def _parameters(table: pd.DataFrame) -> list[str]:
    """The columns between the model and the group: its parameters."""
    columns = [str(c) for c in table]
    return columns[1 : columns.index("group")]


def _style(k: int) -> dict[str, Any]:
    return {
        "color": pictures.COLORS[k % len(pictures.COLORS)],
        "marker": _MARKERS[(k // len(pictures.COLORS)) % len(_MARKERS)],
        "ms": 4,
        "lw": 1.0,
    }


def _styles(table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    return {str(series): _style(k) for k, series in enumerate(table["series"].unique())}


def _panels(titles: list[str]) -> tuple[Figure, dict[str, Axes]]:
    from matplotlib.figure import Figure

    columns = min(len(titles), 4)
    rows = math.ceil(len(titles) / columns)
    figure = Figure(figsize=(4.2 * columns + 1.0, 3.2 * rows + 1.0), layout="constrained")
    axes = {}
    for k, title in enumerate(titles):
        axis = figure.add_subplot(rows, columns, k + 1)
        axis.set_title(title, fontsize=9)
        axis.grid(color="0.9", lw=0.6, which="both")
        axis.tick_params(labelsize=8)
        axes[title] = axis
    return figure, axes


def _with_legend(figure: Figure, styles: dict[str, dict[str, Any]]) -> Figure:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **style, label=name) for name, style in styles.items()]
    columns = max(1, int(figure.get_figwidth() / 2.6))
    # The legend takes no room from the panels.
    rows = math.ceil(len(handles) / columns)
    figure.set_figheight(figure.get_figheight() + 0.19 * rows)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=columns, fontsize=8, frameon=False
    )
    return figure


def _saved(figure: Figure, path: Path) -> list[Path]:
    return [pictures.saved(figure, path.with_suffix(suffix)) for suffix in (".png", ".svg")]
