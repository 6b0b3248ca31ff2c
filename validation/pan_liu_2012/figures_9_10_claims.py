"""What Figures 9 and 10 claim, and which reading of the rod fits their axes."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pan_liu_2012.axes import (
    FIGURE_9,
    FIGURE_10,
    FILLS_TEXT,
    VISIBLE,
    VISIBLE_TEXT,
    fills,
    seen,
)
from pan_liu_2012.claims import (
    BY_CONSTRUCTION,
    NEAR,
    OBVIOUS,
    OBVIOUS_TEXT,
    OPEN,
    WIDER_TEXT,
    Judgement,
    Tables,
    agrees,
    claim,
)
from pan_liu_2012.figures_9_10 import (
    CRANKS,
    FRAME,
    FRAMES,
    MIDDLE,
    RATE,
    RATES,
    STRAINS,
    across,
    obvious,
    ranges,
    suffix,
)
from pan_liu_2012.runs import deviation, span

ROD = "slider-crank, rigid crank, 8 elements"


def judged_readings(tables: Tables) -> pd.DataFrame:
    """Every crank, frame and angular velocity by the one criterion, linear and nonlinear together.

    With the components of the middle's deformation that fill the axis of Fig. 9.
    """
    lines = []
    for crank in CRANKS:
        nine, ten = (tables[f"figure_{n}{suffix(crank)}"] for n in (9, 10))
        for frame in FRAMES:
            good = [
                name
                for name in MIDDLE.values()
                if fills(*ranges(nine, [f"{s}, {frame}, {name} [m]" for s in STRAINS]), FIGURE_9)
            ]
            for rate in RATES:
                columns = [f"{s}, {frame}, {rate} [rad/s]" for s in STRAINS]
                low, high = ranges(ten, columns)
                fits = bool(fills(low, high, FIGURE_10))
                lines.append(
                    {
                        "crank": crank,
                        "frame": frame,
                        "angular velocity": rate,
                        "nonlinear [rad/s]": span(ten[columns[0]]),
                        "linear [rad/s]": span(ten[columns[1]]),
                        "linear against nonlinear [-]": obvious(ten, frame, rate),
                        "share of Fig. 10 [-]": (high - low) / (FIGURE_10[1] - FIGURE_10[0]),
                        "fills Fig. 10": fits,
                        "component that fills Fig. 9": "; ".join(good) or "none",
                        "fills both": fits and bool(good),
                    }
                )
    return pd.DataFrame(lines)


@claim(
    "Linear and nonlinear slider-crank coincide from 0 to 0.35 s",
    "Fig. 9",
    "0.35 s",
    f"{ROD}, v of the middle across the axis, chord frame (tangent frame beside it)",
    VISIBLE_TEXT,
)
def coincide(tables: Tables) -> Judgement:
    parts, held = [], True
    for frame in FRAMES:
        exact, linear = across(tables["figure_9"], frame)
        apart = seen(linear, exact, FIGURE_9) > VISIBLE
        shares = np.abs(linear - exact) / (0.5 * np.ptp(exact))
        times = [exact.index[np.argmax(shares > level)] for level in (0.01, 0.02, 0.05)]
        first = exact.index[np.argmax(apart)]
        parts.append(
            f"{frame} frame: visibly apart from {first:.2f} s (by 1, 2 and 5 % of the amplitude "
            "from {:.2f}, {:.2f} and {:.2f} s)".format(*times)
        )
        held &= bool(first > 0.35)
    return Judgement("; ".join(parts), agrees(held), "it holds in both frames")


@claim(
    "Afterwards the linear amplitude is larger: no dynamic stiffening",
    "Fig. 9",
    "larger",
    f"{ROD}, v and u of the middle, chord frame and tangent frame",
    WIDER_TEXT,
)
def linear_wider(tables: Tables) -> Judgement:
    parts, ratios = [], []
    for frame in FRAMES:
        for component, where in (("v", "across"), ("u", "along")):
            exact, linear = (
                tables["figure_9"][f"{s}, {frame}, {component}, local [m]"] for s in STRAINS
            )
            ratios.append(np.ptp(linear) / np.ptp(exact))
            parts.append(f"{where}, {frame} frame: {ratios[-1]:.2f}")
    return Judgement(
        "; ".join(parts),
        agrees(min(ratios) > 1.0 + NEAR),
        "range linear over nonlinear; the paper gives no number",
    )


@claim(
    "The longitudinal deformation of the middle fills the axis",
    "Fig. 9",
    "-0.20 .. 0.20 m",
    f"{ROD}, both models, both frames, u along and v across the axis",
    FILLS_TEXT,
)
def drawn_component(tables: Tables) -> Judgement:
    parts, good = [], {}
    for frame in FRAMES:
        for component, where in (("u", "along"), ("v", "across")):
            names = [f"{s}, {frame}, {component}, local [m]" for s in STRAINS]
            low, high = ranges(tables["figure_9"], names)
            good[frame, component] = bool(fills(low, high, FIGURE_9))
            parts.append(f"{where} the axis, {frame} frame, {span((low, high))} m")
    fitting = [frame for frame in FRAMES if good[frame, "v"]]
    return Judgement(
        "; ".join(parts),
        agrees(any(good[frame, "u"] for frame in FRAMES)),
        f"the component across the rod fits the axis ({', '.join(fitting)} frame), the one along "
        "it does not",
    )


@claim(
    "The rod's angular velocity fills the axis",
    "Fig. 10",
    "within +-1.5 rad/s",
    "slider-crank, both models; 2 cranks, 2 frames, 4 angular velocities, with Fig. 9",
    FILLS_TEXT,
)
def rod_axis(tables: Tables) -> Judgement:
    table = judged_readings(tables)
    both = table[table["fills both"]]
    names = both[["crank", "frame", "angular velocity"]].agg(", ".join, axis=1)
    used = both[
        (both["crank"] == "rigid") & (both["frame"] == FRAME) & (both["angular velocity"] == RATE)
    ]
    shown = "; ".join(
        f"nonlinear {r['nonlinear [rad/s]']}, linear {r['linear [rad/s]']} rad/s"
        for _, r in used.iterrows()
    )
    return Judgement(
        f"{len(both)} of {len(table)} readings fill Figs. 9 and 10 ({'; '.join(names)}); "
        f"used: {shown}",
        BY_CONSTRUCTION if len(used) else agrees(False),
        "the chord frame with the angular velocity of the start section was chosen by these axes, "
        "as the one reading with the rigid crank; the tangent frame's misses by its linear curve",
    )


@claim(
    "The rod's angular velocity differs obviously between the two",
    "Fig. 10",
    "obvious differences",
    "slider-crank, angular velocity over 4.5 s, linear against nonlinear; every reading that "
    "fills Figs. 9 and 10",
    OBVIOUS_TEXT,
)
def rod_rate(tables: Tables) -> Judgement:
    table = judged_readings(tables)
    off = table["linear against nonlinear [-]"]
    both = off[table["fills both"]]
    chosen = obvious(tables["figure_10"], FRAME, RATE)
    chord = obvious(tables["figure_10"], FRAME, "chord")
    return Judgement(
        f"{chosen:.0%} in the reading used, {both.min():.0%} to {both.max():.0%} in those that "
        f"fill both axes; {int((off > OBVIOUS).sum())} of all {len(table)} are beyond the "
        f"threshold (the chord's rate with a rigid crank: {chord:.1%})",
        agrees(both.min() > OBVIOUS),
        "the readings were chosen by the axes alone; the chord itself hardly turns differently",
    )


@claim(
    "The crank may be taken as rigid (a reading, not stated)",
    "Fig. 8",
    "-",
    "slider-crank, nonlinear, chord frame: flexible against rigid crank",
    OBVIOUS_TEXT,
)
def flexible_crank(tables: Tables) -> Judgement:
    parts = []
    for name, column in (
        ("figure_9", f"nonlinear, {FRAME}, v, local [m]"),
        ("figure_10", f"nonlinear, {FRAME}, {RATE} [rad/s]"),
    ):
        rigid, flexible = tables[name][column], tables[f"{name}_flexible_crank"][column]
        parts.append(
            f"{column}: range {np.ptp(flexible) / np.ptp(rigid):.2f} times, largest difference "
            f"{deviation(flexible, rigid):.0%}"
        )
    columns = [f"{s}, {FRAME}, {RATE} [rad/s]" for s in STRAINS]
    beyond = np.abs(ranges(tables["figure_10_flexible_crank"], columns)).max() / FIGURE_10[1] - 1.0
    return Judgement(
        "; ".join(parts),
        OPEN,
        "the paper gives the crank's section but not whether it bends; it does matter. With a "
        f"flexible crank the start section turns {beyond:.0%} faster than the axis of Fig. 10 "
        "shows; the middle section would fit",
    )


CLAIMS = (
    coincide,
    linear_wider,
    drawn_component,
    rod_axis,
    rod_rate,
    flexible_crank,
)
