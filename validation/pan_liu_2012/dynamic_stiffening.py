"""Dynamic stiffening: spin-up of a straight beam and of the paper's curved beam."""

from dataclasses import replace

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from pan_liu_2012.claims import (
    CONVERGED_ERROR,
    CONVERGED_TEXT,
    UNDECIDED,
    Judgement,
    Tables,
    claim,
    judge_condition,
)
from pan_liu_2012.runs import (
    SECOND_METHOD,
    TIP_COLUMNS,
    compare_methods,
    measure_deviation,
    observe_run,
)
from spin_up import spin_up

import beamdae as bd

SPEEDS = (0.5, 1.0, 2.0, 4.0, 6.0)  # rad/s
ROTARY_INERTIA_SPEED = 4.0  # rad/s, at which the effect of rotary inertia is computed
RUN_UP_TIME = 5.0  # s
T_END = 8.0  # s
OUTPUT_STEP = 1e-2  # s
ELEMENTS = 8  # in all bodies, at least two in each
REFERENCE_BODIES = 8
NO_ROTARY_INERTIA = 1e-9  # factor of rho I; zero would make the mass matrix singular
SPIN_UP_SCHEME = bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-11)
ROOT = (0.05, 0.0)  # m
STEADY_TEXT = "mean tip deflection after the run-up"
STRAIGHT_T_END = 20.0  # s
LINEAR_T_END = 10.0  # s, at which the linear tip deflection is 72 m and growing
TIP_COMPONENTS = {"deformation.u [m]": "u", "deformation.v [m]": "v"}
# First-order steady extension rho A W^2 L^3 / (3 EA), published as 5.14e-4 m (Simo & Vu-Quoc, J.
# Appl. Mech. 53 (1986) 855), and exact for N = EA (r' - 1): tan(b L)/b - L, b^2 = rho A W^2/EA.
# b [1/m]
STRETCH_RATE = np.sqrt(1.2 * 6.0**2 / 2.8e7)
STEADY_EXTENSION = float(np.tan(STRETCH_RATE * 10.0) / STRETCH_RATE - 10.0)
# Tip displacement of the geometrically exact beam relative to the rotating undeformed one: an
# independent computation by p-version finite elements in absolute coordinates and generalized-alpha
# with Richardson extrapolation, accurate to 1e-7.
EXACT = pd.DataFrame(
    [
        (2.5, -0.0013227, -0.1512836),
        (5.0, -0.0126546, -0.4684762),
        (7.5, -0.0177419, -0.5590833),
        (10.0, -0.0070723, -0.3628143),
        (12.5, -0.0002218, -0.1126962),
        (15.0, 0.0005140, 0.0013036),
        (17.5, 0.0005136, 0.0036362),
        (20.0, 0.0005145, 0.0007266),
    ],
    columns=["t [s]", "u, exact [m]", "v, exact [m]"],
).set_index("t [s]")
EXACT_LARGEST_DEFLECTION = -0.5738347  # m, v
EXACT_LARGEST_SHORTENING = -0.0188232  # m, u


def driven_beam(
    speed: float, axis: bd.Arc | bd.Line, bodies: int, strain: str, rotary: float = 1.0
) -> bd.Mechanism:
    """Return the hub with its angle driven up to `speed` [rad/s]; `rotary` scales rho I."""
    original = hub_beam().part("beam").section
    section = replace(original, rotary_inertia_per_length=rotary * original.rhoI)
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.3))
    pivot = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("pivot", pivot, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", pivot, hub.at(0.0, 0.0), law=bd.run_up(speed, RUN_UP_TIME)))
    beams = bd.welded_beams(
        mech,
        "beam",
        axis,
        section,
        bodies,
        elements=max(ELEMENTS // bodies, 2),
        strain=strain,
        frame="tangent",
    )
    mech.add(bd.Weld("root", hub.at(*ROOT), beams[0].start))
    mech.observe("deformation", bd.relative_displacement(of=beams[-1].end, on=hub.at(*ROOT)))
    return mech


def list_beam_axes() -> dict[str, bd.Arc | bd.Line]:
    """Return the arc of 60 degrees of the hub beam, and a straight line of the same length."""
    arc = hub_beam(subtended=60.0).part("beam").curve
    return {"circular, 60 degrees": arc, "straight": bd.Line(ROOT, (ROOT[0] + arc.length, 0.0))}


def compute_curved_spin_up_errors(speed: float) -> dict[str, pd.DataFrame]:
    """Compute the error of the tip deformation by strain, against eight floating frames."""
    lines = []
    for shape, axis in list_beam_axes().items():

        def tip(bodies: int, strain: str, rotary: float = 1.0) -> pd.DataFrame:
            mechanism = driven_beam(speed, axis, bodies, strain, rotary)  # noqa: B023 called here alone
            return observe_run(mechanism, T_END, OUTPUT_STEP, SPIN_UP_SCHEME)[TIP_COLUMNS]

        exact, paper, linear = (
            tip(REFERENCE_BODIES, "nonlinear"),
            tip(1, "nonlinear"),
            tip(1, "linear"),
        )
        line = {
            "shape": shape,
            "speed [rad/s]": speed,
            "largest tip deflection over length [-]": np.hypot(*exact.to_numpy().T).max()
            / axis.length,
            "error, linear [-]": measure_deviation(linear, exact),
            "error, eq. (5) [-]": measure_deviation(paper, exact),
        }
        for name, run in (("exact", exact), ("linear", linear)):
            line[f"{STEADY_TEXT}, {name} [m]"] = np.hypot(
                *run.loc[RUN_UP_TIME:].to_numpy().T
            ).mean()
        if speed == ROTARY_INERTIA_SPEED:
            without = tip(1, "nonlinear", rotary=NO_ROTARY_INERTIA)
            line["change without rotary inertia [-]"] = measure_deviation(without, paper)
        lines.append(line)
    return {"curved_spin_up": pd.DataFrame(lines)}


def rows_of_shape(tables: Tables, shape: str) -> pd.DataFrame:
    """Return the rows of a shape, indexed by speed."""
    table = tables["curved_spin_up"]
    rows = table[table["shape"].str.startswith(shape)].set_index("speed [rad/s]")
    return rows.sort_index()


def format_percentages(values: pd.Series) -> str:
    """Format fractions as a list of percentages."""
    percent = (100.0 * x for x in values)
    return ", ".join(f"{x:.2g}" if x < 10.0 else f"{x:.0f}" for x in percent) + " %"


@claim(
    "Geometric nonlinearity is necessary at high rotating speed",
    "conclusions",
    "-",
    "the paper's circular beam of 60 degrees on a hub run up in 5 s to "
    f"{', '.join(f'{s:g}' for s in SPEEDS)} rad/s, tip deformation over 8 s, against eight "
    "floating frames; the straight spin-up beam of Simo & Vu-Quoc 1986",
    f"linear beyond an {CONVERGED_TEXT} from some speed on, its error growing with speed and at "
    "least five times that of eq. (5)",
)
def stiffening(tables: Tables) -> Judgement:
    curved = rows_of_shape(tables, "circular")
    linear, paper = curved["error, linear [-]"], curved["error, eq. (5) [-]"]
    from_speed = linear.index[linear > CONVERGED_ERROR].min()
    needed = np.all(np.diff(linear) > 0.0) and bool((linear[from_speed:] > CONVERGED_ERROR).all())
    straight = tables["spin_up"]["v, linear [m]"].abs().max()
    return Judgement(
        f"linear off by {format_percentages(linear)}, beyond the threshold from "
        f"{from_speed:g} rad/s; eq. (5) by {format_percentages(paper)}; straight spin-up beam at "
        f"6 rad/s: linear {straight:.0f} m at 10 s",
        judge_condition(
            needed and linear.iloc[-1] > CONVERGED_ERROR and np.all(linear > 5.0 * paper)
        ),
        "the linear model lacks the stiffening by centrifugal tension; on the straight beam it "
        "diverges",
    )


@claim(
    "The special nonlinear dynamic characteristics of the curved beam are concluded",
    "abstract",
    "-",
    "the same hub with the curved and with a straight beam, at constant speed after the run-up",
    "-",
)
def special_characteristics(tables: Tables) -> Judgement:
    parts = []
    for shape in ("circular", "straight"):
        row = rows_of_shape(tables, shape).loc[ROTARY_INERTIA_SPEED]
        exact, linear = (row[f"{STEADY_TEXT}, {name} [m]"] for name in ("exact", "linear"))
        parts.append(f"{shape} {exact:.2g} m, linear {linear:.2g} m")
    return Judgement(
        f"{STEADY_TEXT}, {ROTARY_INERTIA_SPEED:g} rad/s: {'; '.join(parts)}",
        UNDECIDED,
        "the conclusions name only the difference between the models; our result: at constant "
        "speed the curved beam stays bent by the centrifugal force, where the linear model is "
        "off, too; the straight beam returns to its shape",
    )


def compute_spin_up() -> dict[str, pd.DataFrame]:
    """Compute the tip displacement in the rotating axes every 20 ms, linear until 10 s."""
    runs = {
        "nonlinear": ("nonlinear", SPIN_UP_SCHEME, STRAIGHT_T_END),
        "linear": ("linear", SPIN_UP_SCHEME, LINEAR_T_END),
        "IDA": ("nonlinear", SECOND_METHOD, STRAIGHT_T_END),
    }
    histories = {
        name: observe_run(spin_up(strain=strain), end, 2e-2, integrator)
        for name, (strain, integrator, end) in runs.items()
    }
    ida = histories.pop("IDA")
    table = pd.DataFrame(
        {
            f"{component}, {name} [m]": run[column]
            for name, run in histories.items()
            for column, component in TIP_COMPONENTS.items()
        }
    )
    pairs = {f"spin-up, {c}": (histories["nonlinear"][c], ida[c]) for c in TIP_COMPONENTS}
    tables = {"spin_up": table, "spin_up_against_exact": compare_with_exact_beam(table)}
    return tables | compare_methods(pairs)


def compare_with_exact_beam(table: pd.DataFrame) -> pd.DataFrame:
    """Join the nonlinear run with the exact beam at the tabulated times."""
    rows = table.loc[[table.index[np.argmin(np.abs(table.index - t))] for t in EXACT.index]]
    rows.index = EXACT.index
    return EXACT.join(rows[["u, nonlinear [m]", "v, nonlinear [m]"]])


CLAIMS = (stiffening, special_characteristics)
