"""Integrators whose runs can be differentiated."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.errors import BeamdaeError, BeamdaeWarning, format_percent, short_repr, warn_user
from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau
from beamdae.results.solution import Solution

Array = np.ndarray

# Errors of derivatives are larger than those of the motion.
DERIVATIVE_METHOD = Radau(rtol=1e-5)
# With the default tolerance of 1e-6, Newton errors of runs led to errors of derivatives of up to
# 1e-4; with this tolerance, they are limited by rounding errors.
_NEWTON_TOLERANCE = 1e-10
# First word of the warning of a run about its energy balance, see `quality_warnings`.
_IMBALANCE_PREFIX = "energy:"
# Error of derivatives due to steps, relative to their norm, of which users are warned.
_MAX_STEP_ERROR = 0.05
# Ratio of the tolerances of runs whose derivatives are compared.
_RTOL_RATIO = 10.0
# Difference from derivatives by a looser tolerance of Radau, above which a tighter tolerance is
# used. A difference of 1.6 % was the smallest for an error above 5 %.
_MIN_SUSPECT_ERROR_OF_RADAU = 0.01
# Estimate from the difference of single numbers, such as gradients, by a fixed step and twice this
# step, above which half the step is used, too. It was 0.8 % for gradients that were 91 % wrong.
_MIN_SUSPECT_ERROR_OF_NUMBERS = 0.001
# Reason of interrupts after which only the estimate of the error is missing.
INTERRUPTED_ESTIMATE = "interrupted while the error of the derivatives was estimated"
# Fraction of the rows that are not compared: those with the largest differences. Columns that jump
# have derivatives with peaks of any height, e.g. where a mass slides over the end of an element.
_OMITTED_ROWS = 0.01


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


def require_estimate_error(caller: str, value: Any) -> None:
    """Raise BeamdaeError unless the argument `estimate_error` of `caller` is a bool."""
    if not isinstance(value, (bool, np.bool_)):
        raise BeamdaeError(
            f"{caller}: estimate_error must be True or False, got {short_repr(value)}."
        )


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
    repeat: Callable[[GeneralizedAlpha | Radau], Mapping[str, Array]],
    describe: Callable[[float], str] = lambda error: "",
) -> None:
    """Warn if derivatives depend on the step or rtol of their run.

    Derivatives by fixed steps are compared with those by twice the step, or by half the step if
    the former run fails or may agree by chance, see `_fixed_step_errors`. Derivatives by adaptive
    steps are compared with those by a tolerance that is ten times looser and, if these differ by
    more than 1 % (Radau) or 5 %, with those by a tenth of the tolerance: the first difference costs
    less, but was 0.2 to 30 times the error in runs of the example models, the second 0.6 to 1.1
    times.

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
    describe
        Function that returns a phrase about a relative error, to follow its percentage.
    """

    def differences(other: GeneralizedAlpha | Radau, words: Iterable[str]) -> dict[str, float]:
        again = repeat(other)
        return {x: _relative_difference(again[x], fine[x]) for x in words}

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BeamdaeWarning)
        try:
            fine = derivatives()
            if isinstance(method, GeneralizedAlpha) and method.rtol is None:
                cause, advice = f"the step of {method.step:g} s", "use a shorter step"
                errors = _fixed_step_errors(method, fine, differences)
                advice += ", or GeneralizedAlpha(rtol=1e-4)"
            else:
                rtol = method.accuracy.value
                cause, advice = f"rtol={rtol:g}", "reduce rtol by a factor of ten or more"
                is_radau = isinstance(method, Radau)
                bound = _MIN_SUSPECT_ERROR_OF_RADAU if is_radau else _MAX_STEP_ERROR
                suspect = list(fine)
                with suppress(BeamdaeError):  # The run fails, or the tolerance is not permitted.
                    errors = differences(replace(method, rtol=_RTOL_RATIO * rtol), fine)
                    suspect = [x for x, error in errors.items() if not error <= bound]
                errors = {}
                if suspect:
                    errors = differences(replace(method, rtol=rtol / _RTOL_RATIO), suspect)
        except BeamdaeError:
            return  # The other run fails: there is no estimate.
    words = [x for x, error in errors.items() if not error <= _MAX_STEP_ERROR]
    if not words:
        return
    worst = max(words, key=lambda x: errors[x])
    others = ""
    if len(words) > 1:
        others = f" (and above {100.0 * _MAX_STEP_ERROR:g} % for {len(words) - 1} more)"
    size = format_percent(errors[worst]) if errors[worst] <= 1.0 else "more than 100 %"
    size += describe(errors[worst])
    warn_user(
        f"{derivative_call()}: the error of {worst} of {model} due to {cause} is estimated at "
        f"{size}{others}; {advice}."
    )


def _fixed_step_errors(
    method: GeneralizedAlpha,
    derivatives: Mapping[str, Array],
    differences: Callable[[GeneralizedAlpha, Iterable[str]], dict[str, float]],
) -> dict[str, float]:
    """Return Richardson's estimates of the errors of derivatives by a fixed step.

    Derivatives at one time may agree by chance where the steps resolve no vibration. They are
    compared with those by half the step unless the difference is small or exceeds the limit.

    Parameters
    ----------
    method, derivatives
        Integrator with a fixed step, and the derivatives by their words.
    differences
        Function of another integrator and of words that returns the relative differences.
    """
    ratio = 2.0**method.order
    try:
        doubled = differences(replace(method, step=2.0 * method.step), derivatives)
        errors = {x: difference / (ratio - 1.0) for x, difference in doubled.items()}
        suspect = [
            x
            for x, error in errors.items()
            if len(derivatives[x]) == 1 and _MIN_SUSPECT_ERROR_OF_NUMBERS < error <= _MAX_STEP_ERROR
        ]
    except BeamdaeError:  # The step is near the longest one with which Newton's method converges.
        errors, suspect = {}, list(derivatives)
    if suspect:
        halved = differences(replace(method, step=0.5 * method.step), suspect)
        errors |= {x: ratio / (ratio - 1.0) * difference for x, difference in halved.items()}
    return errors


def _relative_difference(other: Array, derivatives: Array) -> float:
    """Return the norm of the difference of derivatives (rows, ...), relative to their norm."""
    differences = np.linalg.norm(np.reshape(other - derivatives, (len(derivatives), -1)), axis=1)
    count = len(differences) - int(_OMITTED_ROWS * len(differences))
    rows = np.argsort(differences)[:count]
    size = float(np.linalg.norm(derivatives[rows]))
    return float(np.linalg.norm(differences[rows])) / size if size else 0.0
