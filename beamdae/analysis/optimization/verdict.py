"""Status of a search, from the conditions of first order of its best design."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beamdae.analysis.optimization.problem import DesignProblem
from beamdae.analysis.optimization.search import SearchResult
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


def conclude(search: SearchResult) -> SearchResult:
    """Return a search with the status of its best design."""
    status, failures = search.status, [x.failure for x in search.trials if x.failure]
    if search.was_ended:
        return search
    sentence = status.sentence
    if search.violation:
        sentence = _describe_violation(search)
    elif status.success and search.residual <= _OPTIMALITY_TOLERANCE:
        return replace(search, status=Status("ok", "converged"))
    else:
        if status.success:
            cause = "analyses fail" if failures else "a quantity jumps or has a kink"
            sentence = f"the search ended next to designs at which {cause}, before an optimum"
        if search.problem.noise.any():
            sentence += (
                "; values of runs with adaptive steps change abruptly between designs, use a fixed "
                "step, GeneralizedAlpha(step=...)"
            )
    if failures:
        sentence += (
            f"; {len(failures)} analyses failed, the last one: {failures[-1]}; pass bounds= that "
            "exclude such designs"
        )
    return replace(search, status=Status("limited" if status.success else status.kind, sentence))


def _describe_violation(search: SearchResult) -> str:
    """Return the sentence of a search without a design that satisfies the constraints."""
    scaled, best = search.scaled, search.best
    worst = int(np.argmin(scaled.margins(best.values)))
    limit = search.problem.limits[worst]
    value = float(scaled.ratios[worst] * best.values[1 + worst])
    numbers = format_distinct(limit.bound, value, digits=4)
    allowed, actual = (format_with_unit(x, search.units[1 + worst]) for x in numbers)
    side = "most" if limit.sign > 0 else "least"
    sentence = (
        f"no evaluated design satisfies the constraints; in the best one {limit.quantity.label} is "
        f"{actual}, but the limit is at {side} {allowed}"
    )
    if not search.status.success:
        sentence += f"; {search.status.sentence}"
    if search.blocking:
        names = list_first(search.blocking, _MAX_NAMES)
        sentence += f"; {names} cannot be satisfied by small changes"
    return (
        f"{sentence}; the search is local, start it from other values (parameters={{name: value}}) "
        "or increase starts="
    )


def find_active(problem: DesignProblem, numbers: Array) -> dict[str, str]:
    """Return "lower" or "upper" by name of the numbers at a bound."""
    sides: dict[str, str] = {}
    for side, bounds in (("lower", problem.lower), ("upper", problem.upper)):
        limits = np.maximum(_BOUND_DISTANCE * problem.sizes, _RELATIVE_DISTANCE * np.abs(bounds))
        is_near = np.isfinite(bounds) & (np.abs(numbers - bounds) <= limits)
        sides |= dict.fromkeys(np.array(problem.names)[is_near].tolist(), side)
    return sides
