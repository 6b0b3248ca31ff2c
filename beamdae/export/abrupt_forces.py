"""Forces that change abruptly with the motion, which fixed steps smear or pass over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formula_forces import compile_formula_forces
from beamdae.equations.surface_gaps import SurfaceGapTerm
from beamdae.errors import list_first, warn_user
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.radau.radau import Radau
from beamdae.results.diagnostics.resolution.unresolved_forces import unresolved_force_warnings

_MAX_NAMES = 3  # of parts in a warning
_MAX_TRIAL_STEPS = 20_000


def choose_integrator(equations: EquationsOfMotion, gaps: Sequence[SurfaceGapTerm]) -> str:
    """Return "radau" for models with contacts, friction or other abrupt forces, else "alpha"."""
    kernels = {id(term.kernel): term.kernel for term in equations.forces}.values()
    is_abrupt = gaps or any(k.local.n_multipliers or k.has_kinks_over_motion for k in kernels)
    return "radau" if is_abrupt else "alpha"


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


def warn_of_short_peaks(
    call: str, equations: EquationsOfMotion, times: np.ndarray, method: GeneralizedAlpha | Radau
) -> None:
    """Warn about formulas of forces with peaks that the steps of an FMU pass over.

    The FMU does not search its steps for these peaks. They are found in a run over `times` [s] with
    the method of the FMU and the default values of inputs and parameters.
    """
    if not compile_formula_forces(equations):
        return
    duration = float(times[-1] - times[0])
    if isinstance(method, Radau):
        run = replace(method, max_steps=_MAX_TRIAL_STEPS).integrate(equations, times)
        if peaks := run.integrator.get("restarted_at"):
            warn_user(
                f"{call}: adaptive steps of an FMU may pass over short peaks of forces ({peaks}); "
                'use integrator="alpha" with steps much shorter than the peaks.'
            )
    elif duration <= _MAX_TRIAL_STEPS * method.step:
        run = method.integrate(equations, times)
        for sentence in unresolved_force_warnings(equations, run.trajectory):
            warn_user(f"{call}: in a trial run, {sentence}")
