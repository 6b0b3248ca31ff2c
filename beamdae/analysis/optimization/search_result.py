"""End of a search, with a status from the conditions of first order of its best design."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.problem import DesignProblem
from beamdae.errors import format_distinct, list_first
from beamdae.model_parameters import format_with_unit
from beamdae.results.outcome import Status

Array = np.ndarray

# Decrease of the linearized objective within a step of one size, relative to that without
# constraints and bounds, up to which a design is an optimum.
_OPTIMALITY_TOLERANCE = 0.05
# Distances from a bound, in sizes of the number and relative to the bound, up to which a number is
# at it.
_BOUND_DISTANCE, _RELATIVE_DISTANCE = 1e-4, 1e-3
_MAX_NAMES = 3  # in a sentence


@dataclass(frozen=True, eq=False)
class Trial:
    """Evaluated design.

    Attributes
    ----------
    numbers
        Values (k,) of the numbers in the parameters.
    values
        Values (1 + C,) of the objective and of the constrained quantities; NaN if an analysis
        failed.
    failure
        Reason for the failure, or "".
    """

    numbers: Array
    values: Array
    failure: str = ""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a search.

    Attributes
    ----------
    problem
        The problem with the ratios of maxima of the best design.
    best
        The best evaluated design.
    trials
        All evaluated designs, in their order.
    status
        Reason of the end; that of the solver until `conclude` has judged the design.
    first_analyses
        Results of the analyses of the first design.
    units
        Units (1 + C,) of the objective and the limited quantities; "" if unknown.
    max_evaluations
        Maximum number of designs.
    multipliers, residual
        Multipliers (C,), the decrease of the objective per unit by which a limit is relaxed; the
        possible decrease, relative to that without constraints. NaN if the search was interrupted.
    blocking
        Limits that no small change of the best design satisfies.
    idle
        Names of the numbers on which no quantity depends at the best design.
    progress_error
        Exception of the user's function `progress` that ended the search, or None.
    """

    problem: DesignProblem
    best: Trial
    trials: tuple[Trial, ...]
    status: Status
    first_analyses: tuple[Any, ...]
    units: tuple[str, ...]
    max_evaluations: int
    multipliers: Array
    residual: float = float("nan")
    blocking: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    progress_error: Exception | None = None

    @property
    def was_ended(self) -> bool:
        """True if an interrupt or an exception of `progress` ended the search."""
        return self.status.kind == "interrupted" or self.progress_error is not None

    @property
    def violation(self) -> float:
        """Largest violation of a limit by the best design, 0 within the tolerances."""
        return self.problem.violation(self.best.values)

    def conclude(self) -> SearchResult:
        """Return the search with the status of its best design."""
        status, failures = self.status, [x.failure for x in self.trials if x.failure]
        if self.was_ended:
            return self
        sentence = status.sentence
        if self.violation:
            sentence = self._describe_violation()
        elif status.success and self.residual <= _OPTIMALITY_TOLERANCE:
            return replace(self, status=Status("ok", "converged"))
        else:
            if status.success:
                cause = "analyses fail" if failures else "a quantity jumps or has a kink"
                sentence = f"the search ended next to designs at which {cause}, before an optimum"
            if self.problem.noise.any():
                sentence += (
                    "; values of runs with adaptive steps change abruptly between designs, use a "
                    "fixed step, GeneralizedAlpha(step=...)"
                )
        if failures:
            sentence += (
                f"; {len(failures)} analyses failed, the last one: {failures[-1]}; pass bounds= "
                "that exclude such designs"
            )
        return replace(self, status=Status("limited" if status.success else status.kind, sentence))

    def _describe_violation(self) -> str:
        """Return the sentence of a search without a design that satisfies the constraints."""
        worst = int(np.argmin(self.problem.margins(self.best.values)))
        limit = self.problem.limits[worst]
        value = float(self.problem.ratios[worst] * self.best.values[1 + worst])
        numbers = format_distinct(limit.bound, value, digits=4)
        allowed, actual = (format_with_unit(x, self.units[1 + worst]) for x in numbers)
        sentences = [
            f"no evaluated design satisfies the constraints; in the best one {limit.quantity.label}"
            f" is {actual}, but the limit is at {'most' if limit.sign > 0 else 'least'} {allowed}"
        ]
        if not self.status.success:
            sentences.append(self.status.sentence)
        if self.blocking:
            names = list_first(self.blocking, _MAX_NAMES)
            sentences.append(f"{names} cannot be satisfied by small changes")
        sentences.append(
            "the search is local, start it from other values (parameters={name: value}) or "
            "increase starts="
        )
        return "; ".join(sentences)


def find_active(problem: DesignProblem, numbers: Array) -> dict[str, str]:
    """Return "lower" or "upper" by name of the numbers at a bound."""
    sides: dict[str, str] = {}
    for side, bounds in (("lower", problem.lower), ("upper", problem.upper)):
        limits = np.maximum(_BOUND_DISTANCE * problem.sizes, _RELATIVE_DISTANCE * np.abs(bounds))
        is_near = np.isfinite(bounds) & (np.abs(numbers - bounds) <= limits)
        sides |= dict.fromkeys(np.array(problem.names)[is_near].tolist(), side)
    return sides
