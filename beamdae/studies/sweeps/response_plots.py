"""Plots of the responses of a sweep: curves over one parameter, and maps over two."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.report.pictures import figures
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot
from beamdae.studies.sweeps.responses import (
    Panel,
    choose_axis,
    group_rows,
)
from beamdae.studies.sweeps.sweep import STATUS, Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray

_MAX_LEGEND_CURVES = 24
_MAX_MARKERS = 200  # of a curve; more hide the line, and each is an element of the SVG file
_FAILURE_STYLE: dict[str, Any] = {
    "marker": "x",
    "color": "0.2",
    "ms": 6,
    "ls": "none",
    "mew": 1.5,
}
_FAILURE_HEIGHT = 0.02  # position of the marks of failed runs, relative to the axes height
_MAX_COLOR = 0.95  # end of the color map for curves; brighter colors are hard to see
_MAX_TICKS = 12
_NOISE = 1e-6  # of responses, relative to the largest one of the same unit, or to 1 rad
_CONSTANT_RANGE = 1e-6  # relative range of responses that are not plotted by default
_MAX_TICK_LETTERS = 18
_AXIS_LETTERS = 40  # letters of all texts that fit side by side below a panel
_LABEL_ROTATION = 30  # of texts below a panel [degrees]
_RATIO_TOLERANCE = 1e-6  # relative tolerance of the ratios of a geometric sequence


class ParameterScale(NamedTuple):
    """Axis of a parameter: numbers at their values, other values in order of appearance.

    Attributes
    ----------
    label
        Name of the parameter with its unit.
    positions
        Position of each row of the table.
    ticks, labels
        Distinct positions in ascending order, and their labels; no labels for numbers.
    scale
        "log" if the values are a geometric sequence, otherwise "linear".
    """

    label: str
    positions: Array
    ticks: Array
    labels: tuple[str, ...] = ()
    scale: str = "linear"

    @classmethod
    def of(cls, study: Sweep, name: str) -> ParameterScale:
        """Return the scale of a parameter of the cases."""
        axis, unit = study.axes[name], study.units.get(name, "")
        label = shorten_text(name, figures.MAX_LABEL_LETTERS)
        if not axis.is_numeric:
            codes, ticks = np.array(axis.locate(study.settings), float), np.arange(len(axis.values))
            return cls(label, codes, ticks.astype(float), tuple(map(str, axis.values)))
        label = label if unit in ("", "-") else f"{label} [{unit}]"
        positions = np.array([setting[name] for setting in study.settings], float)
        ticks = np.unique(positions)
        is_geometric = len(ticks) > 2 and bool(ticks[0] > 0.0)
        if is_geometric:
            ratios = ticks[1:] / ticks[:-1]
            is_geometric = np.allclose(ratios, ratios[0], rtol=_RATIO_TOLERANCE)
        return cls(label, positions, ticks, (), "log" if is_geometric else "linear")

    def format_axis(self, axes: Axes, which: str) -> None:
        """Set the label, scale and ticks of the axis `which` ("x" or "y")."""
        from beamdae.report.pictures.tick_labels import format_ticks

        axis = getattr(axes, f"{which}axis")
        axis.set_label_text(self.label)
        axes.set(**{f"{which}scale": self.scale})
        # Scales the label, too.
        format_ticks(axis)
        if self.labels:
            spread = np.linspace(0, len(self.ticks) - 1, _MAX_TICKS).round().astype(int)
            ticks = self.ticks[np.unique(spread)]
            names = [shorten_text(self.labels[int(k)], _MAX_TICK_LETTERS) for k in ticks]
            axis.set_ticks(ticks, names)
            if which == "x" and len(" ".join(names)) > _AXIS_LETTERS:
                axes.tick_params("x", rotation=_LABEL_ROTATION)


def list_response_plots(
    study: Sweep, table: pd.DataFrame, panels: Sequence[Panel]
) -> dict[str, Callable[[], Figure]]:
    """Return functions that create the response plots of a sweep by file name.

    There are none if no parameter varies or there are no responses.
    """
    if not study.varied or not panels:
        return {}
    panels = choose_panels(study, table, panels)
    plots = {"response.png": plot_curves}
    if len(study.varied) == 2:
        plots["map.png"] = plot_maps

    def create(plot: Callable[..., Plot]) -> Callable[[], Figure]:
        return lambda: plot(study, table, panels).figure

    return {name: create(plot) for name, plot in plots.items()}


def plot_curves(
    study: Sweep, table: pd.DataFrame, panels: Sequence[Panel], x: str | None = None
) -> Plot:
    """Plot each panel over one parameter, with a curve per combination of other parameters.

    Crosses mark failed runs. See `SweepResults.plot`.
    """
    x = choose_axis(study, x)
    scale, groups = ParameterScale.of(study, x), group_rows(study, x)
    several = len(groups) > 1
    panels = _remove_empty(table, _split(panels) if several else panels)
    labels = list(groups)
    if not several:
        labels = list(dict.fromkeys(x for panel in panels for x in panel.lines if x))
    others = [name for name in study.varied if name != x]
    is_graded = (
        len(groups) > len(figures.COLORS) and len(others) == 1 and study.axes[others[0]].is_numeric
    )
    if is_graded:  # along a color map
        from matplotlib import colormaps

        colors = colormaps["viridis"](np.linspace(0.0, _MAX_COLOR, len(labels)))
        styles = {label: {"color": color} for label, color in zip(labels, colors, strict=True)}
    else:
        palette, dashes = figures.COLORS, figures.DASHES
        styles = {
            x: {"color": palette[k % len(palette)], "ls": dashes[k // len(palette) % len(dashes)]}
            for k, x in enumerate(labels)
        }
    drawn = []
    for panel in panels:
        lines = [
            _create_line(table[column], scale, rows, styles.get(group if several else measure))
            for group, rows in groups.items()
            for measure, column in panel.lines.items()
        ]
        axes = (scale.label, "")
        drawn.append(figures.Panel(panel.title, panel.label, lines, axes, (scale.scale, "linear")))
    is_failed = (table[STATUS] != "ok").to_numpy()
    legend = styles if len(labels) > 1 else {}
    entries = dict(list(legend.items())[:_MAX_LEGEND_CURVES])
    if len(legend) > _MAX_LEGEND_CURVES:
        entries[f"and {len(legend) - _MAX_LEGEND_CURVES} more"] = {"ls": "none"}
    if is_failed.any():
        entries["did not reach the end time"] = _FAILURE_STYLE
    figure = figures.draw_panels(drawn, "", entries, x_label=None)
    failures = np.unique(scale.positions[is_failed])
    heights = np.full(len(failures), _FAILURE_HEIGHT)
    for axis in figure.axes:
        axis.plot(failures, heights, transform=axis.get_xaxis_transform(), **_FAILURE_STYLE)
        scale.format_axis(axis, "x")
    return Plot(figure)


def _create_line(
    column: pd.Series, scale: ParameterScale, rows: Array, style: dict[str, Any] | None
) -> tuple[Array, Array, dict[str, Any]]:
    """Return a curve in the order of the parameter; other values have markers only."""
    rows = rows[np.argsort(scale.positions[rows], kind="stable")]
    looks: dict[str, Any] = {"color": figures.COLORS[0], "lw": 1.4} | (style or {})
    if scale.labels:
        looks |= {"ls": "none", "marker": "o", "ms": 6}
    elif len(rows) <= _MAX_MARKERS:
        looks |= {"marker": "o", "ms": 3.5}
    return scale.positions[rows], _extract_numbers(column)[rows], looks


def _extract_numbers(column: pd.Series) -> Array:
    """Return a column as floats; values that are not numbers or too large to draw become NaN."""
    return figures.mask_huge_values(pd.to_numeric(column, "coerce"))


def _split(panels: Sequence[Panel]) -> list[Panel]:
    return [line for panel in panels for line in panel.split()]


def _remove_empty(table: pd.DataFrame, panels: Sequence[Panel]) -> list[Panel]:
    columns = {column for panel in panels for column in panel.lines.values()}
    drawable = {c: not np.isnan(_extract_numbers(table[c])).all() for c in columns}
    return [x for x in panels if any(drawable[c] for c in x.lines.values())]


def choose_panels(study: Sweep, table: pd.DataFrame, panels: Sequence[Panel]) -> list[Panel]:
    """Return the panels that are plotted by default: those of responses that differ between runs.

    Responses whose range is below 1e-6 of their largest magnitude, or of 1e-6 of the largest one of
    the same unit, are constant up to rounding. If several parameters vary, each observed column has
    one panel, see `choose_response`.
    """
    numbers = {x: _extract_numbers(table[x]) for panel in panels for x in panel.lines.values()}
    largest = {"rad": 1.0}
    for panel in panels:
        size = np.nanmax([np.abs(numbers[x]) for x in panel.lines.values()], initial=0.0)
        largest[panel.unit] = max(largest.get(panel.unit, 0.0), float(size))

    def varies(column: str, unit: str) -> bool:
        values = numbers[column][np.isfinite(numbers[column])]
        size = max(np.abs(values).max(initial=0.0), _NOISE * largest[unit])
        return bool(len(values) and np.ptp(values) > _CONSTANT_RANGE * size)

    varying = [
        panel._replace(lines=lines)
        for panel in panels
        if (lines := {k: x for k, x in panel.lines.items() if varies(x, panel.unit)})
    ]
    chosen = varying or list(panels)
    return chosen if len(study.varied) == 1 else [choose_response(table, x) for x in chosen]


def choose_response(table: pd.DataFrame, panel: Panel) -> Panel:
    """Return a panel of one response: of an observed column, the extreme of larger magnitude."""
    lines = {name: panel.lines[name] for name in ("max", "min") if name in panel.lines}
    lines = lines or dict(panel.lines)
    name = max(lines, key=lambda x: np.nanmax(np.abs(_extract_numbers(table[lines[x]])), initial=0))
    return panel._replace(lines={name: lines[name]}).split()[0]


def plot_maps(
    study: Sweep, table: pd.DataFrame, panels: Sequence[Panel], x: str | None = None
) -> Plot:
    """Plot each response as a color map over the two varied parameters.

    See `SweepResults.map`.
    """
    varied = study.varied
    if len(varied) != 2:
        names = f" ({', '.join(varied)})" if varied else ""
        raise BeamdaeError(
            f"{study.name}: a map requires two varied parameters, got {len(varied)}{names}; "
            "vary exactly two parameters."
        )
    x = choose_axis(study, x)
    (other,) = [name for name in varied if name != x]
    horizontal, vertical = (ParameterScale.of(study, name) for name in (x, other))
    panels = _remove_empty(table, _split(panels))
    figure, axes = figures.create_panels(len(panels), "")
    for axis, panel in zip(axes, panels, strict=False):
        (column,) = panel.lines.values()
        figures.format_axis(axis, shorten_text(panel.title, figures.MAX_LABEL_LETTERS), "")
        _draw_map(axis, horizontal, vertical, _extract_numbers(table[column]), panel.label)
        horizontal.format_axis(axis, "x")
        vertical.format_axis(axis, "y")
    figures.disable_math_text(figure)
    return Plot(figure)


def _draw_map(axis: Axes, x: ParameterScale, y: ParameterScale, heights: Array, unit: str) -> None:
    """Draw cells, or dots if not all pairs were run; crosses mark missing values."""
    from beamdae.report.pictures.tick_labels import format_ticks

    if np.nanmax(heights) - np.nanmin(heights) <= _CONSTANT_RANGE * np.nanmax(np.abs(heights)):
        heights = np.where(np.isnan(heights), np.nan, np.nanmean(heights))
    cells = np.full((len(y.ticks), len(x.ticks)), np.nan)
    cells[np.searchsorted(y.ticks, y.positions), np.searchsorted(x.ticks, x.positions)] = heights
    failed = np.isnan(heights)
    if len(heights) < cells.size:
        x_run, y_run = x.positions[~failed], y.positions[~failed]
        colored: Any = axis.scatter(x_run, y_run, c=heights[~failed], s=30, cmap="viridis")
    else:
        colored = axis.pcolormesh(x.ticks, y.ticks, cells, cmap="viridis", shading="nearest")
    axis.plot(x.positions[failed], y.positions[failed], **_FAILURE_STYLE)
    axis.grid(False)
    figure: Figure = axis.figure  # type: ignore[assignment]
    bar = figure.colorbar(colored, ax=axis)
    bar.set_label(unit)
    format_ticks(bar.ax.yaxis)
