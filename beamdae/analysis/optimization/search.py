"""Search of an optimum: the policy that both solvers share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.optimality import (
    Linearization,
    find_blocking,
    measure_decrease,
)
from beamdae.analysis.optimization.problem import Design, DesignProblem
from beamdae.analysis.optimization.scaling import FEASIBILITY_TOLERANCE, Scaling
from beamdae.analysis.optimization.search_result import (
    SearchResult,
    SearchSettings,
    Trial,
    describe_early_end,
    describe_failure,
    describe_violation,
)
from beamdae.analysis.optimization.solvers import SmoothProblem, measure_violations, solve
from beamdae.errors import (
    BeamdaeError,
    ProgressError,
    call_progress,
    format_count,
    record_messages,
    warn_of_result,
)
from beamdae.interrupts import acknowledge
from beamdae.results.outcome import Status

Array = np.ndarray

# Decrease of the linearized objective within a step of one size, relative to that without
# constraints and bounds, up to which a design is an optimum.
_OPTIMALITY_TOLERANCE = 0.05
# Smallest decrease without constraints and bounds to which this is relative, of the scaled
# objective: gradients of minima in the interior vanish.
_MIN_DECREASE = 0.1
# A search ends if this number of designs in a row failed or brought no progress.
_MAX_IDLE_DESIGNS = 20
# Relative decrease of the violation that is progress.
_MIN_PROGRESS = 1e-3
# Relative difference of the maximum over a run from its assumed ratio to the smooth maximum.
_RATIO_TOLERANCE = 1e-3
_MAX_SEARCHES = 6  # with other stress sections or ratios of maxima
INTERRUPTED_CHECKS = "interrupted while the best design was checked"


class _SearchEndError(Exception):
    """End of a search for a reason other than that of its solver."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.sentence)
        self.status = status


class Search:
    """Minimization from the first design of a problem."""

    def __init__(self, problem: DesignProblem, settings: SearchSettings) -> None:
        self._problem, self._settings = problem, settings
        # All evaluated designs, and those with the present stress sections by their numbers.
        self._trials: list[Trial] = []
        self._known: dict[bytes, Trial] = {}
        self._filter: list[Trial] = []  # designs with progress of the present solver
        self._idle = 0  # designs since the last one
        self._end: Trial | None = None
        self._last: tuple[Trial, Linearization] | None = None
        # Values (k,) of the numbers with which the solver begins, and True if it minimizes the
        # violation instead of the objective.
        self._first, self._of_violation = problem.first, False
        self._scaling = Scaling(problem)
        self._first_analyses: tuple[Any, ...] = ()

    def run(self) -> SearchResult:
        """Search until convergence, a limit or an interrupt.

        Raises
        ------
        BeamdaeError
            If an analysis of the first design or its gradient fails.
        """
        problem = self._problem
        first = self._analyze_first()
        problem.require_units(first.results)
        self._first_analyses = first.results
        try:
            try:
                self._scaling.scale_to(first, problem.sizes)
            finally:
                # The result of an interrupted search is at least the first design.
                self._problem = problem.with_sections_of(first)
                self._record(Trial(problem.first, first.values, np.nan))
            # Errors of the gradient concern the model rather than a design.
            self._linearize(self._trials[0])
            return self._search()
        except KeyboardInterrupt:
            acknowledge()
            sentence = f"interrupted after {format_count(len(self._trials), 'evaluation')}"
            return self._result(Status("interrupted", sentence))
        except ProgressError as error:
            result = self._result(Status("failed", str(error)))
            return replace(result, progress_error=error.problem)

    def _search(self) -> SearchResult:
        """Search until the stress sections and maxima of the best design are those assumed.

        All designs of a solver have the same stress sections and ratios of maxima to smooth maxima,
        with which the values are smooth functions: bounds of stresses jump where the number of
        sections changes, and maxima have kinks (Le et al., Struct. Multidisc. Optim. 41 (2010) 605,
        doi:10.1007/s00158-009-0440-y).
        """
        status, ends = Status("ok", ""), []
        for count in range(_MAX_SEARCHES):
            status = self._minimize(self._best())
            if status.success and self._best().violation:
                status = self._minimize(self._best(), of_violation=True)
                if status.success and not self._best().violation:
                    status = self._minimize(self._best())
            try:
                is_changed = self._update_choices(is_first=count == 0)
            except (BeamdaeError, ArithmeticError) as failure:
                status, is_changed = Status("failed", describe_failure(failure)), False
            except KeyboardInterrupt:
                acknowledge()
                return self._result(Status("interrupted", INTERRUPTED_CHECKS))
            ends.append((self._problem, self._best()))
            if not is_changed or not status.success:
                break
        last = ends[-1]
        if self._scaling.rate(last[1]).violation:
            last = min(ends, key=lambda x: _rank(self._scaling.rate(x[1])))
        self._problem, best = last
        self._known = {best.numbers.tobytes(): self._scaling.rate(best)}
        self._end = None
        return self._conclude(status)

    def _minimize(self, first: Trial, of_violation: bool = False) -> Status:
        """Minimize the objective or the violation from a design; return the reason of the end."""
        problem, settings = self._problem, self._settings
        self._first, self._of_violation = first.numbers, of_violation
        points = (problem.variables(x) for x in (first.numbers, problem.lower, problem.upper))
        smooth = SmoothProblem(self._values, self._gradients, len(problem.limits), *points)
        if of_violation:
            worst = -float(np.min(self._transform(first)[0]))
            smooth = measure_violations(smooth, worst)
        self._filter, self._idle, self._end, self._last = [], 0, None, None
        try:
            x = solve(smooth, settings.method, settings.tolerance, settings.max_evaluations)
        except _SearchEndError as end:
            return end.status
        count = len(problem.first)
        self._end = self._known.get(self._numbers(x[:count]).tobytes())
        return Status("ok", "the solver ended")

    def _update_choices(self, is_first: bool) -> bool:
        """Let further designs have the stress sections and maxima of the best one.

        Return False if these are the present ones. From the second time on, sections are added to
        the present ones, so that two designs with different sections cannot follow each other
        without end.
        """
        best, problem = self._best(), self._problem
        design = problem.design(best.numbers)
        if problem.sections:
            own = problem.with_sections({}).design(best.numbers)
            trial = replace(best, values=own.values)
            before, after = (self._scaling.margins(x.values) for x in (best, own))
            excess = (own.values[0] - best.values[0]) / self._scaling.scales[0]
            excess = np.append(excess, before - after)
            if np.max(np.abs(excess) if is_first else excess) > FEASIBILITY_TOLERANCE:
                self._problem, design = problem.with_sections_of(own, not is_first), own
                self._known = {best.numbers.tobytes(): trial}
                self._trials = [x if x.numbers is not best.numbers else trial for x in self._trials]
                best = trial
        rows = zip(problem.limits, best.values[1:].tolist(), strict=True)
        ratios = np.array([design.maximum_ratio(limit, value) for limit, value in rows])
        present = self._scaling.ratios
        is_off = np.abs(ratios - present) > _RATIO_TOLERANCE * present
        # Maxima that do not reach their limit need no further search.
        largest = np.maximum(ratios, present) * np.abs(best.values[1:])
        bounds = np.abs([limit.bound for limit in problem.limits])
        is_limiting = is_off & (largest * (1.0 + _RATIO_TOLERANCE) > bounds)
        self._scaling.ratios = np.where(is_off, ratios, present)
        self._known = {key: self._scaling.rate(trial) for key, trial in self._known.items()}
        is_changed = self._problem is not problem or bool(np.any(is_limiting))
        self._end = None if is_changed else self._end
        return is_changed

    def _numbers(self, x: Array) -> Array:
        """Return the values (k,) of the numbers; those of the first variables are exact."""
        is_first = np.array_equal(x, self._problem.variables(self._first))
        return self._first if is_first else self._problem.numbers(x)

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return the scaled objective, infinite if an analysis fails, and the margins (C,)."""
        numbers = self._numbers(x)
        trial = self._known.get(numbers.tobytes()) or self._evaluate(numbers)
        if trial.failure:
            return np.inf, np.zeros(len(self._scaling.ratios))
        return float(trial.values[0] / self._scaling.scales[0]), self._transform(trial)[0]

    def _gradients(self, x: Array) -> tuple[Array, Array]:
        """Return the gradient of the scaled objective and the derivatives of the margins.

        The search ends at designs that satisfy the conditions of first order, and where no step
        reduces the violation.
        """
        trial = self._known[self._numbers(x).tobytes()]
        if trial.failure:
            raise _SearchEndError(Status("ok", "analyses fail"))
        is_new = self._last is None or self._last[0] is not trial
        try:
            point = self._linearize(trial)
        except (BeamdaeError, ArithmeticError) as failure:
            raise _SearchEndError(Status("failed", describe_failure(failure))) from failure
        if is_new and np.all(point.margins >= -FEASIBILITY_TOLERANCE):
            if self._of_violation or measure_decrease(point)[0] <= self._settings.tolerance:
                self._end = trial
                raise _SearchEndError(Status("ok", "converged"))
        elif is_new and trial.violation and np.any(find_blocking(point)):
            raise _SearchEndError(Status("ok", "the violation has a local minimum"))
        return point.gradient, point.jacobian

    def _transform(self, trial: Trial) -> tuple[Array, Array]:
        return self._scaling.transform(trial.values, self._of_violation)

    def _linearize(self, trial: Trial) -> Linearization:
        if self._last is None or self._last[0] is not trial:
            point = self._scaling.linearize(self._problem, trial, self._of_violation)
            self._last = trial, point
        return self._last[1]

    def _evaluate(self, numbers: Array) -> Trial:
        if len(self._trials) >= self._settings.max_evaluations:
            count = format_count(len(self._trials), "evaluation")
            sentence = f"stopped after {count}; increase max_evaluations="
            raise _SearchEndError(Status("limited", sentence))
        if self._idle >= _MAX_IDLE_DESIGNS:
            raise _SearchEndError(Status("ok", f"{self._idle} designs brought no progress"))
        values = np.full(1 + len(self._scaling.ratios), np.nan)
        try:
            return self._record(Trial(numbers, self._problem.design(numbers).values, np.nan))
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            return self._record(Trial(numbers, values, np.nan, describe_failure(failure)))

    def _record(self, trial: Trial) -> Trial:
        trial = self._scaling.rate(trial)
        self._trials.append(trial)
        self._known[trial.numbers.tobytes()] = trial
        self._idle += 1
        if not trial.failure:
            if self._is_progress(trial):
                self._filter.append(trial)
                self._idle = 0
            if self._settings.progress is not None:
                status = len(self._trials), float(trial.values[0]), trial.violation
                call_progress(self._settings.progress, *status)
        return trial

    def _is_progress(self, trial: Trial) -> bool:
        """Return True if no design of the search is better in the objective and the violation.

        This is the filter of Fletcher & Leyffer, Math. Program. 91 (2002) 239,
        doi:10.1007/s101070100244.
        """
        least = max(self._settings.tolerance, float(self._problem.noise[0]))
        objective, is_progress = trial.values[0] / self._scaling.scales[0], True
        for other in self._filter:
            decrease = other.values[0] / self._scaling.scales[0] - objective
            is_nearer = trial.violation < (1.0 - _MIN_PROGRESS) * other.violation
            is_better = decrease > max(least, _MIN_PROGRESS * other.violation)
            is_progress &= bool(is_nearer or (is_better and not self._of_violation))
        return is_progress

    def _best(self) -> Trial:
        """Return the end of a search that converged, otherwise the best design."""
        if self._end is not None and not self._end.violation:
            return self._end
        return min((x for x in self._known.values() if not x.failure), key=_rank)

    def _result(self, status: Status, **optimality: Any) -> SearchResult:
        scaling = self._scaling
        trials = tuple(scaling.rate(x) for x in self._trials)
        return SearchResult(
            self._problem,
            self._best(),
            trials,
            status,
            scaling.ratios,
            scaling.tolerances,
            scaling.scales,
            self._first_analyses,
            self._settings.max_evaluations,
            **optimality,
        )

    def _conclude(self, status: Status) -> SearchResult:
        """Return the result, whose status follows from the conditions of first order."""
        best, scales = self._best(), self._scaling.scales
        self._of_violation, self._last = bool(best.violation), None
        try:
            point = self._linearize(best)
        except (BeamdaeError, ArithmeticError) as failure:
            return self._result(Status("failed", describe_failure(failure)))
        except KeyboardInterrupt:
            acknowledge()
            return self._result(Status("interrupted", INTERRUPTED_CHECKS))
        decrease, multipliers = measure_decrease(point)
        residual = decrease / max(point.free_decrease, _MIN_DECREASE)
        result = self._result(
            status,
            multipliers=multipliers * self._transform(best)[1] * scales[0] / scales[1:],
            residual=residual,
            has_effect=np.any(np.vstack([point.gradient, point.jacobian]), axis=0),
        )
        if best.violation:
            rows = zip(self._problem.limits, find_blocking(point), strict=True)
            status = describe_violation(result, [limit.label for limit, x in rows if x])
        elif status.success and residual <= _OPTIMALITY_TOLERANCE:
            status = Status("ok", "converged")
        else:
            status = describe_early_end(result)
        return replace(result, status=status)

    def _analyze_first(self) -> Design:
        """Return the first design; if its analysis fails, issue the warnings of the analysis."""
        with record_messages() as messages:
            try:
                return self._problem.design(self._first)
            except BeamdaeError as error:
                # The sentence on the end of an analysis is part of the error.
                warn_of_result(
                    x for x in messages if x.partition(": ")[2].rstrip(".") not in str(error)
                )
                raise


def _rank(trial: Trial) -> tuple[float, float]:
    return trial.violation, float(trial.values[0])
