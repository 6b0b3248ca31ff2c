"""Local search of a fit: a trust-region method with exact Jacobians."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from scipy.optimize import least_squares

from beamdae.analysis.fit.problem import Evaluation, FitProblem, Scaling
from beamdae.errors import BeamdaeError, format_count, format_exception
from beamdae.interrupts import Interrupted
from beamdae.results.outcome import Status

Array = np.ndarray

# Relative changes of the sum of squares and of the parameters at which a fit has converged.
_TOLERANCE = 1e-8
# Gradients below this ratio to the sum of squares of the first values are rounding errors.
_ZERO_GRADIENT = 1e-15
# Distance from a bound, in first values or logarithms, at which an estimate may be at the bound.
_MAX_BOUND_DISTANCE = 1e-2
# Length of the next Gauss-Newton step, in standard deviations of the estimates, up to which the end
# of a search is a minimum.
_MAX_NEXT_STEP = 0.1
# Logarithm of the ratio to its first value from which a parameter without effect ran away.
_MIN_RUNAWAY = np.log(10.0)
# Ratio to its first value from which a parameter ran away, unless the model explains the data, and
# ratio beyond which there is no run: runs with absurd values fail or take long. Parameters without
# a logarithm may be small, because they may change their sign.
_MAX_UNEXPLAINED_RATIO, _MAX_RATIO = 1e6, 1e12
# Residuals below this ratio to the data are rounding errors, whose next step is arbitrary.
MIN_RELATIVE_RESIDUAL = 1e-6
# A search that leaves more than this share of the variation of the data, and whose residuals are
# not noise, has not explained them.
_MAX_UNEXPLAINED_SHARE = 0.2
# Consecutive residuals with at most this correlation are noise.
MAX_NOISE_CORRELATION = 0.5
# Such a search has stalled if its sum of squares decreases less than by this factor in the last
# evaluations, from the second number of evaluations on. Of 51 searches of five small models from
# first values that were wrong by factors of up to 3, 48 reached the solution; 46 of these had
# explained the data after 10 evaluations, the other two after 20. Steps next to values that the
# model rejects, such as a negative damping, hardly decrease the sum: before, a search has stalled
# if it decreases less than by the last factor. Values at which runs fail count as evaluations.
_MAX_STALLED_RATIO, _STALLED_EVALUATIONS, _MIN_EVALUATIONS = 0.2, 6, 12
_MIN_CREEPING_RATIO = 0.95
# Shares of the variation of the data above which the end of a search is no solution.
_MAX_ACCEPTED_SHARE = 0.5
# Steps that return parameters without an effect to their first values, the largest relative change
# that needs none, and the increase of the sum of squares that they may cause, in variances.
_MAX_RETURNS, _MIN_RETURN, _MAX_RETURN_INCREASE = 6, 1e-4, 1e-3
# Shares of the time of the data, one after the other, with which a search begins that has not
# explained all of them; the smallest share of their variation in a part that is used, and the
# largest number of evaluations with a part.
_FIRST_SHARES, _MIN_PART_VARIATION, _MAX_PART_EVALUATIONS = (0.0625, 0.125, 0.25, 0.5), 1e-3, 15
# Relative changes at which it converges; it only provides first values.
_PART_TOLERANCE = 1e-3
# Meanwhile, a change by a factor of e^3 costs one variance of the data. If it is unknown, their
# standard deviation is guessed relative to that of the motion.
_PRIOR_WEIGHT, _GUESSED_SIGMA = 1.0 / 3.0, 0.01
# Singular values below this ratio to the largest are rounding errors of the derivatives.
_MIN_SINGULAR_RATIO = 1e-9


class Checks(Protocol):
    """Checks of the data by a search, which ends if they return a clause on an error."""

    first: Evaluation | None

    def check_ranges(self, first: Evaluation) -> None:
        """Check the data with the first evaluation."""

    def check_scales(self, best: Evaluation) -> str:
        """Check the data with the best evaluation of a search that leaves more than noise."""

    def check_progress(self, best: Evaluation) -> str:
        """Check the data with the best evaluation of searches that do not explain them."""


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
    rejected
        Values of parameters that the model rejected during the search, by name.
    held
        Names of parameters that keep their first values, see `robust_search`.
    recording_error
        Clause on the error of the data that ended the search, or "".
    is_stalled
        True if the search ended without progress and without an explanation of the data.
    """

    evaluation: Evaluation
    evaluations: int
    status: Status
    at_bounds: Array
    rejected: Mapping[str, float] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    recording_error: str = ""
    is_stalled: bool = False

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return self.evaluation.chi_square


def search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
    free: Array | None = None,
    checks: Checks | None = None,
    has_short_steps: bool = False,
    can_stall: bool = False,
    prior: Array | None = None,
    tolerance: float = _TOLERANCE,
) -> SearchResult:
    """Minimize the sum of squares from the variables `first` (K,).

    Only the variables marked in `free` (K,) vary; None means all. Variables without any effect keep
    their first values. `checks` compares the ranges of the data with those of the first run. The
    trust region is scaled by the columns of the Jacobian (Moré, Lect. Notes Math. 630 (1978) 105,
    doi:10.1007/BFb0067700), which suits narrow valleys but permits long steps of variables with
    little effect. With `has_short_steps`, it is a sphere in the variables, as that
    of Levenberg: the first step changes no variable by more than about its first value or a factor
    of e. With `can_stall`, a search ends that has not explained the data and makes no progress.
    Squares of the distances from the variables `prior` (K,) are added with a small weight, which
    keeps those that the data do not determine there. Steps to values far from the first ones are
    shortened unless the model explains the data there. `tolerance` is the relative change of the
    sum of squares and of the variables at which the search has converged.

    Raises
    ------
    BeamdaeError
        If the first run fails or its residuals are not finite.
    Interrupted
        If Ctrl-C ends the search after its first evaluation, with the `SearchResult` at the best
        values as partial result.
    """
    given = np.ones(len(first), bool) if free is None else free
    free = given
    evaluations = 0
    failures: list[str] = []
    failed_values = scaling.values(first)
    best: Evaluation | None = None
    accepted: tuple[bytes, Evaluation] | None = None
    latest: tuple[bytes, Evaluation] | None = None
    sums: list[float] = []
    has_runaways = False

    def evaluate(x: Array) -> Evaluation | None:
        nonlocal latest, best, evaluations, failed_values, has_runaways
        key = x.tobytes()
        for known in (latest, accepted):
            if known is not None and known[0] == key:
                return known[1]
        whole = first.copy()
        whole[free] = x
        ratio = scaling.largest_ratio(whole)
        if accepted is not None and ratio > _MAX_RATIO:
            has_runaways = True
            return None
        evaluations += 1
        try:
            evaluation = problem.evaluate(scaling.values(whole))
        except (ValueError, ArithmeticError) as failure:
            # BeamdaeError, or an error of the model function at extreme values.
            if accepted is None:
                raise
            # The search continues with a shorter step.
            is_ours = isinstance(failure, BeamdaeError)
            failures.append(str(failure) if is_ours else format_exception(failure))
            failed_values = scaling.values(whole)
            record_progress()
            return None
        # The trust region, scaled by derivatives, permits long steps of parameters with little
        # effect, to values at which nothing moves. Steps to such values are shortened.
        is_runaway = (
            accepted is not None
            and ratio > _MAX_UNEXPLAINED_RATIO
            and _unexplained_share(problem, evaluation) > _MAX_ACCEPTED_SHARE
        )
        has_runaways |= is_runaway
        if not is_runaway:
            latest = key, evaluation
            if best is None or evaluation.chi_square < best.chi_square:
                best = evaluation
        record_progress()
        return None if is_runaway else evaluation

    def record_progress() -> None:
        assert best is not None
        sums.append(best.chi_square)
        if not can_stall or len(sums) <= _STALLED_EVALUATIONS or is_explained(problem, best):
            return
        ratio = sums[-1] / sums[-1 - _STALLED_EVALUATIONS]
        if ratio > (_MAX_STALLED_RATIO if len(sums) >= _MIN_EVALUATIONS else _MIN_CREEPING_RATIO):
            raise _StalledError

    def residuals(x: Array) -> Array:
        evaluation = evaluate(x)
        if evaluation is None:
            return np.full(problem.data.count + len(attraction), np.nan)
        whole = first.copy()
        whole[free] = x
        distance = np.zeros(len(first)) if prior is None else whole - prior
        return np.append(evaluation.residuals, attraction @ distance) / size

    def jacobian(x: Array) -> Array:
        nonlocal accepted
        evaluation = evaluate(x)
        assert evaluation is not None
        accepted = x.tobytes(), evaluation
        whole = first.copy()
        whole[free] = x
        rows = evaluation.projected_jacobian * scaling.derivatives(whole)
        return np.vstack([rows, attraction])[:, free] / size

    # Rows of the residuals that attract the variables to `prior`.
    attraction = np.zeros((0, len(first)))
    if prior is not None:
        attraction = _PRIOR_WEIGHT * _guess_sigma(problem) * np.eye(len(first))
    begin = first[free]
    start = evaluate(begin)
    assert start is not None
    if not start.count:
        raise BeamdaeError(
            "fit: reactions of the model grow without bounds at all times of the data; choose "
            "other first values in parameters, or other columns."
        )
    if not np.isfinite(start.chi_square):
        raise BeamdaeError(
            "fit: the first run has no finite sum of squared residuals; choose other first values "
            "in parameters, or check the data."
        )
    if not free.any():
        is_at_bound = np.zeros(len(first), bool)
        return SearchResult(start, 1, Status("ok", "all parameters are fixed"), is_at_bound)
    # The steps of variables without effect are arbitrary, and the search would take many more.
    has_effect = np.any(start.projected_jacobian, axis=0)
    if (given & has_effect).any():
        free = given & has_effect
        begin = first[free]
        latest = begin.tobytes(), start
    lower, upper = (limit[free] for limit in scaling.limits)
    at_bounds = np.zeros(len(first), bool)

    def find_rejected(last: Evaluation) -> dict[str, float]:
        return _find_rejected_values(problem, last.values, failed_values) if failures else {}

    # The search must not depend on the units of the data.
    size = float(np.linalg.norm(start.residuals)) or 1.0
    if checks is not None:
        checks.check_ranges(start)
    try:
        # Kept within the bounds up to rounding, as the method requires.
        result = least_squares(
            residuals,
            np.clip(begin, lower, upper),
            jacobian,
            bounds=(lower, upper),
            x_scale=1.0 if has_short_steps else "jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=_ZERO_GRADIENT,
            max_nfev=max_evaluations,
        )
        last = evaluate(result.x)
    except _StalledError:
        assert best is not None
        status = Status("limited", "stopped without progress")
        rejected = find_rejected(best)
        return SearchResult(best, evaluations, status, at_bounds, rejected, is_stalled=True)
    except KeyboardInterrupt:
        assert best is not None
        reason = f"interrupted after {format_count(evaluations, 'evaluation')}"
        status = Status("interrupted", reason)
        partial = SearchResult(best, evaluations, status, at_bounds)
        raise Interrupted(reason, partial) from None
    assert last is not None
    if np.any(last.projected_jacobian[:, given & ~free]) and max_evaluations > evaluations:
        # They have an effect elsewhere.
        again = search(
            problem,
            scaling,
            scaling.variables(last.values),
            max_evaluations - evaluations,
            given,
            has_short_steps=has_short_steps,
            prior=prior,
        )
        return replace(again, evaluations=evaluations + again.evaluations)
    at_bounds[free] = result.active_mask != 0
    if result.success:
        at_bounds[free] |= _find_bounds_ahead(result, lower, upper)
        jacobian_inside = result.jac[:, ~at_bounds[free]]
        cause = "the columns jump or have a kink"
        if failures or has_runaways:
            cause = "runs fail" if failures else "parameters run away"
        status = _judge_end(problem, last, size * result.fun, jacobian_inside, cause)
    else:
        count = format_count(max_evaluations, "evaluation")
        sentence = f"stopped after {count}; increase max_evaluations="
        status = Status("limited", sentence)
    rejected = find_rejected(last)
    if failures and not status.success:
        count = format_count(len(failures), "run")
        sentence = f"{status.sentence}; {count} failed, the last one: {failures[-1]}"
        status = Status(status.kind, sentence)
    return SearchResult(last, evaluations, status, at_bounds, rejected)


def _guess_sigma(problem: FitProblem) -> float:
    """Return the standard deviation of weighted residuals, which may have unknown units."""
    if problem.data.is_sigma_known:
        return 1.0
    return float(_GUESSED_SIGMA * np.sqrt(problem.data.variation / problem.data.count))


def reject_data(first: Evaluation, evaluations: int, clause: str) -> SearchResult:
    """Return a result with the first values, because of an error of the data."""
    count = format_count(evaluations, "evaluation")
    status = Status("limited", f"the search ended after {count}, because {clause}")
    at_bounds = np.zeros(len(first.values), bool)
    return SearchResult(first, evaluations, status, at_bounds, recording_error=clause)


def _reject(
    checks: Checks, check: Callable[[Evaluation], str], end: SearchResult
) -> SearchResult | None:
    """Return the result of `reject_data` if a check of a search finds an error, otherwise None."""
    clause = check(end.evaluation)
    if not clause:
        return None
    assert checks.first is not None
    return reject_data(checks.first, end.evaluations, clause)


def robust_search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
    checks: Checks | None = None,
) -> SearchResult:
    """Minimize the sum of squares also where parameters have little effect.

    A search that does not explain the data is repeated from values that explain their first half,
    and, if this does not help, with the logarithms of positive parameters: where vibrations of data
    and model are not in phase, steps reduce the amplitude and may move parameters far away. If this
    does not explain the data either, `checks` may name an error.

    A search that ends before a minimum, or far away in a parameter with a negligible effect, is
    repeated with short steps. If parameters with a negligible effect still run away or keep the
    others from a minimum, these are fitted with the first values of the former, from which a last
    search varies all of them: whether the data determine a parameter depends on the others.
    Finally, parameters return to their first values as far as this has no effect.

    Raises
    ------
    BeamdaeError, Interrupted
        See `search`.
    """
    end = search(problem, scaling, first, max_evaluations, checks=checks, can_stall=True)
    evaluations = end.evaluations

    def repeat(
        begin: Array,
        free: Array | None = None,
        names: tuple[str, ...] = (),
        scaling: Scaling = scaling,
        has_short_steps: bool = True,
        can_stall: bool = True,
    ) -> SearchResult | None:
        nonlocal end, evaluations
        if evaluations >= max_evaluations:
            return None
        remaining = max_evaluations - evaluations
        try:
            result = search(
                problem,
                scaling,
                begin,
                remaining,
                free,
                has_short_steps=has_short_steps,
                can_stall=can_stall,
            )
        except Interrupted as interrupt:
            # Otherwise, the partial result is that of a run.
            if isinstance(found := interrupt.partial, SearchResult):
                evaluations += found.evaluations
                end = found if _is_better(problem, found, end) else end
            raise
        except (ValueError, ArithmeticError):
            # BeamdaeError, or an error of the model function: first values of some parameters may
            # not go with the estimates of others.
            return None
        evaluations += result.evaluations
        return replace(result, evaluations=evaluations, held=names)

    try:
        if checks is not None and not is_noise(end.evaluation.residuals):
            rejected = _reject(checks, checks.check_scales, end)
            if rejected is not None:
                return rejected
        if not is_explained(problem, end.evaluation):
            remaining = max_evaluations - evaluations
            values, count = _search_with_first_data(problem, scaling, first, remaining)
            evaluations += count
            if values is not None:
                other = repeat(scaling.start(values), has_short_steps=False)
                if other is not None and _is_better(problem, other, end):
                    end = other
        if not is_explained(problem, end.evaluation):
            logarithmic = scaling.with_logarithms()
            if not np.array_equal(logarithmic.is_log, scaling.is_log):
                begin = logarithmic.start(scaling.values(first))
                other = repeat(begin, scaling=logarithmic, has_short_steps=False)
                if other is not None and _is_better(problem, other, end):
                    end = other
        if checks is not None and not is_explained(problem, end.evaluation):
            rejected = _reject(checks, checks.check_progress, replace(end, evaluations=evaluations))
            if rejected is not None:
                return rejected
        is_runaway = _find_runaways(problem, scaling, end)
        if not end.status.success or is_runaway.any():
            short = repeat(first)
            if short is not None and _is_better(problem, short, end):
                end = short
            # Models that lack an effect may not explain the data better.
            is_hopeless = _unexplained_share(problem, end.evaluation) > _MAX_ACCEPTED_SHARE
            if end.is_stalled and (end is short or not is_hopeless):
                begin = scaling.start(end.evaluation.values)
                again = repeat(begin, has_short_steps=False, can_stall=is_hopeless)
                if again is not None and _is_better(problem, again, end):
                    end = again
            is_runaway = _find_runaways(problem, scaling, end)
        # Where the model does not explain the data, held parameters do not help.
        is_hopeless = _unexplained_share(problem, end.evaluation) > _MAX_ACCEPTED_SHARE
        if is_runaway.any() and not (end.is_stalled and is_hopeless):
            begin = np.where(is_runaway, scaling.first, scaling.variables(end.evaluation.values))
            names = tuple(np.array(problem.variables)[is_runaway].tolist())
            held = repeat(begin, ~is_runaway, names)
            if held is not None and held.chi_square - end.chi_square <= _variance(problem, end):
                end = held
                released = repeat(scaling.variables(held.evaluation.values))
                if released is not None and _is_better(problem, released, held):
                    end = released
        end = replace(end, evaluations=evaluations)
        if end.status.success and evaluations < max_evaluations:
            end = _return_undetermined(problem, scaling.with_logarithms(), end)
    except KeyboardInterrupt:
        reason = f"interrupted after {format_count(evaluations, 'evaluation')}"
        status = Status("interrupted", reason)
        partial = replace(end, evaluations=evaluations, status=status)
        raise Interrupted(reason, partial) from None
    return _judge_explanation(problem, end)


def _search_with_first_data(
    problem: FitProblem, scaling: Scaling, first: Array, max_evaluations: int
) -> tuple[Array | None, int]:
    """Return values (K,) that explain the first half of the data, and the number of evaluations.

    While vibrations of the model and of the data differ by less than half a period, the sum of
    squares has no local minimum between them. The search therefore begins with a short part of the
    data and continues with longer ones. The values are None if the data of a part are not
    explained.
    """
    logarithmic, evaluations, values = scaling.with_logarithms(), 0, None
    sensors = problem.sensors
    if sensors.scales or sensors.offsets or sensors.shifts:
        # They refer to rows of all data.
        return None, 0
    for share in _FIRST_SHARES:
        part = problem.with_first_data(share)
        remaining = min(_MAX_PART_EVALUATIONS, max_evaluations - evaluations)
        if part.data.variation < _MIN_PART_VARIATION * problem.data.variation or remaining < 1:
            continue
        begin = logarithmic.start(scaling.values(first) if values is None else values)
        prior = logarithmic.first
        try:
            end = search(
                part,
                logarithmic,
                begin,
                remaining,
                has_short_steps=True,
                prior=prior,
                tolerance=_PART_TOLERANCE,
            )
        except (ValueError, ArithmeticError):
            # BeamdaeError, or an error of the model function at extreme values.
            return None, evaluations
        evaluations += end.evaluations
        if not is_explained(part, end.evaluation):
            return None, evaluations
        values = end.evaluation.values
    return values, evaluations


def is_explained(problem: FitProblem, evaluation: Evaluation) -> bool:
    """Return True if little of the variation of the data is left, or noise."""
    return _unexplained_share(problem, evaluation) <= _MAX_UNEXPLAINED_SHARE or is_noise(
        evaluation.residuals
    )


def _unexplained_share(problem: FitProblem, evaluation: Evaluation) -> float:
    square = evaluation.chi_square
    return square / problem.data.variation if problem.data.variation else np.inf * bool(square)


def is_noise(residuals: Array) -> bool:
    """Return True if consecutive residuals are not alike."""
    square = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) <= MAX_NOISE_CORRELATION * square


def _judge_explanation(problem: FitProblem, end: SearchResult) -> SearchResult:
    """Return an end with the status "limited" if it leaves most of the variation of the data."""
    share = _unexplained_share(problem, end.evaluation)
    is_poor = share > _MAX_ACCEPTED_SHARE and not is_noise(end.evaluation.residuals)
    if not (end.is_stalled or (end.status.success and is_poor)):
        return end
    amount = f"only {100.0 * (1.0 - share):.2g} % of the variation of the data"
    if share >= 1.0:
        amount = "the data less well than their mean does"
    verb = "converged"
    if end.is_stalled:
        verb = f"stopped without progress after {format_count(end.evaluations, 'evaluation')}"
    sentence = (
        f"{verb}, but the model explains {amount}; check signs, units and times of the data and "
        "start=, or start from other values"
    )
    return replace(end, status=Status("limited", sentence))


def _return_undetermined(problem: FitProblem, scaling: Scaling, end: SearchResult) -> SearchResult:
    """Return an end that is as close to the first values as its sum of squares permits.

    Steps of a search along directions without an effect are arbitrary. Projections onto these
    directions and Gauss-Newton steps of minimal length lead back to the point of the minimum that
    is closest in relative changes.
    """
    evaluation, evaluations = end.evaluation, end.evaluations
    free = ~end.at_bounds & ~np.isin(problem.variables, end.held)
    for _ in range(_MAX_RETURNS):
        x = scaling.variables(evaluation.values)
        jacobian = (evaluation.projected_jacobian * scaling.derivatives(x))[:, free]
        left, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
        is_determined = singular > _MIN_SINGULAR_RATIO * singular.max(initial=0.0)
        if is_determined.all():
            break
        # Dependent directions complete the determined ones, also if there are few data.
        directions = directions[is_determined]
        steps = (evaluation.residuals @ left[:, is_determined]) / singular[is_determined]
        change = (scaling.first - x)[free]
        change = change - directions.T @ (directions @ change + steps)
        if np.abs(change).max() <= _MIN_RETURN:
            increase = evaluation.chi_square - end.chi_square
            if increase > _MAX_RETURN_INCREASE * _variance(problem, end):
                break
            return replace(end, evaluation=evaluation, evaluations=evaluations)
        x[free] += change
        evaluations += 1
        try:
            evaluation = problem.evaluate(scaling.values(np.clip(x, *scaling.limits)))
        except (ValueError, ArithmeticError):
            # BeamdaeError, or an error of the model function.
            break
    return replace(end, evaluations=evaluations)


def _variance(problem: FitProblem, end: SearchResult) -> float:
    """Return the variance of the errors in units of the residuals."""
    if problem.data.is_sigma_known:
        return 1.0
    freedom = end.evaluation.count - len(problem.variables) - len(problem.coefficients)
    return end.chi_square / max(freedom, 1)


def _is_better(problem: FitProblem, end: SearchResult, other: SearchResult) -> bool:
    """Return True if the data prefer an end, or if it alone is a minimum without disadvantage."""
    gain = (other.chi_square - end.chi_square) / (_variance(problem, end) or 1.0)
    is_cleaner = end.status.success and not other.status.success
    return gain > 1.0 or (is_cleaner and gain >= -1.0)


def _find_runaways(problem: FitProblem, scaling: Scaling, end: SearchResult) -> Array:
    """Return True (K,) for parameters whose negligible effect makes their values arbitrary.

    Such a parameter has no bounds, doubling it changes the residuals by less than one standard
    deviation, and it is far from its first value or the search ended before a minimum.
    """
    first, values = scaling.values(scaling.first), end.evaluation.values
    sizes = np.maximum(np.abs(values), np.abs(first) * (not end.status.success))
    effects = np.sum((end.evaluation.projected_jacobian * sizes) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_far = np.abs(np.log(np.abs(values / first))) > _MIN_RUNAWAY
    is_weak = (effects < _variance(problem, end)) & np.isinf(scaling.limits[1]) & (first != 0.0)
    is_weak[len(problem.names) :] = False
    return np.asarray(is_weak & (is_far | (end.status.kind == "limited")))


def _find_rejected_values(problem: FitProblem, values: Array, failed: Array) -> dict[str, float]:
    """Return the failed values of the parameters that the model rejects, by name.

    Each parameter alone is set to its failed value.
    """
    rejected = {}
    for k, name in enumerate(problem.names):
        changed = values.copy()
        changed[k] = failed[k]
        if failed[k] != values[k] and not problem.accepts(changed):
            rejected[name] = float(failed[k])
    return rejected


def _judge_end(
    problem: FitProblem,
    end: Evaluation,
    residuals: Array,
    jacobian: Array,
    cause: str,
) -> Status:
    """Return the status of a search whose steps have become short.

    They also become short in front of values at which runs fail or columns jump: the `cause`.
    """
    freedom = max(end.count - jacobian.shape[1], 1)
    left = end.chi_square
    if left <= MIN_RELATIVE_RESIDUAL**2 * problem.weighted_square:
        return Status("ok", "converged")
    directions, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    largest = singular.max(initial=0.0)
    steps = (residuals @ directions)[singular > _MIN_SINGULAR_RATIO * largest]
    next_step = float(np.linalg.norm(steps)) / np.sqrt(left / freedom)
    if next_step <= _MAX_NEXT_STEP:
        return Status("ok", "converged")
    return Status(
        "limited",
        f"the search ended next to values at which {cause}, {next_step:.2g} standard deviations "
        "before a minimum",
    )


def _find_bounds_ahead(result: Any, lower: Array, upper: Array) -> Array:
    """Return True (k,) for variables near a bound whose own Gauss-Newton step ends beyond it.

    The search stays inside the bounds and may end at a distance from one that ends its progress.
    """
    curvature = np.sum(result.jac**2, axis=0)
    steps = np.divide(-result.grad, curvature, out=np.zeros_like(curvature), where=curvature > 0.0)
    below, above = result.x - lower, upper - result.x
    is_low = (below < _MAX_BOUND_DISTANCE) & (steps < -below)
    return np.asarray(is_low | ((above < _MAX_BOUND_DISTANCE) & (steps > above)))
