"""One picture of all figures, with the axes, units and ranges of the paper, and further tables."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

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
from pan_liu_2012.dynamic_stiffening import EXACT
from pan_liu_2012.table_2 import ELEMENTS, PAPER_RESULTS

# Colors that color-blind readers can distinguish (Okabe & Ito).
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
RED = "#D55E00"
GRAY = "0.6"
NONLINEAR = {"color": BLUE, "lw": 1.3}
LINEAR = {"color": RED, "lw": 1.1, "ls": (0, (5, 2))}
THIN = {"color": GRAY, "lw": 0.7}
Curves = Mapping[str, tuple[pd.Series, dict[str, Any]]]


def draw_convergence(tables: Tables, figure: FigureBase) -> None:
    errors, axes = tables["table_2_errors"], add_panels(figure, 4)
    colors = dict(zip(ELEMENTS, (BLUE, GREEN, ORANGE, RED, GRAY), strict=True))
    paper_scheme = errors[errors["integrator"].str.startswith("generalized")]
    groups = paper_scheme.groupby(["subtended [deg]", "shape"], sort=False)
    for axis, ((subtended, shape), group) in zip(axes, groups, strict=True):
        for name, curve in group.groupby("elements", sort=False):
            axis.loglog(curve["number"], curve["error [-]"], "o-", color=colors[name], ms=3, lw=1)
        for criterion in (0.01, 0.001):
            axis.axhline(criterion, color="0.5", lw=0.8, ls=":")
            axis.text(1.0, 1.1 * criterion, f"{criterion:.1%}", fontsize=7, color="0.4")
        for (kind, angle), (number, _) in PAPER_RESULTS.items():
            if angle == subtended:
                axis.annotate(
                    f"paper, {kind}: {number}",
                    (number, 1.5e-6),
                    (number, 6e-6 if kind == "curved" else 2e-5),
                    fontsize=6.5,
                    ha="center",
                    arrowprops={"arrowstyle": "->", "lw": 0.7},
                )
        axis.set_title(f"{shape}, {subtended:g} degrees", fontsize=9)
        axis.set_xlabel("elements", fontsize=9)
        axis.set_ylim(1e-6, 1.0)
        axis.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        axis.minorticks_off()
    axes[0].set_ylabel("error of the tip deformation / amplitude [-]", fontsize=9)
    handles = axes[0].get_lines()[: len(colors)]
    figure.legend(
        handles, list(colors), loc="outside lower center", ncols=5, fontsize=8, frameon=False
    )


def draw_generalized_alpha(tables: Tables, figure: FigureBase) -> None:
    table = tables["generalized_alpha"]
    start = tables["generalized_alpha_start"].join(tables["generalized_alpha_start_others"])
    left, right = add_panels(figure, 2)
    styles = {
        "resolved, step 2e-5 s": {"color": "0.8", "lw": 0.8},
        "generalized-alpha, plain start, rho_inf 1": {"color": RED, "lw": 0.7},
        "generalized-alpha, plain start, rho_inf 0.8": {"color": BLUE, "lw": 1.0},
        "IDA, order 2, rtol 1e-04": {"color": "0.1", "lw": 1.0, "ls": ":"},
    }
    curves = pick_curves(start, styles, "{} [N]")
    plot_curves(
        left, curves, "hinge force Fx [N]", "no physical damping, step 1e-3 s", (0, 0.3, 0.1)
    )
    column = "hinge force, above 200 Hz, rms [-]"
    for kind, color in (("plain", RED), ("cured", GREEN)):
        rows = table[table["integrator"].str.contains(f"{kind} start")]
        rho = rows["integrator"].str.rsplit(" ", n=1).str[1].astype(float)
        label = f"vibration kept / range, {kind} start"
        right.semilogy(rho, rows[column], "o-", color=color, ms=3, lw=1, label=label)
        if kind == "plain":
            lost = rows["energy lost over largest kinetic [-]"]
            label = "energy lost / largest kinetic (a gain at 1)"
            right.semilogy(rho, lost.where(lost > 0.0), "s--", color=BLUE, ms=3, lw=1, label=label)
    truth = table.set_index("integrator").loc["resolved, step 2e-5 s", column]
    right.axhline(truth, color="0.6", lw=1.0, label="vibration / range, resolved")
    right.set_xlabel(r"$\rho_\infty$", fontsize=9)
    right.set_ylabel("[-]", fontsize=9)
    right.set_title("hinge force above 200 Hz over 2 s", fontsize=9)
    right.legend(fontsize=7, frameon=False)


def draw_spin_up(tables: Tables, figure: FigureBase) -> None:
    table = tables["spin_up"]
    left, right, errors = add_panels(figure, 3)
    dots = {"color": "black", "ls": "none", "marker": "o", "ms": 3, "clip_on": False}
    for axis, component, ends in (
        (left, "u", (-0.020, 0.005, 0.005)),
        (right, "v", (-0.8, 0.2, 0.2)),
    ):
        curves = {
            "nonlinear (eq. 5)": (table[f"{component}, nonlinear [m]"], NONLINEAR),
            "linear": (table[f"{component}, linear [m]"], LINEAR),
            "geometrically exact": (EXACT[f"{component}, exact [m]"], dots),
        }
        title = "straight beam to 6 rad/s"
        plot_curves(axis, curves, f"{component} of the tip [m]", title, (0, 20, 5), ends)
    rows = tables["curved_spin_up"]
    rows = rows[rows["shape"].str.startswith("circular")].sort_values("speed [rad/s]")
    for name, color in (("linear", RED), ("eq. (5)", BLUE)):
        column = rows[f"error, {name} [-]"]
        errors.loglog(rows["speed [rad/s]"], column, "o-", color=color, ms=3, lw=1, label=name)
    errors.set_xticks([0.5, 1, 2, 4, 6], ["0.5", "1", "2", "4", "6"])
    errors.minorticks_off()
    errors.set_xlabel("speed [rad/s]", fontsize=9)
    errors.set_ylabel("error of the tip / amplitude [-]", fontsize=9)
    errors.set_title("the paper's curved beam, 60 degrees", fontsize=9)
    errors.legend(fontsize=7, frameon=False)


def draw_reach(tables: Tables, figure: FigureBase) -> None:
    table, history = tables["reach"], tables["reach_curves"]
    left, right = add_panels(figure, 2)
    deflection = table["largest tip deflection over length [-]"]
    for column, color in (
        ("error, linear, 1 frame [-]", RED),
        ("error, 1 frame [-]", BLUE),
        ("error, 2 frames [-]", GREEN),
        ("error, 4 frames [-]", ORANGE),
    ):
        label = column.removeprefix("error, ").removesuffix(" [-]")
        left.loglog(deflection, table[column], "o-", color=color, ms=3, lw=1, label=label)
    left.set_xlabel("largest tip deflection / length [-]", fontsize=9)
    left.set_xticks([0.02, 0.05, 0.1, 0.2], ["0.02", "0.05", "0.1", "0.2"])
    left.minorticks_off()
    left.set_ylabel("error / amplitude [-]", fontsize=9)
    left.legend(fontsize=7, frameon=False)
    curves = {
        label: (history[f"v, torque x 10, {label} [m]"], style)
        for label, style in (
            ("16 frames", {"color": "0.8", "lw": 4.0}),
            ("1 frame", NONLINEAR),
            ("2 frames", {"color": GREEN, "lw": 1.1, "ls": ":"}),
            ("linear", LINEAR),
        )
    }
    plot_curves(right, curves, "v of the tip [m]", "ten times the torque", (0, 2, 0.5))


def add_panels(figure: FigureBase, columns: int) -> list[Axes]:
    """Return axes side by side."""
    axes = [figure.add_subplot(1, columns, k + 1) for k in range(columns)]
    for axis in axes:
        axis.grid(color="0.9", lw=0.6)
        axis.tick_params(labelsize=8)
    return axes


def plot_curves(
    axis: Axes,
    curves: Curves,
    ylabel: str,
    title: str = "",
    x: tuple[float, float, float] | None = None,
    y: tuple[float, float, float] | None = None,
) -> None:
    """Plot curves over time; `x` and `y` are the ends of the axes and their tick spacing."""
    for label, (series, style) in curves.items():
        series = series.dropna()
        axis.plot(series.index, series.to_numpy(), label=label, **style)
    axis.set_xlabel("t [s]", fontsize=9)
    axis.set_ylabel(ylabel, fontsize=9)
    axis.set_title(title, fontsize=9)
    for ends, limit, ticks in (
        (x, axis.set_xlim, axis.set_xticks),
        (y, axis.set_ylim, axis.set_yticks),
    ):
        if ends is not None:
            start, end, tick = ends
            ticks(np.arange(start, end + 0.5 * tick, tick))
            limit(start, end)
    axis.legend(fontsize=7, framealpha=0.8, edgecolor="none", loc="best")


def pick_curves(
    table: pd.DataFrame, styles: Mapping[str, dict], pattern: str, scale: float = 1.0
) -> Curves:
    """Return columns by label, with each label in place of {} in `pattern`."""
    return {label: (table[pattern.format(label)] * scale, style) for label, style in styles.items()}


DAMPED = {"nonlinear, damped": NONLINEAR, "linear, damped": LINEAR}
UNDAMPED = {"nonlinear, undamped": THIN}


STRAIN = r"strain [$10^{-4}$]"
STRAIN_TIMES = (0, 5, 1)


def draw_figure_5a(tables: Tables, figure: FigureBase) -> None:
    left, right = add_panels(figure, 2)
    for axis, surface, note, ends in (
        (left, "lower", ", the paper's axes", _scale_strain_axis(FIGURE_5A)),
        (right, "upper", "", (-0.4, 1.6, 0.4)),
    ):
        pattern = f"gauge 1, {surface}, {{}} [-]"
        curves = pick_curves(tables["figure_5a"], UNDAMPED | DAMPED, pattern, 1e4)
        plot_curves(axis, curves, STRAIN, f"gauge 1, {surface} surface{note}", STRAIN_TIMES, ends)


def draw_figure_5b(tables: Tables, figure: FigureBase) -> None:
    table, band, axes = tables["figure_5b"], _scale_strain_axis(FIGURE_5B), add_panels(figure, 3)
    for axis, surface, ends in (
        (axes[0], "lower", (-2.0, 0.5, 0.5)),
        (axes[1], "upper", (-0.5, 2, 0.5)),
    ):
        axis.axhspan(band.start, band.end, color="0.92", zorder=0, label="the paper's axis")
        curves = pick_curves(table, UNDAMPED | DAMPED, f"gauge 2, {surface}, {{}} [-]", 1e4)
        title = f"gauge 2 at 0.25 m as printed, {surface} surface"
        plot_curves(axis, curves, STRAIN, title, STRAIN_TIMES, ends)
    near_tip = pick_curves(table, DAMPED, "gauge 2 at 0.70 m, lower, {} [-]", 1e4)
    title = "a gauge at 0.70 m (not the paper's), the paper's axes"
    plot_curves(axes[2], near_tip, STRAIN, title, STRAIN_TIMES, band)


def draw_figure_5c(tables: Tables, figure: FigureBase) -> None:
    (axis,) = add_panels(figure, 1)
    curves = pick_curves(tables["figure_5c"], UNDAMPED | DAMPED, "{} [rad/s]")
    plot_curves(axis, curves, "angular velocity [rad/s]", "the paper's axes", (0, 6, 1), FIGURE_5C)


def _scale_strain_axis(axis: Axis) -> Axis:
    return Axis(axis.start * 1e4, axis.end * 1e4, axis.tick * 1e4)


def draw_damping(tables: Tables, figure: FigureBase) -> None:
    table = tables["damping"]
    laws = [c[13:-4] for c in table if c.startswith("energy lost")]
    left, right = add_panels(figure, 2)
    styles = dict(
        zip(
            laws,
            (
                {"color": "0.75", "lw": 3.0},
                {"color": BLUE, "lw": 1.0, "ls": "--"},
                {"color": ORANGE, "lw": 1.2},
                {"color": RED, "lw": 1.0, "ls": ":"},
                {"color": GREEN, "lw": 1.2},
            ),
            strict=True,
        )
    )
    rates = pick_curves(table, styles, "angular velocity, {} [rad/s]")
    plot_curves(left, rates, "angular velocity [rad/s]", "", (0, 6, 1), FIGURE_5C)
    damped = {k: v for k, v in styles.items() if k != "undamped"}
    plot_curves(
        right, pick_curves(table, damped, "energy lost, {} [J]"), "energy lost [J]", "", (0, 6, 1)
    )
    right.set_yscale("log")
    right.set_ylim(1e-6, 1.0)
    handles, labels = left.get_legend_handles_labels()
    for axis in (left, right):
        axis.get_legend().remove()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8, frameon=False)


def draw_tip(
    tables: Tables, figure: FigureBase, *, table_name: str, component: str, y: Axis
) -> None:
    dots = {"color": RED, "ls": "none", "marker": "o", "ms": 2.5, "markevery": 8}
    left, right = add_panels(figure, 2)
    for axis, subtended, ends, title in (
        (left, 60, y, "60 degrees, the paper's axes"),
        (right, 30, None, "30 degrees"),
    ):
        table = tables[f"{table_name}_{subtended}_degrees"]
        straight = table[f"{component}, straight, 20 elements, 4 nodes [m]"]
        curves = {
            "curved, 8 elements": (table[f"{component}, curved, 8 elements [m]"], NONLINEAR),
            "straight, 20 elements": (straight, dots),
        }
        plot_curves(axis, curves, f"{component} [m]", title, (0, 2, 0.2), ends)


STRAINS = {"nonlinear": NONLINEAR, "linear": LINEAR}
CRANK_TIMES = (0, 4.5, 0.5)
RATE = "angular velocity [rad/s]"


def draw_figure_9(tables: Tables, figure: FigureBase) -> None:
    axes = add_panels(figure, 3)
    for axis, pattern, title in (
        (axes[0], "{}, chord, v, local [m]", "across the axis, chord frame (used)"),
        (axes[1], "{}, chord, u, local [m]", "along the axis, chord frame"),
        (axes[2], "{}, tangent, v, local [m]", "across the axis, tangent frame"),
    ):
        curves = pick_curves(tables["figure_9"], STRAINS, pattern)
        plot_curves(axis, curves, "deformation of the middle [m]", title, CRANK_TIMES, FIGURE_9)


def draw_figure_10(tables: Tables, figure: FigureBase) -> None:
    axes = add_panels(figure, 3)
    for axis, pattern, title in (
        (axes[0], "{}, chord, start section [rad/s]", "start section, chord frame (used)"),
        (axes[1], "{}, tangent, start section [rad/s]", "start section, tangent frame"),
        (axes[2], "{}, chord, chord [rad/s]", "chord, chord frame"),
    ):
        curves = pick_curves(tables["figure_10"], STRAINS, pattern)
        plot_curves(axis, curves, RATE, title, CRANK_TIMES, FIGURE_10)
        # Linear curves slightly exceed the paper's axis.
        axis.set_ylim(-1.65, 1.65)


def draw_flexible_crank(tables: Tables, figure: FigureBase) -> None:
    left, right = add_panels(figure, 2)
    for axis, pattern, name, label in (
        (left, "{}, chord, v, local [m]", "figure_9", "v of the middle [m]"),
        (right, "{}, chord, start section [rad/s]", "figure_10", RATE),
    ):
        rigid, flexible = tables[name], tables[f"{name}_flexible_crank"]
        curves = {
            "rigid crank": (rigid[pattern.format("nonlinear")], NONLINEAR),
            "flexible crank": (flexible[pattern.format("nonlinear")], LINEAR),
        }
        plot_curves(axis, curves, label, "nonlinear, chord frame", CRANK_TIMES)


DRAWINGS = {
    "Figure 5a": draw_figure_5a,
    "Figure 5b": draw_figure_5b,
    "Figure 5c": draw_figure_5c,
    "Figure 6": partial(draw_tip, table_name="figure_6", component="u", y=FIGURE_6),
    "Figure 7": partial(draw_tip, table_name="figure_7", component="v", y=FIGURE_7),
    "Figure 9": draw_figure_9,
    "Figure 10": draw_figure_10,
    "Table 2: error over the number of elements": draw_convergence,
    "Laws of damping of the pendulum": draw_damping,
    "Flexible crank": draw_flexible_crank,
    "Numerical damping of generalized-alpha": draw_generalized_alpha,
    "Dynamic stiffening": draw_spin_up,
    "Validity of the strains": draw_reach,
}


def draw_all(tables: Tables, path: Path) -> None:
    """Draw every figure as a row of one picture."""
    figure = Figure(figsize=(13.2, 3.5 * len(DRAWINGS)), layout="constrained")
    rows = figure.subfigures(len(DRAWINGS), 1)
    for row, (title, draw) in zip(rows, DRAWINGS.items(), strict=True):
        row.suptitle(title, fontsize=11, weight="bold")
        draw(tables, row)
    figure.savefig(path, dpi=100)
