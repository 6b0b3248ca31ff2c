"""Plots of sweeps: responses over one parameter as curves, or over two as color maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.report.pictures import figures
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot
from beamdae.studies.sweeps.parameter_study import (
    STATUS,
    ParameterStudy,
    parameter_column,
)
from beamdae.studies.sweeps.responses import (
    Panel,
    choose_axis,
    group_rows,
    is_numeric_parameter,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray

_MAX_LEGEND_CURVES = 24
_MAX_MARKERS = 200  # of a curve; more hide the line, and each is an element of the SVG file
_MIN_MAP_COVERAGE = 0.5  # fraction of all pairs of values; below it, dots replace cells
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


@dataclass(frozen=True)
class ParameterScale:
    """Axis of a parameter: numbers at their values, other values in order of appearance.

    Attributes
    ----------
    name
        Name of the parameter.
    positions
        Position on the axis for each row of the table.
    ticks
        Distinct positions in ascending order.
    labels
        Tick labels of a parameter that is not numeric; empty for numbers.
    log
        True for a logarithmic axis: at least three positive values form a geometric sequence.
    unit
        Unit of the parameter; "" if unknown, "-" without dimension.
    """

    name: str
    positions: Array
    ticks: Array
    labels: tuple[str, ...]
    log: bool
    unit: str = ""

    @classmethod
    def of(cls, table: pd.DataFrame, name: str, unit: str = "") -> ParameterScale:
        """Return the scale of a parameter in a table of responses."""
        values = list(table[parameter_column(name)])
        if is_numeric_parameter(table, name):
            positions = np.array(values, float)
            ticks = np.unique(positions)
            return cls(name, positions, ticks, (), _is_geometric(ticks), unit)
        texts = [str(value) for value in values]
        labels = list(dict.fromkeys(texts))
        positions = np.array([labels.index(text) for text in texts], float)
        return cls(name, positions, np.arange(len(labels), dtype=float), tuple(labels), False)

    def format_axis(self, axes: Axes, which: str) -> None:
        """Set the label, scale and ticks of the axis `which` ("x" or "y")."""
        from beamdae.report.pictures.tick_labels import format_ticks

        axis = getattr(axes, f"{which}axis")
        label = shorten_text(self.name, figures.MAX_LABEL_LETTERS)
        axis.set_label_text(label if self.unit in ("", "-") else f"{label} [{self.unit}]")
        if self.log:
            getattr(axes, f"set_{which}scale")("log")
        # Scales the label, too.
        format_ticks(axis)
        if self.labels:
            spread = np.linspace(0, len(self.ticks) - 1, _MAX_TICKS).round().astype(int)
            ticks = self.ticks[np.unique(spread)]
            names = [shorten_text(self.labels[int(k)], _MAX_TICK_LETTERS) for k in ticks]
            axis.set_ticks(ticks, names)
            if which == "x" and len(" ".join(names)) > _AXIS_LETTERS:
                axes.tick_params("x", rotation=_LABEL_ROTATION)


def _is_geometric(values: Array) -> bool:
    if len(values) < 3 or values[0] <= 0.0:
        return False
    ratios = values[1:] / values[:-1]
    return bool(np.allclose(ratios, ratios[0], rtol=_RATIO_TOLERANCE))


def list_response_plots(
    study: ParameterStudy, table: pd.DataFrame, panels: Sequence[Panel], folder: Path
) -> dict[str, Callable[[], list[Path]]]:
    """Return functions that write the response plots of a sweep as PNG and SVG, by name.

    The dict is empty if no parameter varies or there are no panels.
    """
    if not study.varied or not panels:
        return {}
    panels = drop_constant(study, table, panels)
    functions: dict[str, Callable[..., Plot]] = {"response": plot_curves}
    if len(study.varied) == 2:
        functions["map"] = plot_maps
    return {
        name: partial(_save_files, partial(plot, study, table, panels), folder / name)
        for name, plot in functions.items()
    }


def _save_files(draw: Callable[[], Plot], path: Path) -> list[Path]:
    figure = draw().figure
    return [figures.save_figure(figure, path.with_suffix(x)) for x in (".png", ".svg")]


def plot_curves(
    study: ParameterStudy, table: pd.DataFrame, panels: Sequence[Panel], x: str | None = None
) -> Plot:
    """Plot each panel over one parameter, with a curve per combination of other parameters.

    If there are several combinations, each measure has a panel; otherwise, the measures of a panel
    are its curves. See `SweepResults.plot` for `x` and errors.
    """
    x = choose_axis(study, table, x)
    scale = ParameterScale.of(table, x, study.units.get(x, ""))
    groups = group_rows(study, scale.name)
    several = len(groups) > 1
    if several:
        panels = [line for panel in panels for line in panel.split()]
    panels = _remove_empty(table, panels)
    labels = list(groups)
    if not several:
        labels = list(dict.fromkeys(x for panel in panels for x in panel.lines if x))
    others = [name for name in study.varied if name != scale.name]
    graded = (
        len(groups) > len(figures.COLORS)
        and len(others) == 1
        and is_numeric_parameter(table, others[0])
    )
    styles = _create_styles(labels, graded)
    failed = (table[STATUS] != "ok").to_numpy()
    figure, axes = figures.create_panels(len(panels), "")
    for axis, panel in zip(axes, panels, strict=False):
        for group, rows in groups.items():
            for measure, column in panel.lines.items():
                style = styles.get(group if several else measure, {"color": figures.COLORS[0]})
                _draw_curve(axis, table, scale, rows, column, style)
        failures = np.unique(scale.positions[failed])
        heights = np.full(len(failures), _FAILURE_HEIGHT)
        axis.plot(failures, heights, transform=axis.get_xaxis_transform(), **_FAILURE_STYLE)
        title = shorten_text(panel.title, figures.MAX_LABEL_LETTERS)
        figures.format_axis(axis, title, _format_unit(panel))
        axis.margins(x=0.04)
        scale.format_axis(axis, "x")
    _add_legend(figure, styles if len(labels) > 1 else {}, bool(failed.any()))
    figures.disable_math_text(figure)
    return Plot(figure)


def _create_styles(labels: Sequence[str], graded: bool) -> dict[str, dict[str, Any]]:
    """Return the style of each curve; if `graded`, the colors follow a color map in order."""
    if graded:
        from matplotlib import colormaps

        colors = colormaps["viridis"](np.linspace(0.0, _MAX_COLOR, len(labels)))
        return {label: {"color": color} for label, color in zip(labels, colors, strict=True)}
    palette, dashes = figures.COLORS, figures.DASHES
    return {
        label: {"color": palette[k % len(palette)], "ls": dashes[k // len(palette) % len(dashes)]}
        for k, label in enumerate(labels)
    }


def _draw_curve(
    axis: Axes,
    table: pd.DataFrame,
    scale: ParameterScale,
    rows: Array,
    column: str,
    style: dict[str, Any],
) -> None:
    """Plot a curve in the order of the parameter; non-numeric parameters have markers only."""
    rows = rows[np.argsort(scale.positions[rows], kind="stable")]
    heights = _extract_numbers(table[column])[rows]
    options: dict[str, Any] = {"marker": "o", "ms": 3.5, "lw": 1.4} | style
    if scale.labels:
        options |= {"ls": "none", "ms": 6}
    elif len(rows) > _MAX_MARKERS:
        # Points without neighbors would be invisible.
        gaps = np.isnan(np.concatenate([[np.nan], heights, [np.nan]]))
        options["markevery"] = np.flatnonzero(~gaps[1:-1] & gaps[:-2] & gaps[2:]).tolist()
    axis.plot(scale.positions[rows], heights, **options)


def _extract_numbers(column: pd.Series) -> Array:
    """Return a column as floats; values that are not numbers or too large to draw become NaN."""
    values = pd.to_numeric(column, "coerce").to_numpy(float)
    return figures.mask_huge_values({"": values})[""]


def _remove_empty(table: pd.DataFrame, panels: Sequence[Panel]) -> list[Panel]:
    columns = {column for panel in panels for column in panel.lines.values()}
    drawable = {c: not np.isnan(_extract_numbers(table[c])).all() for c in columns}
    return [x for x in panels if any(drawable[c] for c in x.lines.values())]


def drop_constant(
    study: ParameterStudy, table: pd.DataFrame, panels: Sequence[Panel]
) -> list[Panel]:
    """Return the panels with a response that differs between runs; all panels if none does.

    With several varied parameters, each measure is a panel, as in `plot_curves`.
    """
    if len(study.varied) > 1:
        panels = [line for panel in panels for line in panel.split()]

    numbers = {x: _extract_numbers(table[x]) for y in panels for x in y.lines.values()}
    largest = {"rad": 1.0}
    for panel in panels:
        size = np.nanmax([np.abs(numbers[x]) for x in panel.lines.values()], initial=0.0)
        largest[panel.unit] = max(largest.get(panel.unit, 0.0), float(size))

    def varies(column: str, unit: str) -> bool:
        values = numbers[column][np.isfinite(numbers[column])]
        size = max(np.abs(values).max(initial=0.0), _NOISE * largest[unit])
        return bool(len(values) and np.ptp(values) > _CONSTANT_RANGE * size)

    varying = [x for x in panels if any(varies(column, x.unit) for column in x.lines.values())]
    return varying or list(panels)


def _format_unit(panel: Panel) -> str:
    return f"[{panel.unit}]" if panel.unit else ""


def _add_legend(figure: Figure, styles: dict[str, dict[str, Any]], any_failed: bool) -> None:
    entries = dict(list(styles.items())[:_MAX_LEGEND_CURVES])
    if len(styles) > _MAX_LEGEND_CURVES:
        entries[f"and {len(styles) - _MAX_LEGEND_CURVES} more"] = {"ls": "none"}
    if any_failed:
        entries["did not reach the end time"] = _FAILURE_STYLE
    if entries:
        figures.add_legend(figure, entries)


def plot_maps(
    study: ParameterStudy,
    table: pd.DataFrame,
    panels: Sequence[Panel],
    x: str | None = None,
    y: str | None = None,
) -> Plot:
    """Plot each response as a color map over the two varied parameters.

    See `SweepResults.map` for `x`, `y` and errors.
    """
    varied = study.varied
    if len(varied) != 2:
        names = f" ({', '.join(varied)})" if varied else ""
        raise BeamdaeError(
            f"{study.name}: a map requires two varied parameters, got {len(varied)}{names}; "
            "vary exactly two parameters."
        )
    x = choose_axis(study, table, x)
    horizontal = ParameterScale.of(table, x, study.units.get(x, ""))
    (other,) = [name for name in varied if name != horizontal.name]
    if y is not None and choose_axis(study, table, y) != other:
        raise BeamdaeError(
            f"{study.name}: y must be {other!r}, got {y!r}, which is on the horizontal axis."
        )
    vertical = ParameterScale.of(table, other, study.units.get(other, ""))
    panels = _remove_empty(table, [line for panel in panels for line in panel.split()])
    figure, axes = figures.create_panels(len(panels), "")
    for axis, panel in zip(axes, panels, strict=False):
        (column,) = panel.lines.values()
        figures.format_axis(axis, shorten_text(panel.title, figures.MAX_LABEL_LETTERS), "")
        heights = _extract_numbers(table[column])
        _draw_map(axis, horizontal, vertical, heights, _format_unit(panel))
        horizontal.format_axis(axis, "x")
        vertical.format_axis(axis, "y")
    figures.disable_math_text(figure)
    return Plot(figure)


def _draw_map(axis: Axes, x: ParameterScale, y: ParameterScale, heights: Array, unit: str) -> None:
    """Draw cells, or dots if fewer than half of all pairs were run; crosses mark missing values.

    Relative differences below 1e-6 are not drawn.
    """
    from beamdae.report.pictures.tick_labels import format_ticks

    if np.nanmax(heights) - np.nanmin(heights) <= _CONSTANT_RANGE * np.nanmax(np.abs(heights)):
        heights = np.where(np.isnan(heights), np.nan, np.nanmean(heights))
    cells = np.full((len(y.ticks), len(x.ticks)), np.nan)
    rows = np.searchsorted(y.ticks, y.positions)
    columns = np.searchsorted(x.ticks, x.positions)
    cells[rows, columns] = heights
    failed = np.isnan(heights)
    if len(heights) < _MIN_MAP_COVERAGE * cells.size:
        x_run, y_run = x.positions[~failed], y.positions[~failed]
        colored: Any = axis.scatter(x_run, y_run, c=heights[~failed], s=30, cmap="viridis")
    else:
        colored = axis.pcolormesh(x.ticks, y.ticks, cells, cmap="viridis", shading="nearest")
    axis.plot(x.positions[failed], y.positions[failed], **_FAILURE_STYLE)
    axis.grid(False)
    bar = axis.figure.colorbar(colored, ax=axis)
    bar.set_label(unit)
    format_ticks(bar.ax.yaxis)
