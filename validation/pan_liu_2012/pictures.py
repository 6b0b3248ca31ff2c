"""The figures, with the axes, units and ranges of the paper's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pan_liu_2012.axes import (
    FIGURE_5A,
    FIGURE_5B,
    FIGURE_5C,
    FIGURE_6,
    FIGURE_7,
    FIGURE_9,
    FIGURE_10,
)
from pan_liu_2012.drawing import (
    BLUE,
    GREEN,
    LINEAR,
    NONLINEAR,
    ORANGE,
    RED,
    THIN,
    panels,
    pick,
    plot,
    save,
)
from pan_liu_2012.pictures_beyond import convergence, generalized_alpha, reach, spin_up

DAMPED = {"nonlinear, damped": NONLINEAR, "linear, damped": LINEAR}
UNDAMPED = {"nonlinear, undamped": THIN}


def draw_all(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    """Draw every figure of the study into a folder."""
    _figure_5(tables, folder)
    _figures_6_7(tables, folder)
    _figures_9_10(tables, folder)
    convergence(tables["table_2_errors"], folder / "table_2.png")
    generalized_alpha(tables, folder / "generalized_alpha.png")
    spin_up(tables, folder / "spin_up.png")
    reach(tables, folder / "reach.png")


def _figure_5(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    strain = r"strain [$10^{-4}$]"
    styles = UNDAMPED | DAMPED
    time = (0, 5, 1)
    table = tables["figure_5a"]
    figure, (left, right) = panels(2)
    below = pick(table, styles, "gauge 1, lower, {} [-]", 1e4)
    plot(left, below, strain, "gauge 1, lower surface, the paper's axes", time, _scaled(FIGURE_5A))
    above = pick(table, styles, "gauge 1, upper, {} [-]", 1e4)
    plot(right, above, strain, "gauge 1, upper surface", time, (-0.4, 1.6, 0.4))
    save(figure, folder / "figure_5a.png")

    table, band = tables["figure_5b"], _scaled(FIGURE_5B)
    figure, axes = panels(3, width=4.4)
    for axis, surface, ends in (
        (axes[0], "lower", (-2.0, 0.5, 0.5)),
        (axes[1], "upper", (-0.5, 2, 0.5)),
    ):
        axis.axhspan(band[0], band[1], color="0.92", zorder=0, label="the paper's axis")
        curves = pick(table, styles, f"gauge 2, {surface}, {{}} [-]", 1e4)
        plot(axis, curves, strain, f"gauge 2 at 0.25 m as printed, {surface} surface", time, ends)
    moved = pick(table, DAMPED, "gauge 2 at 0.70 m, lower, {} [-]", 1e4)
    title = "a gauge at 0.70 m (not the paper's), the paper's axes"
    plot(axes[2], moved, strain, title, time, band)
    save(figure, folder / "figure_5b.png")

    figure, (axis,) = panels()
    curves = pick(tables["figure_5c"], styles, "{} [rad/s]")
    plot(axis, curves, "angular velocity [rad/s]", "the paper's axes", (0, 6, 1), FIGURE_5C)
    save(figure, folder / "figure_5c.png")
    _damping(tables["damping"], folder / "damping.png")


def _scaled(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    return axis[0] * 1e4, axis[1] * 1e4, axis[2] * 1e4


def _damping(table: pd.DataFrame, path: Path) -> None:
    laws = [c[13:-4] for c in table if c.startswith("energy lost")]
    figure, (left, right) = panels(2, height=3.6)
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
    rates = pick(table, styles, "angular velocity, {} [rad/s]")
    plot(left, rates, "angular velocity [rad/s]", "", (0, 6, 1), FIGURE_5C)
    damped = {k: v for k, v in styles.items() if k != "undamped"}
    plot(right, pick(table, damped, "energy lost, {} [J]"), "energy lost [J]", "", (0, 6, 1))
    right.set_yscale("log")
    right.set_ylim(1e-6, 1.0)
    handles, labels = left.get_legend_handles_labels()
    for axis in (left, right):
        axis.get_legend().remove()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    save(figure, path)


def _figures_6_7(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    dots = {"color": RED, "ls": "none", "marker": "o", "ms": 2.5, "markevery": 8}
    for number, component, y in (("6", "u", FIGURE_6), ("7", "v", FIGURE_7)):
        figure, (left, right) = panels(2)
        for axis, subtended, ends, title in (
            (left, 60, y, "60 degrees, the paper's axes"),
            (right, 30, None, "30 degrees"),
        ):
            table = tables[f"figure_{number}_{subtended}_degrees"]
            curves = {
                "curved, 8 elements": (table[f"{component}, curved, 8 elements [m]"], NONLINEAR),
                "straight, 20 elements": (
                    table[f"{component}, straight, 20 elements, 4 nodes [m]"],
                    dots,
                ),
            }
            plot(axis, curves, f"{component} [m]", title, (0, 2, 0.2), ends)
        save(figure, folder / f"figure_{number}.png")


def _figures_9_10(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    nine, ten = tables["figure_9"], tables["figure_10"]
    styles = {"nonlinear": NONLINEAR, "linear": LINEAR}
    time, label = (0, 4.5, 0.5), "deformation of the middle [m]"
    figure, axes = panels(3, width=4.4)
    for axis, pattern, title in (
        (axes[0], "{}, chord, v, local [m]", "across the axis, chord frame (used)"),
        (axes[1], "{}, chord, u, local [m]", "along the axis, chord frame"),
        (axes[2], "{}, tangent, v, local [m]", "across the axis, tangent frame"),
    ):
        plot(axis, pick(nine, styles, pattern), label, title, time, FIGURE_9)
    save(figure, folder / "figure_9.png")
    rate = "angular velocity [rad/s]"
    figure, axes = panels(3, width=4.4)
    for axis, pattern, title in (
        (axes[0], "{}, chord, start section [rad/s]", "start section, chord frame (used)"),
        (axes[1], "{}, tangent, start section [rad/s]", "start section, tangent frame"),
        (axes[2], "{}, chord, chord [rad/s]", "chord, chord frame"),
    ):
        plot(axis, pick(ten, styles, pattern), rate, title, time, FIGURE_10)
        # Linear curves are a little beyond the paper's axis.
        axis.set_ylim(-1.65, 1.65)
    save(figure, folder / "figure_10.png")
    figure, (left, right) = panels(2)
    for axis, pattern, name, label in (
        (left, "{}, chord, v, local [m]", "figure_9", "v of the middle [m]"),
        (right, "{}, chord, start section [rad/s]", "figure_10", rate),
    ):
        rigid, flexible = tables[name], tables[f"{name}_flexible_crank"]
        curves = {
            "rigid crank": (rigid[pattern.format("nonlinear")], NONLINEAR),
            "flexible crank": (flexible[pattern.format("nonlinear")], LINEAR),
        }
        plot(axis, curves, label, "nonlinear, chord frame", time)
    save(figure, folder / "flexible_crank.png")
