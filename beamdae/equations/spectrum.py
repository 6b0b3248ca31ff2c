"""Natural modes of a mechanism, as far as integrators ask for them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.equations.consistent_start import Starter
from beamdae.equations.formulations import State

Array = np.ndarray

_POWER_ITERATIONS = 12


class Mode(NamedTuple):
    """Natural frequency [rad/s] and damping ratio of a mode."""

    frequency: float
    damping_ratio: float


def fastest_mode(starter: Starter, time: Array, state: State) -> Mode:
    """Estimate of the fastest natural mode of the jointed mechanism.

    A few steps of power iteration with M^-1 K under the constraints.
    """
    stiffness, damping, mass = starter.linearized(time, state)
    solve = starter.mass_solver(time, state)
    x = np.cos(np.arange(starter.equations.n) ** 2.0)
    for _ in range(_POWER_ITERATIONS):
        x = solve(stiffness @ x)
        size = np.max(np.abs(x))
        if not size > 0.0:
            return Mode(0.0, 0.0)
        x /= size
    inertia = float(x @ (mass @ x))
    frequency = np.sqrt(abs(float(x @ (stiffness @ x))) / inertia)
    if frequency == 0.0:
        return Mode(0.0, 0.0)
    return Mode(float(frequency), float(x @ (damping @ x)) / (2.0 * frequency * inertia))
