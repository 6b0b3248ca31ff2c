"""Cost of gradients by the adjoint, relative to the run that is differentiated.

    python validation/performance/gradients.py            three minutes
    python validation/performance/gradients.py --quick    half a second of motion, one round

Processor times of the run with the default tolerance, of the backward sweep (with the derivatives
of the objective and of the start), of the differences of the model function, and of the whole
gradient, which includes a run with a Newton tolerance of 1e-10. The actions take turns, and the
smallest times are reported. "gradient" is a first call; "later gradient" is a further call of the
same model, which knows which parameters affect which numbers. "with estimate" is a first call that
also estimates the error, by runs and sweeps with other steps.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from measurement import RESULTS, time_action, time_calls, time_in_turns, write_table

import beamdae as bd
from beamdae.analysis.gradients import gradients, number_derivatives

METHODS = {"GeneralizedAlpha": bd.GeneralizedAlpha(step=8e-4), "Radau": bd.Radau()}
ROUNDS = 5
MODELS = Path(__file__).resolve().parents[2] / "models"
COEFFICIENTS = 100
PARTS = ("sweep", "model", "gradient", "later", "estimate")


@bd.model(t_end=2.0)
def arm(
    thickness: tuple[float, ...] = (0.004,) * COEFFICIENTS,
    waves: tuple[float, ...] = (),
    torque: float = 1.0,
) -> bd.Mechanism:
    """Curved arm on a turning hub, with a thickness linear between equidistant points.

    The axis is an arc or, with `waves` [m], a parabola with waves of these amplitudes, divided by
    the square of their number.
    """
    alloy = bd.Material(E=69e9, nu=0.3, rho=2700.0)
    knots, numbers = np.linspace(0.0, 1.0, len(thickness)), 1.0 + np.arange(len(waves))
    amplitudes = np.array(waves) / numbers**2

    def height_of(x: float) -> float:
        return 0.5 * x**2 + float(amplitudes @ np.sin(np.pi * numbers * x))

    axis: Any = bd.Arc(radius=1.0, length=1.0)
    if waves:
        axis = bd.Curve(height_of, x=(0.0, 0.9))

    def section(s: float) -> bd.Section:
        height = float(np.interp(s, knots, thickness))
        return bd.Section.rectangle(alloy, width=0.02, height=height, damping=1e-3)

    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=0.3))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Moment("torque", on=hub.at(0.0, 0.0), law=bd.sine(torque, 1.0)))
    beam = mech.add(bd.Beam("beam", axis, section, elements=8))
    mech.add(bd.Weld("root", hub.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


CASES: dict[str, tuple[Any, tuple[str, ...], dict[str, Any]]] = {
    "hub_beam, 1": ("hub_beam", ("torque",), {}),
    "hub_beam, 5": (
        "hub_beam",
        ("density", "subtended", "length", "torque", "frequency"),
        {},
    ),
    "pendulum, 5": ("pendulum", ("tip_mass", "damping", "angle", "radius", "air_drag"), {}),
    "four_bar, 4": ("four_bar", ("speed", "height", "stiffness", "damping"), {}),
    "thickness": (arm, ("thickness",), {}),
    "axis": (arm, ("waves",), {"waves": (1e-3,) * COEFFICIENTS}),
}


def measure(name: str, integrator: str, t_end: float, rounds: int) -> dict[str, Any]:
    """Return the times of one case."""
    model, by, parameters = CASES[name]
    model = bd.load_model(MODELS / f"{model}.py") if isinstance(model, str) else model
    method = METHODS[integrator]
    equations = bd.equations_of_motion(model(**parameters))
    times = np.linspace(0.0, t_end, 1001)
    point = "rocker" if name.startswith("four_bar") else "tip"
    objective = bd.quantities.EndValue(f"{point}.y") + bd.quantities.SmoothMaximum(f"{point}.x")
    derivatives = np.zeros(0)

    def differentiate(part: str) -> float:
        nonlocal derivatives
        if part != "later":
            # The search for the numbers that parameters affect, which only the first call needs.
            number_derivatives._latest_effects.clear()
        begin = time.process_time()
        with (
            time_calls(gradients, "transpose_run") as sweep,
            time_calls(gradients, "differentiate_numbers") as calls,
        ):
            derivatives = bd.gradient(
                model,
                objective,
                by,
                method,
                t_end,
                parameters=parameters,
                estimate_error=part == "estimate",
            ).array
        parts = {"sweep": sum(sweep), "model": sum(calls)}
        return parts.get(part, time.process_time() - begin)

    samples = time_in_turns(
        {
            "run": lambda: time_action(lambda: method.integrate(equations, times)),
            **{x: lambda x=x: differentiate(x) for x in PARTS},
        },
        rounds,
    )
    run, sweep, calls, total, later, estimate = (1e3 * x.least for x in samples.values())
    return {
        "case": name,
        "integrator": integrator,
        "parameters": len(derivatives),
        "run [ms]": run,
        "sweep [ms]": sweep,
        "model function [ms]": calls,
        "gradient [ms]": total,
        "sweep / run": sweep / run,
        "gradient / run": total / run,
        "later gradient / run": later / run,
        "with estimate / run": estimate / run,
    }


def main() -> None:
    """Measure all cases and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    rows = [
        # Two hundred builds of the model take several seconds.
        measure(name, integrator, 0.5 if quick else 2.0, 1 if quick or name == "axis" else ROUNDS)
        for name in CASES
        for integrator in METHODS
        if integrator != "Radau" or name not in ("thickness", "axis")
    ]
    folder = Path(tempfile.mkdtemp()) if quick else RESULTS
    write_table(folder, "gradients", pd.DataFrame(rows))


if __name__ == "__main__":
    main()
