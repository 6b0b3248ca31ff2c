"""Integrators whose runs can be differentiated."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.errors import BeamdaeError, BeamdaeWarning, short_repr, warn_user
from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau
from beamdae.results.solution import Solution

Array = np.ndarray

# With the default tolerance of 1e-6, Newton errors of runs led to errors of derivatives of up to
# 1e-4; with this tolerance, they are limited by rounding errors.
_NEWTON_TOLERANCE = 1e-10
# First word of the warning of a run about its energy balance, see `quality_warnings`.
_IMBALANCE_PREFIX = "energy:"
# Error of derivatives due to a fixed step, relative to their norm, of which users are warned.
_MAX_STEP_ERROR = 0.05


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


def warn_of_step_errors(
    model: str,
    method: GeneralizedAlpha | Radau,
    derivatives: Callable[[], Mapping[str, Array]],
    repeat: Callable[[GeneralizedAlpha], Mapping[str, Array]],
) -> None:
    """Warn if derivatives depend on the fixed step of their run; other methods are not checked.

    Parameters
    ----------
    model
        Name of the model.
    method
        Integrator of the run.
    derivatives
        Function that returns the derivatives by the words for them in the warning.
    repeat
        Function that returns the derivatives of the run by another integrator.
    """
    if not isinstance(method, GeneralizedAlpha) or method.rtol is not None:
        return
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", BeamdaeWarning)
            fine, coarse = derivatives(), repeat(replace(method, step=2.0 * method.step))
    except BeamdaeError:
        return  # The longer steps fail: there is no estimate.
    # Richardson's estimate.
    factor = 1.0 / (2.0**method.order - 1.0)
    errors = {
        words: factor * float(np.linalg.norm(coarse[words] - x) / np.linalg.norm(x))
        for words, x in fine.items()
        if np.any(x)
    }
    words = [x for x, error in errors.items() if not error <= _MAX_STEP_ERROR]
    if not words:
        return
    worst = max(words, key=lambda x: errors[x])
    others = ""
    if len(words) > 1:
        others = f" (and above {100.0 * _MAX_STEP_ERROR:g} % for {len(words) - 1} more)"
    size = f"{100.0 * errors[worst]:.2g} %" if errors[worst] <= 1.0 else "more than 100 %"
    warn_user(
        f"{derivative_call()}: the error of {worst} of {model} due to the step of {method.step:g} "
        f"s is estimated at {size}{others}; use a shorter step, or GeneralizedAlpha(rtol=1e-4)."
    )
