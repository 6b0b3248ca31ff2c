"""The figures, with the axes, units and ranges of the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pan_liu_2012.manoeuvre import EXACT

BLUE, ORANGE, GREEN, RED, GRAY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "0.6"
NONLINEAR, LINEAR = {"color": BLUE, "lw": 1.3}, {"color": RED, "lw": 1.1, "ls": (0, (5, 2))}
THIN = {"color": GRAY, "lw": 0.7}
DAMPED = {"nonlinear, damped": NONLINEAR, "linear, damped": LINEAR}
UNDAMPED = {"nonlinear, undamped": THIN}
Curves = Mapping[str, tuple[pd.Series, dict[str, Any]]]


def draw_all(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    """Draw every figure of the study into a folder."""
    _figure_5(tables, folder)
    _figures_6_7(tables, folder)
    _figures_9_10(tables, folder)
    _convergence(tables["table_2_errors"], folder / "table_2.png")
    _generalized_alpha(tables, folder / "generalized_alpha.png")
    _spin_up(tables["spin_up"], folder / "spin_up.png")
    _reach(tables, folder / "reach.png")


def _axes(columns: int = 1, height: float = 3.2, width: float = 5.2) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width * columns, height), layout="constrained")
    axes = [figure.add_subplot(1, columns, k + 1) for k in range(columns)]
    for axis in axes:
        axis.grid(color="0.9", lw=0.6)
        axis.tick_params(labelsize=8)
    return figure, axes


def _plot(
    axis: Axes,
    curves: Curves,
    ylabel: str,
    title: str = "",
    x: tuple[float, float, float] | None = None,
    y: tuple[float, float, float] | None = None,
) -> None:
    """Curves over time; `x`, `y` are the ends of the axes and the distance of their ticks."""
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
            ticks(np.arange(ends[0], ends[1] + 0.5 * ends[2], ends[2]))
            limit(ends[0], ends[1])
    axis.legend(fontsize=7, frameon=False, loc="best")


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=110)


def _pick(
    table: pd.DataFrame, styles: Mapping[str, dict], pattern: str, scale: float = 1.0
) -> Curves:
    """Columns `pattern` with each label in place of {}."""
    return {label: (table[pattern.format(label)] * scale, style) for label, style in styles.items()}


def _figure_5(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    strain = r"strain [$10^{-4}$]"
    styles = UNDAMPED | DAMPED
    table = tables["figure_5a"]
    figure, (left, right) = _axes(2)
    below = _pick(table, styles, "gauge 1, lower, {} [-]", 1e4)
    _plot(left, below, strain, "gauge 1, lower surface", (0, 5, 1), (-1.6, 0.4, 0.4))
    above = _pick(table, styles, "gauge 1, upper, {} [-]", 1e4)
    _plot(right, above, strain, "gauge 1, upper surface", (0, 5, 1), (-0.4, 1.6, 0.4))
    _save(figure, folder / "figure_5a.png")

    table = tables["figure_5b"]
    figure, (left, middle, right) = _axes(3, width=4.4)
    there = _pick(table, DAMPED, "gauge 2 at 0.70 m, lower, {} [-]", 1e4)
    as_printed = table["gauge 2, lower, nonlinear, damped [-]"] * 1e4
    there["nonlinear, as printed: at 0.25 m"] = (as_printed, THIN)
    title = "the paper's axis: gauge 2 at 0.70 m fills it"
    _plot(left, there, strain, title, (0, 5, 1), (-0.5, 0.1, 0.1))
    for axis, surface, ends in (
        (middle, "lower", (-2.0, 0.5, 0.5)),
        (right, "upper", (-0.5, 2.0, 0.5)),
    ):
        curves = _pick(table, styles, f"gauge 2, {surface}, {{}} [-]", 1e4)
        _plot(axis, curves, strain, f"gauge 2 at 0.25 m, {surface} surface", (0, 5, 1), ends)
    _save(figure, folder / "figure_5b.png")

    figure, (axis,) = _axes()
    curves = _pick(tables["figure_5c"], styles, "{} [rad/s]")
    _plot(axis, curves, "angular velocity [rad/s]", "", (0, 6, 1), (-6, 6, 2))
    _save(figure, folder / "figure_5c.png")

    table = tables["damping"]
    laws = [c[13:-4] for c in table if c.startswith("energy lost")]
    figure, (left, right) = _axes(2)
    colors = dict(zip(laws, (GRAY, BLUE, ORANGE, RED, GREEN), strict=True))
    rates = {k: (table[f"angular velocity, {k} [rad/s]"], {"color": c}) for k, c in colors.items()}
    _plot(left, rates, "angular velocity [rad/s]", "", (0, 6, 1), (-6, 6, 2))
    lost = {k: (table[f"energy lost, {k} [J]"], {"color": c}) for k, c in colors.items()}
    del lost["undamped"]
    _plot(right, lost, "energy lost [J]", "", (0, 6, 1))
    right.set_yscale("log")
    right.set_ylim(1e-6, 1.0)
    _save(figure, folder / "damping.png")


def _figures_6_7(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    for number, component, y in (("6", "u", (-0.10, 0.10, 0.02)), ("7", "v", (-0.10, 0.12, 0.02))):
        figure, (left, right) = _axes(2)
        for axis, subtended, ends in ((left, 60, y), (right, 30, None)):
            table = tables[f"figure_{number}_{subtended}_degrees"]
            curves = {
                f"curved, {8} elements": (table[f"{component}, curved, 8 elements [m]"], NONLINEAR),
                "straight, 20 elements": (
                    table[f"{component}, straight, 20 elements, 4 nodes [m]"],
                    LINEAR,
                ),
            }
            _plot(axis, curves, f"{component} [m]", f"{subtended} degrees", (0, 2, 0.2), ends)
        _save(figure, folder / f"figure_{number}.png")


def _figures_9_10(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    nine, ten = tables["figure_9"], tables["figure_10"]
    styles = {"nonlinear": NONLINEAR, "linear": LINEAR}
    time, deformation = (0, 4.5, 0.5), (-0.20, 0.20, 0.05)
    figure, axes = _axes(3, width=4.4)
    for axis, pattern, title in (
        (axes[0], "{}, tangent, v, local [m]", "across the axis, tangent frame"),
        (axes[1], "{}, tangent, u, local [m]", "along the axis, tangent frame"),
        (axes[2], "{}, chord, v, local [m]", "across the axis, chord frame"),
    ):
        curves = _pick(nine, styles, pattern)
        _plot(axis, curves, "deformation of the middle [m]", title, time, deformation)
    _save(figure, folder / "figure_9.png")
    figure, (left, right) = _axes(2)
    for axis, frame in ((left, "tangent"), (right, "chord")):
        curves = _pick(ten, styles, f"{{}}, {frame} [rad/s]")
        _plot(axis, curves, "angular velocity [rad/s]", f"{frame} frame", time, (-1.5, 1.5, 0.5))
        axis.set_ylim(-1.65, 1.65)
    _save(figure, folder / "figure_10.png")
    figure, (left, right) = _axes(2)
    for axis, pattern, name, label in (
        (left, "{}, tangent, v, local [m]", "figure_9", "v of the middle [m]"),
        (right, "{}, tangent [rad/s]", "figure_10", "angular velocity [rad/s]"),
    ):
        rigid, flexible = tables[name], tables[f"{name}_flexible_crank"]
        curves = {
            "rigid crank": (rigid[pattern.format("nonlinear")], NONLINEAR),
            "flexible crank": (flexible[pattern.format("nonlinear")], LINEAR),
        }
        _plot(axis, curves, label, "nonlinear, tangent frame", time)
    _save(figure, folder / "flexible_crank.png")


def _convergence(errors: pd.DataFrame, path: Path) -> None:
    figure, axes = _axes(4, width=3.4, height=3.6)
    colors = dict(zip(errors["elements"].unique(), (BLUE, GREEN, ORANGE, RED, GRAY), strict=True))
    chosen = errors[errors["integrator"].str.startswith("generalized")]
    groups = chosen.groupby(["subtended [deg]", "shape"], sort=False)
    for axis, ((subtended, shape), group) in zip(axes, groups, strict=True):
        for name, curve in group.groupby("elements", sort=False):
            axis.loglog(curve["number"], curve["error [-]"], "o-", color=colors[name], ms=3, lw=1)
        for criterion in (0.01, 0.001):
            axis.axhline(criterion, color="0.5", lw=0.8, ls=":")
        axis.set_title(f"{shape}, {subtended:g} degrees", fontsize=9)
        axis.set_xlabel("elements", fontsize=9)
        axis.set_ylim(1e-6, 1.0)
    axes[0].set_ylabel("error of the tip deformation / amplitude [-]", fontsize=9)
    handles = axes[0].get_lines()[: len(colors)]
    figure.legend(handles, list(colors), loc="outside lower center", ncols=5, fontsize=8)
    _save(figure, path)


def _generalized_alpha(tables: Mapping[str, pd.DataFrame], path: Path) -> None:
    table = tables["generalized_alpha"]
    start = tables["generalized_alpha_start"].join(tables["generalized_alpha_start_ida"])
    figure, (left, right) = _axes(2, height=3.6)
    wanted = {
        "generalized-alpha, plain start, rho_inf 1": {"color": RED, "lw": 0.8},
        "generalized-alpha, plain start, rho_inf 0.8": {"color": BLUE, "lw": 1.0},
        "generalized-alpha, cured start, rho_inf 0.8": {"color": GREEN, "lw": 1.0},
        "IDA, order 2, rtol 1e-04": {"color": "0.2", "lw": 1.0, "ls": ":"},
    }
    _plot(left, _pick(start, wanted, "{} [N]"), "hinge force Fx [N]", "no physical damping")
    for kind, color in (("plain", RED), ("cured", GREEN)):
        rows = table[table["integrator"].str.contains(f"{kind} start")]
        rho = rows["integrator"].str.rsplit(" ", n=1).str[1].astype(float)
        noise = rows["hinge force, above 200 Hz, rms [-]"]
        right.semilogy(rho, noise, "o-", color=color, ms=3, lw=1, label=f"noise, {kind} start")
    lost = rows["energy lost over largest kinetic [-]"].abs()
    right.semilogy(rho, lost, "s--", color=BLUE, ms=3, lw=1, label="energy lost")
    right.set_xlabel(r"$\rho_\infty$", fontsize=9)
    right.set_ylabel("share of the range, of the energy [-]", fontsize=9)
    right.set_title("hinge force above 200 Hz; energy lost in 2 s", fontsize=9)
    right.legend(fontsize=7, frameon=False)
    _save(figure, path)


def _spin_up(table: pd.DataFrame, path: Path) -> None:
    figure, (left, right) = _axes(2)
    dots = {"color": "black", "ls": "none", "marker": "o", "ms": 3}
    for axis, component, ends in (
        (left, "u", (-0.020, 0.005, 0.005)),
        (right, "v", (-0.8, 0.2, 0.2)),
    ):
        curves = {
            "nonlinear (eq. 5)": (table[f"{component}, nonlinear [m]"], NONLINEAR),
            "linear": (table[f"{component}, linear [m]"], LINEAR),
            "geometrically exact": (EXACT[f"{component}, exact [m]"], dots),
        }
        _plot(axis, curves, f"{component} of the tip [m]", "", (0, 20, 5), ends)
    _save(figure, path)


def _reach(tables: Mapping[str, pd.DataFrame], path: Path) -> None:
    table, history = tables["reach"], tables["reach_curves"]
    figure, (left, right) = _axes(2)
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
    _plot(right, curves, "v of the tip [m]", "ten times the torque", (0, 2, 0.5))
    _save(figure, path)
