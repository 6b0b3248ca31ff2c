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
    status = None
    for point in points:
        earlier = replace(settings, earlier_designs=sum(len(x.trials) for x in searches))
        rows.append({f"first {x}": y for x, y in zip(problem.names, point, strict=True)})
        try:
            search = conclude(Search(problem.starting_at(point), earlier).run())
        except KeyboardInterrupt:
            if not searches:
                raise
            acknowledge()
            rows.pop()
            status = _INTERRUPTED
            break
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            reason = describe_failure(failure)
            rows[-1] |= {"status": "failed", "reason": reason, "evaluations": 1}
            continue
        searches.append(search)
        rows[-1] |= {
            "status": search.status.kind,
            "reason": search.status.sentence,
            "objective": float(search.best.values[0]),
            "violation": search.violation,
            "evaluations": len(search.trials),
            **dict(zip(problem.names, search.best.numbers.tolist(), strict=True)),
        }
        if search.was_ended:
            status = _INTERRUPTED if search.progress_error is None else search.status
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
