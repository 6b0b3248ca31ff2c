"""Integrators whose runs can be differentiated."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.errors import BeamdaeError, short_repr, warn_user
from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau
from beamdae.results.solution import Solution

# With the default tolerance of 1e-6, Newton errors of runs led to errors of derivatives of up to
# 1e-4; with this tolerance, they are limited by rounding errors.
_NEWTON_TOLERANCE = 1e-10
# First word of the warning of a run about its energy balance, see `quality_warnings`.
_IMBALANCE_PREFIX = "energy:"


def require_differentiable_method(
    integrator: Any, default: GeneralizedAlpha | Radau
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


def warn_of_unreliable_run(model: str, solution: Solution) -> None:
    """Warn if derivatives are those of a run of `model` that violates the balance of energy."""
    if any(x.startswith(_IMBALANCE_PREFIX) for x in solution.warnings):
        warn_user(
            f"{derivative_call()}: the run of {model} violates the balance of energy, and the "
            "derivatives are those of this inaccurate run; reduce the step or rtol, or use Radau."
        )
