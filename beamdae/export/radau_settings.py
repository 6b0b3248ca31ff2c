"""Radau method of exported models: tolerances that follow from a pilot run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.integrators.drive import drive
from beamdae.integrators.error_control import motion_scales
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.integrators.run_plan import RunPlan

Array = np.ndarray


def plan_radau(
    equations: EquationsOfMotion, times: Array, integrator: Radau
) -> tuple[Workspace, float]:
    """Return the steps that Radau takes in a run over `times` [s], with its pilot run.

    The lower bound on 2 / h^2 of the first step h [1/s^2] follows the work arrays.
    """
    method = replace(integrator, max_steps=1, time_limit=None)
    pilot = replace(method, rtol=PILOT_RTOL)
    plans: list[RunPlan] = []

    def method_on(plan: RunPlan) -> RadauStepper:
        plans.append(plan)
        return method.method_on(plan)

    # The main run ends after one step.
    drive(method, equations, times, method_on, None, pilot.method_on)
    stepper = method.method_on(plans[-1])
    local = stepper.resolved_options["local_tolerance"]
    return stepper.workspace, motion_scales(plans[-1]).rate ** 2 / local
