"""Figures 9 and 10: the slider-crank's rod, nonlinear beside linear, in two floating frames."""

from __future__ import annotations

import numpy as np
import pandas as pd
from slider_crank import slider_crank

import beamdae as bd
from pan_liu_2012.axes import FIGURE_9, FIGURE_10, fills
from pan_liu_2012.claims import BY_CONSTRUCTION, OPEN, Judgement, Tables, agrees, claim
from pan_liu_2012.runs import WITNESS, deviation, observed, second_method, span

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
    parts, times = [], {}
    for frame in FRAMES:
        exact, linear = _across(tables["figure_9"], frame)
        off = np.abs(linear - exact) / (0.5 * np.ptp(exact))
        times[frame] = [float(off.index[np.argmax(off > level)]) for level in (0.01, 0.02, 0.05)]
        ours = "{:.2f}, {:.2f} and {:.2f} s".format(*times[frame])
        parts.append(f"{frame} frame: apart by 1, 2 and 5 % of the amplitude from {ours}")
    return Judgement(
        "; ".join(parts),
        agrees(0.30 <= times["tangent"][1] <= 0.40),
        "deformation of the middle across the axis; the tangent frame is judged",
    )


def _across(table: pd.DataFrame, frame: str) -> tuple[pd.Series, pd.Series]:
    """Deformation of the middle across the axis, nonlinear and linear."""
    return table[f"nonlinear, {frame}, v, local [m]"], table[f"linear, {frame}, v, local [m]"]


@claim(
    "Afterwards the linear amplitude is larger: no dynamic stiffening",
    "Fig. 9",
    "larger",
)
def linear_wider(tables: Tables) -> Judgement:
    parts, wider = [], True
    for frame in FRAMES:
        exact, linear = _across(tables["figure_9"], frame)
        ratio = np.ptp(linear) / np.ptp(exact)
        parts.append(f"{frame} frame: {ratio:.2f}")
        wider &= bool(ratio > 1.1)
    return Judgement(
        "; ".join(parts), agrees(wider), "range linear over nonlinear, across the axis"
    )


@claim(
    "The longitudinal deformation of the middle fills the axis",
    "Fig. 9",
    "-0.20 .. 0.20 m",
)
def drawn_component(tables: Tables) -> Judgement:
    table, parts, good = tables["figure_9"], [], {}
    for frame in FRAMES:
        for component, where in (("u", "along"), ("v", "across")):
            names = [f"{s}, {frame}, {component}, local [m]" for s in STRAINS]
            both = table[names].to_numpy()
            good[frame, component] = bool(fills(both.min(), both.max(), FIGURE_9))
            parts.append(f"{where} the axis, {frame} frame, {span(both)} m")
    across = [frame for frame in FRAMES if good[frame, "v"]]
    return Judgement(
        "; ".join(parts),
        agrees(good["tangent", "u"] or good["chord", "u"]),
        f"the component across the rod fits the axis ({', '.join(across)} frame), the one along it "
        "does not",
    )


@claim(
    "The rod's angular velocity differs obviously between the two",
    "Fig. 10",
    "within +-1.5 rad/s",
)
def rod_rate(tables: Tables) -> Judgement:
    table = tables["figure_10"]
    off, ranges = {}, {}
    for frame in FRAMES:
        exact, linear = (table[f"{s}, {frame} [rad/s]"] for s in STRAINS)
        off[frame] = deviation(linear, exact)
        ranges[frame] = span(exact), span(linear)
    beyond = table["linear, tangent [rad/s]"].abs().max() / FIGURE_10[1] - 1.0
    return Judgement(
        f"tangent frame: largest difference {off['tangent']:.0%} of the amplitude, nonlinear "
        f"{ranges['tangent'][0]}, linear {ranges['tangent'][1]} rad/s; chord frame: "
        f"{off['chord']:.1%}, {ranges['chord'][0]} rad/s",
        BY_CONSTRUCTION if off["tangent"] > 0.1 else agrees(False),
        "the tangent frame was chosen because the rates differ in it and fill the axis (nonlinear "
        f"within it, linear {beyond:.0%} beyond); in the chord frame they hardly differ",
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
    fastest = tables["figure_10_flexible_crank"]["linear, tangent [rad/s]"].abs().max()
    beyond = fastest / FIGURE_10[1] - 1.0
    return Judgement(
        "; ".join(parts),
        OPEN,
        "the paper gives the crank's section but not whether it bends; it does matter: with a "
        f"flexible crank the linear rates are {beyond:.0%} beyond the axis of Fig. 10: rigid fits "
        "better",
    )


CLAIMS = (
    coincide,
    linear_wider,
    drawn_component,
    rod_rate,
    flexible_crank,
)
