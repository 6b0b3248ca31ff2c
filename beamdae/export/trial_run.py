"""Warnings about the steps of an FMU, from a trial run and from the contacts of the model."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm
from beamdae.errors import format_percent, list_first, warn_user
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.radau.radau import Radau
from beamdae.results.columns import remove_unit
from beamdae.results.diagnostics.suspected_errors import refuted_warnings
from beamdae.results.run_checks import find_suspected_errors, skip_error_estimates
from beamdae.results.solution import Solution
from beamdae.simulation import compute_output_times
from beamdae.verification import (
    RELATIVE_ERROR,
    describe_step_errors,
    estimate_errors,
    mark_negligible_columns,
)

_MAX_NAMES = 3  # of parts in a warning
_MAX_TRIAL_STEPS = 20_000
_MAX_STEPS_OF_ESTIMATE = 3 * _MAX_TRIAL_STEPS  # a tenth of rtol takes 1.6 to 2.5 times the steps
# Largest estimated error of an output relative to half its range. Estimates by twice the step are
# up to five times the error, those by a tenth of rtol about twice.
_MAX_ERROR_OF_FIXED_STEPS = 0.05
_MAX_ERROR_OF_ADAPTIVE_STEPS = 0.02


def warn_of_fixed_steps(call: str, gaps: Sequence[SurfaceGapTerm], step: float) -> None:
    """Warn about contacts in a model that is exported with fixed steps of `step` [s]."""
    names = list(dict.fromkeys(gap.part for gap in gaps))
    if not names:
        return
    contacts = list_first(names, _MAX_NAMES)
    warn_user(
        f"{call}: fixed steps of {step:g} s are inaccurate where contacts ({contacts}) last only "
        'a few steps, and pass over shorter ones; use integrator="radau", or halve the step until '
        "the results stay the same."
    )


def warn_of_trial_run(
    call: str,
    equations: EquationsOfMotion,
    t_end: float,
    method: GeneralizedAlpha | Radau,
    outputs: Collection[str],
) -> None:
    """Issue the warnings of a run to `t_end` [s] with the method of an FMU.

    The run has the default values of inputs and parameters. A second run estimates the errors of
    the columns `outputs` (headers). Runs of more than `_MAX_TRIAL_STEPS`
    steps are omitted (generalized-alpha) or end there (Radau).
    """
    if isinstance(method, Radau):
        method = replace(method, max_steps=_MAX_TRIAL_STEPS)
    elif t_end > _MAX_TRIAL_STEPS * method.step:
        return
    run = method.integrate(equations, compute_output_times(call, t_end, None))
    with skip_error_estimates():
        # An FMU has other output rows.
        omitted = {*equations.build_warnings, *run.row_warnings}
        messages = [x for x in run.warnings if x not in omitted]
    if run.status.kind == "failed":
        messages.append(run.status.sentence)
    elif run.status.kind == "limited":
        messages.append(
            f"{_MAX_TRIAL_STEPS} adaptive steps end at t = {run.trajectory.end:.3g} s of "
            f'{t_end:g} s; the FMU takes as many: damp fast vibrations, or use integrator="alpha".'
        )
    else:
        has_fixed_steps = isinstance(method, GeneralizedAlpha)
        errors, large = _estimate_output_errors(run, outputs, has_fixed_steps)
        # Warnings about columns that are no outputs, that are accurate, or whose estimates are
        # reported.
        suspected = (
            0.0 if header not in outputs or header in large else error
            for header, error in zip(run.columns, errors, strict=True)
        )
        refuted = refuted_warnings(find_suspected_errors(run), run.columns, suspected)
        messages = [x for x in messages if x not in refuted]
        if large:
            messages.append(
                describe_step_errors(large, method) if has_fixed_steps else _describe_errors(large)
            )
    for sentence in messages:
        warn_user(f"{call}: in a trial run, {sentence}")
    # An FMU does not search its steps for these peaks.
    if peaks := run.integrator.get("restarted_at"):
        warn_user(
            f"{call}: adaptive steps of an FMU may pass over short peaks of forces ({peaks}); "
            'use integrator="alpha" with steps much shorter than the peaks.'
        )


def _estimate_output_errors(
    run: Solution, outputs: Collection[str], has_fixed_steps: bool
) -> tuple[Iterable[float], dict[str, float]]:
    """Return the estimated errors of all columns, and by header those of outputs above the limit.

    Errors are relative to half the range.
    """
    limit = _MAX_ERROR_OF_FIXED_STEPS if has_fixed_steps else _MAX_ERROR_OF_ADAPTIVE_STEPS
    errors = estimate_errors(run, max_steps=_MAX_STEPS_OF_ESTIMATE)
    relative, is_relevant = errors[RELATIVE_ERROR], ~mark_negligible_columns(run, errors)
    large = {
        header: error
        for header, error, flag in zip(run.columns, relative, is_relevant, strict=True)
        if flag and header in outputs and limit < error < np.inf
    }
    return relative, large


def _describe_errors(large: Mapping[str, float]) -> str:
    """Return the warning about outputs whose estimated errors are too large."""
    worst = sorted(large, key=lambda header: -large[header])
    listed = [f"{remove_unit(x)} {format_percent(large[x])}" for x in worst]
    return (
        f"the estimated errors of {list_first(listed, _MAX_NAMES)} of half the range are large; "
        "reduce rtol, or damp fast vibrations (damping= of the sections)."
    )
