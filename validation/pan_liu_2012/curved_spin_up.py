"""The paper's curved beam brought to ever higher speeds: linear and eq. (5) against many frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
from hub_beam import hub_beam

import beamdae as bd
from pan_liu_2012.claims import (
    CONVERGED,
    CONVERGED_TEXT,
    OPEN,
    Judgement,
    Tables,
    agrees,
    claim,
)
from pan_liu_2012.runs import deviation, observed

SPEEDS = (0.5, 1.0, 2.0, 4.0, 6.0)
RUN_UP, END, ROWS = 5.0, 8.0, 1e-2
SCHEME = bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-11)
COLUMNS = ["deformation.u [m]", "deformation.v [m]"]
ROOT = (0.05, 0.0)
AFTERWARDS = "mean tip deflection after the run-up"
# At this one what rotary inertia changes is looked at.
MIDDLE_SPEED = 4.0


def rotor(
    speed: float, axis: bd.Arc | bd.Line, bodies: int, strain: str, rotary: float = 1.0
) -> bd.Mechanism:
    """The hub with its angle prescribed, run up to `speed` [rad/s]; `rotary` scales rho I."""
    given = hub_beam().part("beam").section
    section = replace(given, rotary_inertia_per_length=rotary * given.rhoI)
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.3))
    pivot = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("pivot", pivot, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", pivot, hub.at(0.0, 0.0), law=bd.run_up(speed, RUN_UP)))
    beams = bd.welded_beams(
        mech,
        "beam",
        axis,
        section,
        bodies,
        elements=max(8 // bodies, 2),
        strain=strain,
        frame="tangent",
    )
    mech.add(bd.Weld("root", hub.at(*ROOT), beams[0].start))
    mech.observe("deformation", bd.relative_displacement(of=beams[-1].end, on=hub.at(*ROOT)))
    return mech


def axes() -> dict[str, bd.Arc | bd.Line]:
    """The arc of 60 degrees of the hub beam, and a straight line as long."""
    arc = hub_beam(subtended=60.0).part("beam").curve
    return {"circular, 60 degrees": arc, "straight": bd.Line(ROOT, (ROOT[0] + arc.length, 0.0))}


def errors(speed: float) -> dict[str, pd.DataFrame]:
    """Error of the tip deformation by strain, against eight floating frames."""
    lines = []
    for shape, axis in axes().items():

        def tip(bodies: int, strain: str, rotary: float = 1.0) -> pd.DataFrame:
            mechanism = rotor(speed, axis, bodies, strain, rotary)  # noqa: B023 called here alone
            return observed(mechanism, END, ROWS, SCHEME)[COLUMNS]

        exact, paper, linear = tip(8, "nonlinear"), tip(1, "nonlinear"), tip(1, "linear")
        line = {
            "shape": shape,
            "speed [rad/s]": speed,
            "largest tip deflection over length [-]": np.hypot(*exact.to_numpy().T).max()
            / axis.length,
            "error, linear [-]": deviation(linear, exact),
            "error, eq. (5) [-]": deviation(paper, exact),
        }
        for name, run in (("exact", exact), ("linear", linear)):
            line[f"{AFTERWARDS}, {name} [m]"] = np.hypot(*run.loc[RUN_UP:].to_numpy().T).mean()
        if speed == MIDDLE_SPEED:
            without = tip(1, "nonlinear", rotary=1e-9)
            line["change without rotary inertia [-]"] = deviation(without, paper)
        lines.append(line)
    return {"curved_spin_up": pd.DataFrame(lines)}


def found(tables: Tables, shape: str) -> pd.DataFrame:
    """The rows of a shape by speed."""
    table = tables["curved_spin_up"]
    rows = table[table["shape"].str.startswith(shape)].set_index("speed [rad/s]")
    return rows.sort_index()


def listed(values: pd.Series) -> str:
    """Percent, one after the other."""
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
    curved = found(tables, "circular")
    linear, paper = curved["error, linear [-]"], curved["error, eq. (5) [-]"]
    from_speed = linear.index[linear > CONVERGED].min()
    needed = np.all(np.diff(linear) > 0.0) and bool((linear[from_speed:] > CONVERGED).all())
    straight = tables["spin_up"]["v, linear [m]"].abs().max()
    return Judgement(
        f"linear off by {listed(linear)}, beyond the threshold from {from_speed:g} rad/s; eq. (5) "
        f"by {listed(paper)}; straight spin-up beam at 6 rad/s: linear {straight:.0f} m at 10 s",
        agrees(needed and linear.iloc[-1] > CONVERGED and np.all(linear > 5.0 * paper)),
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
        row = found(tables, shape).loc[MIDDLE_SPEED]
        exact, linear = (row[f"{AFTERWARDS}, {name} [m]"] for name in ("exact", "linear"))
        parts.append(f"{shape} {exact:.2g} m, linear {linear:.2g} m")
    return Judgement(
        f"{AFTERWARDS}, {MIDDLE_SPEED:g} rad/s: {'; '.join(parts)}",
        OPEN,
        "the conclusions name none but the difference between the models; found here: the curved "
        "beam stays bent by the centrifugal force at constant speed, and the linear model is off "
        "there too, the straight one comes back",
    )


CLAIMS = (stiffening, special_characteristics)
