"""Integrators whose runs can be differentiated."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from beamdae import deferred
from beamdae.analysis.sensitivities.neighbors import derivative_call
from beamdae.errors import BeamdaeError, short_repr, warn_user, warnings_are_ignored
from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau
from beamdae.results.solution import Solution
from beamdae.simulation import skips_result_checks

# Errors of derivatives are larger than those of the motion.
DERIVATIVE_METHOD = Radau(rtol=1e-5)
# With the default tolerance of 1e-6, Newton errors of runs led to errors of derivatives of up to
# 1e-4; with this tolerance, they are limited by rounding errors.
_NEWTON_TOLERANCE = 1e-10
# Reason of interrupts after which only the estimate of the error is missing.
INTERRUPTED_ESTIMATE = "interrupted while the error of the derivatives was estimated"


def require_differentiable_method(
    integrator: Any, default: GeneralizedAlpha | Radau = DERIVATIVE_METHOD
) -> GeneralizedAlpha | Radau:
    """Return the integrator of a run that is differentiated: Radau for Auto.

    Newton errors of generalized-alpha are reduced.

    Raises
    ------
    BeamdaeError
        If runs of the integrator cannot be differentiated.
    """
    method = default if integrator is None else integrator
    if isinstance(method, Auto):
        return Radau(**{x.name: getattr(method, x.name) for x in fields(method)})
    if isinstance(method, Ida):
        raise BeamdaeError(
            f"{derivative_call()}: runs of Ida cannot be differentiated, because a sequence of "
            "steps of "
            "variable order cannot be replayed and scikit-sundae does not include IDAS; use Radau "
            "or GeneralizedAlpha."
        )
    if isinstance(method, Radau):
        return method
    if not isinstance(method, GeneralizedAlpha):
        raise BeamdaeError(
            f"{derivative_call()}: only runs of Radau, Auto and GeneralizedAlpha can be "
            "differentiated, "
            f"got {short_repr(method)}."
        )
    if method.formulation != "index3":
        raise BeamdaeError(
            f"{derivative_call()}: GeneralizedAlpha must have formulation='index3', got "
            f"{short_repr(method)}."
        )
    return replace(method, newton_tolerance=min(method.newton_tolerance, _NEWTON_TOLERANCE))


def require_end(model: str, solution: Solution) -> None:
    """Reject a run of `model` that did not reach its end."""
    if not solution.status.success:
        raise BeamdaeError(
            f"{derivative_call()}: the run of {model} did not reach its end "
            f"({solution.status.sentence}); differentiate a shorter run, or change the integrator."
        )


def warn_of_errors(result: Any) -> None:
    """Measure the errors of `Sensitivities` or a `Gradient`, unless this takes long, and warn."""
    if skips_result_checks() or warnings_are_ignored():
        return
    for sentence in deferred.module("accuracy.derivatives").check_derivatives(result):
        warn_user(f"{derivative_call()}: {sentence}")
