"""The stages of three-stage Radau IIA: their simplified Newton iteration and their error estimate.

A step h from (t, y) seeks Y_i with R(t + c_i h, Y_i, Y'_i) = 0, Y_i = y + h sum_j a_ij Y'_j, and
ends at Y_3, see `radau_coefficients`. Plain Python over arrays: `native.loops` compiles it, and
where that cannot be had it runs as it is.
"""

from __future__ import annotations

import math

import numpy as np

from beamdae.equations.formulations.first_order import evaluate_jacobian_parts, evaluate_residual
from beamdae.integrators.radau.coefficients import (
    COMPLEX_EIGENVALUE,
    EMBEDDED,
    POLYNOMIAL,
    RATES,
    REAL_EIGENVALUE,
    T_INVERSE,
    TO_PAIR,
    UNIFORM,
    C,
    T,
)
from beamdae.integrators.radau.workspace import NOT_CONVERGED, NOT_FINITE, RadauWorkspace
from beamdae.native.loop_functions import (
    combine,
    factorize,
    max_norm,
    minimum,
    scatter,
    solve,
    split_complex,
)
from beamdae.native.return_codes import DONE, NEW_PIVOTS, SINGULAR

Array = np.ndarray

MAX_ITERATIONS = 10
# Of the first change; the next one tells.
FIRST_RATE = 0.99
# The second change may be as large as the first: a linear step stretches a beam that rotates, and
# the next one takes that back.
_MAX_SECOND_GROWTH = 2.0


def solve_stages(run: RadauWorkspace, h: float, renew: bool) -> int:
    """Seek the stages of a step, with new factors or with those there are."""
    _predict_stages(run, h)
    set_stages(run, h)
    velocities = run.bounds[run.form.n :]
    minimum(velocities, run.velocity_bounds, h, run.velocity_rounding)
    if renew:
        code = _factorize_matrices(run, h)
        if code != DONE:
            return code
    return _iterate_newton(run, h)


def _predict_stages(run: RadauWorkspace, h: float) -> None:
    """Extrapolate the collocation polynomial of the step before, or y'."""
    w, before, ahead = run.w, run.before, run.ahead
    if run.size.before == 0.0:
        for i in range(3):
            combine(w[i], (h * UNIFORM[i],), (run.yp,))
        return
    for i in range(3):
        for j in range(3):
            ahead[i, j] = 0.0
    for k in range(3):
        x = 1.0 + C[k] * (h / run.size.before)
        for j in range(3):
            there = (x - 1.0) * POLYNOMIAL[0, j] + (x * x - 1.0) * POLYNOMIAL[1, j]
            there += (x * x * x - 1.0) * POLYNOMIAL[2, j]
            for i in range(3):
                ahead[i, j] += T_INVERSE[i, k] * there
    for i in range(3):
        factors = (ahead[i, 0], ahead[i, 1], ahead[i, 2])
        combine(w[i], factors, (before[0], before[1], before[2]))


def set_stages(run: RadauWorkspace, h: float) -> None:
    """Y and Y' of W."""
    w = run.w
    for i in range(3):
        combine(run.stages[i], (1.0, T[i, 0], T[i, 1], T[i, 2]), (run.y, w[0], w[1], w[2]))
        factors = (RATES[i, 0] / h, RATES[i, 1] / h, RATES[i, 2] / h)
        combine(run.rates[i], factors, (w[0], w[1], w[2]))


def _factorize_matrices(run: RadauWorkspace, h: float) -> int:
    """Factorize at the second stage: no other is as near to all three."""
    form, t, y, yp = run.form, run.t + C[1] * h, run.stages[1], run.rates[1]
    apart = (_state_jacobian(run), _rate_jacobian(run))
    run.factorized = 0.0
    evaluate_jacobian_parts(form, t, run.branch, y, yp, run.jacobian)
    combine(run.real_nonzeros, (1.0, REAL_EIGENVALUE / h), apart)
    combine(run.pair_nonzeros, (1.0, COMPLEX_EIGENVALUE / h), apart)
    real = factorize(run.real, run.real_nonzeros)
    pair = factorize(run.pair, run.pair_nonzeros)
    if real == NEW_PIVOTS or pair == NEW_PIVOTS:
        return NEW_PIVOTS
    run.jacobians += 1
    run.real.singular = 0
    run.pair.singular = 0
    if real == SINGULAR or pair == SINGULAR:
        return SINGULAR
    run.factorized = h
    return DONE


def _state_jacobian(run: RadauWorkspace) -> Array:
    """The non-zeros of R_y at the factors."""
    return run.jacobian[: run.real_nonzeros.size]


def _rate_jacobian(run: RadauWorkspace) -> Array:
    """The non-zeros of R_y' at the factors."""
    return run.jacobian[run.real_nonzeros.size :]


def _iterate_newton(run: RadauWorkspace, h: float) -> int:
    w, at, bounded = run.w, run.residuals_at, run.bounds.size
    change, pair = run.change, run.pair_change
    previous, rate = math.inf, FIRST_RATE
    for k in range(MAX_ITERATIONS):
        run.iterations = k + 1
        if k > 0:
            set_stages(run, h)
        for i in range(3):
            t = run.t + C[i] * h
            evaluate_residual(run.form, t, run.branch, run.stages[i], run.rates[i], at[i])
        run.residuals += 3
        factors = (T_INVERSE[0, 0], T_INVERSE[0, 1], T_INVERSE[0, 2])
        combine(change, factors, (at[0], at[1], at[2]))
        combine(pair, (TO_PAIR[0], TO_PAIR[1], TO_PAIR[2]), (at[0], at[1], at[2]))
        solve(run.real, change)
        solve(run.pair, pair)
        split_complex(run.pair_real, run.pair_imaginary, pair)
        combine(w[0], (1.0, -1.0), (w[0], change))
        combine(w[1], (1.0, -1.0), (w[1], run.pair_real))
        combine(w[2], (1.0, -1.0), (w[2], run.pair_imaginary))
        own, others = max_norm(change[:bounded], run.bounds), max_norm(pair[:bounded], run.bounds)
        if not (math.isfinite(own) and math.isfinite(others)):
            return NOT_FINITE
        moved = max(own, others)
        if k > 0:
            rate = moved / previous if previous > 0.0 else 0.0
            if rate > (_MAX_SECOND_GROWTH if k == 1 else 1.0):
                break
        if rate < 1.0 and moved * rate <= 1.0 - rate:
            run.rate = rate if k > 0 else 0.0
            return DONE
        previous = moved
    return NOT_CONVERGED


def estimate_error(run: RadauWorkspace, h: float) -> None:
    """Error of an embedded method of order 3, without what is stiff in it.

    y^ = y_n + h (y'_n / gamma + sum_i b^_i Y'_i), and of e = y^ - y_{n+1} the filter
    (R_y + (gamma/h) R_y') x = (gamma/h) R_y' e passes what is slow and damps what is fast. For
    R = M y' - f(y) this is the estimate of RADAU5. In constraints, without y', it would leave
    nothing: there the right-hand side is R_y e, the error of what the joints prescribe, which
    is all there is of a motion that drivers force. Multipliers enter R by their derivatives,
    in the same columns of both matrices: their errors stay in their own components.
    """
    w, error, right, n = run.w, run.error, run.right, run.form.n
    factors = (h / REAL_EIGENVALUE, EMBEDDED[0], EMBEDDED[1], EMBEDDED[2])
    combine(right, factors, (run.yp, w[0], w[1], w[2]))
    scatter(error, run.of_row, _rate_jacobian(run), right, run.of_column)
    combine(error, (REAL_EIGENVALUE / h,), (error,))
    scatter(run.change, run.of_row, _state_jacobian(run), right, run.of_column)
    combine(error[2 * n :], (1.0,), (run.change[2 * n :],))
    solve(run.real, error)
