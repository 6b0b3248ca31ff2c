"""Search of an optimum by SciPy, with all evaluated designs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from scipy.optimize import BFGS, Bounds, NonlinearConstraint, minimize, nnls

from beamdae.analysis.optimization.problem import FEASIBILITY_TOLERANCE, Design, DesignProblem
from beamdae.errors import (
    BeamdaeError,
    ProgressError,
    call_progress,
    format_count,
    format_distinct,
    format_exception,
    kind_of_message,
    list_first,
    record_messages,
    warn_of_result,
)
from beamdae.interrupts import acknowledge
from beamdae.model_parameters import format_with_unit
from beamdae.results.outcome import Status
from beamdae.results.solution import Solution

Array = np.ndarray
Method = Literal["SLSQP", "trust-constr"]
METHODS = ("SLSQP", "trust-constr")

# Constraints and bounds are active within this distance, relative to the limit or to the size of
# the number. The barrier of trust-constr stops at about 1e-6.
_ACTIVE_TOLERANCE = 1e-4
# Relative residual of the conditions of first order below which a search that could make no further
# progress is at an optimum. Rounding errors of analyses end searches near 1e-5.
_STATIONARITY_TOLERANCE = 1e-3
# Residual above which the end of a search is no optimum: steps also become short before designs
# whose analyses fail, and at jumps.
_MAX_RESIDUAL = 0.1
# The residual is relative to the largest gradient of the search, within this range: a constant part
# of the objective makes its gradient small, but at a minimum without active constraints and bounds,
# SciPy's tolerance of the objective leaves gradients up to about 1e-3.
_MIN_GRADIENT, _MAX_GRADIENT = 0.1, 1.0
# First values below this ratio to their change over the size of the numbers are rounding errors.
_MIN_RELATIVE_VALUE = 1e-8
# The search ends after this number of failed analyses in a row.
_MAX_FAILURES = 15
# Smallest decrease of the violation in the second half of a search that more evaluations continue.
_MIN_DECREASE = 0.1
# SciPy's message if no step along the search direction of SLSQP reduces the objective, and ours.
_LINE_SEARCH_FAILURE = "Positive directional derivative for linesearch"
_ITERATION_LIMIT = "Iteration limit reached"  # SciPy's message if many designs are repeated
_NO_DECREASE = "no step along the search direction reduces the objective"
_CONTRADICTION = (
    "the search is local, start it from other values (parameters={name: value}) or increase "
    "starts=; otherwise the constraints may contradict each other or the bounds"
)
# Recommended steps of generalized-alpha in a mean adaptive step: with 3 in a step of Radau, peaks
# in five models are within 0.2 % of those with finer steps.
_FIXED_STEPS = 3.0
# Relative change of the objective and of the violation up to which a design hardly differs from the
# one before, and the number of such designs from which the end of a search names a cause. Searches
# whose line searches succeed have 2 to 4 of them (measured).
_IDLE_CHANGE = 2e-4
_MIN_IDLE_TRIALS = 10
# The search ends if this number of designs in a row remain within the distance below, in units of
# the sizes of the numbers, with changes of the scaled objective and of the violation below the
# second one: rounding errors of the analyses keep its line searches from succeeding. Fewer are
# sufficient if all designs are far from feasible, because the violation has a local minimum, and if
# values jump by the noise of runs with adaptive steps; changes below it count as rest.
_MAX_RESTING_TRIALS = 20
_MAX_SHORT_RESTING_TRIALS = 8
_FAR_VIOLATION = 1e-3  # relative to the limit
_RESTING_DISTANCE, _RESTING_CHANGE = 1e-3, 1e-5
_RESTING = "designs hardly differ"
# Relative excess of a maximum over the limit of its smooth maximum from which the search continues
# with another ratio of both; largest number of such searches.
_MAX_EXCESS = 1e-3
_MAX_CORRECTIONS = 5
_MAX_NAMES = 3  # of numbers at a bound in a sentence
_MAX_LIMIT_RATIO = 1e3  # of a value to its limit; from larger ones on, units probably differ
_MIN_LOGARITHMIC_RATIO = 0.5  # of a value to its limit, from which on margins are logarithms
INTERRUPTED_CHECKS = "interrupted while the best design was checked"


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
        Largest violation of a limit, relative to the limit; 0 up to `DesignProblem.noise`, NaN if
        an analysis failed.
    failure
        Reason for the failure, or "".
    """

    numbers: Array
    values: Array
    violation: float
    failure: str = ""


@dataclass(frozen=True)
class Stationarity:
    """Conditions of first order at a design.

    Attributes
    ----------
    multipliers
        Lagrange multipliers (C,): decrease of the objective per unit by which a limit is relaxed.
    residual
        Norm of the gradient of the Lagrange function, relative to that of the objective; where
        this is small, relative to its largest gradient in the search, within 0.1 to 1.
    has_effect
        False (k,) for numbers on which neither the objective nor a constraint depends.
    """

    multipliers: Array
    residual: float
    has_effect: Array


@dataclass(frozen=True)
class SearchResult:
    """End of a search; `best` is the best evaluated design.

    `first_analyses` are the results of the analyses of the first design. `ratios` (C,) are those of
    maxima to their limited smooth maxima by which these were multiplied; 1 for other quantities.
    `progress_error` is the exception of the user's function `progress` that ended it, or None.
    """

    best: Trial
    trials: tuple[Trial, ...]
    status: Status
    stationarity: Stationarity | None
    first_analyses: tuple[Any, ...]
    max_evaluations: int
    ratios: Array
    progress_error: Exception | None = None

    @property
    def was_ended(self) -> bool:
        """True if an interrupt or an exception of `progress` ended the search."""
        return self.status.kind == "interrupted" or self.progress_error is not None


class _SearchEndError(Exception):
    """End of the search by a limit or a failure."""

    def __init__(self, status: Status) -> None:
        super().__init__(status.sentence)
        self.status = status


class Search:
    """Minimization from the first design.

    Parameters
    ----------
    problem
        The problem.
    method, max_evaluations, tolerance, progress
        See `optimize`.
    """

    def __init__(
        self,
        problem: DesignProblem,
        method: Method,
        max_evaluations: int,
        tolerance: float,
        progress: Callable[[int, float, float], object] | None,
    ) -> None:
        self._problem, self._method, self._tolerance = problem, method, tolerance
        self._max_evaluations, self._progress = max_evaluations, progress
        self._trials: dict[bytes, Trial] = {}
        # Designs whose values are those of their own stress sections, and designs with values of
        # other sections than those of the present search, see `_check_sections`.
        self._checked: set[bytes] = set()
        self._outdated: set[bytes] = set()
        self._trials_before = 0  # number of trials before the present search of SciPy
        self._failures = 0
        self._end: Trial | None = None
        self._first_analyses: tuple[Any, ...] = ()
        self._last_gradients: tuple[Array, Array] | None = None
        self._last_margins = np.zeros(len(problem.limits))
        self._largest_gradient = 0.0  # norm, of the scaled objective
        # Factors of limited smooth maxima, see `_limit_maxima`.
        self._ratios = np.ones(len(problem.limits))
        self._is_logarithmic = problem.lower > 0.0
        # Units of the objective and of the constraints.
        self._scales = np.ones(1 + len(problem.limits))

    def run(self) -> SearchResult:
        """Search until convergence, a limit or an interrupt.

        Raises
        ------
        BeamdaeError
            If an analysis of the first design or its gradient fails.
        """
        problem = self._problem
        first = self._analyze_first()
        problem.require_known_units()
        self._first_analyses = first.results
        try:
            try:
                bounds = [0.0, *(abs(limit.bound) for limit in problem.limits)]
                self._scales = np.array([x or self._scale(first, k) for k, x in enumerate(bounds)])
            finally:
                # The result of an interrupted search is at least the first design.
                self._record(problem.first, first)
                self._checked.add(problem.first.tobytes())
                problem.keep_sections(first, problem.first)
            # Errors of the gradient concern the model rather than a design.
            self._gradients(self._variables(problem.first))
            status, is_complete = self._minimize_to_noise(problem.first)
            for _ in range(_MAX_CORRECTIONS):
                if not is_complete:
                    break
                best = self._best()
                if not self._check_sections(best):
                    if not self._limit_maxima():
                        break
                    best = self._best()
                status, is_complete = self._minimize_to_noise(best.numbers)
        except _SearchEndError as end:
            status = end.status
        except KeyboardInterrupt:
            acknowledge()
            sentence = f"interrupted after {format_count(len(self._trials), 'evaluation')}"
            status = Status("interrupted", sentence)
            return self._result(self._best(), status)
        except ProgressError as error:
            failure = Status("failed", str(error))
            return replace(self._result(self._best(), failure), progress_error=error.problem)
        return self._finish(status)

    def _analyze_first(self) -> Design:
        """Return the first design; if its analysis fails, issue the warnings of the analysis."""
        with record_messages() as messages:
            try:
                return self._problem.design(self._problem.first)
            except BeamdaeError as error:
                # The sentence on the end of an analysis is part of the error.
                text, issued = str(error), self._problem.build_warnings
                warn_of_result(
                    x
                    for x in messages
                    if x.partition(": ")[2].rstrip(".") not in text
                    and kind_of_message(x) not in issued
                )
                raise

    def _check_sections(self, best: Trial) -> bool:
        """Return True if a design is worse with its own stress sections; at first, if it differs.

        All designs of a search have the sections of the first one, because bounds of stresses jump
        where the number of sections changes. A search from the given design then has its sections.
        Later ones also have those of the search before, so that two designs with different sections
        cannot follow each other without end; further sections only make the bounds larger.
        """
        problem, key = self._problem, best.numbers.tobytes()
        own = None if key in self._checked else problem.design_with_own_sections(best.numbers)
        if own is None:
            return False
        self._checked.add(key)
        trial = self._rate(best.numbers, own.values)
        excess = np.append(0.0, self._margins(best.values) - self._margins(trial.values))
        excess[0] = (trial.values[0] - best.values[0]) / self._scales[0]
        is_added = bool(self._outdated)
        if np.max(excess if is_added else np.abs(excess)) <= FEASIBILITY_TOLERANCE:
            return False
        problem.keep_sections(own, best.numbers, is_added)
        self._trials[key] = trial
        self._outdated = set(self._trials) - (set() if is_added else {key})
        self._end = None
        return True

    def _best_by_sections(self) -> Trial:
        """Return the best design, which its own stress sections do not make worse."""
        best = self._best()
        if not self._check_sections(best):
            return best
        for _ in range(_MAX_CORRECTIONS):
            if not self._check_sections(self._best()):
                break
        self._problem.release_sections()
        return min((self._trials[x] for x in self._checked), key=self._rank)

    def _limit_maxima(self) -> bool:
        """Update the ratios of maxima to smooth maxima; return False if all remain the same.

        A search with constant ratios is differentiable, and the limits of its end are those of the
        maxima themselves; see Le et al., Struct. Multidisc. Optim. 41 (2010) 605,
        doi:10.1007/s00158-009-0440-y.
        """
        best = self._best()
        ratios = self._corrected_ratios(best)
        bounds = np.abs([limit.bound for limit in self._problem.limits])
        largest = np.maximum(ratios, self._ratios) * np.abs(best.values[1:])
        is_limiting = largest * (1.0 + _MAX_EXCESS) > bounds
        if not np.any(is_limiting & (ratios != self._ratios)):
            return False
        self._rate_all(np.where(is_limiting, ratios, self._ratios))
        self._end = None
        return True

    def _corrected_ratios(self, trial: Trial) -> Array:
        """Return the ratios (C,), replaced by those of a design where they are over 0.1 % off."""
        ratios = self._problem.design(trial.numbers).maximum_ratios(self._problem.limits)
        is_off = np.abs(ratios - self._ratios) > _MAX_EXCESS * self._ratios
        return np.where(is_off, ratios, self._ratios)

    def _rate_all(self, ratios: Array) -> None:
        """Update the violations of all designs with other ratios (C,)."""
        self._ratios = ratios
        self._trials = {
            key: trial if trial.failure else self._rate(trial.numbers, trial.values)
            for key, trial in self._trials.items()
        }

    def _best_by_maxima(self) -> Trial:
        """Return the best design; the ratios are those of its maxima, also if the search failed."""
        for _ in range(_MAX_CORRECTIONS):
            if not self._limit_maxima():
                break
        best = self._best()
        self._rate_all(self._corrected_ratios(best))
        return self._trials[best.numbers.tobytes()]

    def _rate(self, numbers: Array, values: Array) -> Trial:
        """Return an analyzed design with its violation."""
        excess = -self._margins(values)
        is_violated = excess > self._problem.noise[1:]
        return Trial(numbers, values, float(np.max(excess[is_violated], initial=0.0)))

    def _margins(self, values: Array) -> Array:
        """Return the scaled margins (C,) of the constraints for values (1 + C,) of a design."""
        rows = zip(self._problem.limits, self._ratios.tolist(), values[1:].tolist(), strict=True)
        margins = [limit.margin(ratio * value) for limit, ratio, value in rows]
        return np.array(margins) / self._scales[1:]

    def _transform(self, margins: Array) -> tuple[Array, Array]:
        """Return the margins (C,) that the search sees, and their derivatives by the margins.

        Of a quantity whose magnitude r, relative to its limit, must not exceed 1, this is -ln(r)
        instead of 1 - r: stresses and deflections are nearly products of powers of thicknesses,
        whose logarithms are linear in those of the thicknesses. Below r = 1/2, the function
        continues as a straight line, because logarithms of small values diverge.
        """
        limits = self._problem.limits
        is_magnitude = np.array([limit.sign * limit.bound > 0.0 for limit in limits], bool)
        ratio = np.maximum(1.0 - margins, _MIN_LOGARITHMIC_RATIO)
        line = (_MIN_LOGARITHMIC_RATIO - (1.0 - margins)).clip(0.0) / _MIN_LOGARITHMIC_RATIO
        values = np.where(is_magnitude, line - np.log(ratio), margins)
        return values, np.where(is_magnitude, 1.0 / ratio, 1.0)

    def _scale(self, first: Design, index: int) -> float:
        """Return the size of a value: that of the first design, or of its change if it is zero."""
        value = abs(float(first.values[index]))
        change = float(np.linalg.norm(first.gradient(index) * self._problem.sizes))
        return value if value > _MIN_RELATIVE_VALUE * change else change or 1.0

    def _result(
        self, best: Trial, status: Status, stationarity: Stationarity | None = None
    ) -> SearchResult:
        trials, analyses = tuple(self._trials.values()), self._first_analyses
        return SearchResult(
            best, trials, status, stationarity, analyses, self._max_evaluations, self._ratios
        )

    def _finish(self, status: Status) -> SearchResult:
        best, stationarity = self._best(), None
        try:
            best = self._best_by_sections()
            best = self._best_by_maxima()
            stationarity = self._check_stationarity(best)
        except (BeamdaeError, ArithmeticError) as failure:
            sentences = dict.fromkeys((status.sentence, describe_failure(failure)))
            status = Status("failed", "; ".join(sentences))
        except KeyboardInterrupt:
            acknowledge()
            return self._result(best, Status("interrupted", INTERRUPTED_CHECKS))
        trials = tuple(self._trials.values())
        is_feasible = best.violation <= FEASIBILITY_TOLERANCE
        if not is_feasible:
            kind = "limited" if status.success else status.kind
            end = "" if status.success else f"; {status.sentence}"
            if status.success or _NO_DECREASE in end or _RESTING in end:
                end += f"; {_CONTRADICTION}"
            status = Status(kind, f"{self._describe_violation(best)}{end}")
        is_far = stationarity is not None and stationarity.residual > _MAX_RESIDUAL
        if status.success and is_feasible and is_far:
            has_failures = any(x.failure for x in trials)
            cause = "analyses fail" if has_failures else "a quantity jumps or has a kink"
            status = Status(
                "limited", f"the search ended next to designs at which {cause}, before an optimum"
            )
        is_stationary = stationarity and stationarity.residual <= _STATIONARITY_TOLERANCE
        if status.kind == "limited" and is_feasible and is_stationary:
            status = Status("ok", "converged to the accuracy of the analyses")
        elif self._problem.noise.any() and self._is_stuck(best, status):
            status = Status(status.kind, f"{status.sentence}; {self._advise_fixed_steps(best)}")
        elif self._problem.noise.any() and status.success:
            idle = count_idle_trials(trials)
            if idle >= _MIN_IDLE_TRIALS and 2 * idle > len(trials):
                sentence = f"{idle} of {len(trials)} designs hardly differ from the one before"
                advice = self._advise_fixed_steps(best)
                status = Status("ok", f"{status.sentence}, but {sentence}: {advice}")
        count = sum(bool(x.failure) for x in trials)
        if count and status.kind != "ok":
            last = [x.failure for x in trials if x.failure][-1]
            advice = self._advise_bounds()
            status = Status(
                status.kind,
                f"{status.sentence}; {count} analyses failed, the last one: {last}{advice}",
            )
        return self._result(best, status, stationarity)

    def _advise_fixed_steps(self, best: Trial) -> str:
        """Return advice to use a fixed step, derived from the steps of the best design."""
        results = self._problem.design(best.numbers).results
        step = min(x.trajectory.mean_step for x in results if isinstance(x, Solution))
        return (
            "values of runs with adaptive steps change abruptly between designs, use a fixed step "
            f"such as GeneralizedAlpha(step={step / _FIXED_STEPS:.1g})"
        )

    def _advise_bounds(self) -> str:
        """Return advice to bound numbers whose sign changed in designs that failed, or ""."""
        problem = self._problem
        failed = np.array([x.numbers for x in self._trials.values() if x.failure])
        is_free = np.isinf(np.where(problem.first > 0.0, problem.lower, problem.upper))
        is_lost = is_free & np.any(failed * problem.first < 0.0, axis=0)
        names = list_first(np.array(problem.names)[is_lost].tolist(), _MAX_NAMES)
        return f"; pass bounds= that keep the sign of {names}" if names else ""

    def _describe_violation(self, best: Trial) -> str:
        """Return a sentence with the value and the limit of the most violated constraint."""
        problem, margins = self._problem, self._margins(best.values)
        worst = int(np.argmin(margins))
        limit, unit = problem.limits[worst], problem.units_of(self._first_analyses)[1 + worst]
        value = float(self._ratios[worst] * best.values[1 + worst])
        numbers = format_distinct(limit.bound, value, digits=4)
        allowed, actual = (format_with_unit(x, unit) for x in numbers)
        at_bound = np.any(find_active_bounds(problem, best.numbers), axis=0)
        names = np.array(problem.names)[at_bound].tolist()
        where = f", with {list_first(names, _MAX_NAMES)} at a bound," if names else ","
        is_far = limit.bound and abs(value / limit.bound) > _MAX_LIMIT_RATIO
        hint = "; check the unit of the limit" if is_far and unit and not limit.unit else ""
        tolerances = np.maximum(FEASIBILITY_TOLERANCE, problem.noise[1:])
        others = int(np.sum(margins < -tolerances)) - 1
        more = f" ({format_count(others, 'further limit')} violated)" if others > 0 else ""
        return (
            f"no evaluated design satisfies the constraints; in the best one{where} "
            f"{limit.quantity.label} is {actual}, but the limit is at "
            f"{'most' if limit.sign > 0 else 'least'} {allowed}{more}{hint}"
        )

    def _is_stuck(self, best: Trial, status: Status) -> bool:
        """Return True if a search ended, or made no progress in its second half."""
        trials = list(self._trials.values())
        is_early = 2 * next(k for k, x in enumerate(trials) if x is best) < len(trials)
        return status.kind == "limited" and (is_early or _NO_DECREASE in status.sentence)

    def _minimize_to_noise(self, first: Array) -> tuple[Status, bool]:
        """Search from values (k,) of the numbers; return the status and True if it succeeded.

        A search that rests because of the noise of its runs succeeded: they allow no more.
        """
        self._trials_before = len(self._trials)
        try:
            status = self._minimize(first)
        except _SearchEndError as end:
            if not self._problem.noise.any() or _RESTING not in end.status.sentence:
                raise
            return end.status, True
        return status, status.success

    def _minimize(self, first: Array) -> Status:
        """Search from values (k,) of the numbers, and return the status."""
        problem = self._problem
        bounds = Bounds(self._variables(problem.lower), self._variables(problem.upper))
        begin = self._variables(first)
        options: dict[str, Any] = {"maxiter": self._max_evaluations}
        constraints: Any = ()
        if self._method == "SLSQP":
            options["ftol"] = self._tolerance
            if problem.limits:
                constraints = {
                    "type": "ineq",
                    "fun": lambda x: self._values(x)[1],
                    "jac": lambda x: self._gradients(x)[1],
                }
        else:
            # Least-squares multipliers of constraints that are not active can make the gradient of
            # the Lagrange function zero far from the optimum.
            is_free = not problem.limits and np.all(np.isinf([problem.lower, problem.upper]))
            options |= {"gtol": self._tolerance if is_free else 0.0, "xtol": self._tolerance}
            options["barrier_tol"] = self._tolerance
            bounds.keep_feasible = np.ones(len(begin), bool)
            if problem.limits:
                constraints = NonlinearConstraint(
                    lambda x: self._values(x)[1],
                    0.0,
                    np.inf,
                    jac=lambda x: self._gradients(x)[1],
                    hess=BFGS(),
                )
        with warnings.catch_warnings():
            # SciPy warns if two gradients are equal, as after a failed analysis, and if rounding
            # moves a variable out of its bounds.
            warnings.simplefilter("ignore", UserWarning)
            warnings.simplefilter("ignore", RuntimeWarning)
            result = minimize(
                lambda x: self._values(x)[0],
                begin,
                jac=lambda x: self._gradients(x)[0],
                method=self._method,
                bounds=bounds,
                constraints=constraints,
                options=options,
            )
        if not result.success or (self._method != "SLSQP" and result.status == 0):
            message = str(result.message).rstrip(".")
            if message == _ITERATION_LIMIT:
                return self._describe_limit()
            return Status("limited", _NO_DECREASE if message == _LINE_SEARCH_FAILURE else message)
        self._end = self._trials.get(self._numbers(result.x).tobytes())
        return Status("ok", "converged")

    def _variables(self, numbers: Array) -> Array:
        """Return the variables (k,) of the search for values (k,) of the numbers.

        These are logarithms of numbers with a positive lower bound, in which products of powers
        are linear, and otherwise the numbers relative to their sizes.
        """
        problem = self._problem
        variables = numbers / problem.sizes
        variables[self._is_logarithmic] = np.log(numbers[self._is_logarithmic])
        return variables

    def _numbers(self, x: Array) -> Array:
        problem = self._problem
        # The first design is stored under its exact values.
        if np.array_equal(x, self._variables(problem.first)):
            return problem.first
        values = problem.sizes * x
        values[self._is_logarithmic] = np.exp(x[self._is_logarithmic])
        return np.clip(values, problem.lower, problem.upper)

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return the scaled objective and the transformed margins.

        If an analysis fails, the objective is infinite, so that the search shortens its step.
        """
        numbers = self._numbers(x)
        trial = self._trials.get(numbers.tobytes())
        if trial is None or numbers.tobytes() in self._outdated:
            trial = self._evaluate(numbers)
        if trial.failure:
            return np.inf, self._last_margins
        self._last_margins = self._transform(self._margins(trial.values))[0]
        return float(trial.values[0] / self._scales[0]), self._last_margins

    def _describe_limit(self) -> Status:
        """Return the status of a search that reaches the maximum number of evaluations."""
        count = format_count(self._max_evaluations, "evaluation")
        return Status("limited", f"stopped after {count}; {self._remedy}")

    @property
    def _remedy(self) -> str:
        violations = [x.violation for x in self._trials.values() if not x.failure]
        before = min(violations[: len(violations) // 2], default=np.inf)
        if min(violations, default=np.inf) <= max(
            FEASIBILITY_TOLERANCE, (1.0 - _MIN_DECREASE) * before
        ):
            return "increase max_evaluations="
        return (
            f"the violation fell by less than {100.0 * _MIN_DECREASE:.0f} % in the second half; "
            f"{_CONTRADICTION}"
        )

    def _evaluate(self, numbers: Array) -> Trial:
        if len(self._trials) >= self._max_evaluations:
            raise _SearchEndError(self._describe_limit())
        if resting := self._count_resting():
            raise _SearchEndError(
                Status("limited", f"stopped because the last {resting} {_RESTING}")
            )
        try:
            design = self._problem.design(numbers)
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            return self._record_failure(numbers, failure)
        self._failures = 0
        return self._record(numbers, design)

    def _count_resting(self) -> int:
        """Return the number of last designs that hardly differ, or 0 if they are too few."""
        trials = list(self._trials.values())
        is_far = min(x.violation for x in trials if not x.failure) > _FAR_VIOLATION
        noise = float(np.max(self._problem.noise))
        is_short = is_far or noise > 0.0
        count = _MAX_SHORT_RESTING_TRIALS if is_short else _MAX_RESTING_TRIALS
        trials = trials[self._trials_before :][-count:]
        if self._method != "SLSQP" or len(trials) < count:
            return 0
        if any(x.failure for x in trials):
            return 0
        moved = np.ptp([x.numbers / self._problem.sizes for x in trials], axis=0)
        changes = np.ptp([(x.values[0] / self._scales[0], x.violation) for x in trials], axis=0)
        is_resting = np.max(moved) <= _RESTING_DISTANCE
        is_resting &= np.max(changes) <= max(_RESTING_CHANGE, noise)
        return count if is_resting else 0

    def _record(self, numbers: Array, design: Design) -> Trial:
        trial = self._rate(numbers, design.values)
        self._trials[numbers.tobytes()] = trial
        self._outdated.discard(numbers.tobytes())
        if self._progress is not None:
            objective = float(design.values[0])
            call_progress(self._progress, len(self._trials), objective, trial.violation)
        return trial

    def _record_failure(self, numbers: Array, failure: Exception) -> Trial:
        sentence = describe_failure(failure)
        values = np.full(1 + len(self._problem.limits), np.nan)
        trial = Trial(numbers, values, float("nan"), sentence)
        self._trials[numbers.tobytes()] = trial
        self._failures += 1
        if self._failures >= _MAX_FAILURES:
            raise _SearchEndError(Status("failed", f"{self._failures} analyses in a row failed"))
        return trial

    def _gradients(self, x: Array) -> tuple[Array, Array]:
        """Return the gradient of the scaled objective and those of the transformed margins."""
        numbers = self._numbers(x)
        trial = self._trials.get(numbers.tobytes())
        if trial is not None and trial.failure and self._last_gradients is not None:
            # Some methods request derivatives of designs that they reject.
            return self._last_gradients
        try:
            self._last_gradients = self._searched_gradients(numbers)
        except (BeamdaeError, ArithmeticError) as failure:
            if self._last_gradients is None:
                raise
            raise _SearchEndError(Status("failed", describe_failure(failure))) from failure
        return self._last_gradients

    def _searched_gradients(self, numbers: Array) -> tuple[Array, Array]:
        """Return the gradients of the scaled objective and of the transformed margins."""
        problem = self._problem
        objective, margins = self._scaled_gradients(numbers)
        slopes = self._transform(self._margins(problem.design(numbers).values))[1]
        rates = np.where(self._is_logarithmic, numbers / problem.sizes, 1.0)
        return objective * rates, slopes[:, None] * margins * rates

    def _scaled_gradients(self, numbers: Array) -> tuple[Array, Array]:
        problem = self._problem
        design = problem.design(numbers)
        count = len(problem.limits)
        rows = np.array([design.gradient(k) for k in range(1 + count)])
        rows *= problem.sizes / self._scales[:, None]
        self._largest_gradient = max(self._largest_gradient, float(np.linalg.norm(rows[0])))
        signs = self._ratios * [limit.sign for limit in problem.limits]
        return rows[0], -signs[:, None] * rows[1:] if count else np.zeros((0, len(numbers)))

    def _best(self) -> Trial:
        """Return the end of a search that converged, otherwise the best evaluated design.

        The best design is feasible, or it has the smallest violation.
        """
        if self._end is not None and self._end.violation <= FEASIBILITY_TOLERANCE:
            return self._end
        return min((x for x in self._trials.values() if not x.failure), key=self._rank)

    def _rank(self, trial: Trial) -> tuple[bool, bool, float, float]:
        is_feasible = trial.violation <= FEASIBILITY_TOLERANCE
        is_outdated = trial.numbers.tobytes() in self._outdated
        violation = 0.0 if is_feasible else trial.violation
        return not is_feasible, is_outdated, violation, float(trial.values[0])

    def _check_stationarity(self, trial: Trial) -> Stationarity:
        """Return multipliers with the smallest residual of the conditions of first order."""
        problem = self._problem
        gradient, jacobian = self._scaled_gradients(trial.numbers)
        margins = self._margins(trial.values)
        active = np.flatnonzero(margins <= _ACTIVE_TOLERANCE)
        identity = np.eye(len(gradient))
        at_lower, at_upper = find_active_bounds(problem, trial.numbers)
        normals = np.vstack([jacobian[active], identity[at_lower], -identity[at_upper]])
        solution, residual = nnls(normals.T, gradient) if len(normals) else (np.zeros(0), None)
        if residual is None:
            residual = float(np.linalg.norm(gradient))
        multipliers = np.zeros(len(problem.limits))
        multipliers[active] = solution[: len(active)]
        # A stationary objective without constraints has a gradient of the size of its rounding.
        least = min(max(self._largest_gradient, _MIN_GRADIENT), _MAX_GRADIENT)
        size = max(float(np.linalg.norm(gradient)), least)
        multipliers *= self._scales[0] / self._scales[1:]
        has_effect = np.any(np.vstack([gradient, jacobian]), axis=0)
        return Stationarity(multipliers, float(residual) / size, has_effect)


def describe_failure(failure: Exception) -> str:
    """Return the message of an error of an analysis or of the model function."""
    if isinstance(failure, BeamdaeError):
        return str(failure).removeprefix("optimize: ").removesuffix(".")
    return format_exception(failure)


def count_idle_trials(trials: Sequence[Trial]) -> int:
    """Return the number of trials that hardly differ from the one before in value and violation.

    Where errors of the analyses decide whether the merit function of SLSQP decreases along a step,
    its line search evaluates nearly the same designs many times.
    """
    rows = [(x.values[0], x.violation) for x in trials if not x.failure]
    return sum(
        abs(b[0] - a[0]) <= _IDLE_CHANGE * abs(a[0]) and abs(b[1] - a[1]) <= _IDLE_CHANGE
        for a, b in pairwise(rows)
    )


def find_active_bounds(problem: DesignProblem, numbers: Array) -> tuple[Array, Array]:
    """Return True for the numbers at their lower and at their upper bounds, (k,) each."""
    distance = _ACTIVE_TOLERANCE * problem.sizes
    return numbers - problem.lower <= distance, problem.upper - numbers <= distance
