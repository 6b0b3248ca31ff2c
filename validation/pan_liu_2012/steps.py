"""Error in time of the paper's step of 1e-3 s, by system."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from pan_liu_2012.claims import (
    CONVERGED_ERROR,
    CONVERGED_TEXT,
    Judgement,
    Tables,
    claim,
    judge_errors,
)
from pan_liu_2012.figure_5 import DAMPED
from pan_liu_2012.runs import (
    HUB_BEAM_T_END,
    PENDULUM_STRAIN_T_END,
    SLIDER_CRANK_T_END,
    TIP_COLUMNS,
    measure_deviation,
    observe_run,
)
from pan_liu_2012.table_2 import ELEMENTS, FULL
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd

PAPER_STEP = 1e-3  # s
STEPS = (2e-3, PAPER_STEP, 5e-4)
FINE_STEP = 1e-4  # s, a tenth of the paper's
SECOND_METHOD = bd.Ida(rtol=1e-7)
DEFORMATION, FORCE = "tip deformation", "normal force at the root"
HUB_QUANTITIES = {
    DEFORMATION: TIP_COLUMNS,
    FORCE: ["root force.N [N]"],
}
System = tuple[Callable[..., bd.Mechanism], dict[str, object], float, dict[str, list[str]]]
SYSTEMS: dict[str, System] = {
    "hub beam, 30 degrees, 4 curved": (
        hub_beam,
        {"subtended": 30.0, "elements": 4, **ELEMENTS[FULL]},
        HUB_BEAM_T_END,
        HUB_QUANTITIES,
    ),
    "hub beam, 60 degrees, 8 curved": (
        hub_beam,
        {"subtended": 60.0, "elements": 8, **ELEMENTS[FULL]},
        HUB_BEAM_T_END,
        HUB_QUANTITIES,
    ),
    "pendulum, damped": (
        pendulum,
        DAMPED,
        PENDULUM_STRAIN_T_END,
        {"gauge 1": ["gauge 1 [-]"], "angular velocity": ["frame.angle_dot [rad/s]"]},
    ),
    "slider-crank": (
        slider_crank,
        {"frame": "chord"},
        SLIDER_CRANK_T_END,
        {"v of the middle": ["mid-point.v [m]"], "slider": ["slider.x [m]"]},
    ),
}


def compute_step_errors(system: str) -> dict[str, pd.DataFrame]:
    """Compute the error of each quantity by step against a step of 1e-4 s, and that of IDA."""
    make, parameters, end, quantities = SYSTEMS[system]

    def run(integrator: object) -> pd.DataFrame:
        return observe_run(make(**parameters), end, 1e-2, integrator)

    def scheme(step: float) -> bd.GeneralizedAlpha:
        return bd.GeneralizedAlpha(step=step, newton_tolerance=1e-11)

    exact = run(scheme(FINE_STEP))
    others = [("IDA, rtol 1e-7", np.nan, run(SECOND_METHOD))]
    others += [("generalized-alpha", step, run(scheme(step))) for step in STEPS]
    lines = [
        {
            "system": system,
            "quantity": quantity,
            "integrator": name,
            "step [s]": step,
            "error [-]": measure_deviation(history[columns], exact[columns]),
        }
        for name, step, history in others
        for quantity, columns in quantities.items()
    ]
    return {"steps": pd.DataFrame(lines)}


@claim(
    "A step of 1e-3 s is small enough",
    "text, Table 2",
    "time step 0.001 s",
    "hub beam, tip deformation over 2 s, the paper's 4 and 8 curved elements: error in time alone",
    CONVERGED_TEXT,
)
def time_step(tables: Tables) -> Judgement:
    table = tables["steps"]
    rows = table[table["step [s]"] == PAPER_STEP].set_index(["system", "quantity"])["error [-]"]
    hub = [system for system in SYSTEMS if system.startswith("hub")]
    deformation = [rows[system, DEFORMATION] for system in hub]
    force = [rows[system, FORCE] for system in hub]
    return Judgement(
        f"{deformation[0]:.2%} (30 degrees) and {deformation[1]:.2%} (60 degrees); strain of the "
        f"pendulum {rows['pendulum, damped', 'gauge 1']:.2%}, middle of the rod "
        f"{rows['slider-crank', 'v of the middle']:.2%}",
        judge_errors(deformation, CONVERGED_ERROR),
        f"too large for forces: the error of the normal force at the root is {force[0]:.1%} and "
        f"{force[1]:.1%}, because its axial vibrations are not resolved",
    )


CLAIMS = (time_step,)
