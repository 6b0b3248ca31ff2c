"""Searches from several starting designs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.problem import FEASIBILITY_TOLERANCE, DesignProblem
from beamdae.analysis.optimization.search import Method, Search, SearchResult, describe_failure
from beamdae.analysis.parameter_bounds import require_start_bounds, spread_starts
from beamdae.errors import BeamdaeError
from beamdae.interrupts import acknowledge
from beamdae.results.outcome import Status

Array = np.ndarray

# Relative difference of the objectives of two searches up to which they are equal.
_EQUAL_OBJECTIVES = 1e-6
_INTERRUPTED = Status("interrupted", "interrupted before the end of all searches")


@dataclass(frozen=True)
class StartResult:
    """Best of several searches.

    Attributes
    ----------
    problem
        The problem, whose first values are those of the best search.
    search
        The best search.
    rows
        Rows of the table of all searches.
    """

    problem: DesignProblem
    search: SearchResult
    rows: list[dict[str, Any]]


def search_from_starts(
    problem: DesignProblem,
    method: Method,
    max_evaluations: int,
    tolerance: float,
    progress: Callable[[int, float, float], object] | None,
    starts: int,
    seed: int,
) -> StartResult:
    """Return the best of several searches; see `optimize` for the arguments.

    Raises
    ------
    BeamdaeError
        If a number has no finite bounds, or the first designs of all searches fail.
    """
    require_start_bounds("optimize", problem.names, problem.lower, problem.upper)
    points = [problem.first, *spread_starts(problem.lower, problem.upper, starts - 1, seed)]
    best: tuple[DesignProblem, SearchResult] | None = None
    rows: list[dict[str, Any]] = []
    failures: list[Exception] = []
    count = 0

    def report(number: int, objective: float, violation: float) -> object:
        return progress(count + number, objective, violation) if progress else None

    for point in points:
        trial = problem.starting_at(point)
        row: dict[str, Any] = {f"first {x}": y for x, y in zip(problem.names, point, strict=True)}
        rows.append(row)
        try:
            search = Search(trial, method, max_evaluations, tolerance, progress and report).run()
        except KeyboardInterrupt:
            if best is None:
                raise
            acknowledge()
            row |= {"status": _INTERRUPTED.kind, "reason": "interrupted", "evaluations": 0}
            return StartResult(best[0], replace(best[1], status=_INTERRUPTED), rows)
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            failures.append(failure)
            row |= {"status": "failed", "reason": describe_failure(failure), "evaluations": 1}
            continue
        row |= _describe_end(problem.names, search)
        count += len(search.trials)
        if best is None or _is_better(search, best[1]):
            best = trial, search
        if search.was_ended:
            status = _INTERRUPTED if search.progress_error is None else search.status
            error = search.progress_error
            return StartResult(best[0], replace(best[1], status=status, progress_error=error), rows)
    if best is None:
        raise BeamdaeError(
            f"optimize: the first designs of all {starts} searches failed; the first one: "
            f"{describe_failure(failures[0])}."
        ) from failures[0]
    return StartResult(*best, rows)


def _describe_end(names: list[str], search: SearchResult) -> dict[str, Any]:
    best = search.best
    return {
        "status": search.status.kind,
        "reason": search.status.sentence,
        "objective": float(best.values[0]),
        "violation": best.violation,
        "evaluations": len(search.trials),
        **dict(zip(names, best.numbers.tolist(), strict=True)),
    }


def _is_better(search: SearchResult, other: SearchResult) -> bool:
    """Return True if a search found a better design, or the same one and only it converged."""
    violations = [x.best.violation for x in (search, other)]
    if max(violations) > FEASIBILITY_TOLERANCE:
        return violations[0] < violations[1]
    first, second = (float(x.best.values[0]) for x in (search, other))
    if abs(first - second) <= _EQUAL_OBJECTIVES * max(abs(first), abs(second)):
        return search.status.success and not other.status.success
    return first < second
