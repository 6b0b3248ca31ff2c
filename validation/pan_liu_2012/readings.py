"""Readings of lost or missing numbers, and the ranges to which each leads."""

from __future__ import annotations

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
    SLIDER_CRANK_T_END,
    TIP_COLUMNS,
    format_range,
    observe_run,
    observe_until_failure,
)

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
        observe_until_failure(
            observed_slider_crank(strain=strain, **CRANK_READINGS[reading]),
            SLIDER_CRANK_T_END,
            OUTPUT_STEP,
        )
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
