"""Local search of a fit: a trust-region method with exact Jacobians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from beamdae.analysis.fit.problem import Evaluation, FitProblem, Scaling
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Relative changes of the sum of squares and of the parameters at which a fit has converged.
_TOLERANCE = 1e-8
# Distance from a bound, in first values or logarithms, at which an estimate may be at the bound.
_MAX_BOUND_DISTANCE = 1e-2


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a local search.

    Attributes
    ----------
    evaluation
        The runs and residuals at the last values.
    evaluations
        Number of evaluations, each with one run with derivatives per experiment.
    converged
        True if the search converged.
    reason
        Reason for the end of the search.
    at_bounds
        True (K,) for variables at a bound.
    """

    evaluation: Evaluation
    evaluations: int
    converged: bool
    reason: str
    at_bounds: Array

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
) -> SearchResult:
    """Minimize the sum of squares from the variables `first` (K,).

    Only the variables marked in `free` (K,) vary; None means all.

    Raises
    ------
    BeamdaeError
        If the first run fails or its residuals are not finite.
    """
    free = np.ones(len(first), bool) if free is None else free
    evaluations = 0
    accepted: tuple[bytes, Evaluation] | None = None
    latest: tuple[bytes, Evaluation] | None = None

    def evaluate(x: Array) -> Evaluation | None:
        nonlocal latest, evaluations
        key = x.tobytes()
        for known in (latest, accepted):
            if known is not None and known[0] == key:
                return known[1]
        evaluations += 1
        whole = first.copy()
        whole[free] = x
        try:
            evaluation = problem.evaluate(scaling.values(whole))
        except (ValueError, ArithmeticError):
            # BeamdaeError, or an error of the model function at extreme values.
            if accepted is None:
                raise
            # The search continues with a shorter step.
            return None
        latest = key, evaluation
        return evaluation

    def residuals(x: Array) -> Array:
        evaluation = evaluate(x)
        return np.full(problem.data.count, np.nan) if evaluation is None else evaluation.residuals

    def jacobian(x: Array) -> Array:
        nonlocal accepted
        evaluation = evaluate(x)
        assert evaluation is not None
        accepted = x.tobytes(), evaluation
        whole = first.copy()
        whole[free] = x
        return (evaluation.projected_jacobian * scaling.derivatives(whole))[:, free]

    begin = first[free]
    start = evaluate(begin)
    assert start is not None
    if not np.isfinite(start.residuals @ start.residuals):
        raise BeamdaeError(
            "fit: the first run has no finite sum of squared residuals; choose other first values "
            "in parameters, or check the data."
        )
    if not free.any():
        return SearchResult(start, 1, True, "all parameters are fixed", np.zeros(len(first), bool))
    lower, upper = (limit[free] for limit in scaling.limits)
    # Kept within the bounds up to rounding, as the method requires.
    result = least_squares(
        residuals,
        np.clip(begin, lower, upper),
        jacobian,
        bounds=(lower, upper),
        x_scale="jac",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=max_evaluations,
    )
    last = evaluate(result.x)
    assert last is not None
    at_bounds = np.zeros(len(first), bool)
    at_bounds[free] = result.active_mask != 0
    if result.success:
        at_bounds[free] |= _find_bounds_ahead(result, lower, upper)
    reason = str(result.message).rstrip(".")
    return SearchResult(last, evaluations, bool(result.success), reason, at_bounds)


def _find_bounds_ahead(result: Any, lower: Array, upper: Array) -> Array:
    """Return True (k,) for variables near a bound whose own Gauss-Newton step ends beyond it.

    The search stays inside the bounds and may end at a distance from one that ends its progress.
    """
    curvature = np.sum(result.jac**2, axis=0)
    steps = np.divide(-result.grad, curvature, out=np.zeros_like(curvature), where=curvature > 0.0)
    below, above = result.x - lower, upper - result.x
    is_low = (below < _MAX_BOUND_DISTANCE) & (steps < -below)
    return np.asarray(is_low | ((above < _MAX_BOUND_DISTANCE) & (steps > above)))
