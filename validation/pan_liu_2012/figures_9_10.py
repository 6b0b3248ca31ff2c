"""Figures 9 and 10: the slider-crank's rod by frame, strain and crank, and the claims."""

import numpy as np
import pandas as pd
from pan_liu_2012.claims import (
    BY_CONSTRUCTION,
    FIGURE_9,
    FIGURE_10,
    FILLS_TEXT,
    OBVIOUS_DIFFERENCE,
    OBVIOUS_TEXT,
    THRESHOLD_MARGIN,
    UNDECIDED,
    VISIBLE,
    VISIBLE_TEXT,
    WIDER_TEXT,
    Judgement,
    Tables,
    axis_share_of_difference,
    claim,
    fits_axis,
    judge_condition,
)
from pan_liu_2012.runs import (
    SECOND_METHOD,
    SLIDER_CRANK_T_END,
    compare_methods,
    format_range,
    measure_deviation,
    observe_run,
)
from slider_crank import slider_crank

import beamdae as bd

OUTPUT_STEP = 1e-2  # s
# The reading used: chord frame, angular velocity of the start section (see the claims below).
USED_FRAME = "chord"
USED_RATE = "start section"
FRAMES = ("chord", "tangent")
STRAINS = ("nonlinear", "linear")
CRANKS = ("rigid", "flexible")
MIDDLE_COLUMNS = {"local.u [m]": "u, local", "local.v [m]": "v, local", "frame.u [m]": "u, frame"}
MIDDLE_COLUMNS |= {"frame.v [m]": "v, frame"}
# Candidates for "the angular velocity of the connecting rod". The tangent frame rotates with the
# start section, the chord frame with the chord.
ROD_SECTIONS = ("start section", "middle section", "end section")
RATES = (*ROD_SECTIONS, "chord")


def observed_slider_crank(**parameters: object) -> bd.Mechanism:
    """Return the slider-crank with the rod's middle and sections observed."""
    made = slider_crank(**parameters)
    rod = made.part("rod")
    for axes in ("local", "frame"):
        made.observe(axes, rod.deformation(rod.length / 2.0, axes=axes))
    for name, place in zip(
        ROD_SECTIONS, (rod.start, rod.at(rod.length / 2.0), rod.end), strict=True
    ):
        made.observe(name, place)
    return made


def rod_angular_velocities(columns: pd.DataFrame) -> dict[str, pd.Series]:
    """Return the angular velocity [rad/s] of the rod by each reading."""
    rates = {name: columns[f"{name}.angle_dot [rad/s]"] for name in ROD_SECTIONS}
    x, y, vx, vy = (
        columns[f"end section.{column}"] - columns[f"start section.{column}"]
        for column in ("x [m]", "y [m]", "x_dot [m/s]", "y_dot [m/s]")
    )
    return rates | {"chord": (x * vy - y * vx) / (x**2 + y**2)}


def table_suffix(crank: str) -> str:
    """Return the suffix of table names for a crank."""
    return "" if crank == "rigid" else "_flexible_crank"


def compute_figures_9_10(crank: str) -> dict[str, pd.DataFrame]:
    """Compute Figs. 9 and 10: a column for each strain, frame and component or rate."""
    nine, ten, pairs = {}, {}, {}
    for frame in FRAMES:
        for strain in STRAINS:
            columns = observe_run(
                observed_slider_crank(frame=frame, strain=strain, crank=crank),
                SLIDER_CRANK_T_END,
                OUTPUT_STEP,
            )
            for column, name in MIDDLE_COLUMNS.items():
                nine[f"{strain}, {frame}, {name} [m]"] = columns[column]
            nine[f"{strain}, {frame}, slider [m]"] = columns["slider.x [m]"]
            rates = rod_angular_velocities(columns)
            ten |= {f"{strain}, {frame}, {name} [rad/s]": rate for name, rate in rates.items()}
        linear = observed_slider_crank(frame=frame, strain="linear", crank=crank)
        ida = observe_run(linear, SLIDER_CRANK_T_END, OUTPUT_STEP, SECOND_METHOD)
        pairs[f"9{table_suffix(crank)}, linear, {frame}, v, local"] = (
            columns["local.v [m]"],
            ida["local.v [m]"],
        )
        pairs[f"10{table_suffix(crank)}, linear, {frame}, {USED_RATE}"] = (
            rates[USED_RATE],
            rod_angular_velocities(ida)[USED_RATE],
        )
    tables = {
        f"figure_9{table_suffix(crank)}": pd.DataFrame(nine),
        f"figure_10{table_suffix(crank)}": pd.DataFrame(ten),
    }
    return tables | compare_methods(pairs)


def measure_rate_deviation(table: pd.DataFrame, frame: str, rate: str) -> float:
    """Return the deviation of the linear from the nonlinear angular velocity."""
    exact, linear = (table[f"{s}, {frame}, {rate} [rad/s]"] for s in STRAINS)
    return measure_deviation(linear, exact)


def value_range(table: pd.DataFrame, columns: list[str]) -> tuple[float, float]:
    """Return the smallest and the largest value of several columns."""
    values = table[columns].to_numpy()
    return float(np.min(values)), float(np.max(values))


ROD_TEXT = "slider-crank, rigid crank, 8 elements"


def judge_readings(tables: Tables) -> pd.DataFrame:
    """Judge every crank, frame and angular velocity by one criterion, both models together.

    The rows also list the components of the middle's deformation that fit the axis of Fig. 9.
    """
    lines = []
    for crank in CRANKS:
        nine, ten = (tables[f"figure_{n}{table_suffix(crank)}"] for n in (9, 10))
        for frame in FRAMES:
            good = [
                name
                for name in MIDDLE_COLUMNS.values()
                if fits_axis(
                    *value_range(nine, [f"{s}, {frame}, {name} [m]" for s in STRAINS]), FIGURE_9
                )
            ]
            for rate in RATES:
                columns = [f"{s}, {frame}, {rate} [rad/s]" for s in STRAINS]
                low, high = value_range(ten, columns)
                fits = bool(fits_axis(low, high, FIGURE_10))
                lines.append(
                    {
                        "crank": crank,
                        "frame": frame,
                        "angular velocity": rate,
                        "nonlinear [rad/s]": format_range(ten[columns[0]]),
                        "linear [rad/s]": format_range(ten[columns[1]]),
                        "linear against nonlinear [-]": measure_rate_deviation(ten, frame, rate),
                        "share of Fig. 10 [-]": (high - low) / FIGURE_10.length,
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
    f"{ROD_TEXT}, v of the middle across the axis, chord frame (tangent frame beside it)",
    VISIBLE_TEXT,
)
def coincide(tables: Tables) -> Judgement:
    parts, is_later = [], True
    for frame in FRAMES:
        exact, linear = (tables["figure_9"][f"{s}, {frame}, v, local [m]"] for s in STRAINS)
        apart = axis_share_of_difference(linear, exact, FIGURE_9) > VISIBLE
        shares = np.abs(linear - exact) / (0.5 * np.ptp(exact))
        times = [exact.index[np.argmax(shares > level)] for level in (0.01, 0.02, 0.05)]
        first = exact.index[np.argmax(apart)]
        parts.append(
            f"{frame} frame: visibly apart from {first:.2f} s (by 1, 2 and 5 % of the amplitude "
            "from {:.2f}, {:.2f} and {:.2f} s)".format(*times)
        )
        is_later &= bool(first > 0.35)
    return Judgement("; ".join(parts), judge_condition(is_later), "true in both frames")


@claim(
    "Afterwards the linear amplitude is larger: no dynamic stiffening",
    "Fig. 9",
    "larger",
    f"{ROD_TEXT}, v and u of the middle, chord frame and tangent frame",
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
        judge_condition(min(ratios) > 1.0 + THRESHOLD_MARGIN),
        "range linear over nonlinear; the paper gives no number",
    )


@claim(
    "The longitudinal deformation of the middle fills the axis",
    "Fig. 9",
    "-0.20 .. 0.20 m",
    f"{ROD_TEXT}, both models, both frames, u along and v across the axis",
    FILLS_TEXT,
)
def drawn_component(tables: Tables) -> Judgement:
    parts, good = [], {}
    for frame in FRAMES:
        for component, where in (("u", "along"), ("v", "across")):
            names = [f"{s}, {frame}, {component}, local [m]" for s in STRAINS]
            low, high = value_range(tables["figure_9"], names)
            good[frame, component] = bool(fits_axis(low, high, FIGURE_9))
            parts.append(f"{where} the axis, {frame} frame, {format_range((low, high))} m")
    fitting = [frame for frame in FRAMES if good[frame, "v"]]
    return Judgement(
        "; ".join(parts),
        judge_condition(any(good[frame, "u"] for frame in FRAMES)),
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
    table = judge_readings(tables)
    both = table[table["fills both"]]
    names = both[["crank", "frame", "angular velocity"]].agg(", ".join, axis=1)
    used = both[
        (both["crank"] == "rigid")
        & (both["frame"] == USED_FRAME)
        & (both["angular velocity"] == USED_RATE)
    ]
    used_ranges = "; ".join(
        f"nonlinear {r['nonlinear [rad/s]']}, linear {r['linear [rad/s]']} rad/s"
        for _, r in used.iterrows()
    )
    return Judgement(
        f"{len(both)} of {len(table)} readings fill Figs. 9 and 10 ({'; '.join(names)}); "
        f"used: {used_ranges}",
        BY_CONSTRUCTION if len(used) else judge_condition(False),
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
    table = judge_readings(tables)
    deviations = table["linear against nonlinear [-]"]
    both = deviations[table["fills both"]]
    used = measure_rate_deviation(tables["figure_10"], USED_FRAME, USED_RATE)
    chord = measure_rate_deviation(tables["figure_10"], USED_FRAME, "chord")
    return Judgement(
        f"{used:.0%} in the reading used, {both.min():.0%} to {both.max():.0%} in those that "
        f"fill both axes; {int((deviations > OBVIOUS_DIFFERENCE).sum())} of all {len(table)} are "
        f"beyond the threshold (the chord's rate with a rigid crank: {chord:.1%})",
        judge_condition(both.min() > OBVIOUS_DIFFERENCE),
        "the readings were chosen by the axes alone; the rotation of the chord hardly differs",
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
        ("figure_9", f"nonlinear, {USED_FRAME}, v, local [m]"),
        ("figure_10", f"nonlinear, {USED_FRAME}, {USED_RATE} [rad/s]"),
    ):
        rigid, flexible = tables[name][column], tables[f"{name}_flexible_crank"][column]
        parts.append(
            f"{column}: range {np.ptp(flexible) / np.ptp(rigid):.2f} times, largest difference "
            f"{measure_deviation(flexible, rigid):.0%}"
        )
    columns = [f"{s}, {USED_FRAME}, {USED_RATE} [rad/s]" for s in STRAINS]
    beyond = (
        np.abs(value_range(tables["figure_10_flexible_crank"], columns)).max() / FIGURE_10.end - 1.0
    )
    return Judgement(
        "; ".join(parts),
        UNDECIDED,
        "the paper gives the crank's section but not its flexibility, which matters. With a "
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
