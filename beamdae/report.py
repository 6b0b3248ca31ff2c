"""Tables for the terminal and pictures for the page, from the tables of solutions and studies."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich import box
from rich.table import Table

from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe & Ito's palette, readable with every kind of color vision.
COLORS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#000000")
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
_PANELS = 12
# Values this small beside the largest in their unit are what rounding leaves of zero.
_ROUNDING = 1e-12

# Header in the terminal by column of a comparison.
_COMPARED = {
    "status": "status",
    "wall time [s]": "wall\n[s]",
    "steps": "steps",
    "rejected steps": "rejected",
    "residual calls": "residual\ncalls",
    "Jacobian calls": "Jacobian\ncalls",
    "error [-]": "error\n[-]",
    "max position drift": "position\ndrift",
    "max velocity drift": "velocity\ndrift",
    "energy imbalance [-]": "energy\nimbalance",
}


def number(value: Any, digits: int = 3) -> str:
    """A number in few characters; a dash for one that is not there."""
    if value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, (bool, str)):
        return str(value)
    if isinstance(value, (int, np.integer)):
        return f"{value:d}"
    return f"{float(value):.{digits}g}"


def facts(title: str, rows: Mapping[str, Any]) -> Table:
    """Two columns: what, and how much."""
    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=None,
        show_header=False,
        pad_edge=False,
    )
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, value if isinstance(value, str) else number(value))
    return table


def run_facts(summary: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, str]:
    """What a run did and how well, from `Solution.summary()` and `Solution.integrator`."""
    s = {name: number(value) for name, value in summary.items()}
    shown = {k: v for k, v in settings.items() if v is not None and k != "integrator"}
    return {
        "status": str(s["status"]),
        "time reached": f"{number(summary['last_time'], 6)} s",
        "integrator": f"{settings.get('integrator', '')} "
        + ", ".join(f"{name}={number(value)}" for name, value in shown.items()),
        "steps": f"{s['steps']}, {s['rejected_steps']} rejected, "
        f"{s['newton_failures']} Newton failures",
        "calls": f"{s['residual_calls']} residual, {s['jacobian_calls']} Jacobian, "
        f"{s['factorizations']} factorizations",
        "wall time": f"{s['wall_time']} s, and {s['setup_time']} s to build",
        "drift": f"{s['max_position_drift']} in positions, {s['max_velocity_drift']} in velocities",
        "residual": f"{s['max_residual']} of the largest force",
        "energy imbalance": f"{s['energy_imbalance']} of the energy turned over",
    }


def mesh_facts(beam: str, length: float, curvature: float) -> dict[str, Any]:
    """How well the elements of a beam follow its curve."""
    return {
        f"mesh of {beam}": f"arc length within {number(length)} (relative), "
        f"curvature times length within {number(curvature)}"
    }


def ranges(observed: pd.DataFrame) -> Table:
    """Smallest, largest and last value of each observed column."""
    table = _table("observed", "min", "max", "end")
    largest: dict[str, float] = {}
    for name in map(str, observed):
        unit = _split(name)[2]
        largest[unit] = max(largest.get(unit, 0.0), float(observed[name].abs().max()))
    for name in map(str, observed):
        values, rounding = observed[name], _ROUNDING * largest[_split(name)[2]]
        row = (float(x) for x in (values.min(), values.max(), values.iloc[-1]))
        table.add_row(name, *(number(0.0 if abs(x) < rounding else x, 5) for x in row))
    return table


def comparison_table(table: pd.DataFrame) -> Table:
    """The table of a study, with a mark on errors that the reference cannot resolve."""
    shown = [name for name in _COMPARED if name in table]
    result = _table("integrator", *(_COMPARED[name] for name in shown))
    for _, row in table.iterrows():
        cells = {name: number(row[name]) for name in shown}
        if row.get("below resolution", False):
            cells["error [-]"] = f"< {number(10.0 * row['reference uncertainty [-]'])}"
        # The sentence of a failure is too long for a cell, it follows below the table.
        cells["status"] = "ok" if row["status"] == "ok" else "failed"
        result.add_row(row["label"], *cells.values())
    return result


def failures(table: pd.DataFrame) -> list[str]:
    """A sentence for each row of a study that did not reach its end."""
    failed = table[table["status"] != "ok"]
    where = failed["group"] + ", " + failed["label"]
    return [f"{i}: {s}" for i, s in zip(where, failed["status"], strict=True)]


def listing(headers: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of texts, folded where they are long."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for header in headers:
        table.add_column(header, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def _table(first: str, *headers: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, overflow="fold")
    for header in headers:
        table.add_column(header, justify="right", no_wrap=True)
    return table


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
        groups.setdefault(_split(column)[0], []).append(column)
    for columns in groups.values():
        if {_split(c)[1] for c in columns} & {"u", "v", "phi"}:
            return columns[:3]
    motions = [c for columns in groups.values() for c in columns if c.endswith(("[m]", "[rad]"))]
    return (motions or [c for columns in groups.values() for c in columns])[:3]


def _groups(table: pd.DataFrame) -> dict[tuple[str, str], list[str]]:
    """Columns that share a panel, by observable and unit."""
    groups: dict[tuple[str, str], list[str]] = {}
    for column in _moving(table) or [c for c in map(str, table) if c.startswith("energy.")]:
        name, _, unit = _split(column)
        groups.setdefault((name, unit), []).append(column)
    return dict(list(groups.items())[:_PANELS])


def _moving(table: pd.DataFrame) -> list[str]:
    """Observed columns that are neither rates nor still."""
    columns = [
        c for c in map(str, table) if not c.startswith(("t [", "energy.")) and "_dot [" not in c
    ]
    size = {c: float(np.ptp(table[c].to_numpy())) for c in columns}
    largest = max(size.values(), default=0.0)
    return [c for c in columns if size[c] > 1e-9 * largest] or columns


def _split(column: str) -> tuple[str, str, str]:
    """Observable, suffix and unit of a header 'name.suffix [unit]'."""
    name, unit = column.removesuffix("]").rsplit(" [", 1)
    name, _, suffix = name.rpartition(".")
    return name or suffix, suffix, unit


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
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with warnings.catch_warnings():
            # A name in a script the font lacks is drawn as boxes; the tables have it right.
            warnings.filterwarnings("ignore", message="Glyph .* missing from")
            figure.savefig(path, dpi=150)
    except OSError as problem:
        raise BeamdaeError(f"{path}: it cannot be written, {problem.strerror}.") from problem
    return path
