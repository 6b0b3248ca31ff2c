"""How far the paper's strains reach: one floating frame against many welded together."""

from __future__ import annotations

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from slider_crank import slider_crank

from pan_liu_2012.runs import PAPER_SCHEME, deviation, observed

FACTORS = (1, 2, 5, 10)
BODIES = (1, 2, 4, 8)
REFERENCE_BODIES = 16
COLUMNS = ["deformation.u [m]", "deformation.v [m]"]


def tip(factor: float, bodies: int, strain: str = "nonlinear") -> pd.DataFrame:
    """Tip deformation in `bodies` floating frames, at least eight elements in all."""
    mechanism = hub_beam(
        torque=10.0 * factor, bodies=bodies, elements=max(8 // bodies, 2), strain=strain
    )
    return observed(mechanism, 2.0, 4e-3, PAPER_SCHEME)[["deformation.phi [rad]", *COLUMNS]]


def hub(factor: float) -> dict[str, pd.DataFrame]:
    """Error of one, two, ... floating frames against 16; and v over time."""
    exact = tip(factor, REFERENCE_BODIES)
    length = 5.0 * np.pi / 3.0
    deflection = np.hypot(exact[COLUMNS[0]], exact[COLUMNS[1]]).max()
    line = {
        "torque factor": factor,
        "largest tip deflection over length [-]": deflection / length,
        "largest tip rotation [rad]": exact["deformation.phi [rad]"].abs().max(),
    }
    history = {}
    for bodies in BODIES:
        found = tip(factor, bodies)
        line[f"error, {bodies} frame{'s' * (bodies > 1)} [-]"] = deviation(
            found[COLUMNS], exact[COLUMNS]
        )
        history[f"v, torque x {factor}, {bodies} frame{'s' * (bodies > 1)} [m]"] = found[COLUMNS[1]]
    green = tip(factor, 1, "green")
    line["error, Green's strain, 1 frame [-]"] = deviation(green[COLUMNS], exact[COLUMNS])
    linear = tip(factor, 1, "linear")
    line["error, linear, 1 frame [-]"] = deviation(linear[COLUMNS], exact[COLUMNS])
    history[f"v, torque x {factor}, linear [m]"] = linear[COLUMNS[1]]
    history[f"v, torque x {factor}, {REFERENCE_BODIES} frames [m]"] = exact[COLUMNS[1]]
    return {"reach": pd.DataFrame([line]), "reach_curves": pd.DataFrame(history)}


# Frame, number of bodies, strain.
RODS = (
    ("tangent", 1, "linear"),
    ("chord", 1, "linear"),
    ("tangent", 1, "nonlinear"),
    ("chord", 1, "nonlinear"),
    ("tangent", 2, "nonlinear"),
    ("chord", 2, "nonlinear"),
    ("tangent", 4, "nonlinear"),
    ("chord", 4, "nonlinear"),
)


def slider(frame: str, bodies: int, strain: str) -> pd.Series:
    """Position of the slider over time."""
    mechanism = slider_crank(
        frame=frame, bodies=bodies, strain=strain, elements=max(8 // bodies, 2)
    )
    return observed(mechanism, 4.5, 1e-2, PAPER_SCHEME)["slider.x [m]"]


def rod() -> dict[str, pd.DataFrame]:
    """Error of the slider's position: which frame, and how many."""
    exact = slider("chord", 8, "nonlinear")
    lines = [
        {
            "frame": frame,
            "bodies": bodies,
            "strain": strain,
            "error of the slider [-]": deviation(slider(frame, bodies, strain), exact),
        }
        for frame, bodies, strain in RODS
    ]
    return {"reach_slider_crank": pd.DataFrame(lines)}
