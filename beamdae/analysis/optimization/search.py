"""Search of an optimum: the policy that both solvers share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.optimality import Linearization
from beamdae.analysis.optimization.problem import (
    FEASIBILITY_TOLERANCE,
    DesignProblem,
    require_units,
)
from beamdae.analysis.optimization.search_result import SearchResult, Trial
from beamdae.analysis.optimization.solvers import (
    Method,
    SmoothProblem,
    solve,
)
from beamdae.errors import (
    BeamdaeError,
    ProgressError,
    call_progress,
    format_count,
    format_exception,
)
from beamdae.interrupts import acknowledge
from beamdae.results.outcome import Status

Array = np.ndarray

# Smallest decrease without constraints and bounds to which the possible decrease is relative, of
# the scaled objective: gradients of minima in the interior vanish.
_MIN_DECREASE = 0.1
# A search ends if this number of designs in a row failed or brought no progress.
_MAX_IDLE_DESIGNS = 20
# Relative decrease of the violation that is progress.
_MIN_PROGRESS = 1e-3
# Relative difference of the maximum over a run from its assumed ratio to the smooth maximum.
_RATIO_TOLERANCE = 1e-3
_MAX_ROUNDS = 6  # of searches with other ratios of maxima


@dataclass(frozen=True)
class SearchSettings:
    """Arguments of `optimize` for a search."""

    method: Method
    max_evaluations: int
    tolerance: float
    progress: Callable[[int, float, float], object] | None
    earlier_designs: int = 0  # of earlier searches, for `progress`


class _SearchEndError(Exception):
    """End of a search for a reason other than that of its solver."""

    def __init__(self, kind: Any, sentence: str) -> None:
        super().__init__(sentence)
        self.status = Status(kind, sentence)


class Search:
    """Minimization from the first design of a problem.

    All designs of a solver have the same ratios of maxima to smooth maxima, with which the values
    are smooth functions: maxima have kinks (Le et al., Struct. Multidisc. Optim. 41 (2010) 605,
    doi:10.1007/s00158-009-0440-y).
    """

    def __init__(self, problem: DesignProblem, settings: SearchSettings) -> None:
        self._problem, self._settings = problem, settings
        self._trials: list[Trial] = []
        # Designs by the variables of the search.
        self._known: dict[bytes, Trial] = {}
        # Violations and objectives of designs that were progress of the present solver, and the
        # number of designs since the last one.
        self._progress: list[tuple[float, float]] = []
        self._idle = 0
        self._minimizes_violation = False
        self._end: Trial | None = None  # design at which the present solver converged

    def run(self) -> SearchResult:
        """Search until convergence, a limit or an interrupt.

        Raises
        ------
        BeamdaeError
            If an analysis of the first design or its gradient fails.
        """
        problem = self._problem
        first = problem.design(problem.first)
        units = tuple(problem.units_of(first.results))
        require_units(problem, units[1:])
        trial = Trial(problem.first, first.values)
        self._trials, self._known = [trial], {self._key(trial): trial}
        facts, error = {}, None
        try:
            self._problem = self._problem.scaled_by(first)
            self._report(trial)
            # Errors of the first gradient concern the model rather than a design.
            self._problem.linearize(trial.numbers, trial.values, False)
            status = self._search()
            facts = self._judge()
        except KeyboardInterrupt:
            acknowledge()
            sentence = f"interrupted after {format_count(len(self._trials), 'evaluation')}"
            status = Status("interrupted", sentence)
        except ProgressError as problem_of_progress:
            status, error = Status("failed", str(problem_of_progress)), problem_of_progress.problem
        except _SearchEndError as end:
            status = end.status
        return SearchResult(
            self._problem,
            self._best(),
            tuple(self._trials),
            status,
            first.results,
            units,
            self._settings.max_evaluations,
            **{"multipliers": np.full(len(problem.limits), np.nan), **facts},
            progress_error=error,
        ).conclude()

    def _search(self) -> Status:
        """Search until the maxima of the best design are those assumed."""
        for _ in range(_MAX_ROUNDS):
            status = self._solve()
            if status.success and self._violation(self._best()):
                status = self._solve(minimizes_violation=True)
                if status.success and not self._violation(self._best()):
                    status = self._solve()
            if not self._adopt_best() or not status.success:
                break
        return status

    def _solve(self, minimizes_violation: bool = False) -> Status:
        """Minimize the objective or the violation from the best design; return why it ended."""
        problem, settings, best = self._problem, self._settings, self._best()
        self._minimizes_violation, self._progress, self._idle = minimizes_violation, [], 0
        self._end = None
        points = [problem.variables.variables(best.numbers), *problem.variables.limits]
        if minimizes_violation:
            # The violation is the last variable.
            ends = self._violation(best), 0.0, np.inf
            points = [np.append(x, end) for x, end in zip(points, ends, strict=True)]
        smooth = SmoothProblem(self._values, self._gradients, len(problem.limits), *points)
        try:
            x = solve(smooth, settings.method, settings.tolerance, settings.max_evaluations)
        except _SearchEndError as end:
            return end.status
        self._end = self._known.get(x[: len(problem.names)].tobytes())
        return Status("ok", "the solver ended")

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return the function to minimize, infinite if an analysis fails, and the margins (C,)."""
        problem, free = self._problem, x[: len(self._problem.names)]
        trial = self._known.get(free.tobytes()) or self._evaluate(free)
        if trial.failure:
            return np.inf, np.zeros(len(problem.ratios))
        margins = problem.margins(trial.values)
        if self._minimizes_violation:
            return float(x[-1]), margins + x[-1]
        return problem.scaled_objective(trial.values), problem.log_margins(margins)[0]

    def _gradients(self, x: Array) -> tuple[Array, Array]:
        """Return the derivatives of the function to minimize and of the margins.

        The search ends at designs that satisfy the conditions of first order, and where no step
        reduces the violation.
        """
        trial = self._known[x[: len(self._problem.names)].tobytes()]
        if trial.failure:
            raise _SearchEndError("ok", "analyses fail")
        point = self._linearize(trial, not self._minimizes_violation)
        if np.all(point.margins >= -FEASIBILITY_TOLERANCE):
            if self._minimizes_violation or point.measure_decrease()[0] <= self._settings.tolerance:
                self._end = trial
                raise _SearchEndError("ok", "converged")
        elif self._violation(trial) and np.any(point.find_blocking()):
            raise _SearchEndError("ok", "the violation has a local minimum")
        if not self._minimizes_violation:
            return point.gradient, point.jacobian
        ones = np.ones((len(point.margins), 1))
        return np.append(0.0 * point.gradient, 1.0), np.hstack([point.jacobian, ones])

    def _evaluate(self, x: Array) -> Trial:
        """Analyze a design that is not known, unless the search has to end."""
        count, problem = len(self._trials), self._problem
        if count >= self._settings.max_evaluations:
            sentence = f"stopped after {format_count(count, 'evaluation')}"
            raise _SearchEndError("limited", f"{sentence}; increase max_evaluations=")
        if self._idle >= _MAX_IDLE_DESIGNS:
            raise _SearchEndError("ok", f"{self._idle} designs brought no progress")
        numbers = problem.variables.values(x)
        try:
            trial = Trial(numbers, problem.design(numbers).values)
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            nothing = np.full(1 + len(problem.ratios), np.nan)
            trial = Trial(numbers, nothing, describe_failure(failure))
        self._trials.append(trial)
        self._known[x.tobytes()] = trial
        self._idle += 1
        if not trial.failure:
            # Progress is a design that is not dominated: the filter of Fletcher & Leyffer, Math.
            # Program. 91 (2002) 239, doi:10.1007/s101070100244.
            violation, objective = self._violation(trial), problem.scaled_objective(trial.values)
            noise = max(self._settings.tolerance, float(problem.noise[0]))
            if all(
                violation < (1.0 - _MIN_PROGRESS) * other
                or (
                    not self._minimizes_violation
                    and objective < lowest - max(noise, _MIN_PROGRESS * other)
                )
                for other, lowest in self._progress
            ):
                self._progress.append((violation, objective))
                self._idle = 0
            self._report(trial)
        return trial

    def _adopt_best(self) -> bool:
        """Let further designs have the maxima of the best one.

        Return False if these are the present ones.
        """
        problem, best, limits = self._problem, self._best(), self._problem.limits
        with _failures_end():
            design = problem.design(best.numbers)
            rows = zip(limits, design.values[1:].tolist(), strict=True)
            ratios = np.array([design.maximum_ratio(limit, value) for limit, value in rows])
        is_off = np.abs(ratios - problem.ratios) > _RATIO_TOLERANCE * problem.ratios
        # Maxima that do not reach their limit need no further search.
        largest = np.maximum(ratios, problem.ratios) * np.abs(design.values[1:])
        reaches = largest * (1.0 + _RATIO_TOLERANCE) > np.abs([limit.bound for limit in limits])
        self._problem = replace(problem, ratios=np.where(is_off, ratios, problem.ratios))
        return bool(np.any(is_off & reaches))

    def _judge(self) -> dict[str, Any]:
        """Return the conditions of first order at the best design; see `SearchResult`."""
        problem, best = self._problem, self._best()
        point = self._linearize(best, False)
        decrease, multipliers = point.measure_decrease()
        is_blocking = (
            point.find_blocking() if self._violation(best) else np.zeros(len(point.margins))
        )
        has_effect = np.any(np.vstack([point.gradient, point.jacobian]), axis=0)
        return {
            "multipliers": multipliers * problem.scales[0] / problem.scales[1:],
            "residual": decrease / max(float(np.linalg.norm(point.gradient)), _MIN_DECREASE),
            "blocking": tuple(
                x.label for x, y in zip(problem.limits, is_blocking, strict=True) if y
            ),
            "idle": tuple(x for x, y in zip(problem.names, has_effect, strict=True) if not y),
        }

    def _linearize(self, trial: Trial, is_logarithmic: bool) -> Linearization:
        with _failures_end():
            return self._problem.linearize(trial.numbers, trial.values, is_logarithmic)

    def _report(self, trial: Trial) -> None:
        if self._settings.progress is not None:
            count = self._settings.earlier_designs + len(self._trials)
            facts = float(trial.values[0]), self._violation(trial)
            call_progress(self._settings.progress, count, *facts)

    def _key(self, trial: Trial) -> bytes:
        return self._problem.variables.variables(trial.numbers).tobytes()

    def _violation(self, trial: Trial) -> float:
        return self._problem.violation(trial.values)

    def _best(self) -> Trial:
        """Return the end of a solver that converged, otherwise the best design."""
        if self._end is not None and not self._end.failure and not self._violation(self._end):
            return self._end
        designs = (x for x in self._known.values() if not x.failure)
        return min(designs, key=lambda x: (self._violation(x), float(x.values[0])))


@contextmanager
def _failures_end() -> Iterator[None]:
    """End a search at a failure of an analysis or a gradient."""
    try:
        yield
    except (BeamdaeError, ArithmeticError) as failure:
        raise _SearchEndError("failed", describe_failure(failure)) from failure


def describe_failure(failure: Exception) -> str:
    """Return the message of an error of an analysis or of the model function."""
    if isinstance(failure, BeamdaeError):
        return str(failure).removeprefix("optimize: ").removesuffix(".")
    return format_exception(failure)
