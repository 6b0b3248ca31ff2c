"""Numbers the print has lost or left open: every reading with the ranges it leads to."""

from __future__ import annotations

import numpy as np
import pandas as pd
from hub_beam import hub_beam

from pan_liu_2012.axes import FIGURE_6, FIGURE_7, FIGURE_9, FIGURE_10, Axis, fills
from pan_liu_2012.figures_9_10 import END, FRAME, MIDDLE, ROWS, mechanism, rates
from pan_liu_2012.runs import PAPER_SCHEME, observed, observed_until_failure, span

TIP = ["deformation.u [m]", "deformation.v [m]"]
HUB = {
    "as used": {},
    "density 27 667 kg/m^3, as printed": {"density": 27667.0},
    "length 5/3 m, as extracted": {"length": 5.0 / 3.0},
    "torque 10 sin(2 t), as extracted": {"frequency": 1.0 / np.pi},
}


def hub(reading: str) -> dict[str, pd.DataFrame]:
    """Ranges of Figs. 6 and 7 under one reading."""
    found = observed(hub_beam(**HUB[reading]), 2.0, 4e-3, PAPER_SCHEME)
    lines = [
        _line("hub beam", reading, f"{c.split('.')[1][0]} of the tip [m]", figure, found[c], axis)
        for c, figure, axis in zip(TIP, ("6", "7"), (FIGURE_6, FIGURE_7), strict=True)
    ]
    return {"readings": pd.DataFrame(lines)}


USED = {"frame": FRAME, "crank": "rigid"}
CRANK = {
    "as used": USED,
    "speed 2 pi rad/s": USED | {"speed": 2.0 * np.pi},
    "density 27 667 kg/m^3, as printed for the hub beam": USED | {"density": 27667.0},
    "tangent frame": USED | {"frame": "tangent"},
    "flexible crank": USED | {"crank": "flexible"},
    "flexible crank, tangent frame": {"crank": "flexible", "frame": "tangent"},
}


def crank(reading: str) -> dict[str, pd.DataFrame]:
    """Ranges of Figs. 9 and 10, nonlinear and linear together, under one reading."""
    lines = []
    runs = (
        observed_until_failure(mechanism(strain=strain, **CRANK[reading]), END, ROWS)
        for strain in ("nonlinear", "linear")
    )
    both = pd.concat([_before_snapping(run) for run in runs])
    for column, name in MIDDLE.items():
        quantity = f"{name}, of the middle [m]"
        lines.append(_line("slider-crank", reading, quantity, "9", both[column], FIGURE_9))
    for name, rate in rates(both).items():
        quantity = f"angular velocity, {name} [rad/s]"
        lines.append(_line("slider-crank", reading, quantity, "10", rate, FIGURE_10))
    return {"readings": pd.DataFrame(lines)}


def _before_snapping(run: pd.DataFrame) -> pd.DataFrame:
    """The rows until the rod is bent by twice the axis of Fig. 9.

    Then it snaps through, and what follows depends on rounding.
    """
    bent = np.flatnonzero(run["local.v [m]"].abs() > 2.0 * FIGURE_9[1])
    return run.iloc[: bent[0]] if len(bent) else run


def _line(
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
        "range": span(values),
        "figure": figure,
        "its axis": f"{axis[0]:g} .. {axis[1]:g}",
        "share of the axis [-]": (high - low) / (axis[1] - axis[0]),
        "fills it": bool(fills(low, high, axis)),
    }
