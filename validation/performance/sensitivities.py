"""Cost of derivatives by parameters, relative to the run that is differentiated.

    python validation/performance/sensitivities.py            two minutes
    python validation/performance/sensitivities.py --quick    half a second of motion, one round

Processor times of the run, of the derivatives of its steps and start, and of the calls of the model
function at neighboring values of the parameters. "derivatives / run" excludes the model function.
The actions take turns, and the smallest times are reported.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from measurement import RESULTS, time_action, time_calls, time_in_turns, write_table

import beamdae as bd
from beamdae.analysis.sensitivities import differentiable_run

METHODS = {"GeneralizedAlpha": bd.GeneralizedAlpha(step=8e-4), "Radau": bd.Radau()}
ROUNDS = 5
MODELS = Path(__file__).resolve().parents[2] / "models"
CASES = {
    "hub_beam": (("torque",), ("density", "subtended", "length", "torque", "frequency")),
    "pendulum": (("tip_mass",), ("tip_mass", "damping", "angle", "radius", "air_drag")),
    "four_bar": (("speed",), ("speed", "height", "stiffness", "damping")),
    "ring_mount": (("unbalance",), ("unbalance", "frequency", "motor_mass")),
}


def measure(
    name: str, parameters: tuple[str, ...], integrator: str, t_end: float, rounds: int
) -> dict[str, Any]:
    """Return the times of one case."""
    model = bd.load_model(MODELS / f"{name}.py")
    method = METHODS[integrator]
    equations = bd.equations_of_motion(model())
    times = np.linspace(0.0, t_end, 1001)

    def time_part(owner: Any, name: str) -> float:
        with time_calls(owner, name) as part:
            bd.sensitivities(model, parameters, method, t_end, estimate_error=False)
        return sum(part)

    samples = time_in_turns(
        {
            "run": lambda: time_action(lambda: method.integrate(equations, times)),
            "derivatives": lambda: time_part(differentiable_run, "differentiate_states"),
            "model": lambda: time_part(differentiable_run, "difference_model"),
        },
        rounds,
    )
    run, derivatives, calls = (1e3 * x.least for x in samples.values())
    return {
        "model": name,
        "integrator": integrator,
        "parameters": len(parameters),
        "run [ms]": run,
        "derivatives [ms]": derivatives,
        "model function [ms]": calls,
        "derivatives / run": derivatives / run,
        "total / run": (run + derivatives + calls) / run,
    }


def main() -> None:
    """Measure all cases and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    warnings.simplefilter("ignore", bd.BeamdaeWarning)
    rows = [
        measure(name, parameters, integrator, 0.5 if quick else 2.0, 1 if quick else ROUNDS)
        for name, sets in CASES.items()
        for parameters in sets
        for integrator in METHODS
        # Radau takes 10 000 steps for the ring, so that its rounds would take most of the time.
        if name != "ring_mount" or not (quick or integrator == "Radau")
    ]
    folder = Path(tempfile.mkdtemp()) if quick else RESULTS
    write_table(folder, "sensitivities", pd.DataFrame(rows))


if __name__ == "__main__":
    main()
