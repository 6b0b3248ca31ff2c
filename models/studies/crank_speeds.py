"""Four-bar linkage over the speed of its crank: the motor's torque, and how far couplers bend."""

from pathlib import Path

import numpy as np

import beamdae as bd

four_bar = bd.load_model(Path(__file__).parents[1] / "four_bar.py")


def turning(run, column):
    """Largest size of a column once the crank has come to its speed, at 0.5 s."""
    return run[column].loc[0.5:].abs().max()


@bd.sweep(
    four_bar,
    of=["rocker.x", "coupler.v"],
    outputs={
        "peak torque [N m]": lambda run: turning(run, "motor.M"),
        "peak deflection [m]": lambda run: turning(run, "coupler.v"),
    },
    integrator=bd.Radau(1e-5),
)
def crank_speeds():
    return {"speed": np.linspace(2.0, 8.0, 7), "rise": [0.0, 0.06, 0.12]}
