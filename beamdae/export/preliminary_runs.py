"""Runs before an export: the settings of Radau from a pilot run, and warnings from a trial run."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.watched_terms import SurfaceGapTerm
from beamdae.errors import list_first, warn_user
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.drive import drive
from beamdae.integrators.error_control import motion_scales
from beamdae.integrators.pilot_run import PILOT_RTOL
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.integrators.run_plan import RunPlan
from beamdae.simulation import compute_output_times

Array = np.ndarray


_MAX_NAMES = 3  # of parts in a warning
_MAX_TRIAL_STEPS = 20_000


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


def warn_of_fixed_steps(call: str, gaps: Sequence[SurfaceGapTerm], step: float) -> None:
    """Warn about contacts in a model that is exported with fixed steps of `step` [s]."""
    names = list(dict.fromkeys(gap.part for gap in gaps))
    if not names:
        return
    contacts = list_first(names, _MAX_NAMES)
    warn_user(
        f"{call}: fixed steps of {step:g} s are inaccurate where contacts ({contacts}) last only "
        "a few steps, and pass over shorter ones; choose Radau, or halve the step until the "
        "results stay the same."
    )


def warn_of_trial_run(
    call: str,
    equations: EquationsOfMotion,
    t_end: float,
    method: GeneralizedAlpha | Radau,
    outputs: Collection[str],
) -> None:
    """Issue the warnings of a run to `t_end` [s] with the method of an FMU.

    The run has the default values of inputs and parameters. The errors of the columns `outputs`
    (headers) are measured. Runs of more than `_MAX_TRIAL_STEPS` steps are omitted
    (generalized-alpha) or end there (Radau).
    """
    method = replace(method, time_limit=None)
    if isinstance(method, Radau):
        method = replace(method, max_steps=_MAX_TRIAL_STEPS)
    elif t_end > _MAX_TRIAL_STEPS * method.step:
        return
    run = method.integrate(equations, compute_output_times(call, t_end, None))
    # An FMU has other output rows.
    omitted = {*equations.build_warnings, *run.row_warnings}
    messages = [x for x in run.model_warnings if x not in omitted]
    if run.status.kind == "failed":
        messages.append(run.status.sentence)
    elif run.status.kind == "limited":
        messages.append(
            f"{_MAX_TRIAL_STEPS} adaptive steps end at t = {run.trajectory.end:.3g} s of "
            f"{t_end:g} s; the FMU takes as many: damp fast vibrations, or choose GeneralizedAlpha."
        )
    else:
        messages += run.errors.select(outputs).sentences()
    for sentence in messages:
        warn_user(f"{call}: in a trial run, {sentence}")
    # An FMU does not search its steps for these peaks.
    if peaks := run.integrator.get("restarted_at"):
        warn_user(
            f"{call}: adaptive steps of an FMU may pass over short peaks of forces ({peaks}); "
            "choose GeneralizedAlpha with steps much shorter than the peaks."
        )
