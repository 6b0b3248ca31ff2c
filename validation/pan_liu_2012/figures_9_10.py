"""Figures 9 and 10: the slider-crank's rod, nonlinear beside linear, in two floating frames."""

from __future__ import annotations

import numpy as np
import pandas as pd
from slider_crank import slider_crank

import beamdae as bd
from pan_liu_2012.claims import OPEN, Judgement, Tables, agrees, claim
from pan_liu_2012.runs import WITNESS, deviation, fills, observed, second_method, span

END, ROWS = 4.5, 1e-2
FRAMES, STRAINS = ("tangent", "chord"), ("nonlinear", "linear")
MIDDLE = {"local.u [m]": "u, local", "local.v [m]": "v, local", "frame.u [m]": "u, frame"}
MIDDLE |= {"frame.v [m]": "v, frame"}
RATE = "rod frame.angle_dot [rad/s]"


def mechanism(**parameters: object) -> bd.Mechanism:
    """The slider-crank with the deformation of the rod's middle in local and in frame axes."""
    made = slider_crank(**parameters)
    rod = made.part("rod")
    for axes in ("local", "frame"):
        made.observe(axes, rod.deformation(rod.length / 2.0, axes=axes))
    return made


def histories(crank: str) -> dict[str, pd.DataFrame]:
    """Figs. 9 and 10: one column a strain, a frame and a component."""
    nine, ten, pairs = {}, {}, {}
    suffix = "" if crank == "rigid" else "_flexible_crank"
    for frame in FRAMES:
        for strain in STRAINS:
            found = observed(mechanism(frame=frame, strain=strain, crank=crank), END, ROWS)
            for column, name in MIDDLE.items():
                nine[f"{strain}, {frame}, {name} [m]"] = found[column]
            nine[f"{strain}, {frame}, slider [m]"] = found["slider.x [m]"]
            ten[f"{strain}, {frame} [rad/s]"] = found[RATE]
        linear = mechanism(frame=frame, strain="linear", crank=crank)
        witness = observed(linear, END, ROWS, WITNESS)
        for figure, column in (("9", "local.v [m]"), ("10", RATE)):
            pairs[f"{figure}{suffix}, linear, {frame}, {column}"] = found[column], witness[column]
    tables = {f"figure_9{suffix}": pd.DataFrame(nine), f"figure_10{suffix}": pd.DataFrame(ten)}
    return tables | second_method(pairs)


@claim(
    "Linear and nonlinear slider-crank coincide from 0 to 0.35 s",
    "Fig. 9",
    "0.35 s",
)
def coincide(tables: Tables) -> Judgement:
    table = tables["figure_9"]
    exact, linear = (table[f"{s}, tangent, v, local [m]"] for s in ("nonlinear", "linear"))
    off = np.abs(linear - exact) / (0.5 * np.ptp(exact))
    times = [float(off.index[np.argmax(off > level)]) for level in (0.01, 0.02, 0.05)]
    return Judgement(
        f"apart by 1 % of the amplitude from {times[0]:.2f} s, 2 % from {times[1]:.2f} s, "
        f"5 % from {times[2]:.2f} s",
        agrees(0.30 <= times[1] <= 0.40),
        "deformation of the middle across the axis, tangent frame",
    )


@claim(
    "Afterwards the linear amplitude is larger: no dynamic stiffening",
    "Fig. 9",
    "larger",
)
def linear_wider(tables: Tables) -> Judgement:
    table, parts, wider = tables["figure_9"], [], True
    for component in ("u, local", "v, local"):
        ranges = [np.ptp(table[f"{s}, tangent, {component} [m]"]) for s in ("linear", "nonlinear")]
        parts.append(f"{component}: {ranges[0] / ranges[1]:.2f}")
        wider &= ranges[0] > 1.1 * ranges[1]
    return Judgement("; ".join(parts), agrees(wider), "range linear over nonlinear, tangent frame")


@claim(
    "The longitudinal deformation of the middle fills the axis",
    "Fig. 9",
    "-0.20 .. 0.20 m",
)
def drawn_component(tables: Tables) -> Judgement:
    table = tables["figure_9"]
    u, v = (
        np.concatenate([table[f"{s}, tangent, {c}, local [m]"] for s in ("nonlinear", "linear")])
        for c in "uv"
    )
    axis = (-0.20, 0.20)
    return Judgement(
        f"along the axis {span(u)} m, across it {span(v)} m",
        agrees(fills(u.min(), u.max(), axis)),
        "the axis fits the component across the rod"
        if fills(v.min(), v.max(), axis)
        else "neither component fits the axis",
    )


@claim(
    "The rod's angular velocity differs obviously between the two",
    "Fig. 10",
    "within +-1.5 rad/s",
)
def rod_rate(tables: Tables) -> Judgement:
    table = tables["figure_10"]
    exact, linear = (table[f"{s}, tangent [rad/s]"] for s in ("nonlinear", "linear"))
    off = deviation(linear, exact)
    return Judgement(
        f"largest difference {off:.0%} of the amplitude; nonlinear {span(exact)}, "
        f"linear {span(linear)} rad/s; chord frame {span(table['nonlinear, chord [rad/s]'])}",
        agrees(off > 0.1),
        "tangent frame: the nonlinear curve fits the axis of +-1.5 rad/s, the linear one is 6 % "
        "beyond; the chord frame fills half of it",
    )


@claim(
    "The crank may be taken as rigid (a reading, not stated)",
    "Fig. 8",
    "-",
)
def flexible_crank(tables: Tables) -> Judgement:
    parts = []
    for name, column in (
        ("figure_9", "nonlinear, tangent, v, local [m]"),
        ("figure_10", "nonlinear, tangent [rad/s]"),
    ):
        rigid, flexible = tables[name][column], tables[f"{name}_flexible_crank"][column]
        parts.append(
            f"{column}: range {np.ptp(flexible) / np.ptp(rigid):.2f} times, largest difference "
            f"{deviation(flexible, rigid):.0%}"
        )
    return Judgement(
        "; ".join(parts),
        OPEN,
        "the paper gives the crank's section but not whether it bends; it does matter: with a "
        "flexible crank the linear rates leave the axis of Fig. 10 by a third: rigid fits better",
    )


CLAIMS = (
    coincide,
    linear_wider,
    drawn_component,
    rod_rate,
    flexible_crank,
)
