"""Settings of the Radau method of exported models: tolerances that follow from a pilot run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.integrators.drive import drive
from beamdae.integrators.error_control import (
    MultiplierTolerances,
    motion_scales,
    plan_multiplier_tolerances,
)
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.integrators.run_plan import RunPlan

Array = np.ndarray


@dataclass(frozen=True)
class RadauSettings:
    """Settings of radau.c.

    Attributes
    ----------
    test_weights, iteration_weights
        Reciprocal tolerances of (q, v) in the error test and in Newton's iteration, (2 n,).
    rounding_weights
        Reciprocal rounding errors of q near the origin, (n,).
    rounding_ratio
        Rounding errors of q relative to those near the origin, for Newton's iteration.
    stagnation_limit, longest_step, start_rate
        Largest weighted correction if Newton's iteration stagnates, longest step [s], and lower
        bound on 2 / h^2 of the first step h [1/s^2].
    multipliers
        Error test of the multipliers.
    """

    test_weights: Array
    iteration_weights: Array
    rounding_weights: Array
    rounding_ratio: float
    stagnation_limit: float
    longest_step: float
    start_rate: float
    multipliers: MultiplierTolerances


def plan_radau(equations: EquationsOfMotion, times: Array, rtol: float) -> RadauSettings:
    """Return the settings that `Radau(rtol)` uses in a run over `times` [s], with its pilot run."""
    method = Radau(rtol=rtol, max_steps=1)
    pilot = replace(method, rtol=PILOT_RTOL)
    last: list[tuple[RunPlan, RadauStepper]] = []

    def method_on(plan: RunPlan) -> RadauStepper:
        last[:] = [(plan, method.method_on(plan))]
        return last[0][1]

    # The main run ends after one step.
    drive(method, equations, times, method_on, None, pilot.method_on)
    plan, stepper = last[0]
    work, scales = stepper.workspace, motion_scales(plan)
    n = plan.equations.n
    local = stepper.resolved_options["local_tolerance"]
    return RadauSettings(
        # The step loop changes the weights of velocities in both arrays.
        test_weights=np.concatenate([work.test_weights[:n], work.tested_velocity_weights]),
        iteration_weights=np.concatenate([work.iteration_weights[:n], work.velocity_weights]),
        rounding_weights=work.velocity_rounding_weights.copy(),
        rounding_ratio=work.rounding_ratio,
        stagnation_limit=work.stagnation_limit,
        longest_step=work.step_size.longest,
        start_rate=scales.rate**2 / local,
        multipliers=plan_multiplier_tolerances(plan, scales, rtol),
    )
