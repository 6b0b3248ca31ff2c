"""Plots of equilibrium paths, responses, Bode diagrams, fits and section forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.analysis.linear_dynamics.bode_diagram import Bode
from beamdae.analysis.statics.boundary import Boundary
from beamdae.analysis.statics.imperfections import KnockDown
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_choice,
    require_finite,
)
from beamdae.report.pictures.figures import (
    COLORS,
    Panel,
    disable_math_text,
    draw_grid,
    draw_panels,
    select_default,
    wrap_title,
)
from beamdae.report.pictures.tick_labels import format_ticks
from beamdae.results.columns import (
    Header,
    merge_columns,
    remove_unit,
    require_one_column,
    select_column,
    select_columns,
)
from beamdae.results.displays import Plot
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.frequency_response import FrequencyResponse
from beamdae.results.section_forces.section_forces import SECTION_FORCE_HEADERS, SectionForces

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from beamdae.analysis.fit.profile import ProfileLikelihood
    from beamdae.analysis.fit.result import Fit

Array = np.ndarray

# Columns with smaller ranges are not plotted; relative to the length of the mechanism, or in rad.
_MIN_RANGE = 1e-9
_PEAK = {"color": COLORS[1], "ls": "", "marker": "o", "ms": 4}
_UNSTABLE_DASHES = (0, (3, 2))
_MARKERS = {"limit point": "o", "branch point": "s", "flutter point": "^", "stopped": "x"}
_PHASE_STEPS = [1.0, 1.5, 3.0, 4.5, 9.0, 10.0]  # of ticks; 4.5 is that of 45 degrees
# Least ranges of axes.
_MIN_MAGNITUDE_RATIO, _MIN_PHASE_RANGE = 10.0, 20.0
_PROFILE_SIZE = (5.6, 3.6)  # [inch]
# Standard deviations between which 95 % of the residuals of a right model are.
_BAND = 1.96
# Largest distance of a requested time from the nearest row, relative to the mean row spacing. With
# equally spaced rows, all times between the first and the last row are accepted.
_MAX_TIME_DISTANCE = 0.51
_TIME_ROUNDING = 1e-12


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
    # Segments are drawn as unstable if one of their ends is not known to be stable. Critical
    # points, which are neither stable nor unstable, are ignored unless both ends are critical.
    is_known = ~np.isin(np.arange(len(factors)), [point.row for point in equilibrium.critical])
    is_unstable = []
    for k in range(max(len(factors) - 1, 1)):
        ends, known = equilibrium.unstable[k : k + 2] != 0, is_known[k : k + 2]
        is_unstable.append(bool(np.any(ends[known] if known.any() else ends)))
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
        lines = _split_by_stability(u, v, is_unstable, (stable, unstable))
        lines += [(u[[row]], v[[row]], entries[kind]) for row, kind in marks.items()]
        panels.append(Panel("", vertical, lines, (horizontal, vertical)))
    return draw_panels(panels, title, entries if panels else {}, x_label=None)


def _split_by_stability(
    u: Array, v: Array, is_unstable: Sequence[bool], styles: Sequence[Mapping[str, Any]]
) -> list[tuple[Any, Any, Mapping[str, Any]]]:
    """Return a curve as lines whose segments are all stable or all unstable.

    `is_unstable` has one entry per segment, and `styles` are those of stable and unstable lines.
    """
    lines = []
    for unstable, segments in groupby(range(max(len(u) - 1, 1)), is_unstable.__getitem__):
        rows = list(segments)
        part = slice(rows[0], rows[-1] + 2)
        lines.append((u[part], v[part], styles[unstable]))
    return lines


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
    styles = [{"color": COLORS[0], "lw": 1.6, "ls": dashes} for dashes in ("-", "--")]
    # A segment has the stability of its first point.
    is_unstable = [not point.stable for point in response.points]
    lines = _split_by_stability(values, amplitudes, is_unstable, styles)
    peaks = response.peaks(column) if x is None else ()
    lines += [([value], [amplitude], _PEAK) for value, amplitude in peaks]
    return Panel("", vertical, lines, (horizontal, vertical))


def _label_half_range(response: FrequencyResponse, name: str) -> str:
    header = select_column("frequency_response", response.points[0].solution.columns, name)
    unit = Header.of(header).unit
    return f"{header.removesuffix(f' [{unit}]')}, half range [{unit}]"


def create_bode_figure(diagram: Bode, title: str = "") -> Figure:
    """Draw the magnitudes on the left and the phases on the right, one transfer function a row.

    Transfer functions that are zero but for rounding errors are omitted.
    """
    model, panels = diagram.model, []
    style = {"color": COLORS[0], "lw": 1.2}
    for x in diagram.transfer_functions:
        if not x.is_noise:
            name = x.name.replace(f" [{model.outputs[x.output].unit}]", "", 1)
            name = name.removesuffix(f" [{model.inputs[x.input].unit}]")
            size, phase = ((diagram.frequencies, y, style) for y in (np.abs(x.response), x.phase))
            panels.append(Panel(name, f"magnitude [{x.unit}]", [size], scales=("log", "log")))
            panels.append(Panel(name, "phase [deg]", [phase], scales=("log", "linear")))
    figure = draw_panels(panels, title, what="panels", x_label="frequency [Hz]")
    for axis in figure.axes:
        format_ticks(axis.xaxis)
    for upper, lower in zip(figure.axes[::2], figure.axes[1::2], strict=True):
        lower.locator_params(axis="y", steps=_PHASE_STEPS)
        _widen_ranges(upper, lower)
    return figure


def _widen_ranges(magnitude: Axes, phase: Axes) -> None:
    """Show at least a decade of magnitudes and 20 degrees, so that constants are drawn as such."""
    least, most = magnitude.get_ylim()
    if most < _MIN_MAGNITUDE_RATIO * least:
        center, factor = np.sqrt(least * most), np.sqrt(_MIN_MAGNITUDE_RATIO)
        magnitude.set_ylim(center / factor, center * factor)
    least, most = phase.get_ylim()
    if most - least < _MIN_PHASE_RANGE:
        center = 0.5 * (least + most)
        phase.set_ylim(center - 0.5 * _MIN_PHASE_RANGE, center + 0.5 * _MIN_PHASE_RANGE)


def create_fit_figure(fit: Fit, title: str = "") -> Figure:
    """Plot data and model, and the residuals in standard deviations; see `Fit.plot`."""
    data: dict[str, Any] = {"color": COLORS[0], "ls": "", "marker": "o", "ms": 2.5}
    model: dict[str, Any] = {"color": COLORS[3], "lw": 1.2}
    band = {"color": "0.6", "lw": 1.0, "ls": "--"}
    panels = []
    table = fit.residual_table()
    for (experiment, column), rows in table.groupby(["experiment", "observable"], sort=False):
        time = rows["t [s]"].to_numpy()
        name, unit = remove_unit(str(column)), Header.of(str(column)).unit
        label = f"{name} in {experiment}" if experiment else name
        curves = [(time, rows["model"], model), (time, rows["value"], data)]
        limits = [(time[[0, -1]], np.full(2, x), band) for x in (-_BAND, _BAND)]
        residuals = [*limits, (time, rows["residual"], data)]
        panels += [Panel(label, f"[{unit}]", curves)]
        panels += [Panel(f"residuals of {label}", "[sigma]", residuals)]
    entries = {"data": data, "model": model, "95 % of residuals": band}
    return draw_panels(panels, title, entries)


def create_profile_figure(profile: ProfileLikelihood, title: str = "") -> Figure:
    """Plot the increase of the sum of squares over the parameter; see `ProfileLikelihood.plot`."""
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    figure = Figure(figsize=_PROFILE_SIZE, layout="constrained")
    axis = figure.add_subplot()
    axis.plot(profile.values, profile.increases, "o-", color=COLORS[0], lw=1.4, ms=3)
    axis.axhline(profile.threshold, color="0.5", lw=1.0, ls="--")
    for limit in profile.interval:
        if np.isfinite(limit):
            axis.axvline(limit, color=COLORS[1], lw=1.0)
    axis.set_xlabel(profile.name)
    axis.set_ylabel("increase of chi-square")
    draw_grid(axis)
    disable_math_text(figure)
    return figure


def plot_section_diagram(forces: SectionForces, what: str = "M", t: float | None = None) -> Plot:
    """Plot N, Q or M of a beam over its arc length; see `SectionForces.diagram`."""
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    name = forces.beam.name
    require_choice(name, "what", what, tuple(SECTION_FORCE_HEADERS))
    k = list(SECTION_FORCE_HEADERS).index(what)
    values = (forces.N, forces.Q, forces.M)[k]
    figure = Figure(figsize=(5.6, 3.2), layout="constrained")
    axis = figure.add_subplot()
    row = _find_row(forces, t)
    axis.axhline(0.0, color="0.6", lw=0.8)
    if row is None:
        envelope, unit = forces.envelope(), SECTION_FORCE_HEADERS[what].partition(" [")[2]
        (lowest, lower), (highest, upper) = (
            [envelope[f"{what} {name} [{unit}"] for name in (word, f"{word} error")]
            for word in ("min", "max")
        )
        axis.fill_between(forces.s, lowest - lower, highest + upper, color="0.93", lw=0.0)
        axis.fill_between(forces.s, lowest, highest, color="0.85")
        axis.plot(forces.s, highest, color=COLORS[0], lw=1.4)
        axis.plot(forces.s, lowest, color=COLORS[1], lw=1.4)
        time = f"{forces.t[0]:g} to {forces.t[-1]:g} s"
    else:
        line, error = values[row], forces.error[k, row]
        axis.fill_between(forces.s, line - error, line + error, color="0.85", lw=0.0)
        axis.plot(forces.s, line, color=COLORS[0], lw=1.6)
        axis.plot(forces.s, forces.strained[k, row], ".", color=COLORS[1], ms=4)
        time = f"t = {forces.t[row]:g} s"
    axis.set_title(wrap_title(f"{name}, {time}"), fontsize=10)
    axis.set_xlabel("s [m]")
    axis.set_ylabel(SECTION_FORCE_HEADERS[what])
    axis.margins(x=0.0)
    draw_grid(axis)
    disable_math_text(figure)
    return Plot(figure)


def _find_row(forces: SectionForces, t: Any) -> int | None:
    if t is None:
        return 0 if len(forces.t) == 1 else None
    t = require_finite(forces.beam.name, "t", t)
    row = int(np.argmin(np.abs(forces.t - t)))
    distance = np.ptp(forces.t) / max(len(forces.t) - 1, 1)
    if abs(forces.t[row] - t) > _MAX_TIME_DISTANCE * distance + _TIME_ROUNDING * abs(t):
        first, last, given = format_distinct(forces.t[0], forces.t[-1], t)
        raise BeamdaeError(
            f"{forces.beam.name}: t must be close to a time of the section forces ({first} to "
            f"{last} s), got {given} s."
        )
    return row
