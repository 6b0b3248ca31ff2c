"""Search of an optimum: the policy that both solvers share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.optimality import (
    Linearization,
    find_blocking,
    measure_decrease,
)
from beamdae.analysis.optimization.problem import DesignProblem, require_units
from beamdae.analysis.optimization.scaling import FEASIBILITY_TOLERANCE, ScaledProblem
from beamdae.analysis.optimization.solvers import (
    Method,
    SmoothProblem,
    measure_violations,
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
_MAX_ROUNDS = 6  # of searches with other stress sections or ratios of maxima


@dataclass(frozen=True)
class SearchSettings:
    """Arguments of `optimize` for a search."""

    method: Method
    max_evaluations: int
    tolerance: float
    progress: Callable[[int, float, float], object] | None
    earlier_designs: int = 0  # of earlier searches, for `progress`


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
    scaled
        The problem with the stress sections and the ratios of maxima of the best design.
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

    scaled: ScaledProblem
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
    def problem(self) -> DesignProblem:
        """The problem with the stress sections of the best design."""
        return self.scaled.problem

    @property
    def was_ended(self) -> bool:
        """True if an interrupt or an exception of `progress` ended the search."""
        return self.status.kind == "interrupted" or self.progress_error is not None

    @property
    def violation(self) -> float:
        """Largest violation of a limit by the best design, 0 within the tolerances."""
        return self.scaled.violation(self.best.values)


class _SearchEndError(Exception):
    """End of a search for a reason other than that of its solver."""

    def __init__(self, kind: Any, sentence: str) -> None:
        super().__init__(sentence)
        self.status = Status(kind, sentence)


class Search:
    """Minimization from the first design of a problem.

    All designs of a solver have the same stress sections and ratios of maxima to smooth maxima,
    with which the values are smooth functions: bounds of stresses jump where the number of sections
    changes, and maxima have kinks (Le et al., Struct. Multidisc. Optim. 41 (2010) 605,
    doi:10.1007/s00158-009-0440-y).
    """

    def __init__(self, problem: DesignProblem, settings: SearchSettings) -> None:
        self._scaled, self._settings = ScaledProblem.of(problem), settings
        self._trials: list[Trial] = []
        # Designs with the present stress sections, by the variables of the search.
        self._known: dict[bytes, Trial] = {}
        # Violations and objectives of designs that were progress of the present solver, and the
        # number of designs since the last one.
        self._progress: list[tuple[float, float]] = []
        self._idle = 0
        self._end: Trial | None = None  # design at which the present solver converged
        self._minimizes_violation = False

    def run(self) -> SearchResult:
        """Search until convergence, a limit or an interrupt.

        Raises
        ------
        BeamdaeError
            If an analysis of the first design or its gradient fails.
        """
        problem = self._scaled.problem
        first = problem.design(problem.first)
        units = tuple(problem.units_of(first.results))
        require_units(problem, units[1:])
        self._scaled = replace(self._scaled, problem=problem.with_sections_of(first))
        trial = Trial(problem.first, first.values)
        self._trials, self._known = [trial], {self._key(trial): trial}
        facts, error = {}, None
        try:
            self._scaled = self._scaled.scaled_by(first)
            self._report(trial)
            # Errors of the first gradient concern the model rather than a design.
            self._linearize(trial)
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
            self._scaled,
            self._best(),
            tuple(self._trials),
            status,
            first.results,
            units,
            self._settings.max_evaluations,
            **{"multipliers": np.full(len(problem.limits), np.nan), **facts},
            progress_error=error,
        )

    def _search(self) -> Status:
        """Search until the stress sections and maxima of the best design are those assumed."""
        for count in range(_MAX_ROUNDS):
            status = self._solve()
            if status.success and self._violation(self._best()):
                status = self._solve(minimizes_violation=True)
                if status.success and not self._violation(self._best()):
                    status = self._solve()
            if not self._adopt_best(adds=count > 0) or not status.success:
                break
        return status

    def _solve(self, minimizes_violation: bool = False) -> Status:
        """Minimize the objective or the violation from the best design; return why it ended."""
        problem, settings = self._scaled.problem, self._settings
        best = self._best()
        self._minimizes_violation, self._end = minimizes_violation, None
        self._progress, self._idle = [], 0
        points = (problem.variables(x) for x in (best.numbers, problem.lower, problem.upper))
        smooth = SmoothProblem(self._values, self._gradients, len(problem.limits), *points)
        if minimizes_violation:
            smooth = measure_violations(smooth, self._violation(best))
        try:
            x = solve(smooth, settings.method, settings.tolerance, settings.max_evaluations)
        except _SearchEndError as end:
            return end.status
        self._end = self._known.get(x[: len(best.numbers)].tobytes())
        return Status("ok", "the solver ended")

    def _adopt_best(self, adds: bool) -> bool:
        """Let further designs have the stress sections and maxima of the best one.

        Return False if these are the present ones. If `adds`, sections are added to the present
        ones, so that two designs with different sections cannot follow each other without end.
        """
        scaled, best = self._scaled, self._best()
        problem, limits = scaled.problem, scaled.problem.limits
        try:
            own = replace(problem, sections={}) if problem.sections else problem
            design = own.design(best.numbers)
            rows = zip(limits, design.values[1:].tolist(), strict=True)
            ratios = np.array([design.maximum_ratio(limit, value) for limit, value in rows])
        except (BeamdaeError, ArithmeticError) as failure:
            raise _SearchEndError("failed", describe_failure(failure)) from failure
        one, other = (
            np.append(scaled.objective(x), -scaled.margins(x)) for x in (design.values, best.values)
        )
        # Additional sections only increase the values.
        has_changed = np.max(one - other if adds else np.abs(one - other)) > FEASIBILITY_TOLERANCE
        if has_changed:
            problem = problem.with_sections_of(design, adds)
            trial = replace(best, values=design.values)
            self._trials = [trial if x is best else x for x in self._trials]
            self._known = {self._key(trial): trial}
        is_off = np.abs(ratios - scaled.ratios) > _RATIO_TOLERANCE * scaled.ratios
        # Maxima that do not reach their limit need no further search.
        largest = np.maximum(ratios, scaled.ratios) * np.abs(design.values[1:])
        reaches = largest * (1.0 + _RATIO_TOLERANCE) > np.abs([limit.bound for limit in limits])
        self._scaled = replace(
            scaled, problem=problem, ratios=np.where(is_off, ratios, scaled.ratios)
        )
        has_changed |= bool(np.any(is_off & reaches))
        self._end = None if has_changed else self._end
        return bool(has_changed)

    def _judge(self) -> dict[str, Any]:
        """Return the conditions of first order at the best design; see `SearchResult`."""
        scaled, best = self._scaled, self._best()
        point = self._linearize(best, is_logarithmic=False)
        decrease, multipliers = measure_decrease(point)
        limits, names = scaled.problem.limits, scaled.problem.names
        is_blocking = np.zeros(len(limits), bool)
        if self._violation(best):
            is_blocking = find_blocking(point)
        has_effect = np.any(np.vstack([point.gradient, point.jacobian]), axis=0)
        return {
            "multipliers": multipliers * scaled.scales[0] / scaled.scales[1:],
            "residual": decrease / max(point.free_decrease, _MIN_DECREASE),
            "blocking": tuple(x.label for x, y in zip(limits, is_blocking, strict=True) if y),
            "idle": tuple(x for x, y in zip(names, has_effect, strict=True) if not y),
        }

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return the scaled objective, infinite if an analysis fails, and the margins (C,)."""
        trial = self._known.get(x.tobytes()) or self._evaluate(x)
        if trial.failure:
            return np.inf, np.zeros(len(self._scaled.ratios))
        scaled = self._scaled
        plain = self._minimizes_violation
        margins = scaled.margins(trial.values) if plain else scaled.log_margins(trial.values)[0]
        return scaled.objective(trial.values), margins

    def _gradients(self, x: Array) -> tuple[Array, Array]:
        """Return the gradient of the scaled objective and the derivatives of the margins.

        The search ends at designs that satisfy the conditions of first order, and where no step
        reduces the violation.
        """
        trial = self._known[x.tobytes()]
        if trial.failure:
            raise _SearchEndError("ok", "analyses fail")
        point = self._linearize(trial, not self._minimizes_violation)
        if np.all(point.margins >= -FEASIBILITY_TOLERANCE):
            if self._minimizes_violation or measure_decrease(point)[0] <= self._settings.tolerance:
                self._end = trial
                raise _SearchEndError("ok", "converged")
        elif self._violation(trial) and np.any(find_blocking(point)):
            raise _SearchEndError("ok", "the violation has a local minimum")
        return point.gradient, point.jacobian

    def _linearize(self, trial: Trial, is_logarithmic: bool = True) -> Linearization:
        try:
            return self._scaled.linearize(trial.numbers, trial.values, is_logarithmic)
        except (BeamdaeError, ArithmeticError) as failure:
            if len(self._trials) == 1:
                raise
            raise _SearchEndError("failed", describe_failure(failure)) from failure

    def _evaluate(self, x: Array) -> Trial:
        count, scaled = len(self._trials), self._scaled
        if count >= self._settings.max_evaluations:
            sentence = f"stopped after {format_count(count, 'evaluation')}"
            raise _SearchEndError("limited", f"{sentence}; increase max_evaluations=")
        if self._idle >= _MAX_IDLE_DESIGNS:
            raise _SearchEndError("ok", f"{self._idle} designs brought no progress")
        numbers = scaled.problem.numbers(x)
        try:
            trial = Trial(numbers, scaled.problem.design(numbers).values)
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            nothing = np.full(1 + len(scaled.ratios), np.nan)
            trial = Trial(numbers, nothing, describe_failure(failure))
        self._trials.append(trial)
        self._known[x.tobytes()] = trial
        self._idle += 1
        if not trial.failure:
            # Progress is a design that is not dominated: the filter of Fletcher & Leyffer, Math.
            # Program. 91 (2002) 239, doi:10.1007/s101070100244.
            violation, objective = self._violation(trial), scaled.objective(trial.values)
            noise = max(self._settings.tolerance, float(scaled.problem.noise[0]))
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

    def _report(self, trial: Trial) -> None:
        if self._settings.progress is not None:
            count = self._settings.earlier_designs + len(self._trials)
            facts = float(trial.values[0]), self._violation(trial)
            call_progress(self._settings.progress, count, *facts)

    def _key(self, trial: Trial) -> bytes:
        return self._scaled.problem.variables(trial.numbers).tobytes()

    def _violation(self, trial: Trial) -> float:
        return self._scaled.violation(trial.values)

    def _best(self) -> Trial:
        """Return the end of a solver that converged, otherwise the best design."""
        if self._end is not None and not self._end.failure and not self._violation(self._end):
            return self._end
        designs = (x for x in self._known.values() if not x.failure)
        return min(designs, key=lambda x: (self._violation(x), float(x.values[0])))


def describe_failure(failure: Exception) -> str:
    """Return the message of an error of an analysis or of the model function."""
    if isinstance(failure, BeamdaeError):
        return str(failure).removeprefix("optimize: ").removesuffix(".")
    return format_exception(failure)
