"""Searches from one or several starting designs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from beamdae.analysis.optimization.problem import DesignProblem
from beamdae.analysis.optimization.search import Search, SearchSettings, describe_failure
from beamdae.analysis.optimization.search_result import SearchResult
from beamdae.analysis.parameter_bounds import draw_starts
from beamdae.errors import BeamdaeError
from beamdae.interrupts import acknowledge
from beamdae.results.outcome import Status

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
        return Search(problem, settings).run(), None
    bounds = problem.lower, problem.upper
    points = [problem.first, *draw_starts("optimize", problem.names, *bounds, starts - 1, seed)]
    searches: list[SearchResult] = []
    rows: list[dict[str, Any]] = []
    status = None
    for point in points:
        row: dict[str, Any] = {f"first {x}": y for x, y in zip(problem.names, point, strict=True)}
        count = sum(len(x.trials) for x in searches)
        try:
            search = Search(problem.starting_at(point), replace(settings, earlier_designs=count))
            end = search.run()
        except KeyboardInterrupt:
            if not searches:
                raise
            acknowledge()
            status = _INTERRUPTED
            break
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            reason = describe_failure(failure)
            rows.append(row | {"status": "failed", "reason": reason, "evaluations": 1})
            continue
        searches.append(end)
        row |= {"status": end.status.kind, "reason": end.status.sentence}
        row |= {"objective": float(end.best.values[0]), "violation": end.violation}
        row |= {"evaluations": len(end.trials)}
        rows.append(row | dict(zip(problem.names, end.best.numbers.tolist(), strict=True)))
        if end.was_ended:
            status = _INTERRUPTED if end.progress_error is None else end.status
            break
    if not searches:
        raise BeamdaeError(
            f"optimize: the first designs of all {starts} searches failed; the first one: "
            f"{rows[0]['reason']}."
        )
    best, error = min(searches, key=_rank), searches[-1].progress_error
    return replace(best, status=status or best.status, progress_error=error), rows


def _rank(search: SearchResult) -> tuple[float, float, bool, float]:
    """Return a key that is smallest for the best design; of equal ones, for one that converged."""
    objective = float(search.best.values[0])
    return search.violation, float(f"{objective:.6g}"), not search.status.success, objective
