"""Pictures of runs and of what several runs say of the same columns."""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.errors import BeamdaeError
from beamdae.report.text import shorten_text
from beamdae.results.columns import Header, observed_columns
from beamdae.results.storage.files import atomic_write

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

    # By header.
    Columns = Mapping[str, Any] | pd.DataFrame

Array = np.ndarray

# Okabe & Ito's palette, readable with every kind of color vision.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
_PANELS = 12
# What is larger could overflow when the range of an axis is taken.
_HUGE = 1e300
# Letters of a title on one line, of names of panels (beside a legend) and axes, and of entries.
_LINE, _NAME, _BESIDE, AXIS, _ENTRY = 60, 40, 22, 28, 60
# About as wide is a letter of a legend below the panels, and the line beside its name [inches].
_LETTER, _SIGN = 0.075, 0.8


def plot_run(path: Path, table: Columns, title: str) -> Path:
    """Draw the observed positions, deformations and forces over time; rates are left out.

    Parameters
    ----------
    table
        Time, observed columns and the energy ledger, see `Solution.table`.

    Returns
    -------
    Path
        Of the PNG file.
    """
    drawn = mask_huge_values(table)
    groups = _groups(drawn)
    figure, axes = create_panels(len(groups), title, "observables")
    for axis, ((name, unit), columns) in zip(axes, groups.items(), strict=False):
        labels = [column.removesuffix(f" [{unit}]").removeprefix(f"{name}.") for column in columns]
        for column, color in zip(columns, repeat_styles(COLORS), strict=False):
            time, values = drawn[TIME], drawn[column]
            axis.plot(time, values, color=color, lw=1.2, **single_point_marker(time))
        format_axis(axis, shorten_text(name, _BESIDE if len(columns) > 1 else _NAME), f"[{unit}]")
        if len(columns) > 1:
            _legend(axis, labels)
        else:
            label = f"{labels[0]} [{unit}]" if labels[0] != name else f"[{unit}]"
            axis.set_ylabel(shorten_text(label, AXIS))
    return save_figure(figure, path)


def plot_comparison(
    path: Path,
    reference: pd.DataFrame,
    runs: Mapping[str, tuple[pd.DataFrame, pd.DataFrame | None]],
    uncertainty: float,
    title: str,
) -> Path:
    """Draw what several runs say of the same columns, and their errors over time.

    Parameters
    ----------
    reference
        Time and observed columns.
    runs
        By label: the same of each run, and its errors relative to the amplitude over time.
    uncertainty
        Of the reference, in the same measure.
    """
    drawn = mask_huge_values(reference)
    columns = characteristic_columns(drawn)
    errors = {
        label: deviant.max(axis=1) for label, (_, deviant) in runs.items() if deviant is not None
    }
    errors = {label: x.where((x > 0.0) & (x < _HUGE)) for label, x in errors.items()}
    measured = any(x.notna().any() for x in errors.values())
    figure, axes = create_panels(len(columns) + measured, title)
    looks = [
        {"color": c, "ls": d}
        for c, d in zip(repeat_styles(COLORS), repeat_styles(DASHES), strict=False)
    ]
    styles = dict(zip(runs, looks, strict=False))
    for axis, column in zip(axes, columns, strict=False):
        time = drawn[TIME]
        axis.plot(time, drawn[column], color="0.8", lw=5, **single_point_marker(time))
        for label, (curve, _) in runs.items():
            table = mask_huge_values(curve)
            if column in table:
                time = table[TIME]
                axis.plot(time, table[column], lw=1.4, **styles[label], **single_point_marker(time))
        format_axis(axis, "", column)
    if measured:
        _errors(axes[-1], errors, styles, uncertainty)
    entries = {"reference": {"color": "0.8", "lw": 5}} | {x: {"lw": 1.4, **styles[x]} for x in runs}
    add_legend(figure, entries)
    return save_figure(figure, path)


def _errors(
    axis: Axes,
    errors: Mapping[str, pd.Series],
    styles: Mapping[str, dict[str, Any]],
    uncertainty: float,
) -> None:
    """Errors over time, each in the style of its run."""
    for label, error in errors.items():
        axis.plot(error.index, error, lw=1.0, **styles[label], **single_point_marker(error))
    axis.set_yscale("log")
    if 0.0 < uncertainty < _HUGE:
        line = axis.axhline(uncertainty, color="0.4", lw=1.0, ls=":")
        axis.legend([line], ["reference uncertainty"], loc="lower right", frameon=False, fontsize=8)
    format_axis(axis, "", "error / amplitude [-]")


def characteristic_columns(table: Columns) -> list[str]:
    """The columns a comparison is drawn in: a deformation, or else the first motion."""
    groups: dict[str, list[str]] = {}
    for column in varying_columns(table):
        groups.setdefault(Header.of(column).name, []).append(column)
    for columns in groups.values():
        if {Header.of(c).suffix for c in columns} & {"u", "v", "phi"}:
            return columns[:3]
    drawn = [column for columns in groups.values() for column in columns]
    motions = [column for column in drawn if Header.of(column).unit in ("m", "rad")]
    return (motions or drawn)[:3]


def _groups(table: Columns) -> dict[tuple[str, str], list[str]]:
    """Columns that share a panel, by observable and unit."""
    groups: dict[tuple[str, str], list[str]] = {}
    for column in varying_columns(table) or [c for c in map(str, table) if c in LEDGER_COLUMNS]:
        header = Header.of(column)
        groups.setdefault((header.name, header.unit), []).append(column)
    return groups


def varying_columns(table: Columns) -> list[str]:
    """Observed columns that are neither rates nor still, and hold a number that can be drawn."""
    columns = [c for c in observed_columns(table) if not Header.of(c).suffix.endswith("_dot")]
    values = {c: np.asarray(table[c], float) for c in columns}
    columns = [c for c in columns if not np.isnan(values[c]).all()]
    size = {c: float(np.nanmax(values[c]) - np.nanmin(values[c])) for c in columns}
    # A stress in Pa is 1e10 times a way in m: only what has the same unit tells how small is small,
    # and where nothing in a unit moves, what is left of it by rounding.
    largest = {c: max(size[x] for x in columns if _unit(x) == _unit(c)) for c in columns}
    rounding = 1e-15 * max(size.values(), default=0.0)
    return [c for c in columns if size[c] > max(1e-9 * largest[c], rounding)] or columns


def _unit(column: str) -> str:
    return Header.of(column).unit


def mask_huge_values(table: Columns) -> dict[str, Array]:
    """The columns without numbers no axis has a place for."""
    columns = {name: np.asarray(table[name], float) for name in map(str, table)}
    return {name: np.where(np.abs(x) < _HUGE, x, np.nan) for name, x in columns.items()}


def single_point_marker(rows: Sequence[Any] | Array | pd.Series) -> dict[str, Any]:
    """A mark where there is but one row: a line would not be seen."""
    return {"marker": "o", "ms": 4} if len(rows) == 1 else {}


def repeat_styles(styles: Sequence[Any]) -> list[Any]:
    """More styles than anything drawn here has need of."""
    return list(styles) * 8


def create_panels(number: int, title: str, what: str = "columns") -> tuple[Figure, list[Axes]]:
    """A figure with so many axes over time, in two columns; of more it has twelve and says so."""
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    wanted, number = number, min(number, _PANELS)
    columns = 1 if number == 1 else 2
    rows = max(math.ceil(number / columns), 1)
    figure = Figure(figsize=(4.6 * columns + 0.6, 2.3 * rows + 1.2), layout="constrained")
    axes = [figure.add_subplot(rows, columns, k + 1) for k in range(number)]
    for axis in axes[-columns:]:
        axis.set_xlabel("t [s]")
    if not axes:
        figure.text(0.5, 0.4, "there is nothing to draw", ha="center", color="0.4")
    # Not below, where legends are.
    some = [f"{number} of {wanted} {what}"] if wanted > number else []
    figure.suptitle("\n".join(filter(None, [wrap_title(title), *some])), fontsize=11)
    return figure, axes


def wrap_title(title: str, line: int = _LINE) -> str:
    """A title on about two lines; of a longer one the middle is left out."""
    return textwrap.fill(shorten_text(title, 2 * line - 10), line)


def format_axis(axis: Axes, title: str, ylabel: str) -> None:
    """Title, label and grid of an axis."""
    axis.set_title(title, fontsize=10)
    axis.set_ylabel(shorten_text(ylabel, AXIS))
    axis.grid(color="0.9", lw=0.6)
    axis.margins(x=0.0)
    if axis.get_yscale() == "linear":
        axis.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    axis.tick_params(labelsize=9, which="both")
    axis.yaxis.get_offset_text().set_fontsize(9)
    axis.spines[["top", "right"]].set_visible(False)


def _legend(axis: Axes, labels: Sequence[str]) -> None:
    """A legend in the corner above the axes, where no curve runs through it."""
    found = axis.legend(
        axis.lines,
        [""] * len(labels),
        loc="lower right",
        bbox_to_anchor=(1.02, 0.97),
        frameon=False,
        fontsize=8,
        ncols=min(len(labels), 4),
        handlelength=1.2,
        columnspacing=1.0,
    )
    _name(found, [shorten_text(label, 14) for label in labels])


def add_legend(figure: Figure, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """A legend below the panels, of lines in these styles by name, that takes no room from them."""
    from matplotlib.lines import Line2D

    width = figure.get_figwidth()
    most = min(_ENTRY, int((width - _SIGN) / _LETTER))
    names = [shorten_text(name, most) for name in entries]
    widest = _LETTER * max(map(len, names), default=1) + _SIGN
    columns = max(1, min(len(names), int(width / widest)))
    figure.set_figheight(figure.get_figheight() + 0.19 * math.ceil(len(names) / columns))
    found = figure.legend(
        handles=[Line2D([], [], **style) for style in entries.values()],
        labels=[""] * len(names),
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        fontsize=8,
        handlelength=3.0,
    )
    _name(found, names)


def _name(found: Legend, names: Sequence[str]) -> None:
    # Legends leave out what begins with an underscore, if they are given it.
    for text, name in zip(found.get_texts(), names, strict=True):
        text.set_text(name)


def disable_math_text(figure: Figure) -> None:
    """Names are no formulas: a dollar sign in them is one."""
    legends = [axis.get_legend() for axis in figure.axes] + figure.legends
    texts = [text for found in legends if found is not None for text in found.get_texts()]
    for axis in figure.axes:
        texts += [axis.title, axis.xaxis.label, axis.yaxis.label]
    for text in [*texts, *figure.texts]:
        text.set_parse_math(False)


def save_figure(figure: Figure, path: Path) -> Path:
    """Save a picture, names in it drawn as they are written; the folder is made if need be."""
    kind = path.suffix.removeprefix(".").lower() or "png"
    if kind not in (known := figure.canvas.get_supported_filetypes()):
        raise BeamdaeError(f"path {path} must end in one of {', '.join(f'.{k}' for k in known)}.")
    disable_math_text(figure)
    with atomic_write(path) as scratch, warnings.catch_warnings():
        # A name in a script the font lacks is drawn as boxes; the tables have it right.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(scratch, dpi=150, format=kind)
    return path
