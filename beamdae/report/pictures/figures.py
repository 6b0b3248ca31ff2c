"""Common functions for figures: palette, column selection, panels, legends and file output."""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    is_valid_path,
    path_as_text,
    short_repr,
)
from beamdae.report.text import shorten_text
from beamdae.results.columns import Header, is_derivative, largest_by, observed_columns
from beamdae.results.storage.files import atomic_write

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

    # A table by header.
    Columns = Mapping[str, Any] | pd.DataFrame

Array = np.ndarray

# Palette of Okabe & Ito, which is suitable for all types of color vision.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))

MAX_LABEL_LETTERS = 28  # of an axis label
_TITLE_LINE_LETTERS = 60
_LEGEND_ENTRY_LETTERS = 60
_PANEL_TITLE_LETTERS = 40
_PANEL_LEGEND_LETTERS = 14  # of an entry in the legend of a panel
_PANEL_LEGEND_COLUMNS = 4
_LEGEND_LETTER_WIDTH = 0.075  # approximate width of a letter [inch]
_LEGEND_LINE_WIDTH = 0.8  # width of the line beside a legend entry [inch]
_LEGEND_ROW_HEIGHT = 0.19  # [inch]
MAX_PANELS = 12
_MAX_DEFAULT_PANELS = 6  # more are too small to read on a screen
# Largest number of ticks for which numbers with six digits do not overlap.
_MAX_HORIZONTAL_TICKS = 5
_RESOLUTION = 150  # of picture files [dots per inch]
_PANEL_WIDTH, _PANEL_HEIGHT = 4.8, 2.35  # [inch]
_HEADING_LINE_HEIGHT = 0.2  # [inch]

# Larger values overflow when Matplotlib computes the range of an axis.
MAX_DRAWABLE = 1e300
_MINOR_RANGE = 0.2  # relative to the largest range of columns with the same unit, as in curves.js
# A column is considered constant if its range is at or below one of these limits.
_MIN_RELATIVE_RANGE = 1e-9  # relative to the largest range of the columns with the same unit
_ROUNDING = 1e-15  # relative to the largest range of all columns


def mask_huge_values(values: Any) -> Array:
    """Return values with nan in place of those that are too large to draw."""
    numbers = np.asarray(values, float)
    return np.where(np.abs(numbers) < MAX_DRAWABLE, numbers, np.nan)


def varying_columns(table: Columns) -> list[str]:
    """Return the observed columns that vary.

    Rates, derivatives by parameters and columns that contain only nan are excluded.

    If all remaining columns are constant, return all of them.
    """
    columns = [
        c
        for c in observed_columns(table)
        if not (Header.of(c).suffix.endswith("_dot") or is_derivative(c))
    ]
    size = {c: x for c in columns if not np.isnan(x := _range(table[c]))}
    largest = _largest_with_unit(size)
    rounding = _ROUNDING * max(size.values(), default=0.0)
    limits = {c: max(_MIN_RELATIVE_RANGE * largest[c], rounding) for c in size}
    return [c for c in size if size[c] > limits[c]] or list(size)


def characteristic_columns(table: Columns) -> list[str]:
    """Return up to three columns that characterize a run, preferring deformations, then motions.

    Columns whose range is a minor part of the largest one with their unit, such as the shortening
    of a beam that bends, follow the others.
    """
    groups: dict[str, list[str]] = {}
    for column in varying_columns(table):
        groups.setdefault(Header.of(column).name, []).append(column)
    for columns in groups.values():
        if {Header.of(c).suffix for c in columns} & {"u", "v", "phi"}:
            return columns[:3]
    candidates = [column for columns in groups.values() for column in columns]
    motions = [column for column in candidates if Header.of(column).unit in ("m", "rad")]
    columns = motions or candidates
    size = {c: _range(table[c]) for c in columns}
    largest = _largest_with_unit(size)
    return sorted(columns, key=lambda c: size[c] < _MINOR_RANGE * largest[c])[:3]


def select_default(table: Columns) -> list[str]:
    """Return up to six columns that vary, those that characterize a result first."""
    columns = dict.fromkeys([*characteristic_columns(table), *varying_columns(table)])
    return list(columns)[:_MAX_DEFAULT_PANELS]


def _largest_with_unit(size: Mapping[str, float]) -> dict[str, float]:
    """Return the largest size of the columns with the same unit, for each column.

    Others are not comparable: a stress in Pa can be 1e10 times a displacement in m.
    """
    units = {column: Header.of(column).unit for column in size}
    largest = largest_by(units.values(), size.values())
    return {column: largest[unit] for column, unit in units.items()}


def _range(values: Any) -> float:
    """Return the range of the values that can be drawn; nan if there are none."""
    values = np.asarray(values, float)
    numbers = values[np.abs(values) < MAX_DRAWABLE]
    return float(np.ptp(numbers)) if len(numbers) else np.nan


def create_panels(
    number: int, title: str, what: str = "columns", x_label: str | None = "t [s]"
) -> tuple[Figure, list[Axes]]:
    """Create a figure with panels, arranged in up to two columns.

    At most twelve panels are created. If panels are omitted, the title states the numbers.

    Parameters
    ----------
    number
        Number of panels.
    title
        Title of the figure.
    what
        Name of the panel content in the title, for example "columns".
    x_label
        Label below the lowest panels.
    """
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    requested, number = number, min(number, MAX_PANELS)
    columns = 1 if number == 1 else 2
    rows = max(math.ceil(number / columns), 1)
    # Shown above the panels because legends are placed below.
    omission = [f"{number} of {requested} {what}"] if requested > number else []
    heading = "\n".join(filter(None, [wrap_title(title), *omission]))
    lines = heading.count("\n") + 1 if heading else 0
    size = (columns * _PANEL_WIDTH, rows * _PANEL_HEIGHT + lines * _HEADING_LINE_HEIGHT)
    figure = Figure(figsize=size, layout="constrained")
    axes = [figure.add_subplot(rows, columns, k + 1) for k in range(number)]
    # The last row may have one panel; the panel above its empty place is labeled instead.
    for axis in axes[-columns:]:
        axis.set_xlabel(x_label or "")
    if not axes:
        figure.text(0.5, 0.4, "there is nothing to draw", ha="center", color="0.4")
    if heading:
        figure.suptitle(heading, fontsize=11)
    return figure, axes


def wrap_title(title: str) -> str:
    """Wrap a title to about two lines, shortening long titles in the middle."""
    text = shorten_text(title, 2 * _TITLE_LINE_LETTERS - 10)
    return textwrap.fill(text, _TITLE_LINE_LETTERS)


def format_axis(axis: Axes, title: str, ylabel: str) -> None:
    """Set title, y label, grid and ticks of an axis."""
    from beamdae.report.pictures.tick_labels import format_ticks

    axis.set_title(title, fontsize=10)
    axis.set_ylabel(shorten_text(ylabel, MAX_LABEL_LETTERS))
    draw_grid(axis)
    axis.margins(x=0.0)
    format_ticks(axis.yaxis)
    axis.tick_params(labelsize=9, which="both")
    axis.yaxis.get_offset_text().set_fontsize(9)


def draw_grid(axis: Axes) -> None:
    """Draw a light grid, and hide the frame at the top and on the right."""
    axis.grid(color="0.9", lw=0.6)
    axis.spines[["top", "right"]].set_visible(False)


class Panel(NamedTuple):
    """Lines over common axes.

    Attributes
    ----------
    title, label
        Title, and label of the vertical axis.
    lines
        Horizontal and vertical values, and the style of each line.
    abscissa
        Header of the column on the horizontal axis, and of that on the vertical one; None for the
        common axis of all panels.
    scales
        Scales of both axes.
    legend
        Names of the lines in a legend above the axes.
    """

    title: str
    label: str
    lines: Sequence[tuple[Any, Any, Mapping[str, Any]]]
    abscissa: tuple[str, str] | None = None
    scales: tuple[str, str] = ("linear", "linear")
    legend: Sequence[str] = ()


def draw_panels(
    panels: Sequence[Panel],
    title: str = "",
    entries: Mapping[str, Mapping[str, Any]] | None = None,
    what: str = "columns",
    x_label: str | None = "t [s]",
) -> Figure:
    """Create a figure of panels, see `create_panels`.

    If both columns of an abscissa are coordinates of one point, such as "tip.x [m]" and
    "tip.y [m]", the axes have equal scales. The common legend contains the line styles of `entries`
    by name.
    """
    figure, axes = create_panels(len(panels), title, what, x_label)
    for axis, panel in zip(axes, panels, strict=False):
        for x, y, style in panel.lines:
            # A line through a single point would be invisible.
            looks: dict[str, Any] = {"marker": "o", "ms": 4} if len(x) == 1 else {}
            axis.plot(mask_huge_values(x), mask_huge_values(y), **(looks | dict(style)))
        axis.set(xscale=panel.scales[0], yscale=panel.scales[1])
        format_axis(axis, shorten_text(panel.title, _PANEL_TITLE_LETTERS), panel.label)
        if panel.abscissa is not None:
            _format_abscissa(axis, *panel.abscissa)
        if panel.legend:
            _add_panel_legend(axis, panel.legend)
    if entries:
        _add_legend(figure, entries)
    disable_math_text(figure)
    return figure


def _format_abscissa(axis: Axes, header: str, vertical: str) -> None:
    """Set label, ticks and scale of an axis that shows the column `header` instead of time."""
    from beamdae.report.pictures.tick_labels import format_ticks

    axis.margins(x=0.05)
    format_ticks(axis.xaxis)
    if axis.get_xscale() == "linear":
        axis.locator_params(axis="x", nbins=_MAX_HORIZONTAL_TICKS)
    axis.set_xlabel(shorten_text(header, MAX_LABEL_LETTERS))
    axis.xaxis.get_offset_text().set_fontsize(9)
    columns = [Header.of(x) for x in (header, vertical)]
    if columns[0].name == columns[1].name and {x.unit for x in columns} == {"m"}:
        axis.set_aspect("equal", adjustable="datalim")


def _add_panel_legend(axis: Axes, labels: Sequence[str]) -> None:
    """Add a legend above the upper right corner of the axes, where it covers no curve."""
    legend = axis.legend(
        axis.lines,
        [""] * len(labels),
        loc="lower right",
        bbox_to_anchor=(1.02, 0.97),
        frameon=False,
        fontsize=8,
        ncols=min(len(labels), _PANEL_LEGEND_COLUMNS),
        handlelength=1.2,
        columnspacing=1.0,
    )
    set_legend_names(legend, [shorten_text(x, _PANEL_LEGEND_LETTERS) for x in labels])


def _add_legend(figure: Figure, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Add a legend below the panels, by which the figure becomes higher."""
    from matplotlib.lines import Line2D

    width = figure.get_figwidth()
    letters = int((width - _LEGEND_LINE_WIDTH) / _LEGEND_LETTER_WIDTH)
    names = [shorten_text(name, min(_LEGEND_ENTRY_LETTERS, letters)) for name in entries]
    widest = _LEGEND_LETTER_WIDTH * max(map(len, names)) + _LEGEND_LINE_WIDTH
    ncols = max(1, min(len(names), int(width / widest)))
    rows = math.ceil(len(names) / ncols)
    figure.set_figheight(figure.get_figheight() + _LEGEND_ROW_HEIGHT * rows)
    legend = figure.legend(
        handles=[Line2D([], [], **style) for style in entries.values()],
        labels=[""] * len(names),
        loc="outside lower center",
        ncols=ncols,
        frameon=False,
        fontsize=8,
        handlelength=3.0,
    )
    set_legend_names(legend, names)


def set_legend_names(legend: Legend, names: Sequence[str]) -> None:
    """Set the texts of a legend.

    On creation, Matplotlib would omit labels with a leading underscore.
    """
    for text, name in zip(legend.get_texts(), names, strict=True):
        text.set_text(name)


def disable_math_text(figure: Figure) -> None:
    """Display dollar signs in titles, labels and legends literally, not as math delimiters."""
    legends = [axis.get_legend() for axis in figure.axes] + figure.legends
    texts = [text for legend in legends if legend is not None for text in legend.get_texts()]
    for axis in figure.axes:
        texts += [axis.title, axis.xaxis.label, axis.yaxis.label]
    for text in [*texts, *figure.texts]:
        text.set_parse_math(False)


def require_picture_path(name: str, path: Any) -> Path:
    """Return the path of a picture.

    Raises
    ------
    BeamdaeError
        If the path is invalid or has no suffix; the message begins with `name`.
    """
    text = path_as_text(path) or ""
    if not (is_valid_path(text) and Path(text).suffix):
        raise BeamdaeError(f"{name}: path must have a suffix such as .png, got {short_repr(path)}.")
    return Path(text)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure to a file and return the path.

    The suffix selects the format; a file without a suffix is written in PNG format. Folders are
    created as needed.

    Raises
    ------
    BeamdaeError
        If the suffix is not supported or the file cannot be written.
    """
    kind = path.suffix.removeprefix(".").lower() or "png"
    if kind not in (supported := figure.canvas.get_supported_filetypes()):
        suffixes = ", ".join(f".{k}" for k in supported)
        raise BeamdaeError(f"{path}: the suffix must be one of {suffixes}.")
    disable_math_text(figure)
    with atomic_write(path) as scratch, warnings.catch_warnings():
        # Characters missing from the font are drawn as boxes; tables show them correctly.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        if kind == "png":
            _write_png(figure, scratch)
        else:
            figure.savefig(scratch, dpi=_RESOLUTION, format=kind)
    return path


def _write_png(figure: Figure, path: Path) -> None:
    """Write a figure as `savefig` does, which draws it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    dpi, canvas = figure.dpi, figure.canvas
    figure.set_dpi(_RESOLUTION)
    try:
        FigureCanvasAgg(figure).print_png(path)
    finally:
        figure.set_dpi(dpi)
        figure.set_canvas(canvas)
