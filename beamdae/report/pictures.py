"""Pictures of runs and of what several runs say of the same columns."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import LEDGER_COLUMNS
from beamdae.results.files import replacing
from beamdae.results.headers import Header, observed_columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe & Ito's palette, readable with every kind of color vision.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
_PANELS = 12


def picture_of_run(path: Path, table: pd.DataFrame, title: str) -> Path:
    """Draw the observed positions, deformations and forces over time; rates are left out.

    Parameters
    ----------
    table
        `Solution.table()`.

    Returns
    -------
    Path
        Of the PNG file.
    """
    groups = _groups(table)
    figure, axes = _figure(len(groups), title)
    for axis, ((name, unit), columns) in zip(axes, groups.items(), strict=True):
        for column, color in zip(columns, _repeated(COLORS), strict=False):
            label = column.removesuffix(f" [{unit}]").removeprefix(f"{name}.")
            axis.plot(table["t [s]"], table[column], color=color, lw=1.2, label=label)
        _dress(axis, name, f"[{unit}]")
        if len(columns) > 1:
            _legend(axis, len(columns))
        else:
            axis.set_ylabel(f"{label} [{unit}]" if label != name else f"[{unit}]")
    return saved(figure, path)


def picture_of_comparison(
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
    columns = characteristic_columns(reference)
    figure, axes = _figure(len(columns) + 1, title)
    styles = [
        {"color": c, "ls": d, "lw": 1.4}
        for c, d in zip(_repeated(COLORS), _repeated(_DASHES), strict=False)
    ]
    for axis, column in zip(axes, columns, strict=False):
        axis.plot(reference["t [s]"], reference[column], color="0.8", lw=5, label="reference")
        for (label, (curve, _)), style in zip(runs.items(), styles, strict=False):
            axis.plot(curve["t [s]"], curve[column], label=label, **style)
        _dress(axis, "", column)
    error = axes[-1]
    for (_, deviant), style in zip(runs.values(), styles, strict=False):
        if deviant is None:
            continue
        largest = deviant.max(axis=1)
        error.plot(largest.index, largest.where(largest > 0.0), **{**style, "ls": "-", "lw": 1.0})
    error.set_yscale("log")
    if uncertainty > 0.0:
        error.axhline(uncertainty, color="0.4", lw=1.0, ls=":", label="reference uncertainty")
        error.legend(loc="lower right", frameon=False, fontsize=8)
    _dress(error, "", "error / amplitude [-]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return saved(figure, path)


def characteristic_columns(table: pd.DataFrame) -> list[str]:
    """The columns a comparison is drawn in: a deformation, or else the first motion."""
    groups: dict[str, list[str]] = {}
    for column in _moving(table):
        groups.setdefault(Header.of(column).name, []).append(column)
    for columns in groups.values():
        if {Header.of(c).suffix for c in columns} & {"u", "v", "phi"}:
            return columns[:3]
    moving = [column for columns in groups.values() for column in columns]
    motions = [column for column in moving if Header.of(column).unit in ("m", "rad")]
    return (motions or moving)[:3]


def _groups(table: pd.DataFrame) -> dict[tuple[str, str], list[str]]:
    """Columns that share a panel, by observable and unit."""
    groups: dict[tuple[str, str], list[str]] = {}
    for column in _moving(table) or [c for c in map(str, table) if c in LEDGER_COLUMNS]:
        header = Header.of(column)
        groups.setdefault((header.name, header.unit), []).append(column)
    return dict(list(groups.items())[:_PANELS])


def _moving(table: pd.DataFrame) -> list[str]:
    """Observed columns that are neither rates nor still."""
    columns = [c for c in observed_columns(table) if not Header.of(c).suffix.endswith("_dot")]
    size = {c: float(np.ptp(table[c].to_numpy())) for c in columns}
    largest = max(size.values(), default=0.0)
    return [c for c in columns if size[c] > 1e-9 * largest] or columns


def _repeated(styles: Sequence[Any]) -> list[Any]:
    return list(styles) * 8


def _figure(panels: int, title: str) -> tuple[Figure, list[Axes]]:
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    columns = 1 if panels == 1 else 2
    rows = max(math.ceil(panels / columns), 1)
    figure = Figure(figsize=(4.6 * columns + 0.6, 2.3 * rows + 1.2), layout="constrained")
    axes = [figure.add_subplot(rows, columns, k + 1) for k in range(panels)]
    for axis in axes[-columns:]:
        axis.set_xlabel("t [s]")
    figure.suptitle(title, fontsize=11)
    return figure, axes


def _dress(axis: Axes, title: str, ylabel: str) -> None:
    axis.set_title(title, fontsize=10)
    axis.set_ylabel(ylabel)
    axis.grid(color="0.9", lw=0.6)
    axis.margins(x=0.0)
    if axis.get_yscale() == "linear":
        axis.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    axis.tick_params(labelsize=9)
    axis.spines[["top", "right"]].set_visible(False)


def _legend(axis: Axes, columns: int) -> None:
    """A legend in the corner above the axes, where no curve runs through it."""
    axis.legend(
        loc="lower right",
        bbox_to_anchor=(1.02, 0.97),
        frameon=False,
        fontsize=8,
        ncols=columns,
        handlelength=1.2,
        columnspacing=1.0,
    )


def _as_written(figure: Figure) -> None:
    """Names are no formulas: a dollar sign in them is one."""
    legends = [axis.get_legend() for axis in figure.axes] + figure.legends
    texts = [text for legend in legends if legend is not None for text in legend.get_texts()]
    texts += [text for axis in figure.axes for text in (axis.title, axis.yaxis.label)]
    for text in texts:
        text.set_parse_math(False)


def saved(figure: Figure, path: Path) -> Path:
    """Save a picture, names in it drawn as they are written; the folder is made if need be."""
    _as_written(figure)
    with replacing(path) as scratch, warnings.catch_warnings():
        # A name in a script the font lacks is drawn as boxes; the tables have it right.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        figure.savefig(scratch, dpi=150, format=path.suffix.removeprefix(".") or "png")
    return path
