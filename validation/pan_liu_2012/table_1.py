"""Table 1, the pendulum of the experiment, and the data of the other two systems."""

from __future__ import annotations

from typing import Any

import pandas as pd
from hub_beam import hub_beam
from pendulum import pendulum
from slider_crank import slider_crank

PENDULUM = "pendulum (Table 1)"
HUB_BEAM = "hub and beam (eqs. 25-27)"
SLIDER_CRANK = "slider-crank (eq. 28)"


def compare_data() -> dict[str, pd.DataFrame]:
    """Return printed data beside those of the models."""
    strip, hub = pendulum().part("beam"), hub_beam()
    beam, half = hub.part("beam"), hub_beam(subtended=30.0).part("beam")
    crank = slider_crank()
    rod = crank.part("rod")
    tip = pendulum().part("tip mass")
    rows: list[tuple[str, str, str, Any]] = [
        (PENDULUM, "arc length [m]", "0.80", strip.length),
        (PENDULUM, "width times thickness [m^2]", "0.03 x 0.0025", strip.section.area),
        (PENDULUM, "density [kg/m^3]", "2760.0", strip.section.material.rho),
        (PENDULUM, "Poisson's ratio", "0.3", strip.section.material.nu),
        (PENDULUM, "elastic modulus [Pa]", "68.950e9", strip.section.material.E),
        (PENDULUM, "radius of the curved beam [m]", "0.85", 1.0 / strip.curve.curvature(0.0)),
        (PENDULUM, "initial angle [rad]", "0.60", strip.curve.tangent_angle(0.0)),
        (PENDULUM, "tip mass [kg]", "0.060", tip.mass),
        (HUB_BEAM, "density [kg/m^3]", "27 667", beam.section.material.rho),
        (HUB_BEAM, "elastic modulus [Pa]", "68.952e9", beam.section.material.E),
        (HUB_BEAM, "area [m^2]", "8e-5", beam.section.area),
        (HUB_BEAM, "second moment [m^4]", "1.06667e-8", beam.section.second_moment),
        (HUB_BEAM, "length [m]", "5/3 (a pi is lost)", beam.length),
        (HUB_BEAM, "radius at 30 degrees [m]", "-", 1.0 / half.curve.curvature(0.0)),
        (HUB_BEAM, "radius at 60 degrees [m]", "-", 1.0 / beam.curve.curvature(0.0)),
        (HUB_BEAM, "hub radius [m]", "0.05", beam.start.point[0]),
        (HUB_BEAM, "hub inertia [kg m^2]", "0.3", hub.part("hub").inertia),
        (SLIDER_CRANK, "crank length [m]", "1", rod.start.point[0]),
        (SLIDER_CRANK, "area [m^2]", "0.02 x 0.02", rod.section.area),
        (SLIDER_CRANK, "slider mass [kg]", "0.5", crank.part("slider").mass),
        (SLIDER_CRANK, "span of the rod [m]", "4", rod.end.point[0] - rod.start.point[0]),
        (SLIDER_CRANK, "rise of the rod [m]", "1", rod.curve.point(rod.length / 2.0)[1]),
        (SLIDER_CRANK, "density [kg/m^3]", "not stated", rod.section.material.rho),
    ]
    columns = ["system", "quantity", "printed", "used"]
    return {"table_1": pd.DataFrame(rows, columns=columns).astype({"used": float})}
