"""How far the strains of a floating frame reach: what `Solution.validity` predicts an error by.

    python validation/strain_validity/run.py

Cantilevers bent by end loads against exact answers, and the hub beam and the slider-crank against
the same in 16 and 8 bodies in chord frames with Green's strain. Errors are relative to the largest
displacement, deformation or half the range; rotations are those relative to the floating frames.
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
from strain_validity.statics import SECTION, cantilever, solve_exact_tips, solve_tips_and_rotations

import beamdae as bd
from beamdae.beams.floating_frame.strain_validity import strain_error_coefficients

EI = SECTION.EI
LOADS = {
    "moment": ((0.0, 0.0), np.pi * EI),
    "- moment": ((0.0, 0.0), -np.pi * EI),
    "force y": ((0.0, 6.0 * EI), 0.0),
    "- force y": ((0.0, -6.0 * EI), 0.0),
    "force x": ((4.0 * EI, 0.0), 0.0),
    "- force x": ((-4.0 * EI, 0.0), 0.0),
}
TIMES = np.array([0.003, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.17, 0.25, 0.35, 0.5, 0.7, 1.0])
LEVELS = (1e-3, 1e-2, 5e-2)
FRAMES = ("tangent", "chord")
INTEGRATOR = bd.GeneralizedAlpha(step=2e-3, newton_tolerance=1e-7)


def create_curve(degrees: float):
    """A curve of 1 m that turns by so much."""
    if degrees == 0.0:
        return bd.Line((0.0, 0.0), (1.0, 0.0))
    return bd.Arc(radius=1.0 / np.radians(degrees), length=1.0)


def interpolate_rotation(error, rotation, level):
    """Rotation at which an error first exceeds a level; infinite where it does not."""
    (above,) = np.nonzero(error > level)
    if not len(above):
        return np.inf
    if above[0] == 0:
        return rotation[0]
    part = slice(above[0] - 1, above[0] + 1)
    return float(np.exp(np.interp(np.log(level), np.log(error[part]), np.log(rotation[part]))))


def measure_cantilevers(degrees=(0, 60, 180), bodies=(1, 2, 4, 8), loads=LOADS) -> pd.DataFrame:
    """Rotations at which the tip of cantilevers is off by 0.1, 1 and 5 % of its displacement."""
    rows = []
    for turn, (load, (force, moment)) in product(degrees, loads.items()):
        if turn == 0 and load not in ("moment", "force y"):
            continue
        axis = create_curve(turn)
        exact = solve_exact_tips(axis, force, moment, TIMES)
        moved = np.linalg.norm(exact - axis.point(1.0), axis=1)
        for strain, frame, n in product(("nonlinear", "green"), FRAMES, bodies):
            if turn == 0 and strain == "green":
                continue
            equations = cantilever(axis, force, moment, n, frame=frame, strain=strain)
            tip, rotation = solve_tips_and_rotations(equations, TIMES)
            k = len(tip)
            error = np.linalg.norm(tip - exact[:k], axis=1) / moved[:k]
            row = {"turn [deg]": turn, "load": load, "strain": strain, "frame": frame, "bodies": n}
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
    """Errors of the hub beam and the slider-crank, measured and predicted."""
    tip, slider = ["deformation.u [m]", "deformation.v [m]"], ["slider.x [m]"]
    cases = {f"hub beam x {k}": (hub_beam, {"torque": 10.0 * k}, 16, tip) for k in (1, 2, 5, 10)}
    cases["slider-crank"] = (slider_crank, {}, 8, slider)
    rows = []
    for name, (model, given, most, columns) in cases.items():

        def run(bodies, strain, frame, model=model, given=given, columns=columns):
            elements = max(8 // bodies, 2)
            settings = {"bodies": bodies, "elements": elements, "strain": strain, "frame": frame}
            return _simulate_columns(model(**given, **settings), model.t_end, columns)

        exact, _ = run(most, "green", "chord")
        half = 0.5 * np.max(np.ptp(exact, axis=0))
        for strain, frame, bodies in product(("linear", "nonlinear", "green"), FRAMES, (1, 2, 4)):
            found, beams = run(bodies, strain, frame)
            row = {"model": name, "strain": strain, "frame": frame, "bodies": bodies}
            row |= {"rotation": max(beam.rotation for beam in beams)}
            row |= {"error": np.max(np.abs(found - exact)) / half}
            rows.append(row | {"predicted": max(beam.error for beam in beams)})
    return pd.DataFrame(rows)


def main() -> None:
    print("smallest and middle rotation [rad], of six loads, at which the tip is off by so much")
    found = measure_cantilevers()
    of_loads = found.groupby(["turn [deg]", "strain", "frame", "bodies"])
    names = [f"{level:.1%}" for level in LEVELS]
    print(of_loads[names].agg(["min", "median"]).to_string(float_format="{:.2g}".format))
    print("\nerror of the tip at the full load over the number of bodies")
    at_full = ["turn [deg]", "load", "strain", "frame"]
    full = found.pivot(index=at_full, columns="bodies", values="last error")
    print(full.to_string(float_format="{:.2g}".format))
    print("\nerrors of moving mechanisms, measured and predicted")
    print(measure_mechanisms().to_string(index=False, float_format="{:.2g}".format))
    print("\nrotation [rad] at which 1 % is predicted")
    for strain, frame, turn in product(("nonlinear", "green", "linear"), FRAMES, (0, 60, 180)):
        linear, square = strain_error_coefficients(strain, frame, np.radians(turn))
        at = 0.02 / (linear + np.sqrt(linear**2 + 0.04 * square))
        print(f"{strain:>9} {frame:>7} {turn:3d} deg: {at:.2g}")


if __name__ == "__main__":
    main()
