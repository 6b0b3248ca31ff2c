"""One picture of the figures of the paper, with its axes, units and ranges."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pan_liu_2012.claims import (
    FIGURE_5A,
    FIGURE_5B,
    FIGURE_5C,
    FIGURE_6,
    FIGURE_7,
    FIGURE_9,
    FIGURE_10,
    Axis,
    Tables,
)

# Colors that color-blind readers can distinguish (Okabe & Ito).
NONLINEAR = {"color": "#0072B2", "lw": 1.3}
LINEAR = {"color": "#D55E00", "lw": 1.1, "ls": (0, (5, 2))}
DOTS = {"color": "#D55E00", "ls": "none", "marker": "o", "ms": 2.5, "markevery": 8}
Styles = dict[str, dict[str, Any]]
STRAINS: Styles = {"nonlinear": NONLINEAR, "linear": LINEAR}
DAMPED: Styles = {"nonlinear, damped": NONLINEAR, "linear, damped": LINEAR}
PENDULUM: Styles = {"nonlinear, undamped": {"color": "0.6", "lw": 0.7}} | DAMPED
ELEMENTS: Styles = {"curved, 8 elements": NONLINEAR, "straight, 20 elements, 4 nodes": DOTS}


class Panel(NamedTuple):
    """Curves over time.

    Attributes
    ----------
    table, pattern
        Table, and its columns with a label in place of {}.
    styles
        Style of each label.
    times
        Axis of the times [s].
    quantity
        Label of the vertical axis, in units of `unit`.
    axis
        Vertical axis in units of the table; None fits the curves.
    """

    title: str
    table: str
    pattern: str
    styles: Styles
    times: Axis
    quantity: str
    axis: Axis | None = None
    unit: float = 1.0


def _strain(title: str, figure: str, gauge: str, styles: Styles, axis: Axis | None) -> Panel:
    pattern, times = f"{gauge}, {{}} [-]", Axis(0, 5, 1)
    quantity = r"strain [$10^{-4}$]"
    return Panel(title, f"figure_5{figure}", pattern, styles, times, quantity, axis, 1e-4)


def _tip(figure: int, component: str, subtended: int, axis: Axis | None) -> Panel:
    table, pattern = f"figure_{figure}_{subtended}_degrees", f"{component}, {{}} [m]"
    times, quantity = Axis(0, 2, 0.2), f"{component} [m]"
    return Panel(f"{subtended} degrees", table, pattern, ELEMENTS, times, quantity, axis)


def _rod(title: str, figure: int, curve: str, quantity: str, axis: Axis) -> Panel:
    times = Axis(0, 4.5, 0.5)
    return Panel(title, f"figure_{figure}", f"{{}}, {curve}", STRAINS, times, quantity, axis)


DEFORMATION, RATE = "deformation of the middle [m]", "angular velocity [rad/s]"
# The linear curve of the tangent frame slightly exceeds the paper's axis.
WIDE_10 = FIGURE_10._replace(start=-2.0, end=2.0)
FIGURES = {
    "Figure 5a": (
        _strain("lower surface, the paper's axis", "a", "gauge 1, lower", PENDULUM, FIGURE_5A),
        _strain("upper surface", "a", "gauge 1, upper", PENDULUM, None),
    ),
    "Figure 5b": (
        _strain("gauge 2 at 0.25 m as printed", "b", "gauge 2, lower", PENDULUM, None),
        _strain("at 0.70 m, the paper's axis", "b", "gauge 2 at 0.70 m, lower", DAMPED, FIGURE_5B),
    ),
    "Figure 5c": (Panel("", "figure_5c", "{} [rad/s]", PENDULUM, Axis(0, 6, 1), RATE, FIGURE_5C),),
    "Figure 6": (_tip(6, "u", 60, FIGURE_6), _tip(6, "u", 30, None)),
    "Figure 7": (_tip(7, "v", 60, FIGURE_7), _tip(7, "v", 30, None)),
    "Figure 9": (
        _rod("across, chord frame (used)", 9, "chord, v, local [m]", DEFORMATION, FIGURE_9),
        _rod("along, chord frame", 9, "chord, u, local [m]", DEFORMATION, FIGURE_9),
        _rod("across, tangent frame", 9, "tangent, v, local [m]", DEFORMATION, FIGURE_9),
    ),
    "Figure 10": (
        _rod("start, chord frame (used)", 10, "chord, start section [rad/s]", RATE, WIDE_10),
        _rod("start, tangent frame", 10, "tangent, start section [rad/s]", RATE, WIDE_10),
        _rod("chord, chord frame", 10, "chord, chord [rad/s]", RATE, WIDE_10),
    ),
}


def draw_panel(panel: Panel, tables: Tables, axes: Axes) -> None:
    """Draw the curves of a panel."""
    table = tables[panel.table]
    for label, style in panel.styles.items():
        axes.plot(
            table.index, table[panel.pattern.format(label)] / panel.unit, label=label, **style
        )
    axes.set(title=panel.title, xlabel="t [s]", ylabel=panel.quantity)
    scaled = panel.axis and Axis(*(x / panel.unit for x in panel.axis))
    for axis, limit, ticks in (
        (panel.times, axes.set_xlim, axes.set_xticks),
        (scaled, axes.set_ylim, axes.set_yticks),
    ):
        if axis:
            ticks(np.arange(axis.start, axis.end + 0.5 * axis.tick, axis.tick))
            limit(axis.start, axis.end)
    axes.grid(color="0.9", lw=0.6)
    axes.legend(fontsize=7, edgecolor="none")


def draw_all(tables: Tables, path: Path) -> None:
    """Draw every figure as a row of one picture."""
    figure = Figure(figsize=(13.2, 3.5 * len(FIGURES)), layout="constrained")
    rows = figure.subfigures(len(FIGURES), 1)
    for row, (title, panels) in zip(rows, FIGURES.items(), strict=True):
        row.suptitle(title, fontsize=11, weight="bold")
        for k, panel in enumerate(panels, 1):
            draw_panel(panel, tables, row.add_subplot(1, len(panels), k))
    figure.savefig(path, dpi=80)
