"""Plots of equilibrium paths and of frequency responses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.report.pictures.figures import (
    COLORS,
    Panel,
    draw_panels,
    select_default,
)
from beamdae.results.columns import (
    Header,
    merge_columns,
    require_one_column,
    select_column,
    select_columns,
)
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray

# Columns with smaller ranges are not plotted; relative to the length of the mechanism, or in rad.
_MIN_RANGE = 1e-9
_PEAK = {"color": COLORS[1], "ls": "", "marker": "o", "ms": 4}
_UNSTABLE_DASHES = (0, (3, 2))
_MARKERS = {"limit point": "o", "branch point": "s", "flutter point": "^", "stopped": "x"}


def create_path_figure(
    equilibrium: Equilibrium, title: str, names: Sequence[str], x: str | None
) -> Figure:
    """Plot the load factor over columns, or columns over the column `x`; see `Equilibrium.plot`.

    Without names, the columns are up to six that vary; if only `x` varies, the load
    factor is plotted over it. The path is dashed where it is unstable.
    """
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
        observed = equilibrium.columns.items()
        varying = {c: y for c, y in observed if c != abscissa and _is_varying(equilibrium, c)}
        chosen = select_default(varying)
    if not chosen and abscissa is not None:
        chosen, abscissa = [abscissa], None
    columns = {**columns, header: factors}
    is_unstable = _find_unstable_segments(equilibrium)
    stable, unstable = ({"color": COLORS[0], "lw": 1.2, "ls": x} for x in ("-", _UNSTABLE_DASHES))
    entries: dict[str, dict[str, Any]] = {} if all(is_unstable) else {"stable": stable}
    entries |= {"unstable": unstable} if any(is_unstable) else {}
    marks = mark_rows(equilibrium)
    for kind in marks.values():
        entries[kind] = {"marker": _MARKERS[kind], "color": COLORS[3], "ls": "", "ms": 4}
    panels = []
    for name in chosen:
        horizontal, vertical = (name, header) if abscissa is None else (abscissa, name)
        u, v = (np.asarray(columns[c]) for c in (horizontal, vertical))
        lines = []
        for dashed, segments in groupby(range(len(u) - 1), is_unstable.__getitem__):
            rows = list(segments)
            part = slice(rows[0], rows[-1] + 2)
            lines.append((u[part], v[part], unstable if dashed else stable))
        lines += [(u[[row]], v[[row]], entries[kind]) for row, kind in marks.items()]
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


def mark_rows(equilibrium: Equilibrium) -> dict[int, str]:
    """Return the kinds of the critical points, and "stopped" where a path ended early, by row."""
    is_complete = equilibrium.status.success
    stop = {} if is_complete else {len(equilibrium.factors) - 1: "stopped"}
    return stop | {point.row: point.kind for point in equilibrium.critical}


def _is_varying(equilibrium: Equilibrium, column: str) -> bool:
    """Return True if loads or a quantity vary and a column varies by more than rounding noise."""
    sizes = {"m": equilibrium.equations.length, "rad": 1.0}
    limit = _MIN_RANGE * sizes.get(Header.of(column).unit, 0.0)
    is_path = bool(equilibrium.loads or equilibrium.over)
    return is_path and float(np.ptp(equilibrium.columns[column])) > limit


def create_critical_loads_figure(result: Boundary | KnockDown, title: str = "") -> Figure:
    """Plot critical load factors over the parameter or over the amplitude of the imperfection."""
    table = result.table()
    name, factor = map(str, table.columns[:2])
    looks = {"marker": "o", "ms": 3} if isinstance(result, KnockDown) else {}
    style = {"color": COLORS[0], "lw": 1.6, **looks}
    lines: list[tuple[Any, Any, dict[str, Any]]] = [(table[name], table[factor], style)]
    special = result.special if isinstance(result, Boundary) else ()
    lines += [([x.value], [x.factor], _PEAK) for x in special]
    return draw_panels([Panel("", factor, lines, (name, factor))], title, x_label=None)


def create_response_figure(
    response: FrequencyResponse, title: str, names: Sequence[str] = (), x: str | None = None
) -> Figure | None:
    """Plot half ranges of observed columns over the parameter or over that of another column.

    Without names, the columns are up to six that vary. See `FrequencyResponse.plot`.
    """
    if not response.points:
        return None
    if not names:
        curves = {c: response.curve(c)[1] for c in response.points[0].solution.columns}
        moving = {c: y for c, y in curves.items() if c not in response.resting_columns}
        names = select_default(moving or curves)
    panels = [_create_response_panel(response, name, x) for name in names]
    return draw_panels(panels, title, x_label=None)


def _create_response_panel(response: FrequencyResponse, column: str, x: str | None) -> Panel:
    values, amplitudes = response.curve(column)
    horizontal, vertical = response.label, _label_half_range(response, column)
    if x is not None:
        _, values = response.curve(x)
        horizontal = _label_half_range(response, x)
    is_stable = np.array([point.stable for point in response.points], bool)
    lines: list[tuple[Any, Any, dict[str, Any]]] = []
    # Each line has the stability of its first point and extends to the start of the next line.
    for rows in np.split(np.arange(len(values)), np.flatnonzero(np.diff(is_stable)) + 1):
        if len(rows):
            points = slice(rows[0], rows[-1] + 2)
            dashes = "-" if is_stable[rows[0]] else "--"
            style = {"color": COLORS[0], "lw": 1.6, "ls": dashes}
            lines.append((values[points], amplitudes[points], style))
    peaks = response.peaks(column) if x is None else ()
    lines += [([value], [amplitude], _PEAK) for value, amplitude in peaks]
    return Panel("", vertical, lines, (horizontal, vertical))


def _label_half_range(response: FrequencyResponse, name: str) -> str:
    header = select_column("frequency_response", response.points[0].solution.columns, name)
    unit = Header.of(header).unit
    return f"{header.removesuffix(f' [{unit}]')}, half range [{unit}]"
