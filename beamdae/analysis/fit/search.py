"""Search of a fit: `scipy.optimize.least_squares` with exact Jacobians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from beamdae.analysis.fit.problem import (
    MIN_SINGULAR_RATIO,
    Evaluation,
    FitProblem,
    Scaling,
    is_noise,
    unexplained_share,
)
from beamdae.analysis.fit.sensors import SCALE
from beamdae.errors import BeamdaeError, format_count, format_exception
from beamdae.interrupts import Interrupted
from beamdae.read_only import read_only_data
from beamdae.results.outcome import Status

Array = np.ndarray

# Changes of parameters below this ratio to their first value are relative to the first value.
_MIN_RELATIVE_VALUE = 1e-3
# Parameters with smaller shares of a direction are not named.
_MIN_NAMED_SHARE = 0.05


@read_only_data
@dataclass(frozen=True, eq=False)
class Information:
    """Singular value decomposition of the Jacobian of the residuals.

    Attributes
    ----------
    jacobian
        Derivatives (n, k) of the residuals, in standard deviations, with respect to the parameters.
    sizes
        Sizes (k,) to which changes of the parameters are relative; 0 for fixed parameters.
    """

    jacobian: Array
    sizes: Array

    @cached_property
    def _decomposition(self) -> tuple[Array, Array]:
        # Rows of zeros complete the directions of few data.
        matrix = np.vstack([self.jacobian * self.sizes, np.zeros((len(self.sizes),) * 2)])
        return np.linalg.svd(matrix, full_matrices=False)[1:]

    @property
    def singular(self) -> Array:
        """Singular values (k,) for relative changes of the parameters, in descending order."""
        return self._decomposition[0]

    @property
    def directions(self) -> Array:
        """Orthonormal relative changes (k, k) of the parameters, one row per singular value."""
        return self._decomposition[1]

    @property
    def is_dependent(self) -> Array:
        """True (k,) for directions without an effect on the residuals."""
        return np.asarray(self.singular <= MIN_SINGULAR_RATIO * self.singular[0])

    @property
    def covariance(self) -> Array:
        """Covariance (k, k) of the parameters; undetermined ones have infinite variances."""
        with np.errstate(divide="ignore"):
            variances = np.where(self.is_dependent, 0.0, 1.0 / self.singular**2)
        covariance = (self.directions.T * variances) @ self.directions
        covariance *= np.outer(self.sizes, self.sizes)
        deviations = self.standard_deviations(np.eye(len(self.sizes)))
        covariance[np.diag_indices_from(covariance)] = deviations**2
        return np.asarray(covariance)

    def standard_deviations(self, derivatives: Array) -> Array:
        """Return the standard deviations (j,) of quantities with derivatives (j, k).

        They are infinite if a direction without an effect on the residuals changes the quantity.
        """
        along = (derivatives * self.sizes) @ self.directions.T
        largest = np.abs(along).max(axis=1, initial=0.0, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = np.where(np.abs(along) > _MIN_NAMED_SHARE * largest, np.inf, 0.0)
            terms = np.where(self.is_dependent, terms, along / self.singular)
        return np.asarray(np.sqrt((terms**2).sum(axis=1)))

    def describe_undetermined(
        self, values: Mapping[str, float], units: Mapping[str, str]
    ) -> list[str]:
        """Return sentences on combinations of parameters that the data do not determine.

        Changes are relative to the values; those of parameters with another size have units.
        """
        sentences = []
        for s, direction, is_dependent in zip(
            self.singular, self.directions, self.is_dependent, strict=True
        ):
            # Relative changes have a standard deviation of at most 1.
            if s >= 1.0 and not is_dependent:
                continue
            # The largest share is positive.
            largest = direction[np.argmax(np.abs(direction))]
            change = direction / largest * (0.01 if is_dependent else abs(largest) / s)
            shares = [
                f"{name} by {100.0 * x:+.3g} %"
                if size == abs(value)
                else f"{name} by {x * size:+.3g} {units[name]}".rstrip()
                for (name, value), size, x in zip(values.items(), self.sizes, change, strict=True)
                if abs(x) > _MIN_NAMED_SHARE * np.abs(change).max()
            ]
            effect = "lie within one standard deviation"
            effect = "do not change the fitted columns" if is_dependent else effect
            subject = "Changes of" if len(shares) == 1 else "Joint changes of"
            sentences.append(f"{subject} {', '.join(shares)} {effect}.")
        return sentences


def find_covariance(
    problem: FitProblem, scaling: Scaling, end: Evaluation, at_bounds: Array, sigma: float
) -> tuple[Information, Information, Array]:
    """Return the information on all estimates, that on free ones, and the covariance."""
    estimates, jacobian = end.estimates, end.jacobian / sigma
    # Changes are relative to the values, or to the first values near zero, or to typical sizes.
    typical = np.append(scaling.sizes, [x.size for x in problem.linear])
    has_size = np.isin(problem.estimated, [x.name for x in problem.sensors if x.kind != SCALE])
    is_small = has_size | (np.abs(estimates) < _MIN_RELATIVE_VALUE * typical)
    sizes = np.where(is_small, typical, np.abs(estimates))
    # The covariance of the others holds fixed what is at a bound or has no effect of its own.
    effects = np.linalg.norm(jacobian * np.maximum(sizes, typical), axis=0)
    is_fixed = effects < 1.0
    is_fixed[: len(at_bounds)] |= at_bounds
    whole, free = (Information(jacobian, x) for x in (sizes, np.where(is_fixed, 0.0, sizes)))
    covariance = free.covariance
    variances = np.where(is_fixed, np.diag(whole.covariance), np.diag(covariance))
    np.fill_diagonal(covariance, variances)
    return whole, free, covariance


# Relative changes of the sum of squares and of the variables at which a search has converged, and
# those at which one has that only provides first values.
_TOLERANCE, _ROUGH_TOLERANCE = 1e-8, 1e-3
# Gradients below this ratio to the sum of squares of the first values are rounding errors.
_ZERO_GRADIENT = 1e-15
_ROUNDING = 1e-12  # of variables
# Weight of the distance from the first values in undetermined directions: a change by a factor of
# e^3 costs one variance of the data, whose standard deviation is guessed, relative to that of the
# motion, while it is unknown.
_PRIOR_WEIGHT, _GUESSED_SIGMA = 1.0 / 3.0, 0.01
# Length of the next Gauss-Newton step, in standard deviations of the estimates, up to which the end
# of a search is a minimum.
_MAX_NEXT_STEP = 0.1
# A search has explained the data if it leaves less than this share of their variation, or noise.
_MAX_UNEXPLAINED_SHARE = 0.2
# One that has not ends if the sum of squares does not decrease to this share in this number of
# evaluations, which is also the largest one in parts of the data.
_FEW_EVALUATIONS = 7
# Shares of the time of the data, one after the other, from which first values are estimated.
_FIRST_SHARES = (0.0625, 0.25)
_MIN_PART_VARIATION = 1e-3  # smallest share of the variation of the data in a part
# Share of the variation of the data above which the end of a search is no solution.
_MAX_ACCEPTED_SHARE = 0.5


class _StalledError(Exception):
    """Raised to end a search without progress."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a search.

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
    failures
        Sentence on runs that failed during the search, or "".
    explains
        False if the end leaves most of the variation of the data.
    """

    evaluation: Evaluation
    evaluations: int
    status: Status
    at_bounds: Array
    failures: str = ""
    explains: bool = True

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return self.evaluation.chi_square


class _Record:
    """Evaluations of a search: the best, the latest and the latest accepted one."""

    def __init__(self, problem: FitProblem, scaling: Scaling, first: Array) -> None:
        self.problem, self.scaling = problem, scaling
        self.best = problem.evaluate(scaling.values(first))
        self._accepted, self._known = first.tobytes(), {first.tobytes(): self.best}
        self._sums, self.failures = [self.best.chi_square], list[str]()
        if not np.isfinite(self.best.chi_square):
            raise BeamdaeError(
                "fit: the first run has no finite sum of squared residuals; choose other first "
                "values in parameters, or check the data."
            )

    @property
    def count(self) -> int:
        """Number of evaluations."""
        return len(self._sums)

    def accept(self, x: Array) -> Evaluation:
        """Return the evaluation at variables (K,) to which the search has moved."""
        self._accepted = x.tobytes()
        return self._known[self._accepted]

    def residuals(self, x: Array) -> Array:
        """Return the residuals (N,) at variables (K,), NaN if the model or its run fails."""
        key = x.tobytes()
        if key not in self._known:
            try:
                evaluation = self.problem.evaluate(self.scaling.values(x))
                self._known = {k: y for k, y in self._known.items() if k == self._accepted}
                self._known[key] = evaluation
                self.best = min(self.best, evaluation, key=lambda e: e.chi_square)
            except (ValueError, ArithmeticError) as failure:
                # BeamdaeError, or an error of the model function at extreme values.
                is_ours = isinstance(failure, BeamdaeError)
                self.failures.append(str(failure) if is_ours else format_exception(failure))
            self._sums.append(self.best.chi_square)
            earlier = self._sums[-1 - _FEW_EVALUATIONS :]
            is_stalled = self._sums[-1] > _MAX_UNEXPLAINED_SHARE * earlier[0]
            is_stalled &= len(earlier) > _FEW_EVALUATIONS
            if is_stalled and not is_explained(self.problem, self.best):
                raise _StalledError
        known = self._known.get(key)
        return np.full(self.problem.count, np.nan) if known is None else known.residuals

    def minimize(
        self, first: Array, free: Array, attraction: Array, tolerance: float, limit: int
    ) -> tuple[Array, bool]:
        """Return the variables (K,) at a minimum over the free ones; False if the limit ended it.

        The residuals are those of the data and the rows `attraction` (j, K) times the distance from
        the first values of the fit, relative to the first residuals, so that units of the data are
        of no importance.
        """
        scaling, size = self.scaling, float(np.linalg.norm(self.residuals(first))) or 1.0

        def whole(x: Array) -> Array:
            variables = first.copy()
            variables[free] = x
            # Rounding errors of steps to a bound, which `least_squares` removes afterwards.
            for limit in scaling.limits:
                is_at = np.isclose(variables, limit, rtol=_ROUNDING, atol=_ROUNDING)
                variables = np.where(is_at, limit, variables)
            return variables

        def residuals(x: Array) -> Array:
            distance = attraction @ (whole(x) - 1.0)
            return np.append(self.residuals(whole(x)), distance) / size

        def jacobian(x: Array) -> Array:
            rows = self.accept(whole(x)).projected_jacobian * scaling.derivatives(whole(x))
            return np.vstack([rows, attraction])[:, free] / size

        result = least_squares(
            residuals,
            first[free],
            jacobian,
            bounds=[x[free] for x in scaling.limits],
            method="dogbox",
            ftol=tolerance,
            xtol=tolerance,
            gtol=_ZERO_GRADIENT,
            max_nfev=max(limit - self.count, 0) + 1,  # The first evaluation is known.
        )
        return whole(result.x), bool(result.success)


def local_search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
    free: Array | None = None,
    is_rough: bool = False,
) -> SearchResult:
    """Minimize the sum of squares from the variables `first` (K,).

    Only the variables marked in `free` (K,) vary; None means all. All parameters are attracted to
    their first values by a small weight until the sum of squares hardly changes, then only
    combinations that the data do not determine, so that these stay there. A search that does not
    explain the data and makes no progress ends. With `is_rough`, it ends before the second part.

    Raises
    ------
    BeamdaeError
        If the first run fails or its residuals are not finite.
    Interrupted
        If Ctrl-C ends the search after its first evaluation, with the `SearchResult` at the best
        values as partial result.
    """
    record, nowhere = _Record(problem, scaling, first), np.zeros(len(first), bool)
    free = ~nowhere if free is None else free
    if not free.any():
        status = Status("ok", "all parameters are fixed")
        return SearchResult(record.best, 1, status, nowhere)
    sigma, ending, explains, is_known = 1.0, "", True, problem.data.is_sigma_known
    if not is_known:
        sigma = float(_GUESSED_SIGMA * np.sqrt(problem.data.variation / problem.count))
    attraction = _PRIOR_WEIGHT * sigma * np.eye(len(first))
    try:
        x, success = record.minimize(first, free, attraction, _ROUGH_TOLERANCE, max_evaluations)
        if success and not is_rough:
            end, slopes = record.accept(x), scaling.derivatives(x)
            freedom = max(problem.count - len(problem.estimated), 1)
            sigma = float(np.sqrt(end.chi_square / freedom))
            sigma = min(sigma, 1.0) if is_known else sigma
            # Near zero, changes are relative to the first value.
            sizes = np.maximum(slopes, scaling.sizes)
            information = Information(end.projected_jacobian, sizes * free)
            singular = information.singular
            limit = max(sigma, MIN_SINGULAR_RATIO * singular[0])
            directions = information.directions[singular < (limit or np.inf)]
            # Orthonormal directions in the variables.
            basis, _ = np.linalg.qr((directions * sizes / slopes).T)
            attraction = _PRIOR_WEIGHT * sigma * basis.T
            x, success = record.minimize(x, free, attraction, _TOLERANCE, max_evaluations)
        end = record.accept(x)
        if not success:
            count = format_count(max_evaluations, "evaluation")
            ending = f"stopped after {count}; increase max_evaluations="
    except _StalledError:
        end = record.best
        count = format_count(record.count, "evaluation")
        ending, explains = f"stopped without progress after {count}", False
    except KeyboardInterrupt:
        sentence = f"interrupted after {format_count(record.count, 'evaluation')}"
        status = Status("interrupted", sentence)
        partial = SearchResult(record.best, record.count, status, nowhere)
        raise Interrupted(sentence, partial) from None
    x, status, failures = scaling.variables(end.values), Status("ok", "converged"), ""
    is_bound = (end.values == scaling.bounds[0]) | (end.values == scaling.bounds[1])
    inner = free & ~is_bound
    # The next step from rounding errors is arbitrary.
    if inner.any() and end.chi_square > problem.rounding:
        # It is long where a search ended before values at which runs fail or columns jump.
        rows = np.vstack([end.projected_jacobian * scaling.derivatives(x), attraction])[:, inner]
        residuals = np.append(end.residuals, attraction @ (x - 1.0))
        change = rows @ np.linalg.lstsq(rows, residuals, MIN_SINGULAR_RATIO)[0]
        freedom = max(problem.count - int(np.sum(inner)), 1)
        next_step = float(np.linalg.norm(change) * np.sqrt(freedom / end.chi_square))
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
    explains |= status.success
    return SearchResult(end, record.count, status, free & is_bound, failures, explains)


def search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
) -> SearchResult:
    """Minimize the sum of squares, if necessary from estimates by first parts of the data.

    Raises
    ------
    BeamdaeError, Interrupted
        See `local_search`.
    """
    end = local_search(problem, scaling, first, max_evaluations)
    spent, shares = end.evaluations, (*_FIRST_SHARES, 1.0)
    try:
        # While vibrations of the model and of the data differ by less than half a period, the sum
        # of squares has no local minimum between them. A search that fails therefore begins with a
        # short part of the data and continues with longer ones, up to all.
        for share in () if is_explained(problem, end.evaluation) else shares:
            part = problem.within(0.0, share)[0] if share < 1.0 else problem
            if part.data.variation < _MIN_PART_VARIATION * problem.data.variation:
                continue
            limit = max_evaluations - spent
            if share < 1.0:
                limit = min(limit, _FEW_EVALUATIONS)
            if limit <= 0:
                break
            try:
                other = local_search(part, scaling, first, limit, is_rough=share < 1.0)
            except (ValueError, ArithmeticError):
                break  # BeamdaeError, or an error of the model function at extreme values.
            spent += other.evaluations
            if share == 1.0:
                end = min(end, other, key=lambda x: x.chi_square)
            if not is_explained(part, other.evaluation):
                break
            first = scaling.variables(other.evaluation.values)
    except KeyboardInterrupt as interrupt:
        best = getattr(interrupt, "partial", None)
        # Those of first parts of the data are no ends of the fit.
        if isinstance(best, SearchResult) and len(best.evaluation.residuals) == problem.count:
            end = min(end, best, key=lambda x: x.chi_square)
        reason = f"interrupted after {format_count(end.evaluations, 'evaluation')}"
        partial = replace(end, status=Status("interrupted", reason))
        raise Interrupted(reason, partial) from None
    end = replace(end, evaluations=spent)
    share, status, explains = unexplained_share(problem, end.evaluation), end.status, end.explains
    if share > _MAX_ACCEPTED_SHARE and not is_noise(problem, end.evaluation.residuals):
        explains = False
    if not explains:
        amount = f"only {100.0 * (1.0 - share):.2g} % of the variation of the data"
        if share >= 1.0:
            amount = "the data less well than their mean does"
        status = Status("limited", f"{status.sentence}, but the model explains {amount}")
    if end.failures and not status.success:
        status = Status(status.kind, f"{status.sentence}; {end.failures}")
    return replace(end, status=status, explains=explains)


def is_explained(problem: FitProblem, evaluation: Evaluation) -> bool:
    """Return True if little of the variation of the data is left, or noise."""
    share = unexplained_share(problem, evaluation)
    return share <= _MAX_UNEXPLAINED_SHARE or is_noise(problem, evaluation.residuals)
