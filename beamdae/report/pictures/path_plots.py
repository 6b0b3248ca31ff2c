"""Plots of equilibrium paths and of frequency responses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.report.pictures.figures import (
    COLORS,
    Panel,
    create_panels,
    disable_math_text,
    draw_grid,
    draw_panels,
    mask_huge_values,
    save_figure,
    varying_columns,
)
from beamdae.results.columns import (
    Header,
    merge_columns,
    require_one_column,
    select_column,
    select_columns,
)
from beamdae.results.displays import Plot
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray

# Columns with smaller ranges are not plotted; relative to the length of the mechanism, or in rad.
_MIN_RANGE = 1e-9
# Largest magnitudes are drawn if they are within these multiples of the half ranges: about equal
# ones look the same, and those of columns with a large mean hide the response.
_MIN_MAGNITUDE_RATIO, _MAX_MAGNITUDE_RATIO = 1.02, 3.0
_UNSTABLE_DASHES = (0, (3, 2))
_CRITICAL_MARKERS = {"limit point": "o", "branch point": "s", "flutter point": "^"}


def save_path_figure(
    path: Path,
    equilibrium: Equilibrium,
    title: str,
    names: Sequence[str] = (),
    x: str | None = None,
) -> Path:
    """Plot the load factor over columns, or columns over the column `x`, and write the figure.

    Without names, the columns are the observed ones that vary, except rates; if only `x` varies,
    the load factor is plotted over it. The suffix of `path` selects the image format. Lines are
    dashed where the equilibrium under constant loads is unstable or its stability is unknown, and
    limit, branch and flutter points are marked. If the path has several stages, their load factors
    are added.

    Returns
    -------
    Path
        Path of the image file.
    """
    return save_figure(_create_path_figure(equilibrium, title, names, x), path)


def plot_path(equilibrium: Equilibrium, names: Sequence[str], x: str | None = None) -> Plot:
    """Plot the load factor over the named columns, or these over `x`; see `Equilibrium.plot`."""
    return Plot(_create_path_figure(equilibrium, "", names, x))


def _create_path_figure(
    equilibrium: Equilibrium, title: str, names: Sequence[str], x: str | None
) -> Figure:
    columns = merge_columns(equilibrium.columns, equilibrium.coordinate_columns())
    factors, over, header = equilibrium.factors.sum(axis=1), equilibrium.over, equilibrium.header

    def select(name: str) -> list[str]:
        return select_columns(columns, name, "Equilibrium", equilibrium.columns)

    abscissa = over or None
    if x is not None:
        abscissa = require_one_column("Equilibrium.plot", x, select(x))
    chosen = list(dict.fromkeys(header for name in names for header in select(name)))
    # The name of an observable selects the abscissa, too.
    chosen = [c for c in chosen if x is None or c != abscissa] or chosen
    if not chosen:
        observed = mask_huge_values(equilibrium.columns)
        chosen = [c for c in varying_columns(observed) if _is_varying(equilibrium, c)]
        chosen = [c for c in chosen if c != abscissa]
    if not chosen and abscissa is not None:
        chosen, abscissa = [abscissa], None
    columns = {**columns, header: factors}
    is_unstable = _find_unstable_segments(equilibrium)
    stable, unstable = ({"color": COLORS[0], "lw": 1.2, "ls": x} for x in ("-", _UNSTABLE_DASHES))
    entries: dict[str, dict[str, Any]] = {} if all(is_unstable) else {"stable": stable}
    entries |= {"unstable": unstable} if any(is_unstable) else {}
    for point in equilibrium.critical:
        entries.setdefault(point.kind, _marker_style(point.kind))
    panels = []
    for name in chosen:
        horizontal, vertical = (name, header) if abscissa is None else (abscissa, name)
        u, v = (np.asarray(columns[c]) for c in (horizontal, vertical))
        lines = []
        for dashed, segments in groupby(range(len(u) - 1), is_unstable.__getitem__):
            rows = list(segments)
            part = slice(rows[0], rows[-1] + 2)
            lines.append((u[part], v[part], unstable if dashed else stable))
        lines += [(u[[x.row]], v[[x.row]], entries[x.kind]) for x in equilibrium.critical]
        panels.append(Panel("", vertical, lines, (horizontal, vertical)))
    return draw_panels(panels, title, entries if panels else {}, x_label=None)


def _find_unstable_segments(equilibrium: Equilibrium) -> list[bool]:
    """Return one boolean per segment between neighboring points: True if drawn as unstable.

    A segment is drawn as unstable if one of its ends is not known to be stable. Critical points,
    which are neither stable nor unstable, are ignored unless both ends are critical.
    """
    unstable = equilibrium.unstable != 0
    critical = {point.row for point in equilibrium.critical}
    segments = []
    for k in range(len(unstable) - 1):
        ends = [row for row in (k, k + 1) if row not in critical] or [k, k + 1]
        segments.append(bool(np.any(unstable[ends])))
    return segments


def _marker_style(kind: str) -> dict[str, Any]:
    return {"marker": _CRITICAL_MARKERS[kind], "color": COLORS[3], "ls": "", "ms": 4}


def _is_varying(equilibrium: Equilibrium, column: str) -> bool:
    """Return True if loads or a quantity vary and a column varies by more than rounding noise."""
    sizes = {"m": equilibrium.equations.length, "rad": 1.0}
    limit = _MIN_RANGE * sizes.get(Header.of(column).unit, 0.0)
    is_path = bool(equilibrium.loads or equilibrium.over)
    return is_path and float(np.ptp(equilibrium.columns[column])) > limit


def plot_critical_loads(result: Boundary | KnockDown) -> Plot:
    """Plot critical load factors over the parameter or over the amplitude of the imperfection."""
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    table = result.table()
    name, factor = map(str, table.columns[:2])
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axis = figure.add_subplot()
    style: dict[str, Any] = {"marker": "o", "ms": 3} if isinstance(result, KnockDown) else {}
    axis.plot(table[name], table[factor], color=COLORS[0], lw=1.6, **style)
    for point in result.special if isinstance(result, Boundary) else ():
        axis.plot(point.value, point.factor, "o", color=COLORS[1], ms=5)
    axis.set_xlabel(name)
    axis.set_ylabel(factor)
    draw_grid(axis)
    disable_math_text(figure)
    return Plot(figure)


def plot_response(response: FrequencyResponse, column: str, x: str | None = None) -> Plot:
    """Plot the half range of a column over the parameter or over that of another column.

    Unstable parts are dashed.
    """
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    _draw_response(figure.add_subplot(), response, column, x)
    disable_math_text(figure)
    return Plot(figure)


def create_response_figure(
    response: FrequencyResponse, title: str, names: Sequence[str] = ()
) -> Figure:
    """Plot half ranges of observed columns over the parameter.

    Without names, these are the columns that vary, except rates and columns at rest. Unstable
    parts are dashed, and peaks are marked.
    """
    if not names:
        curves = {c: response.curve(c)[1] for c in response.points[0].solution.columns}
        names = varying_columns(mask_huge_values(curves))
        names = [x for x in names if x not in response.resting_columns] or names
    figure, axes = create_panels(len(names), title, x_label=None)
    for axis, name in zip(axes, names, strict=False):
        _draw_response(axis, response, name)
    return figure


def _draw_response(
    axis: Axes, response: FrequencyResponse, column: str, x: str | None = None
) -> None:
    values, amplitudes = response.curve(column)
    horizontal = response.label
    if x is not None:
        _, values = response.curve(x)
        horizontal = _label_half_range(response, x)
    vertical = _label_half_range(response, column)
    is_stable = np.array([point.stable for point in response.points], bool)
    # Each line has the stability of its first point and extends to the start of the next line.
    changes = np.flatnonzero(np.diff(is_stable)) + 1
    for rows in np.split(np.arange(len(values)), changes):
        if len(rows):
            points = slice(rows[0], rows[-1] + 2)
            dashes = "-" if is_stable[rows[0]] else "--"
            axis.plot(values[points], amplitudes[points], dashes, color=COLORS[0], lw=1.6)
    _draw_magnitudes(axis, response, column, values, amplitudes)
    for value, amplitude in response.peaks(column) if x is None else ():
        axis.plot(value, amplitude, "o", color=COLORS[1], ms=4)
    axis.set_xlabel(horizontal)
    axis.set_ylabel(vertical)
    draw_grid(axis)


def _draw_magnitudes(
    axis: Axes, response: FrequencyResponse, column: str, values: Array, amplitudes: Array
) -> None:
    """Draw largest magnitudes where they differ from half ranges but have their size.

    Those of positions and angles depend on the origin.
    """
    if not response.points:
        return
    header = select_column("frequency_response", response.points[0].solution.columns, column)
    if Header.of(header).unit in ("m", "rad"):
        return
    magnitudes = response._largest_magnitudes(header)
    ratio = magnitudes.max() / (amplitudes.max() or np.inf)
    if _MIN_MAGNITUDE_RATIO < ratio < _MAX_MAGNITUDE_RATIO:
        axis.plot(values, magnitudes, ":", color=COLORS[2], lw=1.6, label="largest magnitude")
        axis.legend(frameon=False)


def _label_half_range(response: FrequencyResponse, name: str) -> str:
    if not response.points:
        return f"{name}, half range"
    header = select_column("frequency_response", response.points[0].solution.columns, name)
    unit = Header.of(header).unit
    return f"{header.removesuffix(f' [{unit}]')}, half range [{unit}]"
