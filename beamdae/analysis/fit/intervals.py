"""Confidence intervals of a linearized fit within the bounds of its parameters."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq, lsq_linear

Array = np.ndarray

# Doublings of the half width for known other parameters until an interval counts as infinite.
_MAX_DOUBLINGS = 60
# Error of the limits, relative to the half width.
_TOLERANCE = 1e-6


def bounded_interval(
    jacobian: Array, residuals: Array, bounds: tuple[Array, Array], k: int, quantile: float
) -> tuple[float, float]:
    """Return the limits of the changes of variable k within bounds, about a minimum.

    A change t lies in the interval if the other variables can follow within their bounds so that

        |J x + r|^2 <= |r|^2 + quantile^2,    x_k = t,    lower <= x <= upper.

    This is the profile likelihood (Venzon & Moolgavkar, Appl. Stat. 37 (1988) 87,
    doi:10.2307/2347496) of the linearized problem. Without bounds, it is the interval of
    `quantile` standard deviations; an interval that reaches a bound of its variable ends there.

    Parameters
    ----------
    jacobian
        Derivatives J (N, k) of the residuals with respect to the variables.
    residuals
        Residuals r (N,) in standard deviations at the minimum.
    bounds
        Lower and upper bounds (k,) of the changes x, around zero; may be infinite.
    k
        Index of the variable.
    quantile
        Half width in standard deviations.
    """
    lengths = np.linalg.norm(jacobian, axis=0)
    lengths[lengths == 0.0] = 1.0
    others = np.arange(len(lengths)) != k
    whole = np.column_stack([jacobian / lengths, residuals])
    triangle: Array = np.linalg.qr(whole)[1]
    matrix, offset = triangle[:, :-1], triangle[:, -1]
    lower, upper = (limit * lengths for limit in bounds)
    # The ends of searches are at bounds up to rounding.
    lower, upper = np.minimum(lower, 0.0), np.maximum(upper, 0.0)
    is_open = others & (lower < upper)
    box = lower[is_open], upper[is_open]

    def excess(t: float) -> float:
        target = -(offset + matrix[:, k] * t)
        if is_open.any():
            target = target - matrix[:, is_open] @ (
                lsq_linear(matrix[:, is_open], target, box, method="bvls").x
            )
        return float(target @ target) - square

    square = float(offset @ offset) + quantile**2
    limits = []
    for side, bound in ((-1.0, -lower[k]), (1.0, upper[k])):
        inner, outer = 0.0, min(quantile, float(bound))
        for _ in range(_MAX_DOUBLINGS):
            if outer == bound or excess(side * outer) >= 0.0:
                break
            inner, outer = outer, min(2.0 * outer, float(bound))
        if excess(side * outer) < 0.0:
            outer = float(bound) if outer == bound else np.inf
        elif excess(side * inner) < 0.0:
            outer = side * brentq(excess, side * inner, side * outer, rtol=_TOLERANCE)
        limits.append(side * outer / lengths[k])
    return limits[0], limits[1]
