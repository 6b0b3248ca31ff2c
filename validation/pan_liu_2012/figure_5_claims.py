"""What Figures 5a to 5c claim."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pan_liu_2012.axes import FIGURE_5A, FIGURE_5C, FILLS_TEXT, VISIBLE, VISIBLE_TEXT, fills, seen
from pan_liu_2012.claims import (
    AGREES,
    BY_CONSTRUCTION,
    DIFFERS,
    IN_DIRECTION,
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
from pan_liu_2012.runs import deviation, span

PENDULUM = "pendulum with our damping"


def drawn(tables: Tables, figure: str, gauge: str) -> tuple[pd.Series, pd.Series]:
    """Nonlinear and linear strain of a gauge over the 5 s of the figure."""
    table = tables[figure].iloc[:501]
    exact, linear = (table[f"{gauge}, lower, {s}, damped [-]"] for s in ("nonlinear", "linear"))
    return exact, linear


@claim(
    "The strain of gauge 1 stays within the axis",
    "Fig. 5a",
    "-1.6e-4 .. 0.4e-4",
    f"{PENDULUM}, lower surface at 0.50 m, both models",
    FILLS_TEXT,
)
def gauge_range(tables: Tables) -> Judgement:
    curves = drawn(tables, "figure_5a", "gauge 1")
    both = np.concatenate(curves)
    good = fills(both.min(), both.max(), FIGURE_5A)
    return Judgement(
        f"nonlinear {span(curves[0])}, linear {span(curves[1])}",
        BY_CONSTRUCTION if good else agrees(good),
        "orientation and surface were chosen by this axis (gauge_scan.csv); damping coefficients "
        "are ours",
    )


@claim(
    "Linear strains differ significantly from the nonlinear ones",
    "Figs. 5a, 5b",
    "the curves are apart",
    f"{PENDULUM}, gauges 1 and 2 over 5 s",
    f"{OBVIOUS_TEXT}; {WIDER_TEXT}",
)
def linear_strain(tables: Tables) -> Judgement:
    parts, apart = [], True
    for figure, gauge in (("figure_5a", "gauge 1"), ("figure_5b", "gauge 2")):
        exact, linear = drawn(tables, figure, gauge)
        off, ratio = deviation(linear, exact), np.ptp(linear) / np.ptp(exact)
        parts.append(
            f"{gauge}: largest difference {off:.0%} of the amplitude, range {ratio:.2f} times"
        )
        apart &= bool(off > OBVIOUS and ratio > 1.0 + NEAR)
    return Judgement(
        "; ".join(parts),
        agrees(apart),
        "the linear model swings wider, and its bending vibrations get out of phase",
    )


@claim(
    "The strain of gauge 2 is about a third of that of gauge 1",
    "Fig. 5b",
    "-0.5e-4 .. 0.1e-4",
    f"{PENDULUM}, range of gauge 2 over that of gauge 1, nonlinear; 8 orientations, 2 surfaces, 2 "
    "zeros",
    "below a half, or a reading that fills the axis of Fig. 5b",
)
def second_gauge(tables: Tables) -> Judgement:
    second, _ = drawn(tables, "figure_5b", "gauge 2")
    moved, _ = drawn(tables, "figure_5b", "gauge 2 at 0.70 m")
    first, _ = drawn(tables, "figure_5a", "gauge 1")
    ratio = np.ptp(second) / np.ptp(first)
    scan = tables["gauge_scan"]["fills Fig. 5b"]
    return Judgement(
        f"{span(second)}, {ratio:.2f} of gauge 1; {int(scan.sum())} of {len(scan)} readings fill "
        f"the axis; at 0.70 m: {span(moved)}",
        agrees(ratio < 0.5 or scan.any()),
        "a strip hinged at one end and free to turn at the other bends most near 0.35 m, so a "
        "gauge at 0.25 m sees more than one at 0.50 m; one about 0.70 m from the hinge (0.10 m "
        "from the tip mass) would fit",
    )


@claim(
    "The nonlinear terms hardly affect the angular velocity",
    "Fig. 5c",
    "the curves agree well within +-6 rad/s",
    f"{PENDULUM}, angular velocity of the floating frame over 6 s, linear against nonlinear",
    VISIBLE_TEXT,
)
def same_rate(tables: Tables) -> Judgement:
    table = tables["figure_5c"]
    exact, linear = (table[f"{s}, damped [rad/s]"] for s in ("nonlinear", "linear"))
    off, shown = np.abs(linear - exact), seen(linear, exact, FIGURE_5C).max()
    share = deviation(linear, exact)
    first, second = drawn(tables, "figure_5a", "gauge 1")
    strain = deviation(second, first)
    less = DIFFERS if share * (1.0 + NEAR) > strain else IN_DIRECTION
    return Judgement(
        f"largest difference {off.max():.2f} rad/s at {off.idxmax():.2f} s: {shown:.1%} of the "
        f"axis, {share:.1%} of the amplitude (strain of gauge 1: {strain:.0%})",
        AGREES if shown < VISIBLE else less,
        "far less than the strain, but to be seen in the figure",
    )


@claim(
    "The nonlinear model agrees with the experiment, damping included",
    "Figs. 5a to 5c",
    "-",
    "-",
    "-",
)
def experiment(tables: Tables) -> Judgement:
    return Judgement(
        "-", OPEN, "the measurements and the damping coefficients are not given in numbers"
    )


CLAIMS = (
    gauge_range,
    linear_strain,
    second_gauge,
    same_rate,
    experiment,
)
