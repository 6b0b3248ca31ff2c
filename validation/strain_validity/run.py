"""Measure the range of validity of floating-frame strains, the basis of `Solution.validity`.

    python validation/strain_validity/run.py

Cantilevers bent by end loads are compared with exact solutions, the hub beam and the slider-crank
with 16 and 8 bodies in chord frames with Green's strain. Errors are relative to the displacement of
the tip or half the range of the motion; rotations are relative to the floating frames.
"""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2] / "models")]

import warnings

import numpy as np
import pandas as pd
from hub_beam import hub_beam
from slider_crank import slider_crank

import beamdae as bd
from strain_validity.statics import SECTION, cantilever, solve_exact_tips, solve_tips_and_rotations

EI = SECTION.EI
LOADS = {
    "moment": ((0.0, 0.0), np.pi * EI),
    "- moment": ((0.0, 0.0), -np.pi * EI),
    "force y": ((0.0, 6.0 * EI), 0.0),
    "- force y": ((0.0, -6.0 * EI), 0.0),
    "force x": ((4.0 * EI, 0.0), 0.0),
    "- force x": ((-4.0 * EI, 0.0), 0.0),
}
# Load factors, applied as times.
TIMES = np.array([0.003, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.17, 0.25, 0.35, 0.5, 0.7, 1.0])
# Relative errors for which the rotation is tabulated.
LEVELS = (1e-3, 1e-2, 5e-2)
FRAMES = ("tangent", "chord")
INTEGRATOR = bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-7)


def create_curve(degrees: float):
    """Return a line or arc of 1 m that subtends the given angle."""
    if degrees == 0.0:
        return bd.Line((0.0, 0.0), (1.0, 0.0))
    return bd.Arc(radius=1.0 / np.radians(degrees), length=1.0)


def interpolate_rotation(error, rotation, level):
    """Return the rotation at which the error first exceeds `level`, or infinity."""
    (above,) = np.nonzero(error > level)
    if not len(above):
        return np.inf
    if above[0] == 0:
        return rotation[0]
    part = slice(above[0] - 1, above[0] + 1)
    return float(np.exp(np.interp(np.log(level), np.log(error[part]), np.log(rotation[part]))))


def measure_cantilevers(degrees=(0, 60, 180), bodies=(1, 2, 4, 8), loads=LOADS) -> pd.DataFrame:
    """Tabulate the rotations at which the tip error exceeds 0.1, 1 and 5 % of the displacement."""
    rows = []
    for angle, (load, (force, moment)) in product(degrees, loads.items()):
        if angle == 0 and load not in ("moment", "force y"):
            continue
        axis = create_curve(angle)
        exact = solve_exact_tips(axis, force, moment, TIMES)
        displacement = np.linalg.norm(exact - axis.point(1.0), axis=1)
        for strain, frame, n in product(("nonlinear", "green"), FRAMES, bodies):
            if angle == 0 and strain == "green":
                continue
            equations = cantilever(axis, force, moment, n, frame=frame, strain=strain)
            tip, rotation = solve_tips_and_rotations(equations, TIMES)
            k = len(tip)
            error = np.linalg.norm(tip - exact[:k], axis=1) / displacement[:k]
            row = {"turn [deg]": angle, "load": load, "strain": strain, "frame": frame, "bodies": n}
            row |= {
                f"{level:.1%}": interpolate_rotation(error, rotation, level) for level in LEVELS
            }
            rows.append(row | {"last error": error[-1], "last rotation": rotation[-1]})
    return pd.DataFrame(rows)


def _simulate_columns(mechanism, t_end, columns):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(mechanism, INTEGRATOR, t_end=t_end, output_step=1e-2)
    return solution.observed[columns].to_numpy(), solution.validity


def measure_mechanisms() -> pd.DataFrame:
    """Tabulate measured and predicted errors of the hub beam and the slider-crank."""
    tip, slider = ["deformation.u [m]", "deformation.v [m]"], ["slider.x [m]"]
    cases = {f"hub beam x {k}": (hub_beam, {"torque": 10.0 * k}, 16, tip) for k in (1, 2, 5, 10)}
    cases["slider-crank"] = (slider_crank, {}, 8, slider)
    rows = []
    for name, (model, parameters, most_bodies, columns) in cases.items():

        def run(bodies, strain, frame, model=model, parameters=parameters, columns=columns):
            elements = max(8 // bodies, 2)
            settings = {"bodies": bodies, "elements": elements, "strain": strain, "frame": frame}
            return _simulate_columns(model(**parameters, **settings), model.t_end, columns)

        exact, _ = run(most_bodies, "green", "chord")
        half = 0.5 * np.max(np.ptp(exact, axis=0))
        for strain, frame, bodies in product(("linear", "nonlinear", "green"), FRAMES, (1, 2, 4)):
            motion, beams = run(bodies, strain, frame)
            row = {"model": name, "strain": strain, "frame": frame, "bodies": bodies}
            row |= {"rotation": max(beam.rotation for beam in beams)}
            row |= {"error": np.max(np.abs(motion - exact)) / half}
            rows.append(row | {"predicted": max(beam.error for beam in beams)})
    return pd.DataFrame(rows)


def main() -> None:
    print(
        "smallest and median rotation [rad] over the loads at which the tip error reaches a level"
    )
    table = measure_cantilevers()
    groups = table.groupby(["turn [deg]", "strain", "frame", "bodies"])
    names = [f"{level:.1%}" for level in LEVELS]
    print(groups[names].agg(["min", "median"]).to_string(float_format="{:.2g}".format))
    print("\nerror of the tip at the full load over the number of bodies")
    index = ["turn [deg]", "load", "strain", "frame"]
    final_errors = table.pivot(index=index, columns="bodies", values="last error")
    print(final_errors.to_string(float_format="{:.2g}".format))
    print("\nerrors of moving mechanisms, measured and predicted")
    print(measure_mechanisms().to_string(index=False, float_format="{:.2g}".format))


if __name__ == "__main__":
    main()
