"""Pictures of what the paper names without showing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pan_liu_2012.drawing import (
    BLUE,
    GRAY,
    GREEN,
    LINEAR,
    NONLINEAR,
    ORANGE,
    RED,
    panels,
    pick,
    plot,
    save,
)
from pan_liu_2012.manoeuvre import EXACT
from pan_liu_2012.table_2 import ELEMENTS, PAPER


def convergence(errors: pd.DataFrame, path: Path) -> None:
    figure, axes = panels(4, width=3.4, height=3.8)
    colors = dict(zip(ELEMENTS, (BLUE, GREEN, ORANGE, RED, GRAY), strict=True))
    chosen = errors[errors["integrator"].str.startswith("generalized")]
    groups = chosen.groupby(["subtended [deg]", "shape"], sort=False)
    for axis, ((subtended, shape), group) in zip(axes, groups, strict=True):
        for name, curve in group.groupby("elements", sort=False):
            axis.loglog(curve["number"], curve["error [-]"], "o-", color=colors[name], ms=3, lw=1)
        for criterion in (0.01, 0.001):
            axis.axhline(criterion, color="0.5", lw=0.8, ls=":")
            axis.text(1.0, 1.1 * criterion, f"{criterion:.1%}", fontsize=7, color="0.4")
        for (kind, angle), (number, _) in PAPER.items():
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
    save(figure, path)


def generalized_alpha(tables: Mapping[str, pd.DataFrame], path: Path) -> None:
    table = tables["generalized_alpha"]
    start = tables["generalized_alpha_start"].join(tables["generalized_alpha_start_others"])
    figure, (left, right) = panels(2, height=3.6)
    wanted = {
        "resolved, step 2e-5 s": {"color": "0.8", "lw": 0.8},
        "generalized-alpha, plain start, rho_inf 1": {"color": RED, "lw": 0.7},
        "generalized-alpha, plain start, rho_inf 0.8": {"color": BLUE, "lw": 1.0},
        "IDA, order 2, rtol 1e-04": {"color": "0.1", "lw": 1.0, "ls": ":"},
    }
    curves = pick(start, wanted, "{} [N]")
    plot(left, curves, "hinge force Fx [N]", "no physical damping, step 1e-3 s", (0, 0.3, 0.1))
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
    save(figure, path)


def spin_up(tables: Mapping[str, pd.DataFrame], path: Path) -> None:
    table = tables["spin_up"]
    figure, (left, right, errors) = panels(3, width=4.4)
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
        plot(axis, curves, f"{component} of the tip [m]", title, (0, 20, 5), ends)
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
    save(figure, path)


def reach(tables: Mapping[str, pd.DataFrame], path: Path) -> None:
    table, history = tables["reach"], tables["reach_curves"]
    figure, (left, right) = panels(2)
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
    plot(right, curves, "v of the tip [m]", "ten times the torque", (0, 2, 0.5))
    save(figure, path)
