"""Searches from one or several starting designs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from beamdae.analysis.optimization.problem import DesignProblem
from beamdae.analysis.optimization.search import (
    Search,
    SearchResult,
    SearchSettings,
    describe_failure,
)
from beamdae.analysis.optimization.verdict import conclude
from beamdae.analysis.parameter_bounds import require_start_bounds, spread_starts
from beamdae.errors import BeamdaeError
from beamdae.interrupts import acknowledge
from beamdae.results.outcome import Status

# Relative difference of the objectives of two searches up to which they are equal.
_EQUAL_OBJECTIVES = 1e-6
_INTERRUPTED = Status("interrupted", "interrupted before the end of all searches")


def search_from_starts(
    problem: DesignProblem, settings: SearchSettings, starts: int, seed: int
) -> tuple[SearchResult, list[dict[str, Any]] | None]:
    """Return the best of several searches, and the rows of the table of all; None for one search.

    See `optimize` for the arguments.

    Raises
    ------
    BeamdaeError
        If a number has no finite bounds, or the first designs of all searches fail.
    """
    if starts == 1:
        return conclude(Search(problem, settings).run()), None
    require_start_bounds("optimize", problem.names, problem.lower, problem.upper)
    points = [problem.first, *spread_starts(problem.lower, problem.upper, starts - 1, seed)]
    searches: list[SearchResult] = []
    rows: list[dict[str, Any]] = []
    failures: list[Exception] = []
    is_interrupted = False
    for point in points:
        earlier = replace(settings, earlier_designs=sum(len(x.trials) for x in searches))
        row = {f"first {x}": y for x, y in zip(problem.names, point, strict=True)}
        try:
            search = conclude(Search(problem.starting_at(point), earlier).run())
        except KeyboardInterrupt:
            if not searches:
                raise
            acknowledge()
            is_interrupted = True
            break
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            failures.append(failure)
            end = {"status": "failed", "reason": describe_failure(failure), "evaluations": 1}
            rows.append(row | end)
            continue
        rows.append(row | _describe_end(search))
        searches.append(search)
        if search.was_ended:
            is_interrupted = search.progress_error is None
            break
    if not searches:
        raise BeamdaeError(
            f"optimize: the first designs of all {starts} searches failed; the first one: "
            f"{describe_failure(failures[0])}."
        ) from failures[0]
    best, last = searches[0], searches[-1]
    for search in searches[1:]:
        best = search if _is_better(search, best) else best
    if is_interrupted:
        best = replace(best, status=_INTERRUPTED)
    elif last.progress_error is not None:
        best = replace(best, status=last.status, progress_error=last.progress_error)
    return best, rows


def _describe_end(search: SearchResult) -> dict[str, Any]:
    best = search.best
    return {
        "status": search.status.kind,
        "reason": search.status.sentence,
        "objective": float(best.values[0]),
        "violation": search.violation,
        "evaluations": len(search.trials),
        **dict(zip(search.problem.names, best.numbers.tolist(), strict=True)),
    }


def _is_better(search: SearchResult, other: SearchResult) -> bool:
    """Return True if a search found a better design, or the same one and only it converged."""
    if search.violation or other.violation:
        return search.violation < other.violation
    first, second = (float(x.best.values[0]) for x in (search, other))
    if abs(first - second) <= _EQUAL_OBJECTIVES * max(abs(first), abs(second)):
        return search.status.success and not other.status.success
    return first < second
