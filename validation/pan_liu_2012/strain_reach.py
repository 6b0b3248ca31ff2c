"""Validity of the paper's strains: one floating frame against many that are welded together."""

from __future__ import annotations

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from slider_crank import slider_crank

from pan_liu_2012.runs import (
    HUB_BEAM_T_END,
    PAPER_SCHEME,
    SLIDER_CRANK_T_END,
    TIP_COLUMNS,
    TIP_U,
    TIP_V,
    measure_deviation,
    observe_run,
)

TORQUE_FACTORS = (1, 2, 5, 10)
BODY_COUNTS = (1, 2, 4, 8)
REFERENCE_BODIES = 16


def run_hub_beam(factor: float, bodies: int, strain: str = "nonlinear") -> pd.DataFrame:
    """Return the tip deformation in `bodies` floating frames, with at least eight elements."""
    mechanism = hub_beam(
        torque=10.0 * factor, bodies=bodies, elements=max(8 // bodies, 2), strain=strain
    )
    return observe_run(mechanism, HUB_BEAM_T_END, 4e-3, PAPER_SCHEME)[
        ["deformation.phi [rad]", *TIP_COLUMNS]
    ]


def compute_hub_beam_reach(factor: float) -> dict[str, pd.DataFrame]:
    """Compute the error of 1 to 8 floating frames against 16, and v over time."""
    exact = run_hub_beam(factor, REFERENCE_BODIES)
    length = 5.0 * np.pi / 3.0
    deflection = np.hypot(exact[TIP_U], exact[TIP_V]).max()
    line = {
        "torque factor": factor,
        "largest tip deflection over length [-]": deflection / length,
        "largest tip rotation [rad]": exact["deformation.phi [rad]"].abs().max(),
    }
    history = {}
    for bodies in BODY_COUNTS:
        frames = f"{bodies} frame{'s' * (bodies > 1)}"
        deformation = run_hub_beam(factor, bodies)[TIP_COLUMNS]
        line[f"error, {frames} [-]"] = measure_deviation(deformation, exact[TIP_COLUMNS])
        history[f"v, torque x {factor}, {frames} [m]"] = deformation[TIP_V]
    green = run_hub_beam(factor, 1, "green")
    line["error, Green's strain, 1 frame [-]"] = measure_deviation(
        green[TIP_COLUMNS], exact[TIP_COLUMNS]
    )
    linear = run_hub_beam(factor, 1, "linear")
    line["error, linear, 1 frame [-]"] = measure_deviation(linear[TIP_COLUMNS], exact[TIP_COLUMNS])
    history[f"v, torque x {factor}, linear [m]"] = linear[TIP_V]
    history[f"v, torque x {factor}, {REFERENCE_BODIES} frames [m]"] = exact[TIP_V]
    return {"reach": pd.DataFrame([line]), "reach_curves": pd.DataFrame(history)}


# Frame, number of bodies, strain.
ROD_VARIANTS = (
    ("tangent", 1, "linear"),
    ("chord", 1, "linear"),
    ("tangent", 1, "nonlinear"),
    ("chord", 1, "nonlinear"),
    ("tangent", 2, "nonlinear"),
    ("chord", 2, "nonlinear"),
    ("tangent", 4, "nonlinear"),
    ("chord", 4, "nonlinear"),
)


def run_slider_crank(frame: str, bodies: int, strain: str) -> pd.Series:
    """Return the position of the slider over time."""
    mechanism = slider_crank(
        frame=frame, bodies=bodies, strain=strain, elements=max(8 // bodies, 2)
    )
    return observe_run(mechanism, SLIDER_CRANK_T_END, 1e-2, PAPER_SCHEME)["slider.x [m]"]


def compute_slider_crank_reach() -> dict[str, pd.DataFrame]:
    """Compute the error of the slider's position by frame, bodies and strain."""
    exact = run_slider_crank("chord", 8, "nonlinear")
    lines = [
        {
            "frame": frame,
            "bodies": bodies,
            "strain": strain,
            "error of the slider [-]": measure_deviation(
                run_slider_crank(frame, bodies, strain), exact
            ),
        }
        for frame, bodies, strain in ROD_VARIANTS
    ]
    return {"reach_slider_crank": pd.DataFrame(lines)}
