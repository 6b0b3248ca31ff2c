"""Data as printed and as used, and the ranges to which readings of lost numbers lead."""

from typing import Any

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from pan_liu_2012.claims import FIGURE_6, FIGURE_7, FIGURE_9, FIGURE_10, Axis, fits_axis
from pan_liu_2012.figures_9_10 import (
    MIDDLE_COLUMNS,
    OUTPUT_STEP,
    USED_FRAME,
    observed_slider_crank,
    rod_angular_velocities,
)
from pan_liu_2012.runs import (
    HUB_BEAM_T_END,
    PAPER_SCHEME,
    SCHEME,
    SLIDER_CRANK_T_END,
    TIP_COLUMNS,
    format_range,
    observe_run,
)
from pendulum import pendulum
from slider_crank import slider_crank

import beamdae as bd

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


SNAP_THROUGH_FACTOR = 2.0  # deformation over the axis of Fig. 9, beyond which the rod snaps through
HUB_READINGS = {
    "as used": {},
    "density 27 667 kg/m^3, as printed": {"density": 27667.0},
    "length 5/3 m, as extracted": {"length": 5.0 / 3.0},
    "torque 10 sin(2 t), as extracted": {"frequency": 1.0 / np.pi},
}


def compute_hub_readings(reading: str) -> dict[str, pd.DataFrame]:
    """Return ranges of Figs. 6 and 7 for one reading."""
    columns = observe_run(hub_beam(**HUB_READINGS[reading]), HUB_BEAM_T_END, 4e-3, PAPER_SCHEME)
    lines = [
        _make_row(
            "hub beam", reading, f"{c.split('.')[1][0]} of the tip [m]", figure, columns[c], axis
        )
        for c, figure, axis in zip(TIP_COLUMNS, ("6", "7"), (FIGURE_6, FIGURE_7), strict=True)
    ]
    return {"readings": pd.DataFrame(lines)}


USED_READING = {"frame": USED_FRAME, "crank": "rigid"}
CRANK_READINGS = {
    "as used": USED_READING,
    "speed 2 pi rad/s": USED_READING | {"speed": 2.0 * np.pi},
    "density 27 667 kg/m^3, as printed for the hub beam": USED_READING | {"density": 27667.0},
    "tangent frame": USED_READING | {"frame": "tangent"},
    "flexible crank": USED_READING | {"crank": "flexible"},
    "flexible crank, tangent frame": {"crank": "flexible", "frame": "tangent"},
}


def compute_crank_readings(reading: str) -> dict[str, pd.DataFrame]:
    """Return ranges of Figs. 9 and 10 for one reading, of both models together."""
    lines = []
    runs = (
        # The run of a reading may fail.
        bd.simulate(
            observed_slider_crank(strain=strain, **CRANK_READINGS[reading]),
            SCHEME,
            SLIDER_CRANK_T_END,
            OUTPUT_STEP,
        ).observed
        for strain in ("nonlinear", "linear")
    )
    both = pd.concat([_cut_before_snap_through(run) for run in runs])
    for column, name in MIDDLE_COLUMNS.items():
        quantity = f"{name}, of the middle [m]"
        lines.append(_make_row("slider-crank", reading, quantity, "9", both[column], FIGURE_9))
    for name, rate in rod_angular_velocities(both).items():
        quantity = f"angular velocity, {name} [rad/s]"
        lines.append(_make_row("slider-crank", reading, quantity, "10", rate, FIGURE_10))
    return {"readings": pd.DataFrame(lines)}


def _cut_before_snap_through(run: pd.DataFrame) -> pd.DataFrame:
    """Return the rows until the deformation of the rod is twice the axis of Fig. 9.

    The rod then snaps through, and later rows depend on rounding.
    """
    bent = np.flatnonzero(run["local.v [m]"].abs() > SNAP_THROUGH_FACTOR * FIGURE_9.end)
    return run.iloc[: bent[0]] if len(bent) else run


def _make_row(
    system: str,
    reading: str,
    quantity: str,
    figure: str,
    values: pd.Series,
    axis: Axis,
) -> dict[str, object]:
    low, high = float(values.min()), float(values.max())
    return {
        "system": system,
        "reading": reading,
        "quantity": quantity,
        "range": format_range(values),
        "figure": figure,
        "its axis": f"{axis.start:g} .. {axis.end:g}",
        "share of the axis [-]": (high - low) / axis.length,
        "fills it": bool(fits_axis(low, high, axis)),
    }
