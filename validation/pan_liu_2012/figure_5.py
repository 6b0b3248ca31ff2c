"""Figures 5a to 5c: the pendulum's gauges and angular velocity, and their claims."""

import numpy as np
import pandas as pd
from pan_liu_2012.claims import (
    AGREES,
    AGREES_IN_DIRECTION,
    BY_CONSTRUCTION,
    DIFFERS,
    FIGURE_5A,
    FIGURE_5B,
    FIGURE_5C,
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
    PAPER_SCHEME,
    PENDULUM_STRAIN_T_END,
    PENDULUM_T_END,
    SCHEME,
    SECOND_METHOD,
    compare_methods,
    format_range,
    measure_deviation,
    observe_run,
)
from pendulum import pendulum

import beamdae as bd

# The paper does not state its damping coefficients. Ours: drag of a flat strip (C_d = 2) of
# 0.03 m in air of 1.2 kg/m^3, c = C_d rho_air width / 2, and a damping ratio of 0.28 percent in the
# first bending mode (8.8 Hz).
DAMPED = {"damping": 1e-4, "air_drag": 0.036}
UNDAMPED = {"damping": 0.0}
OUTPUT_STEP = 1e-2  # s
REST_DAMPING = 8.0  # 1/s, mass-proportional damping that brings the strip to rest
REST_TIME = 8.0  # s
HALF_THICKNESS = 0.00125  # m
# Arc length at each gauge [m].
GAUGES = {"gauge 1": 0.50, "gauge 2": 0.25, "gauge 2 at 0.70 m": 0.70}
FRAME_RATE = "frame.angle_dot [rad/s]"


def run_pendulum(strain: str, integrator: object = SCHEME, **parameters: object) -> pd.DataFrame:
    """Return gauges on both surfaces and the angular velocity, every 10 ms of 6 s."""
    mechanism = pendulum(strain=strain, **parameters)
    beam = mechanism.part("beam")
    for name, s in GAUGES.items():
        for surface, sign in (("lower", -1.0), ("upper", 1.0)):
            mechanism.observe(f"{name}, {surface}", beam.strain(s, sign * HALF_THICKNESS))
    return observe_run(mechanism, PENDULUM_T_END, OUTPUT_STEP, integrator)


def compute_figure_5() -> dict[str, pd.DataFrame]:
    """Compute Figs. 5a, 5b and 5c."""
    histories = {
        f"{strain}, {label}": run_pendulum(strain, **parameters)
        for label, parameters in (("damped", DAMPED), ("undamped", UNDAMPED))
        for strain in ("nonlinear", "linear")
    }
    tables = {}
    for figure, gauges in {"a": ["gauge 1"], "b": ["gauge 2", "gauge 2 at 0.70 m"]}.items():
        columns = {
            f"{gauge}, {surface}, {label} [-]": run[f"{gauge}, {surface} [-]"]
            for gauge in gauges
            for surface in ("lower", "upper")
            for label, run in histories.items()
        }
        tables[f"figure_5{figure}"] = pd.DataFrame(columns)
    tables["figure_5c"] = pd.DataFrame(
        {f"{k} [rad/s]": r[FRAME_RATE] for k, r in histories.items()}
    )
    ida = run_pendulum("nonlinear", SECOND_METHOD, **DAMPED)
    return tables | compare_methods(
        {
            f"5, {column}": (histories["nonlinear, damped"][column], ida[column])
            for column in ("gauge 1, lower [-]", "gauge 2, lower [-]", FRAME_RATE)
        }
    )


RADIUS = pendulum.parameters["radius"]
# Angle from the tangent at the root to the chord [rad].
CHORD_ANGLE = 0.5 * pendulum().part("beam").length / RADIUS
# Root tangent [rad] and sign of the curvature, by the meaning of "0.60 rad".
ORIENTATIONS = {
    "tangent 0.60 rad below the horizontal, bending up": (-0.60, 1.0),
    "tangent 0.60 rad above the horizontal, bending up": (0.60, 1.0),
    "tangent 0.60 rad below the horizontal, bending down": (-0.60, -1.0),
    "tangent 0.60 rad above the horizontal, bending down": (0.60, -1.0),
    "chord 0.60 rad below the horizontal, bending up": (-0.60 - CHORD_ANGLE, 1.0),
    "chord 0.60 rad below the horizontal, bending down": (-0.60 + CHORD_ANGLE, -1.0),
    "tangent 0.60 rad from the vertical, bending up": (0.60 - 0.5 * np.pi, 1.0),
    "tangent 0.60 rad from the vertical, bending down": (0.60 - 0.5 * np.pi, -1.0),
}
GAUGE_POSITIONS = np.round(np.arange(0.02, 0.79, 0.02), 2)


def pendulum_with_gauges(**parameters: object) -> tuple[bd.Mechanism, list[list[str]]]:
    """Return a pendulum with gauges along both surfaces, and their columns by surface."""
    mechanism = pendulum(**parameters)
    beam = mechanism.part("beam")
    names = []
    for surface in (-1.0, 1.0):
        names.append([f"gauge {surface} {s}" for s in GAUGE_POSITIONS])
        for name, s in zip(names[-1], GAUGE_POSITIONS, strict=True):
            mechanism.observe(name, beam.strain(s, surface * HALF_THICKNESS))
    return mechanism, [[f"{name} [-]" for name in row] for row in names]


def compute_strains(angle: float, sign: float, strain: str) -> tuple[np.ndarray, np.ndarray]:
    """Return strains (surfaces, times, positions) and the angular velocity of the frame."""
    mechanism, names = pendulum_with_gauges(
        angle=angle, radius=sign * RADIUS, strain=strain, **DAMPED
    )
    columns = observe_run(mechanism, PENDULUM_STRAIN_T_END, OUTPUT_STEP, PAPER_SCHEME)
    return np.array([columns[row].to_numpy() for row in names]), columns[FRAME_RATE].to_numpy()


def compute_strains_at_rest(sign: float) -> np.ndarray:
    """Return strains (2, 1, positions) of the hanging strip, where gauges may be zeroed."""
    mechanism, names = pendulum_with_gauges(
        angle=-0.5 * np.pi, radius=sign * RADIUS, mass_damping=REST_DAMPING
    )
    last = observe_run(mechanism, REST_TIME, REST_TIME, bd.GeneralizedAlpha(step=1e-2)).iloc[-1]
    return np.array([[last[row].to_numpy(float)] for row in names])


def scan_gauges(orientation: str) -> dict[str, pd.DataFrame]:
    """Return ranges of the gauges for one orientation: both surfaces and both zeros."""
    angle, sign = ORIENTATIONS[orientation]
    runs = {strain: compute_strains(angle, sign, strain) for strain in ("nonlinear", "linear")}
    rest = compute_strains_at_rest(sign)
    rates = np.concatenate([rate for _, rate in runs.values()])
    lines = []
    for tared in (False, True):
        for k, surface in enumerate(("lower", "upper")):
            values = {name: (x - tared * rest)[k] for name, (x, _) in runs.items()}
            low = np.min([x.min(axis=0) for x in values.values()], axis=0)
            high = np.max([x.max(axis=0) for x in values.values()], axis=0)
            line: dict[str, object] = {
                "orientation": orientation,
                "surface": surface,
                "zero": "hanging at rest" if tared else "unstrained",
                "angular velocity": format_range(rates),
                "fills Fig. 5c": bool(fits_axis(rates.min(), rates.max(), FIGURE_5C)),
            }
            for gauge, figure, axis in (
                ("gauge 1", "Fig. 5a", FIGURE_5A),
                ("gauge 2", "Fig. 5b", FIGURE_5B),
            ):
                at = int(np.argmin(np.abs(GAUGE_POSITIONS - GAUGES[gauge])))
                good = fits_axis(low, high, axis)
                line[f"{gauge} [1e-4]"] = format_range(np.array([low[at], high[at]]) * 1e4)
                line[f"fills {figure}"] = bool(good[at])
                line[f"would fill {figure} at [m]"] = _format_intervals(GAUGE_POSITIONS[good])
            lines.append(line)
    return {"gauge_scan": pd.DataFrame(lines)}


def _format_intervals(places: np.ndarray) -> str:
    """Format positions as intervals, such as '0.06-0.10, 0.66'."""
    if not len(places):
        return "nowhere"
    groups = np.split(places, np.flatnonzero(np.diff(places) > 0.021) + 1)
    return ", ".join(f"{g[0]:.2f}" if len(g) == 1 else f"{g[0]:.2f}-{g[-1]:.2f}" for g in groups)


PENDULUM_TEXT = "pendulum with our damping"


def get_gauge_strains(tables: Tables, figure: str, gauge: str) -> tuple[pd.Series, pd.Series]:
    """Return the nonlinear and the linear strain of a gauge over the 5 s of the figure."""
    table = tables[figure].iloc[:501]
    exact, linear = (table[f"{gauge}, lower, {s}, damped [-]"] for s in ("nonlinear", "linear"))
    return exact, linear


@claim(
    "The strain of gauge 1 stays within the axis",
    "Fig. 5a",
    "-1.6e-4 .. 0.4e-4",
    f"{PENDULUM_TEXT}, lower surface at 0.50 m, both models",
    FILLS_TEXT,
)
def gauge_range(tables: Tables) -> Judgement:
    curves = get_gauge_strains(tables, "figure_5a", "gauge 1")
    both = np.concatenate(curves)
    good = fits_axis(both.min(), both.max(), FIGURE_5A)
    return Judgement(
        f"nonlinear {format_range(curves[0])}, linear {format_range(curves[1])}",
        BY_CONSTRUCTION if good else judge_condition(good),
        "orientation and surface were chosen by this axis (gauge_scan.csv); damping coefficients "
        "are ours",
    )


@claim(
    "Linear strains differ significantly from the nonlinear ones",
    "Figs. 5a, 5b",
    "the curves are apart",
    f"{PENDULUM_TEXT}, gauges 1 and 2 over 5 s",
    f"{OBVIOUS_TEXT}; {WIDER_TEXT}",
)
def linear_strain(tables: Tables) -> Judgement:
    parts, apart = [], True
    for figure, gauge in (("figure_5a", "gauge 1"), ("figure_5b", "gauge 2")):
        exact, linear = get_gauge_strains(tables, figure, gauge)
        off, ratio = measure_deviation(linear, exact), np.ptp(linear) / np.ptp(exact)
        parts.append(
            f"{gauge}: largest difference {off:.0%} of the amplitude, range {ratio:.2f} times"
        )
        apart &= bool(off > OBVIOUS_DIFFERENCE and ratio > 1.0 + THRESHOLD_MARGIN)
    return Judgement(
        "; ".join(parts),
        judge_condition(apart),
        "the linear model has a larger range, and its bending vibrations get out of phase",
    )


@claim(
    "The strain of gauge 2 is about a third of that of gauge 1",
    "Fig. 5b",
    "-0.5e-4 .. 0.1e-4",
    f"{PENDULUM_TEXT}, range of gauge 2 over that of gauge 1, nonlinear; 8 orientations, "
    "2 surfaces, 2 zeros",
    "below a half, or a reading that fills the axis of Fig. 5b",
)
def second_gauge(tables: Tables) -> Judgement:
    second, _ = get_gauge_strains(tables, "figure_5b", "gauge 2")
    near_tip, _ = get_gauge_strains(tables, "figure_5b", "gauge 2 at 0.70 m")
    first, _ = get_gauge_strains(tables, "figure_5a", "gauge 1")
    ratio = np.ptp(second) / np.ptp(first)
    scan = tables["gauge_scan"]["fills Fig. 5b"]
    return Judgement(
        f"{format_range(second)}, {ratio:.2f} of gauge 1; {int(scan.sum())} of {len(scan)} "
        f"readings fill the axis; at 0.70 m: {format_range(near_tip)}",
        judge_condition(ratio < 0.5 or scan.any()),
        "a strip hinged at one end and free to rotate at the other bends most near 0.35 m, so a "
        "gauge at 0.25 m sees more than one at 0.50 m; one about 0.70 m from the hinge (0.10 m "
        "from the tip mass) would fit",
    )


@claim(
    "The nonlinear terms hardly affect the angular velocity",
    "Fig. 5c",
    "the curves agree well within +-6 rad/s",
    f"{PENDULUM_TEXT}, angular velocity of the floating frame over 6 s, linear against nonlinear",
    VISIBLE_TEXT,
)
def same_rate(tables: Tables) -> Judgement:
    table = tables["figure_5c"]
    exact, linear = (table[f"{s}, damped [rad/s]"] for s in ("nonlinear", "linear"))
    difference, visible_share = (
        np.abs(linear - exact),
        axis_share_of_difference(linear, exact, FIGURE_5C).max(),
    )
    share = measure_deviation(linear, exact)
    first, second = get_gauge_strains(tables, "figure_5a", "gauge 1")
    strain = measure_deviation(second, first)
    less = DIFFERS if share * (1.0 + THRESHOLD_MARGIN) > strain else AGREES_IN_DIRECTION
    return Judgement(
        f"largest difference {difference.max():.2f} rad/s at {difference.idxmax():.2f} s: "
        f"{visible_share:.1%} of the axis, {share:.1%} of the amplitude "
        f"(strain of gauge 1: {strain:.0%})",
        AGREES if visible_share < VISIBLE else less,
        "far less than in the strain, but visible in the figure",
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
        "-", UNDECIDED, "the measurements and the damping coefficients are not given in numbers"
    )


CLAIMS = (
    gauge_range,
    linear_strain,
    second_gauge,
    same_rate,
    experiment,
)
