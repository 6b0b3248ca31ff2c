"""Pictures of equilibrium paths: the load factor over what is observed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.pictures.figures import (
    AXIS,
    COLORS,
    add_legend,
    create_panels,
    disable_math_text,
    format_axis,
    mask_huge_values,
    save_figure,
    varying_columns,
)
from beamdae.report.text import shorten_text
from beamdae.results.columns import Header, merge_columns, select_columns
from beamdae.results.displays import Plot
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Of the mechanism, or rad: what a panel has to show.
_STILL = 1e-9
# Marks of an axis, of which numbers of six digits stay apart.
_TICKS = 5
_MARKS = {"limit point": "o", "branch point": "s", "flutter point": "^"}


def save_path_figure(path: Path, found: Equilibrium, title: str) -> Path:
    """Draw the load factor over each observed position, deformation and force.

    Stretches are dashed where the equilibrium is unstable under loads that stay; limit and branch
    points are marked. Of several stages the factors are added.

    Returns
    -------
    Path
        Of the PNG file.
    """
    return save_figure(_figure(found, mask_huge_values(found.columns), title), path)


def plot_path(found: Equilibrium, names: Sequence[str]) -> Plot:
    """The same of some columns by name, for a notebook or a file; see `Equilibrium.plot`."""
    every = merge_columns(found.columns, found.coordinates())
    chosen = (select_columns(every, name, "Equilibrium", found.columns) for name in names)
    headers = dict.fromkeys(header for some in chosen for header in some)
    columns = {h: np.asarray(every[h]) for h in headers} if names else found.columns
    figure = _figure(found, mask_huge_values(columns), "", tuple(headers))
    disable_math_text(figure)
    return Plot(figure)


def _figure(found: Equilibrium, columns: Any, title: str, names: Sequence[str] = ()) -> Figure:
    names = names or [name for name in varying_columns(columns) if _changes(found, name)]
    factors, unstable = found.factors.sum(axis=1), _unstable_stretches(found)
    figure, axes = create_panels(len(names), title)
    for axis, name in zip(axes, names, strict=False):
        values = columns[name]
        for is_unstable, stretch in groupby(range(len(values) - 1), unstable.__getitem__):
            rows = list(stretch)
            part = slice(rows[0], rows[-1] + 2)
            style = (0, (3, 2)) if is_unstable else "-"
            axis.plot(values[part], factors[part], color=COLORS[0], lw=1.2, ls=style)
        for one in found.critical:
            axis.plot(values[one.row], factors[one.row], **_mark(one.kind))
        format_axis(axis, "", "load factor [-]")
        axis.margins(x=0.03)
        axis.locator_params(axis="x", nbins=_TICKS)
        axis.set_xlabel(shorten_text(name, AXIS))
    entries: dict[str, dict[str, Any]] = {
        "stable": {"color": COLORS[0], "ls": "-"},
        "unstable": {"color": COLORS[0], "ls": (0, (3, 2))},
    }
    shown = {"unstable": any(unstable), "stable": not all(unstable)}
    entries = {name: style for name, style in entries.items() if shown[name]}
    for kind in dict.fromkeys(one.kind for one in found.critical):
        entries[kind] = _mark(kind)
    if names:
        add_legend(figure, entries)
    return figure


def _unstable_stretches(found: Equilibrium) -> list[bool]:
    """Whether the path is unstable from each point to the next.

    A critical point is neither; the other end tells, or, between two of them, both.
    """
    unstable = found.unstable != 0
    critical = {one.row for one in found.critical}
    told = []
    for k in range(len(unstable) - 1):
        ends = [row for row in (k, k + 1) if row not in critical] or [k, k + 1]
        told.append(bool(np.any(unstable[ends])))
    return told


def _mark(kind: str) -> dict[str, Any]:
    return {"marker": _MARKS[kind], "color": COLORS[3], "ls": "", "ms": 4}


def _changes(found: Equilibrium, name: str) -> bool:
    """Whether a column is more than what rounding makes of one that stays."""
    size = {"m": found.equations.length, "rad": 1.0}.get(Header.of(name).unit, 0.0)
    return bool(found.loads) and float(np.ptp(found.columns[name])) > _STILL * size


def plot_response(response: FrequencyResponse, column: str) -> Plot:
    """Half the range of an observed column over the parameter; dashed where it is unstable."""
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    values, sizes = response.curve(column)
    stable = np.array([point.stable for point in response.points], bool)
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.add_subplot()
    # A stretch is as stable as its beginning, and reaches to the next.
    cuts = np.flatnonzero(np.diff(stable)) + 1
    for part in np.split(np.arange(len(values)), cuts):
        if len(part):
            own = slice(part[0], part[-1] + 2)
            look = "-" if stable[part[0]] else "--"
            axes.plot(values[own], sizes[own], look, color=COLORS[0], lw=1.6)
    for value, size in response.peaks(column):
        axes.plot(value, size, "o", color=COLORS[1], ms=4)
    axes.set_xlabel(response.parameter)
    unit = Header.of(column).unit if response.points else ""
    axes.set_ylabel(f"{column.removesuffix(f' [{unit}]')}, half range [{unit}]")
    axes.grid(color="0.9", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    disable_math_text(figure)
    return Plot(figure)
