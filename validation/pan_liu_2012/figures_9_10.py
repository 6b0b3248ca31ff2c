"""Figures 9 and 10: the slider-crank's rod, nonlinear beside linear, in two floating frames."""

from __future__ import annotations

import numpy as np
import pandas as pd
from slider_crank import slider_crank

import beamdae as bd
from pan_liu_2012.runs import WITNESS, deviation, observed, second_method

END, ROWS = 4.5, 1e-2
# The reading: chord frame, angular velocity of the start section (figures_9_10_claims.py).
FRAME, RATE = "chord", "start section"
FRAMES, STRAINS, CRANKS = ("chord", "tangent"), ("nonlinear", "linear"), ("rigid", "flexible")
MIDDLE = {"local.u [m]": "u, local", "local.v [m]": "v, local", "frame.u [m]": "u, frame"}
MIDDLE |= {"frame.v [m]": "v, frame"}
# What "the angular velocity of the connecting rod" may be. In the tangent frame that of the frame
# is that of the start section, in the chord frame that of the chord.
SECTIONS = ("start section", "middle section", "end section")
RATES = (*SECTIONS, "chord")


def mechanism(**parameters: object) -> bd.Mechanism:
    """The slider-crank with the deformation of the rod's middle, and the motion of its sections."""
    made = slider_crank(**parameters)
    rod = made.part("rod")
    for axes in ("local", "frame"):
        made.observe(axes, rod.deformation(rod.length / 2.0, axes=axes))
    for name, place in zip(SECTIONS, (rod.start, rod.at(rod.length / 2.0), rod.end), strict=True):
        made.observe(name, place)
    return made


def rates(found: pd.DataFrame) -> dict[str, pd.Series]:
    """Angular velocity [rad/s] of the rod by each reading."""
    read = {name: found[f"{name}.angle_dot [rad/s]"] for name in SECTIONS}
    x, y, vx, vy = (
        found[f"end section.{column}"] - found[f"start section.{column}"]
        for column in ("x [m]", "y [m]", "x_dot [m/s]", "y_dot [m/s]")
    )
    return read | {"chord": (x * vy - y * vx) / (x**2 + y**2)}


def suffix(crank: str) -> str:
    """Of the tables of a crank."""
    return "" if crank == "rigid" else "_flexible_crank"


def histories(crank: str) -> dict[str, pd.DataFrame]:
    """Figs. 9 and 10: one column a strain, a frame and a component or a rate."""
    nine, ten, pairs = {}, {}, {}
    for frame in FRAMES:
        for strain in STRAINS:
            found = observed(mechanism(frame=frame, strain=strain, crank=crank), END, ROWS)
            for column, name in MIDDLE.items():
                nine[f"{strain}, {frame}, {name} [m]"] = found[column]
            nine[f"{strain}, {frame}, slider [m]"] = found["slider.x [m]"]
            read = rates(found)
            ten |= {f"{strain}, {frame}, {name} [rad/s]": rate for name, rate in read.items()}
        linear = mechanism(frame=frame, strain="linear", crank=crank)
        witness = observed(linear, END, ROWS, WITNESS)
        pairs[f"9{suffix(crank)}, linear, {frame}, v, local"] = (
            found["local.v [m]"],
            witness["local.v [m]"],
        )
        pairs[f"10{suffix(crank)}, linear, {frame}, {RATE}"] = read[RATE], rates(witness)[RATE]
    tables = {
        f"figure_9{suffix(crank)}": pd.DataFrame(nine),
        f"figure_10{suffix(crank)}": pd.DataFrame(ten),
    }
    return tables | second_method(pairs)


def across(table: pd.DataFrame, frame: str) -> tuple[pd.Series, pd.Series]:
    """Deformation of the middle across the axis, nonlinear and linear."""
    return table[f"nonlinear, {frame}, v, local [m]"], table[f"linear, {frame}, v, local [m]"]


def obvious(table: pd.DataFrame, frame: str, rate: str) -> float:
    """Largest difference of the linear from the nonlinear angular velocity over its amplitude."""
    exact, linear = (table[f"{s}, {frame}, {rate} [rad/s]"] for s in STRAINS)
    return deviation(linear, exact)


def ranges(table: pd.DataFrame, columns: list[str]) -> tuple[float, float]:
    """Smallest and largest value of several columns."""
    values = table[columns].to_numpy()
    return float(np.min(values)), float(np.max(values))
