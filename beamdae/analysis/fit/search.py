"""Search of a fit: `scipy.optimize.least_squares` with exact Jacobians."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from beamdae.analysis.fit.information import MAX_RELATIVE_DEVIATION
from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    is_noise,
    unexplained_share,
)
from beamdae.analysis.fit.variables import Scaling
from beamdae.errors import BeamdaeError, format_count, format_exception
from beamdae.interrupts import Interrupted
from beamdae.results.outcome import Status

Array = np.ndarray

# Relative changes of the sum of squares and of the variables at which a search has converged, and
# those at which one has that only provides first values.
_TOLERANCE, _ROUGH_TOLERANCE = 1e-8, 1e-3
# Gradients below this ratio to the sum of squares of the first values are rounding errors.
_ZERO_GRADIENT = 1e-15
# Weight of the distance from the first values in undetermined directions: a change by a factor of
# e^3 costs one variance of the data, whose standard deviation is guessed, relative to that of the
# motion, while it is unknown.
_PRIOR_WEIGHT, _GUESSED_SIGMA = 1.0 / 3.0, 0.01
# Distance from a bound, in first values or logarithms, up to which an estimate may be at the bound.
_MAX_BOUND_DISTANCE = 1e-2
# Length of the next Gauss-Newton step, in standard deviations of the estimates, up to which the end
# of a search is a minimum.
_MAX_NEXT_STEP = 0.1
# Residuals below this ratio to the data are rounding errors, whose next step is arbitrary.
MIN_RELATIVE_RESIDUAL = 1e-6
# A search has explained the data if it leaves less than this share of their variation, or noise.
_MAX_UNEXPLAINED_SHARE = 0.2
# One that has not ends if the sum of squares does not decrease by this factor in this number of
# evaluations.
_STALLED_EVALUATIONS, _MAX_STALLED_RATIO = 7, 0.2
# Shares of the time of the data, one after the other, from which first values are estimated.
_FIRST_SHARES = (0.0625, 0.25)
# Smallest share of the variation of the data in a part, and largest number of its evaluations.
_MIN_PART_VARIATION, _MAX_PART_EVALUATIONS = 1e-3, 7
# Share of the variation of the data above which the end of a search is no solution.
_MAX_ACCEPTED_SHARE = 0.5


class _StalledError(Exception):
    """Raised to end a search without progress."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a local search.

    Attributes
    ----------
    evaluation
        The runs and residuals at the last values.
    evaluations
        Number of evaluations, each with one run with derivatives per experiment.
    status
        Status and reason of the end of the search, see `Fit`.
    at_bounds
        True (K,) for variables at a bound.
    first
        The first evaluation.
    failures
        Sentence on runs that failed during the search, or "".
    is_stalled
        True if the search ended without progress before it explained the data.
    explains
        False if the end leaves most of the variation of the data.
    """

    evaluation: Evaluation
    evaluations: int
    status: Status
    at_bounds: Array
    first: Evaluation | None = None
    failures: str = ""
    is_stalled: bool = False
    explains: bool = True

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return self.evaluation.chi_square


class _Evaluations:
    """Evaluations of a search: counted, with the last, the last accepted and the best one."""

    def __init__(
        self,
        problem: FitProblem,
        scaling: Scaling,
        first: Array,
        limit: int,
        known: Evaluation | None,
    ) -> None:
        self.problem, self.scaling, self.limit = problem, scaling, limit
        self.failures: list[str] = []
        self._sums: list[float] = []
        # The first run must succeed.
        self.first = self.best = problem.evaluate(scaling.values(first)) if known is None else known
        self.count = 1
        self._accepted = first.tobytes()
        self._cache = {self._accepted: self.first}
        if not self.best.count:
            raise BeamdaeError(
                "fit: reactions of the model grow without bounds at all times of the data; choose "
                "other first values in parameters, or other columns."
            )
        if not np.isfinite(self.best.chi_square):
            raise BeamdaeError(
                "fit: the first run has no finite sum of squared residuals; choose other first "
                "values in parameters, or check the data."
            )

    def at(self, x: Array) -> Evaluation:
        """Return the evaluation at variables (K,)."""
        key = x.tobytes()
        if key not in self._cache:
            self.count += 1
            evaluation = self.problem.evaluate(self.scaling.values(x))
            kept = {x: y for x, y in self._cache.items() if x == self._accepted}
            self._cache = kept | {key: evaluation}
            if evaluation.chi_square < self.best.chi_square:
                self.best = evaluation
            self._require_progress()
        return self._cache[key]

    def accept(self, x: Array) -> Evaluation:
        """Return the evaluation at variables (K,) to which the search has moved."""
        evaluation = self.at(x)
        self._accepted = x.tobytes()
        return evaluation

    def at_or_none(self, x: Array) -> Evaluation | None:
        """Return the evaluation at variables (K,), or None if the model or its run fails."""
        try:
            return self.at(x)
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            is_ours = isinstance(failure, BeamdaeError)
            self.failures.append(str(failure) if is_ours else format_exception(failure))
            self._require_progress()
            return None

    def _require_progress(self) -> None:
        """End a search that has not explained the data and hardly reduces the sum of squares."""
        self._sums.append(self.best.chi_square)
        if len(self._sums) <= _STALLED_EVALUATIONS or is_explained(self.problem, self.best):
            return
        if self._sums[-1] > _MAX_STALLED_RATIO * self._sums[-1 - _STALLED_EVALUATIONS]:
            raise _StalledError


def local_search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
    free: Array | None = None,
    is_rough: bool = False,
    known: Evaluation | None = None,
) -> SearchResult:
    """Minimize the sum of squares from the variables `first` (K,).

    Only the variables marked in `free` (K,) vary; None means all. The trust region is a sphere in
    the variables, which are logarithms or like them. All parameters are attracted to their first
    values by a small weight until the sum of squares hardly changes, then only combinations that
    the data do not determine, so that these stay there. A search that does not explain the data and
    makes no progress ends. With `is_rough`, it ends before the second part. `known` is the first
    evaluation if it has been computed.

    Raises
    ------
    BeamdaeError
        If the first run fails or its residuals are not finite.
    Interrupted
        If Ctrl-C ends the search after its first evaluation, with the `SearchResult` at the best
        values as partial result.
    """
    free = np.ones(len(first), bool) if free is None else free
    record = _Evaluations(problem, scaling, first, max_evaluations, known)
    at_bounds = np.zeros(len(first), bool)
    if not free.any():
        status = Status("ok", "all parameters are fixed")
        return SearchResult(record.best, 1, status, at_bounds, record.first)
    sigma, is_stalled = 1.0, False
    if not problem.data.is_sigma_known:
        sigma = float(_GUESSED_SIGMA * np.sqrt(problem.data.variation / problem.count))
    try:
        attraction = _PRIOR_WEIGHT * sigma * np.eye(len(first))
        x, result = _minimize(record, first, free, attraction, _ROUGH_TOLERANCE)
        if not is_rough and result.success:
            x = np.where(free, scaling.inside(x), x)
            attraction = _attract_undetermined(record, x, free)
            x, result = _minimize(record, x, free, attraction, _TOLERANCE)
        last, ending = record.at(x), ""
        if not result.success:
            count = format_count(max_evaluations, "evaluation")
            ending = f"stopped after {count}; increase max_evaluations="
    except _StalledError:
        last, ending, is_stalled = record.best, "stopped without progress", True
    except KeyboardInterrupt:
        reason = f"interrupted after {format_count(record.count, 'evaluation')}"
        status = Status("interrupted", reason)
        partial = SearchResult(record.best, record.count, status, at_bounds, record.first)
        raise Interrupted(reason, partial) from None
    at_bounds, next_step = _find_next_step(record, last, attraction, free)
    status = Status("ok", "converged")
    if next_step > _MAX_NEXT_STEP:
        cause = "runs fail" if record.failures else "the columns jump or have a kink"
        status = Status(
            "limited",
            ending
            or f"the search ended next to values at which {cause}, {next_step:.2g} standard "
            "deviations before a minimum",
        )
    failures = ""
    if record.failures:
        count, last_one = format_count(len(record.failures), "run"), record.failures[-1]
        failures = (
            f"{count} failed, the last one: {last_one.removesuffix('.')}; pass bounds= that "
            "exclude such values"
        )
    is_stalled &= not status.success
    return SearchResult(last, record.count, status, at_bounds, record.first, failures, is_stalled)


def _minimize(
    record: _Evaluations, first: Array, free: Array, attraction: Array, tolerance: float
) -> tuple[Array, Any]:
    """Return the variables (K,) at a minimum, and the result of `least_squares` in the free ones.

    The residuals are those of the data and the rows `attraction` (j, K) times the distance from the
    first values of the fit, relative to the first residuals, so that units of the data are of no
    importance.
    """
    scaling = record.scaling
    size = float(np.linalg.norm(record.at(first).residuals)) or 1.0

    def whole(x: Array) -> Array:
        values = first.copy()
        values[free] = x
        return values

    def residuals(x: Array) -> Array:
        evaluation = record.at_or_none(whole(x))
        count = record.problem.count + len(attraction)
        if evaluation is None:
            return np.full(count, np.nan)  # The search continues with a shorter step.
        distance = attraction @ (whole(x) - scaling.first)
        return np.append(evaluation.residuals, distance) / size

    def jacobian(x: Array) -> Array:
        rows = record.accept(whole(x)).projected_jacobian * scaling.derivatives(whole(x))
        return np.vstack([rows, attraction])[:, free] / size

    lower, upper = (limit[free] for limit in scaling.limits)
    result = least_squares(
        residuals,
        np.clip(first[free], lower, upper),
        jacobian,
        bounds=(lower, upper),
        ftol=tolerance,
        xtol=tolerance,
        gtol=_ZERO_GRADIENT,
        max_nfev=max(record.limit - record.count, 0) + 1,  # The first evaluation is cached.
    )
    return whole(result.x), result


def _attract_undetermined(record: _Evaluations, x: Array, free: Array) -> Array:
    """Return the attraction (j, K) of the combinations that the data do not determine at `x`."""
    evaluation = record.at(x)
    sigma = _standard_deviation(record.problem, evaluation)
    # Near zero, changes are relative to the first value.
    sizes = np.maximum(record.scaling.derivatives(x), record.scaling.sizes)
    jacobian = evaluation.projected_jacobian * sizes * free
    _, singular, directions = np.linalg.svd(jacobian)
    singular = np.append(singular, np.zeros(len(x) - len(singular)))
    limit = max(sigma / MAX_RELATIVE_DEVIATION, MIN_SINGULAR_RATIO * singular[0])
    is_undetermined = singular < (limit or np.inf)
    # Orthonormal directions in the variables.
    ratios = sizes / record.scaling.derivatives(x)
    basis, _ = np.linalg.qr((directions[is_undetermined] * ratios).T)
    return np.asarray(_PRIOR_WEIGHT * sigma * basis.T)


def search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
    known: Evaluation | None = None,
) -> SearchResult:
    """Minimize the sum of squares, if necessary from estimates by first parts of the data.

    Raises
    ------
    BeamdaeError, Interrupted
        See `local_search`.
    """
    end = local_search(problem, scaling, first, max_evaluations, known=known)
    if not is_explained(problem, end.evaluation) and end.evaluations < max_evaluations:
        count = problem.count
        try:
            end = _repeat_from_first_data(problem, scaling, first, end, max_evaluations)
        except KeyboardInterrupt as interrupt:
            best = getattr(interrupt, "partial", None)
            # Those of first parts of the data are no ends of the fit.
            if isinstance(best, SearchResult) and len(best.evaluation.residuals) == count:
                end = min(end, best, key=lambda x: x.chi_square)
            reason = f"interrupted after {format_count(end.evaluations, 'evaluation')}"
            partial = replace(end, status=Status("interrupted", reason))
            raise Interrupted(reason, partial) from None
    end = _judge_explanation(problem, end)
    if end.status.success or not end.failures:
        return end
    sentence = f"{end.status.sentence}; {end.failures}"
    return replace(end, status=Status(end.status.kind, sentence))


def _repeat_from_first_data(
    problem: FitProblem, scaling: Scaling, first: Array, end: SearchResult, max_evaluations: int
) -> SearchResult:
    """Return the better of an end and of a search from values that explain first parts of the data.

    While vibrations of the model and of the data differ by less than half a period, the sum of
    squares has no local minimum between them. The search therefore begins with a short part of the
    data and continues with longer ones.
    """
    count = end.evaluations
    for share in _FIRST_SHARES:
        if (
            problem.with_first_data(share).data.variation
            < _MIN_PART_VARIATION * problem.data.variation
        ):
            continue
        # Short parts hardly determine scales and offsets, which most sensors have near 1 and 0.
        for is_calibrated in (True, False) if problem.coefficients else (False,):
            part = problem.with_first_data(share, is_calibrated)
            limit = min(_MAX_PART_EVALUATIONS, max_evaluations - count)
            if limit < 1:
                return replace(end, evaluations=count)
            try:
                other = local_search(part, scaling, first, limit, is_rough=True)
            except (ValueError, ArithmeticError):
                # BeamdaeError, or an error of the model function at extreme values.
                return replace(end, evaluations=count)
            count += other.evaluations
            if is_explained(part, other.evaluation):
                first = scaling.start(other.evaluation.values)
                break
        else:
            return replace(end, evaluations=count)
    if count < max_evaluations:
        with suppress(ValueError, ArithmeticError):
            other = local_search(problem, scaling, first, max_evaluations - count)
            count += other.evaluations
            if other.chi_square < end.chi_square:
                return replace(other, evaluations=count, first=end.first)
    return replace(end, evaluations=count)


def is_explained(problem: FitProblem, evaluation: Evaluation) -> bool:
    """Return True if little of the variation of the data is left, or noise."""
    return unexplained_share(problem, evaluation) <= _MAX_UNEXPLAINED_SHARE or is_noise(
        evaluation.residuals
    )


def _standard_deviation(problem: FitProblem, evaluation: Evaluation) -> float:
    """Return the standard deviation of the errors in units of the residuals.

    It is that of the residuals, or that of a given sigma if it is smaller.
    """
    freedom = evaluation.count - len(problem.variables) - len(problem.coefficients)
    deviation = float(np.sqrt(evaluation.chi_square / max(freedom, 1)))
    return min(deviation, 1.0) if problem.data.is_sigma_known else deviation


def _judge_explanation(problem: FitProblem, end: SearchResult) -> SearchResult:
    """Return an end with the status "limited" if it leaves most of the variation of the data."""
    share = unexplained_share(problem, end.evaluation)
    is_poor = share > _MAX_ACCEPTED_SHARE and not is_noise(end.evaluation.residuals)
    if not (is_poor or end.is_stalled):
        return end
    amount = f"only {100.0 * (1.0 - share):.2g} % of the variation of the data"
    if share >= 1.0:
        amount = "the data less well than their mean does"
    ending = end.status.sentence
    if end.is_stalled:
        ending = f"stopped without progress after {format_count(end.evaluations, 'evaluation')}"
    status = Status("limited", f"{ending}, but the model explains {amount}")
    return replace(end, status=status, explains=False)


def _find_next_step(
    record: _Evaluations, end: Evaluation, attraction: Array, free: Array
) -> tuple[Array, float]:
    """Return which variables (K,) are at a bound, and the length of the next Gauss-Newton step.

    The length is that of the other variables in standard deviations. Searches stay inside the
    bounds and may end at a distance from one that the step of a variable crosses. They also end in
    front of values at which runs fail or columns jump.
    """
    scaling = record.scaling
    x, (lower, upper) = scaling.variables(end.values), scaling.limits
    jacobian = np.vstack([end.projected_jacobian * scaling.derivatives(x), attraction])
    residuals = np.append(end.residuals, attraction @ (x - scaling.first))
    curvature, gradient = np.sum(jacobian**2, axis=0), residuals @ jacobian
    steps = np.divide(-gradient, curvature, out=np.zeros(len(x)), where=curvature > 0.0)
    below, above = scaling.distances(end.values)
    is_low = (below < _MAX_BOUND_DISTANCE) & (steps < lower - x)
    is_high = (above < _MAX_BOUND_DISTANCE) & (steps > upper - x)
    at_bounds = free & (is_low | is_high)
    rounding = MIN_RELATIVE_RESIDUAL * np.sqrt(record.problem.weighted_square)
    left = free & ~at_bounds
    if np.sqrt(end.chi_square) <= rounding or not left.any():
        return at_bounds, 0.0
    directions, singular, _ = np.linalg.svd(jacobian[:, left], full_matrices=False)
    is_determined = singular > MIN_SINGULAR_RATIO * singular[0]
    freedom = max(end.count - int(np.sum(left)), 1)
    step = np.linalg.norm((residuals @ directions)[is_determined])
    return at_bounds, float(step * np.sqrt(freedom / end.chi_square))
