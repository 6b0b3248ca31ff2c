"""Search of an optimum: the policy that both solvers share.

The first part of this file is the policy: scales, the choices that all designs of a search share,
failed designs, the ends of searches and their verdicts. The second part contains the sentences.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.optimization.optimality import (
    Linearization,
    measure_decrease,
    measure_violation,
)
from beamdae.analysis.optimization.problem import Design, DesignProblem
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
    format_distinct,
    format_exception,
    list_first,
    record_messages,
    warn_of_result,
)
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import format_with_unit
from beamdae.results.outcome import Status

Array = np.ndarray

# Violation of a limit, relative to the limit, up to which a design satisfies it.
FEASIBILITY_TOLERANCE = 1e-6
# Decrease of the linearized objective within one size of the variables, relative to that without
# constraints and bounds, up to which a design is an optimum.
_OPTIMALITY_TOLERANCE = 1e-2
# Smallest decrease without constraints and bounds to which this is relative, of the scaled
# objective: gradients of minima in the interior vanish.
_MIN_DECREASE = 0.1
# Relative decrease of the violation below which the limits contradict each other to first order.
_MIN_VIOLATION_DECREASE = 1e-3
# A search ends if this number of designs in a row failed or are no better than the best one.
_MAX_IDLE_DESIGNS = 20
# Relative difference of the maximum over a run from its assumed ratio to the smooth maximum.
_RATIO_TOLERANCE = 1e-3
_MAX_SEARCHES = 6  # with other stress sections or ratios of maxima
_MIN_LOGARITHMIC_RATIO = 0.5  # of a value to its limit, from which on margins are logarithms
# Distance from a bound, in sizes of the number, up to which a number is at it.
_BOUND_DISTANCE = 1e-4
_MAX_NAMES = 3  # in a sentence
# Ratio of a limit and a value from which they are far apart: mm and degrees are 1000 and 57 times
# smaller than m and rad.
FAR_RATIO = 20.0
_OTHER_START = (
    "the search is local, start it from other values (parameters={name: value}) or increase starts="
)
INTERRUPTED_CHECKS = "interrupted while the best design was checked"


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
        self._scales = np.array([1.0, *(abs(x.bound) or 1.0 for x in problem.limits)])
        self._ratios = np.ones(len(problem.limits))
        self._tolerances = np.maximum(FEASIBILITY_TOLERANCE, problem.noise[1:])
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
                self._choose_scales(first)
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
        if self._rate(last[1]).violation:
            last = min(ends, key=lambda x: _rank(self._rate(x[1])))
        self._problem, best = last
        self._known = {best.numbers.tobytes(): self._rate(best)}
        self._end = None
        return self._conclude(status)

    def _minimize(self, first: Trial, of_violation: bool = False) -> Status:
        """Minimize the objective or the violation from a design; return the reason of the end."""
        problem, settings = self._problem, self._settings
        self._first, self._of_violation = first.numbers, of_violation
        points = (problem.variables(x) for x in (first.numbers, problem.lower, problem.upper))
        smooth = SmoothProblem(self._values, self._gradients, len(problem.limits), *points)
        if of_violation:
            worst = -float(np.min(self._transform(first.values)[0]))
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
            excess = np.append(0.0, self._margins(best.values) - self._margins(own.values))
            excess[0] = (own.values[0] - best.values[0]) / self._scales[0]
            if np.max(np.abs(excess) if is_first else excess) > FEASIBILITY_TOLERANCE:
                self._problem, design = problem.with_sections_of(own, not is_first), own
                self._known = {best.numbers.tobytes(): trial}
                self._trials = [x if x.numbers is not best.numbers else trial for x in self._trials]
                best = trial
        values, limits = best.values[1:].tolist(), self._problem.limits
        pairs = zip(limits, values, strict=True)
        ratios = np.array([design.maximum_ratio(limit, value) for limit, value in pairs])
        is_off = np.abs(ratios - self._ratios) > _RATIO_TOLERANCE * self._ratios
        bounds = np.abs([limit.bound for limit in limits])
        largest = np.maximum(ratios, self._ratios) * np.abs(values)
        is_limiting = is_off & (largest * (1.0 + _RATIO_TOLERANCE) > bounds)
        self._ratios = np.where(is_off, ratios, self._ratios)
        self._known = {key: self._rate(trial) for key, trial in self._known.items()}
        is_changed = self._problem is not problem or bool(np.any(is_limiting))
        self._end = None if is_changed else self._end
        return is_changed

    def _choose_scales(self, first: Design) -> None:
        """Scale limits by their bounds; the objective and limits of zero by their first values."""
        is_missing = np.array([True, *(x.bound == 0.0 for x in self._problem.limits)])
        changes = np.linalg.norm(first.gradients * self._problem.sizes, axis=1)
        sizes = np.maximum(np.abs(first.values), changes)
        self._scales = np.where(is_missing & (sizes > 0.0), sizes, self._scales)

    def _numbers(self, x: Array) -> Array:
        """Return the values (k,) of the numbers; those of the first variables are exact."""
        is_first = np.array_equal(x, self._problem.variables(self._first))
        return self._first if is_first else self._problem.numbers(x)

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return the scaled objective, infinite if an analysis fails, and the margins (C,)."""
        numbers = self._numbers(x)
        trial = self._known.get(numbers.tobytes()) or self._evaluate(numbers)
        if trial.failure:
            return np.inf, np.zeros(len(self._ratios))
        return float(trial.values[0] / self._scales[0]), self._transform(trial.values)[0]

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
        elif is_new and trial.violation and _is_blocked(point):
            raise _SearchEndError(Status("ok", "the violation has a local minimum"))
        return point.gradient, point.jacobian

    def _linearize(self, trial: Trial) -> Linearization:
        if self._last is None or self._last[0] is not trial:
            problem = self._problem
            rates = problem.design(trial.numbers).gradients * problem.rates(trial.numbers)
            rows = rates / self._scales[:, None]
            margins, slopes = self._transform(trial.values)
            signs = self._ratios * [limit.sign for limit in problem.limits]
            bounds = (problem.variables(x) for x in (problem.lower, problem.upper))
            distances = (x - problem.variables(trial.numbers) for x in bounds)
            jacobian = -(slopes * signs)[:, None] * rows[1:]
            self._last = trial, Linearization(rows[0], margins, jacobian, *distances)
        return self._last[1]

    def _evaluate(self, numbers: Array) -> Trial:
        if len(self._trials) >= self._settings.max_evaluations:
            count = format_count(len(self._trials), "evaluation")
            sentence = f"stopped after {count}; increase max_evaluations="
            raise _SearchEndError(Status("limited", sentence))
        if self._idle >= _MAX_IDLE_DESIGNS:
            raise _SearchEndError(Status("ok", f"{self._idle} designs brought no progress"))
        values = np.full(1 + len(self._ratios), np.nan)
        try:
            return self._record(Trial(numbers, self._problem.design(numbers).values, np.nan))
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            return self._record(Trial(numbers, values, np.nan, describe_failure(failure)))

    def _record(self, trial: Trial) -> Trial:
        trial = self._rate(trial)
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
        objective, is_progress = trial.values[0] / self._scales[0], True
        for other in self._filter:
            decrease = other.values[0] / self._scales[0] - objective
            is_nearer = trial.violation < (1.0 - _MIN_VIOLATION_DECREASE) * other.violation
            is_better = decrease > max(least, _MIN_VIOLATION_DECREASE * other.violation)
            is_progress &= bool(is_nearer or is_better)
        return is_progress

    def _rate(self, trial: Trial) -> Trial:
        """Return a design with its violation by the present ratios of maxima."""
        if trial.failure:
            return trial
        excess = -self._margins(trial.values)
        violation = np.max(excess[excess > self._tolerances], initial=0.0)
        return replace(trial, violation=float(violation))

    def _margins(self, values: Array) -> Array:
        """Return the scaled margins (C,) of the constraints for values (1 + C,) of a design."""
        rows = zip(self._problem.limits, self._ratios.tolist(), values[1:].tolist(), strict=True)
        margins = [limit.margin(ratio * value) for limit, ratio, value in rows]
        return np.array(margins) / self._scales[1:]

    def _transform(self, values: Array) -> tuple[Array, Array]:
        """Return the margins (C,) that the solver sees, and their derivatives by scaled margins.

        Of a quantity whose magnitude r, relative to its limit, must not exceed 1, this is -ln(r)
        instead of 1 - r: stresses and deflections are nearly products of powers of thicknesses,
        whose logarithms are linear in those of the thicknesses. Below r = 1/2, the function
        continues as a straight line, because logarithms of small values diverge. Violations are
        minimized as they are.
        """
        margins, limits = self._margins(values), self._problem.limits
        is_magnitude = np.array([limit.sign * limit.bound > 0.0 for limit in limits], bool)
        is_magnitude &= not self._of_violation
        ratio = np.maximum(1.0 - margins, _MIN_LOGARITHMIC_RATIO)
        line = (_MIN_LOGARITHMIC_RATIO - (1.0 - margins)).clip(0.0) / _MIN_LOGARITHMIC_RATIO
        transformed = np.where(is_magnitude, line - np.log(ratio), margins)
        return transformed, np.where(is_magnitude, 1.0 / ratio, 1.0)

    def _best(self) -> Trial:
        """Return the end of a search that converged, otherwise the best design."""
        if self._end is not None and not self._end.violation:
            return self._end
        return min((x for x in self._known.values() if not x.failure), key=_rank)

    def _result(self, status: Status, **optimality: Any) -> SearchResult:
        trials = tuple(self._rate(x) for x in self._trials)
        return SearchResult(
            self._problem,
            self._best(),
            trials,
            status,
            self._ratios,
            self._tolerances,
            self._first_analyses,
            self._settings.max_evaluations,
            **optimality,
        )

    def _conclude(self, status: Status) -> SearchResult:
        """Return the result, whose status follows from the conditions of first order."""
        best = self._best()
        self._of_violation, self._last = bool(best.violation), None
        try:
            point = self._linearize(best)
            blocking = self._list_blocking(point) if best.violation else []
        except (BeamdaeError, ArithmeticError) as failure:
            return self._result(Status("failed", describe_failure(failure)))
        except KeyboardInterrupt:
            acknowledge()
            return self._result(Status("interrupted", INTERRUPTED_CHECKS))
        decrease, multipliers = measure_decrease(point)
        residual = decrease / max(float(np.sum(np.abs(point.gradient))), _MIN_DECREASE)
        if best.violation:
            status = self._describe_violation(status, best, blocking)
        elif residual <= _OPTIMALITY_TOLERANCE:
            status = Status("ok", "converged")
        else:
            status = self._describe_early_end(status)
        slopes = self._transform(best.values)[1]
        return self._result(
            status,
            multipliers=multipliers * slopes * self._scales[0] / self._scales[1:],
            residual=residual,
            has_effect=np.any(np.vstack([point.gradient, point.jacobian]), axis=0),
        )

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

    def _list_blocking(self, point: Linearization) -> list[str]:
        """Return the limits that contradict each other or the bounds near a design, or nothing."""
        if not _is_blocked(point):
            return []
        weights = measure_violation(point)[1]
        return [limit.label for limit, x in zip(self._problem.limits, weights, strict=True) if x]

    def _describe_violation(self, status: Status, best: Trial, blocking: list[str]) -> Status:
        """Return the status of a search without a design that satisfies the constraints."""
        problem, margins = self._problem, self._margins(best.values)
        worst = int(np.argmin(margins))
        limit, unit = problem.limits[worst], problem.units_of(self._first_analyses)[1 + worst]
        value = float(self._ratios[worst] * best.values[1 + worst])
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
        return Status(kind, f"{sentence}; {_OTHER_START}{self._describe_failures()}")

    def _describe_early_end(self, status: Status) -> Status:
        """Return the status of a search that ended before an optimum."""
        sentence = status.sentence
        if status.success:
            has_failures = any(x.failure for x in self._trials)
            cause = "analyses fail" if has_failures else "a quantity jumps or has a kink"
            sentence = f"the search ended next to designs at which {cause}, before an optimum"
        if self._problem.noise.any():
            sentence += (
                "; values of runs with adaptive steps change abruptly between designs, use a fixed "
                "step, GeneralizedAlpha(step=...)"
            )
        kind = "limited" if status.success else status.kind
        return Status(kind, sentence + self._describe_failures())

    def _describe_failures(self) -> str:
        """Return the number of failed analyses with the last reason, and advice, or ""."""
        problem, failed = self._problem, [x for x in self._trials if x.failure]
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


def _rank(trial: Trial) -> tuple[float, float]:
    return trial.violation, float(trial.values[0])


def _is_blocked(point: Linearization) -> bool:
    """Return True if no step reduces the violation of the linearized limits."""
    violation = float(np.max(-point.margins))
    return measure_violation(point)[0] >= (1.0 - _MIN_VIOLATION_DECREASE) * violation
