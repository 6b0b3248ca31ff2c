"""Search of a fit: `scipy.optimize.least_squares` with exact Jacobians."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from beamdae.analysis.fit.information import MAX_RELATIVE_DEVIATION, Information
from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    column_lengths,
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
    explains
        False if the end leaves most of the variation of the data.
    """

    evaluation: Evaluation
    evaluations: int
    status: Status
    at_bounds: Array
    first: Evaluation
    failures: str = ""
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
        # The first run must succeed.
        self.first = self.best = known or problem.evaluate(scaling.values(first))
        self._sums = [self.first.chi_square]
        self._accepted = first.tobytes()
        self._cache = {self._accepted: self.first}
        if not np.isfinite(self.first.chi_square):
            raise BeamdaeError(
                "fit: the first run has no finite sum of squared residuals; choose other first "
                "values in parameters, or check the data."
            )

    @property
    def count(self) -> int:
        """Number of evaluations."""
        return len(self._sums)

    def at(self, x: Array) -> Evaluation:
        """Return the evaluation at variables (K,)."""
        key = x.tobytes()
        if key not in self._cache:
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
    nowhere = np.zeros(len(first), bool)
    if not free.any():
        status = Status("ok", "all parameters are fixed")
        return SearchResult(record.best, 1, status, nowhere, record.first)
    sigma, is_stalled, ending = 1.0, False, ""
    if not problem.data.is_sigma_known:
        sigma = float(_GUESSED_SIGMA * np.sqrt(problem.data.variation / problem.count))
    attraction = _PRIOR_WEIGHT * sigma * np.eye(len(first))
    try:
        x, result = _minimize(record, first, free, attraction, _ROUGH_TOLERANCE)
        if not is_rough and result.success:
            x = np.where(free, scaling.inside(x), x)
            attraction = _attract_undetermined(record, x, free)
            x, result = _minimize(record, x, free, attraction, _TOLERANCE)
        end = record.at(x)
        if not result.success:
            count = format_count(max_evaluations, "evaluation")
            ending = f"stopped after {count}; increase max_evaluations="
    except _StalledError:
        end, is_stalled = record.best, True
        count = format_count(record.count, "evaluation")
        ending = f"stopped without progress after {count}"
    except KeyboardInterrupt:
        status = Status(
            "interrupted", f"interrupted after {format_count(record.count, 'evaluation')}"
        )
        partial = SearchResult(record.best, record.count, status, nowhere, record.first)
        raise Interrupted(status.sentence, partial) from None
    at_bounds, next_step = _find_next_step(record, end, attraction, free)
    status, failures = Status("ok", "converged"), ""
    if next_step > _MAX_NEXT_STEP:
        cause = "runs fail" if record.failures else "the columns jump or have a kink"
        ended = (
            f"the search ended next to values at which {cause}, {next_step:.2g} standard "
            "deviations before a minimum"
        )
        status = Status("limited", ending or ended)
    if record.failures:
        count, last_one = format_count(len(record.failures), "run"), record.failures[-1]
        failures = (
            f"{count} failed, the last one: {last_one.removesuffix('.')}; pass bounds= that "
            "exclude such values"
        )
    result = SearchResult(end, record.count, status, at_bounds, record.first, failures)
    return replace(result, explains=False) if is_stalled and not status.success else result


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
        distance = attraction @ (whole(x) - scaling.first)
        # The search continues with a shorter step from NaN.
        left = np.full(record.problem.count, np.nan) if evaluation is None else evaluation.residuals
        return np.append(left, distance) / size

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
    evaluation, slopes = record.at(x), record.scaling.derivatives(x)
    sigma = _standard_deviation(record.problem, evaluation)
    # Near zero, changes are relative to the first value.
    sizes = np.maximum(slopes, record.scaling.sizes)
    information = Information(evaluation.projected_jacobian, sizes * free)
    singular = information.singular
    limit = max(sigma / MAX_RELATIVE_DEVIATION, MIN_SINGULAR_RATIO * singular[0])
    directions = information.directions[singular < (limit or np.inf)]
    # Orthonormal directions in the variables.
    basis, _ = np.linalg.qr((directions * sizes / slopes).T)
    return np.asarray(_PRIOR_WEIGHT * sigma * basis.T)


def _find_next_step(
    record: _Evaluations, end: Evaluation, attraction: Array, free: Array
) -> tuple[Array, float]:
    """Return which variables (K,) are at a bound, and the length of the next Gauss-Newton step.

    The step minimizes the linearized problem within the bounds. The length is that of the variables
    inside the bounds in standard deviations; searches end in front of bounds, and in front of
    values at which runs fail or columns jump.
    """
    scaling, at_bounds = record.scaling, np.zeros(len(free), bool)
    x = scaling.variables(end.values)
    jacobian = np.vstack([end.projected_jacobian * scaling.derivatives(x), attraction])
    residuals = np.append(end.residuals, attraction @ (x - scaling.first))
    if end.chi_square <= MIN_RELATIVE_RESIDUAL**2 * record.problem.weighted_square:
        return at_bounds, 0.0
    lengths = column_lengths(jacobian)
    lower, upper = ((limit - x) * lengths for limit in scaling.limits)
    box = np.minimum(lower, 0.0)[free], np.maximum(upper, 0.0)[free]
    least = lsq_linear((jacobian / lengths)[:, free], -residuals, box, method="bvls")
    step = np.zeros(len(x))
    step[free] = least.x / lengths[free]
    change = np.abs(scaling.values(x + step) - end.values) / scaling.sizes
    is_near = np.minimum(np.abs(step), change) < _MAX_BOUND_DISTANCE
    at_bounds[free] = (least.active_mask != 0) & is_near[free]
    length = float(np.linalg.norm(jacobian @ np.where(at_bounds, 0.0, step)))
    freedom = max(record.problem.count - int(np.sum(free & ~at_bounds)), 1)
    return at_bounds, length * np.sqrt(freedom / end.chi_square)


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
    if not is_explained(problem, end.evaluation):
        try:
            end = _repeat_from_first_data(problem, scaling, first, end, max_evaluations)
        except KeyboardInterrupt as interrupt:
            best = getattr(interrupt, "partial", None)
            # Those of first parts of the data are no ends of the fit.
            if isinstance(best, SearchResult) and len(best.evaluation.residuals) == problem.count:
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
    spent = end.evaluations
    for share in _FIRST_SHARES:
        parts = [problem.with_first_data(share)]
        if parts[0].data.variation < _MIN_PART_VARIATION * problem.data.variation:
            continue
        if len(problem.estimated) > len(problem.variables):
            # Short parts hardly determine scales and offsets, which most sensors have near 1 and 0.
            parts.insert(0, problem.with_first_data(share, is_calibrated=True))
        for part in parts:
            limit = min(_MAX_PART_EVALUATIONS, max_evaluations - spent)
            if limit < 1:
                return replace(end, evaluations=spent)
            try:
                other = local_search(part, scaling, first, limit, is_rough=True)
            except (ValueError, ArithmeticError):
                # BeamdaeError, or an error of the model function at extreme values.
                return replace(end, evaluations=spent)
            spent += other.evaluations
            if is_explained(part, other.evaluation):
                first = scaling.start(other.evaluation.values)
                break
        else:
            return replace(end, evaluations=spent)
    best = end
    if spent < max_evaluations:
        with suppress(ValueError, ArithmeticError):
            other = local_search(problem, scaling, first, max_evaluations - spent)
            spent += other.evaluations
            best = min(end, other, key=lambda x: x.chi_square)
    return replace(best, evaluations=spent, first=end.first)


def is_explained(problem: FitProblem, evaluation: Evaluation) -> bool:
    """Return True if little of the variation of the data is left, or noise."""
    share = unexplained_share(problem, evaluation)
    return share <= _MAX_UNEXPLAINED_SHARE or is_noise(evaluation.residuals)


def _standard_deviation(problem: FitProblem, evaluation: Evaluation) -> float:
    """Return the standard deviation of the errors in units of the residuals.

    It is that of the residuals, or that of a given sigma if it is smaller.
    """
    freedom = problem.count - len(problem.estimated)
    deviation = float(np.sqrt(evaluation.chi_square / max(freedom, 1)))
    return min(deviation, 1.0) if problem.data.is_sigma_known else deviation


def _judge_explanation(problem: FitProblem, end: SearchResult) -> SearchResult:
    """Return an end with the status "limited" if it leaves most of the variation of the data."""
    share = unexplained_share(problem, end.evaluation)
    is_poor = share > _MAX_ACCEPTED_SHARE and not is_noise(end.evaluation.residuals)
    if end.explains and not is_poor:
        return end
    amount = f"only {100.0 * (1.0 - share):.2g} % of the variation of the data"
    if share >= 1.0:
        amount = "the data less well than their mean does"
    status = Status("limited", f"{end.status.sentence}, but the model explains {amount}")
    return replace(end, status=status, explains=False)
