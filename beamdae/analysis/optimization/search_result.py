"""Designs and end of a search, with the sentences of its status."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.optimization.problem import DesignProblem
from beamdae.analysis.optimization.solvers import Method
from beamdae.errors import BeamdaeError, format_distinct, format_exception, list_first
from beamdae.model_parameters import format_with_unit
from beamdae.results.outcome import Status

Array = np.ndarray

# Distance from a bound, in sizes of the number, up to which a number is at it.
_BOUND_DISTANCE = 1e-4
# Ratio of a limit and a value from which they are far apart: mm and degrees are 1000 and 57 times
# smaller than m and rad.
FAR_RATIO = 20.0
_MAX_NAMES = 3  # in a sentence
_OTHER_START = (
    "the search is local, start it from other values (parameters={name: value}) or increase starts="
)


@dataclass(frozen=True)
class SearchSettings:
    """Arguments of `optimize` for a search."""

    method: Method
    max_evaluations: int
    tolerance: float
    progress: Callable[[int, float, float], object] | None


@dataclass(frozen=True)
class Trial:
    """Evaluated design.

    Attributes
    ----------
    numbers
        Values (k,) of the numbers in the parameters.
    values
        Values (1 + C,) of the objective and of the constrained quantities; NaN if an analysis
        failed.
    violation
        Largest violation of a limit, relative to the limit, 0 within its tolerance: 1e-6, or
        `DesignProblem.noise`. NaN if an analysis failed.
    failure
        Reason for the failure, or "".
    """

    numbers: Array
    values: Array
    violation: float
    failure: str = ""


@dataclass(frozen=True)
class SearchResult:
    """End of a search.

    Attributes
    ----------
    problem
        The problem with the stress sections of the best design.
    best
        The best evaluated design.
    trials
        All evaluated designs, in their order.
    status
        Status and reason of the end.
    ratios
        Ratios (C,) of maxima to their limited smooth maxima by which these were multiplied; 1 for
        other quantities.
    tolerances
        Violations (C,), relative to the limits, up to which these are satisfied.
    scales
        Units (1 + C,) of the objective and of the limited quantities in the search.
    first_analyses
        Results of the analyses of the first design.
    multipliers, residual, has_effect
        Multipliers (C,), the decrease of the objective per unit by which a limit is relaxed; the
        possible decrease, relative to that without constraints; False (k,) for numbers on which
        no quantity depends. None if the search was interrupted.
    progress_error
        Exception of the user's function `progress` that ended the search, or None.
    """

    problem: DesignProblem
    best: Trial
    trials: tuple[Trial, ...]
    status: Status
    ratios: Array
    tolerances: Array
    scales: Array
    first_analyses: tuple[Any, ...]
    max_evaluations: int
    multipliers: Array | None = None
    residual: float = float("nan")
    has_effect: Array | None = None
    progress_error: Exception | None = None

    @property
    def was_ended(self) -> bool:
        """True if an interrupt or an exception of `progress` ended the search."""
        return self.status.kind == "interrupted" or self.progress_error is not None


def describe_violation(search: SearchResult, blocking: Sequence[str]) -> Status:
    """Return the status of a search without a design that satisfies the constraints.

    `blocking` are limits that no small change of the best design satisfies.
    """
    problem, status, best = search.problem, search.status, search.best
    values = search.ratios * best.values[1:]
    bounds = np.array([x.bound for x in problem.limits])
    signs = np.array([x.sign for x in problem.limits])
    worst = int(np.argmin(signs * (bounds - values) / search.scales[1:]))
    limit, value = problem.limits[worst], float(values[worst])
    unit = problem.units_of(search.first_analyses)[1 + worst]
    numbers = format_distinct(limit.bound, value, digits=4)
    allowed, actual = (format_with_unit(x, unit) for x in numbers)
    at_bound = np.any(find_active_bounds(problem, best.numbers), axis=0)
    names = np.array(problem.names)[at_bound].tolist()
    where = f", with {list_first(names, _MAX_NAMES)} at a bound," if names else ","
    sentence = (
        f"no evaluated design satisfies the constraints; in the best one{where} "
        f"{limit.quantity.label} is {actual}, but the limit is at "
        f"{'most' if limit.sign > 0 else 'least'} {allowed}"
    )
    if not limit.unit and limit.bound and abs(value / limit.bound) > FAR_RATIO:
        sentence += "; check the unit of the limit"
    if not status.success:
        sentence += f"; {status.sentence}"
    if blocking:
        sentence += f"; {list_first(blocking, _MAX_NAMES)} cannot be satisfied by small changes"
    kind = "limited" if status.success else status.kind
    return Status(kind, f"{sentence}; {_OTHER_START}{_describe_failures(search)}")


def describe_early_end(search: SearchResult) -> Status:
    """Return the status of a search that ended before an optimum."""
    status = search.status
    sentence = status.sentence
    if status.success:
        has_failures = any(x.failure for x in search.trials)
        cause = "analyses fail" if has_failures else "a quantity jumps or has a kink"
        sentence = f"the search ended next to designs at which {cause}, before an optimum"
    if search.problem.noise.any():
        sentence += (
            "; values of runs with adaptive steps change abruptly between designs, use a fixed "
            "step, GeneralizedAlpha(step=...)"
        )
    kind = "limited" if status.success else status.kind
    return Status(kind, sentence + _describe_failures(search))


def _describe_failures(search: SearchResult) -> str:
    """Return the number of failed analyses with the last reason, and advice, or ""."""
    problem, failed = search.problem, [x for x in search.trials if x.failure]
    if not failed:
        return ""
    numbers = np.array([x.numbers for x in failed])
    is_free = np.isinf(np.where(problem.first > 0.0, problem.lower, problem.upper))
    is_lost = is_free & np.any(numbers * problem.first < 0.0, axis=0)
    names = list_first(np.array(problem.names)[is_lost].tolist(), _MAX_NAMES)
    advice = f"; pass bounds= that keep the sign of {names}" if names else ""
    return f"; {len(failed)} analyses failed, the last one: {failed[-1].failure}{advice}"


def describe_failure(failure: Exception) -> str:
    """Return the message of an error of an analysis or of the model function."""
    if isinstance(failure, BeamdaeError):
        return str(failure).removeprefix("optimize: ").removesuffix(".")
    return format_exception(failure)


def find_active_bounds(problem: DesignProblem, numbers: Array) -> tuple[Array, Array]:
    """Return True for the numbers at their lower and at their upper bounds, (k,) each."""
    distance = _BOUND_DISTANCE * problem.sizes
    return numbers - problem.lower <= distance, problem.upper - numbers <= distance
