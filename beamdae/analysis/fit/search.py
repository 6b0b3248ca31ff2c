"""Local search of a fit: a trust-region method with exact Jacobians."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

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
# Residuals below this ratio to the data are rounding errors, whose next step is arbitrary.
MIN_RELATIVE_RESIDUAL = 1e-6
# Singular values below this ratio to the largest are rounding errors of the derivatives.
_MIN_SINGULAR_RATIO = 1e-9


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
    invalid
        Sentence on parameters whose values the model rejected during the search, or "".
    held
        Names of parameters that keep their first values, see `hold_runaways`.
    """

    evaluation: Evaluation
    evaluations: int
    status: Status
    at_bounds: Array
    invalid: str = ""
    held: tuple[str, ...] = ()

    @property
    def chi_square(self) -> float:
        """Sum of the squared residuals."""
        return float(self.evaluation.residuals @ self.evaluation.residuals)


def search(
    problem: FitProblem,
    scaling: Scaling,
    first: Array,
    max_evaluations: int,
    free: Array | None = None,
    check_start: Callable[[Evaluation], None] | None = None,
) -> SearchResult:
    """Minimize the sum of squares from the variables `first` (K,).

    Only the variables marked in `free` (K,) vary; None means all. Variables without any effect keep
    their first values. `check_start` is called with the first evaluation.

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
    best: tuple[float, Evaluation] | None = None
    accepted: tuple[bytes, Evaluation] | None = None
    latest: tuple[bytes, Evaluation] | None = None

    def evaluate(x: Array) -> Evaluation | None:
        nonlocal latest, best, evaluations, failed_values
        key = x.tobytes()
        for known in (latest, accepted):
            if known is not None and known[0] == key:
                return known[1]
        evaluations += 1
        whole = first.copy()
        whole[free] = x
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
            return None
        latest = key, evaluation
        chi_square = float(evaluation.residuals @ evaluation.residuals)
        if best is None or chi_square < best[0]:
            best = chi_square, evaluation
        return evaluation

    def residuals(x: Array) -> Array:
        evaluation = evaluate(x)
        if evaluation is None:
            return np.full(problem.data.count, np.nan)
        return evaluation.residuals / size

    def jacobian(x: Array) -> Array:
        nonlocal accepted
        evaluation = evaluate(x)
        assert evaluation is not None
        accepted = x.tobytes(), evaluation
        whole = first.copy()
        whole[free] = x
        return (evaluation.projected_jacobian * scaling.derivatives(whole))[:, free] / size

    begin = first[free]
    start = evaluate(begin)
    assert start is not None
    if not np.isfinite(start.residuals @ start.residuals):
        raise BeamdaeError(
            "fit: the first run has no finite sum of squared residuals; choose other first values "
            "in parameters, or check the data."
        )
    if check_start is not None:
        check_start(start)
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
    # The search must not depend on the units of the data.
    size = float(np.linalg.norm(start.residuals)) or 1.0
    try:
        # Kept within the bounds up to rounding, as the method requires.
        result = least_squares(
            residuals,
            np.clip(begin, lower, upper),
            jacobian,
            bounds=(lower, upper),
            x_scale="jac",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_ZERO_GRADIENT,
            max_nfev=max_evaluations,
        )
    except KeyboardInterrupt:
        assert best is not None
        reason = f"interrupted after {format_count(evaluations, 'evaluation')}"
        status = Status("interrupted", reason)
        partial = SearchResult(best[1], evaluations, status, at_bounds)
        raise Interrupted(reason, partial) from None
    last = evaluate(result.x)
    assert last is not None
    if np.any(last.projected_jacobian[:, given & ~free]) and max_evaluations > evaluations:
        # They have an effect elsewhere.
        again = search(
            problem, scaling, scaling.variables(last.values), max_evaluations - evaluations, given
        )
        return replace(again, evaluations=evaluations + again.evaluations)
    at_bounds[free] = result.active_mask != 0
    if result.success:
        at_bounds[free] |= _find_bounds_ahead(result, lower, upper)
        status = _judge_end(problem, last, result.jac[:, ~at_bounds[free]], failures)
    else:
        count = format_count(max_evaluations, "evaluation")
        sentence = f"stopped after {count}; increase max_evaluations="
        status = Status("limited", sentence)
    invalid = _name_invalid_values(problem, last.values, failed_values) if failures else ""
    if failures and not status.success:
        count = format_count(len(failures), "run")
        sentence = f"{status.sentence}; {count} failed, the last one: {failures[-1]}"
        status = Status(status.kind, sentence)
    return SearchResult(last, evaluations, status, at_bounds, invalid)


def hold_runaways(
    problem: FitProblem, scaling: Scaling, end: SearchResult, max_evaluations: int
) -> SearchResult:
    """Return the end of a search, repeated with the first values of parameters that ran away.

    The steps of parameters with a negligible effect are arbitrary. Such a parameter has no bounds,
    is far from its first value, and doubling it changes the residuals by less than one standard
    deviation. The result is `end` if there is none, or if the data prefer its value.

    Raises
    ------
    Interrupted
        See `search`.
    """
    evaluation, count = end.evaluation, len(problem.names)
    first, values = scaling.values(scaling.first), evaluation.values
    variance = 1.0
    if not problem.data.is_sigma_known:
        variance = end.chi_square / max(evaluation.residuals.size - len(values), 1)
    effects = np.sum((evaluation.projected_jacobian * values) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        is_far = np.abs(np.log(np.abs(values / first))) > _MIN_RUNAWAY
    is_runaway = is_far & (effects < variance) & np.isinf(scaling.limits[1]) & (first != 0.0)
    is_runaway[count:] = False
    remaining = max_evaluations - end.evaluations
    if remaining < 1 or not is_runaway.any():
        return end
    begin = np.where(is_runaway, scaling.first, scaling.variables(values))
    try:
        again = search(problem, scaling, begin, remaining, ~is_runaway)
    except BeamdaeError:
        return end
    if again.chi_square - end.chi_square > variance:
        return end
    names = tuple(np.array(problem.names)[is_runaway[:count]].tolist())
    return replace(again, evaluations=end.evaluations + again.evaluations, held=names)


def _name_invalid_values(problem: FitProblem, values: Array, failed: Array) -> str:
    """Return a sentence on the parameters whose failed values the model rejects, or "".

    Each parameter alone is set to its failed value.
    """
    sentences, bounds = [], []
    for k, name in enumerate(problem.names):
        changed = values.copy()
        changed[k] = failed[k]
        if failed[k] == values[k] or problem.accepts(changed):
            continue
        is_low = failed[k] < values[k]
        # Most domains end at zero.
        limit = 0.0 if failed[k] * values[k] <= 0.0 else values[k]
        sentences.append(f"{name} = {failed[k]:.4g}")
        ends = f"{limit:.4g}, upper" if is_low else f"lower, {limit:.4g}"
        bounds.append(f"{name!r}: ({ends})")
    if not bounds:
        return ""
    return (
        f"The model rejected {' and '.join(sentences)} during the search; pass "
        f"bounds={{{', '.join(bounds)}}}, because searches next to invalid values may end early or "
        "elsewhere."
    )


def _judge_end(
    problem: FitProblem, end: Evaluation, jacobian: Array, failures: Sequence[str]
) -> Status:
    """Return the status of a search whose steps have become short.

    They also become short in front of values at which runs fail or columns jump.
    """
    residuals = end.residuals
    freedom = max(residuals.size - jacobian.shape[1], 1)
    left = float(residuals @ residuals)
    if left <= MIN_RELATIVE_RESIDUAL**2 * problem.weighted_square:
        return Status("ok", "converged")
    directions, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    largest = singular.max(initial=0.0)
    steps = (residuals @ directions)[singular > _MIN_SINGULAR_RATIO * largest]
    next_step = float(np.linalg.norm(steps)) / np.sqrt(left / freedom)
    if next_step <= _MAX_NEXT_STEP:
        return Status("ok", "converged")
    cause = "runs fail" if failures else "the columns jump or have a kink"
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
