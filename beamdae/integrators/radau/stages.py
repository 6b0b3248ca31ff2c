"""Stages of three-stage Radau IIA: simplified Newton iteration and error estimate.

A step h from (t, y) solves R(t + c_i h, Y_i, Y'_i) = 0 with Y_i = y + h sum_j a_ij Y'_j and ends at
Y_3; see `coefficients`. The functions are plain Python over arrays; `native.loops` compiles them if
possible.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import evaluate_jacobian_parts, evaluate_residual
from beamdae.equations.formulations.kinematic_reduction import (
    expand_solution,
    reduce_right,
    reduce_unknowns,
)
from beamdae.integrators.radau.coefficients import (
    COMPLEX_EIGENVALUE,
    EMBEDDED,
    POLYNOMIAL,
    RATE_BLOCKS,
    RATES,
    REAL_EIGENVALUE,
    START,
    T_INVERSE,
    TO_COMPLEX,
    UNIFORM,
    C,
    T,
)
from beamdae.integrators.radau.workspace import RadauWorkspace
from beamdae.native.loop_functions import (
    combine,
    factorize,
    fill,
    max_norm,
    minimum,
    pick,
    scatter,
    scatter_magnitudes,
    solve,
    split_complex,
)
from beamdae.native.return_codes import DONE, NEW_PIVOTS, NOT_CONVERGED, NOT_FINITE, SINGULAR

Array = np.ndarray

MAX_ITERATIONS = 10
# Rate of convergence assumed in the first iteration; later iterations measure it.
FIRST_RATE = 0.99
# The iteration continues if the second correction grows by less than this factor: the first, linear
# correction stretches a rotating beam, and the second correction removes the stretch.
_MAX_SECOND_GROWTH = 2.0

# The iteration stagnates at its rounding errors if a correction shrinks by less than this factor.
_STAGNATION_RATE = 0.5
# Relative rounding error of positions in the residual, two units in the last place. Corrections of
# strips of 0.1 and 1 mm stagnated at 0.004 to 0.5 of the estimate.
_POSITION_ROUNDING = 2.0**-51


def solve_stages(run: RadauWorkspace, h: float, renew: bool) -> int:
    """Solve for the stages of a step `h` [s]; `renew` requests new factors. Return the code."""
    predict_stages(run, h)
    set_stages(run, h)
    velocities = run.iteration_weights[run.form.n :]
    h_rounding = h / run.rounding_ratio
    minimum(velocities, run.velocity_weights, h_rounding, run.velocity_rounding_weights)
    if renew:
        code = factorize_matrices(run, h)
        if code != DONE:
            return code
    return _iterate_newton(run, h)


def predict_stages(run: Any, h: float) -> None:
    """Predict W from the last collocation polynomial, or with constant y' in a first step.

    Where no correction by joints enters q' = v, velocities are derivatives of predicted positions.
    """
    w, last_w, extrapolation = run.w, run.last_w, run.extrapolation
    if run.step_size.last_step == 0.0:
        for i in range(3):
            combine(w[i], (h * UNIFORM[i],), (run.yp,))
        derive_velocities(run, h)
        return
    for i in range(3):
        for j in range(3):
            extrapolation[i, j] = 0.0
    for k in range(3):
        x = 1.0 + C[k] * (h / run.step_size.last_step)
        for j in range(3):
            stage = (x - 1.0) * POLYNOMIAL[0, j] + (x * x - 1.0) * POLYNOMIAL[1, j]
            stage += (x * x * x - 1.0) * POLYNOMIAL[2, j]
            for i in range(3):
                extrapolation[i, j] += T_INVERSE[i, k] * stage
    for i in range(3):
        factors = (extrapolation[i, 0], extrapolation[i, 1], extrapolation[i, 2])
        combine(w[i], factors, (last_w[0], last_w[1], last_w[2]))
    derive_velocities(run, h)


def derive_velocities(run: Any, h: float) -> None:
    """Set the defined velocities of the stages to the derivatives of their positions."""
    n, w, at = run.velocities.size, run.w, run.reduction
    known = (w[0][:n], w[1][:n], w[2][:n], run.y[n : 2 * n])
    for i in range(3):
        factors = (RATE_BLOCKS[i, 0] / h, RATE_BLOCKS[i, 1] / h, RATE_BLOCKS[i, 2] / h, -START[i])
        combine(run.velocities, factors, known)
        pick(w[i], at.defined_velocities, run.velocities, at.defined, 0, at.defined.size)


def set_stages(run: Any, h: float) -> None:
    """Compute the stages Y and Y' from W."""
    w = run.w
    for i in range(3):
        combine(run.stages[i], (1.0, T[i, 0], T[i, 1], T[i, 2]), (run.y, w[0], w[1], w[2]))
        factors = (RATES[i, 0] / h, RATES[i, 1] / h, RATES[i, 2] / h)
        combine(run.rates[i], factors, (w[0], w[1], w[2]))


def factorize_matrices(run: RadauWorkspace, h: float) -> int:
    """Factorize both matrices at the second stage, which lies between the other two.

    If they succeed, the factors are those of `h`.
    """
    _evaluate_matrices(run, h)
    code = factorize_both(run)
    if code != NEW_PIVOTS:
        run.jacobians += 1
    if code == DONE:
        run.factors_step = h
    return code


def factorize_both(run: Any) -> int:
    """Factorize the real and the complex matrix; return DONE, NEW_PIVOTS or SINGULAR.

    `run` has the solvers and non-zeros of both, as a `RadauWorkspace`.
    """
    real_code = factorize(run.real_solver, run.real_nonzeros)
    complex_code = factorize(run.complex_solver, run.complex_nonzeros)
    if real_code == NEW_PIVOTS or complex_code == NEW_PIVOTS:
        return NEW_PIVOTS
    run.real_solver.singular = 0
    run.complex_solver.singular = 0
    if real_code == SINGULAR or complex_code == SINGULAR:
        return SINGULAR
    return DONE


def _evaluate_matrices(run: RadauWorkspace, h: float) -> None:
    """Evaluate the non-zeros of both matrices at the second stage."""
    form, t, y, yp = run.form, run.t + C[1] * h, run.stages[1], run.rates[1]
    run.factors_step = 0.0
    evaluate_jacobian_parts(form, t, run.branch, y, yp, run.jacobian)
    parts = (_jacobian_part(run, 0), _jacobian_part(run, 1), _jacobian_part(run, 2))
    rate, complex_rate = REAL_EIGENVALUE / h, COMPLEX_EIGENVALUE / h
    combine(run.real_nonzeros, (1.0, rate, rate * rate), parts)
    combine(run.complex_nonzeros, (1.0, complex_rate, complex_rate * complex_rate), parts)


def _jacobian_part(run: RadauWorkspace, power: int) -> Array:
    """Return the part of the reduced matrix that is multiplied by this power of the rate."""
    size = run.real_nonzeros.size
    return run.jacobian[power * size : (power + 1) * size]


def _iterate_newton(run: RadauWorkspace, h: float) -> int:
    residuals, weights = run.stage_residuals, run.iteration_weights
    previous, rate, last_rate = math.inf, FIRST_RATE, 0.0
    for k in range(MAX_ITERATIONS):
        run.iterations = k + 1
        if k > 0:
            set_stages(run, h)
        for i in range(3):
            t = run.t + C[i] * h
            evaluate_residual(run.form, t, run.branch, run.stages[i], run.rates[i], residuals[i])
        run.residuals += 3
        correct_stages(run, h)
        real_size = max_norm(run.real_change[: weights.size], weights)
        complex_size = max_norm(run.complex_change[: weights.size], weights)
        if not (math.isfinite(real_size) and math.isfinite(complex_size)):
            return NOT_FINITE
        size = max(real_size, complex_size)
        if k > 0:
            rate = size / previous if previous > 0.0 else 0.0
            if rate > _STAGNATION_RATE:
                is_rounding = _is_rounding(run, h, size)
                if is_rounding or size <= run.stagnation_limit:
                    # Rounding errors do not indicate how fast the iteration converged.
                    run.rate = last_rate if is_rounding else rate
                    return DONE
            if rate > (_MAX_SECOND_GROWTH if k == 1 else 1.0):
                break
        if rate < 1.0 and size * rate <= 1.0 - rate:
            run.rate = rate if k > 0 else 0.0
            return DONE
        if k > 0:
            last_rate = rate
        previous = size
    return NOT_CONVERGED


def _is_rounding(run: RadauWorkspace, h: float, size: float) -> bool:
    """Return True if rounding errors of the residual explain corrections of a weighted size.

    Rounding errors eps |q| of positions cause errors of up to eps |R_q| |q| of the residual R. In a
    thin beam, these errors of axial and shear forces are large compared with the bending stiffness.
    The resulting corrections of velocities are those of positions divided by the step, so that a
    shorter step does not reduce them. Corrections of positions above `stagnation_limit` are not
    accepted.
    """
    n, at, weights, vector = run.form.n, run.reduction, run.iteration_weights, run.vector
    positions = weights[:n]
    real_size = max_norm(run.real_change[:n], positions)
    if max(real_size, max_norm(run.complex_change[:n], positions)) > run.stagnation_limit:
        return False
    fill(vector, 0.0)
    combine(vector[:n], (_POSITION_ROUNDING,), (run.stages[1][:n],))
    rows, columns = run.entry_rows, run.entry_columns
    scatter_magnitudes(run.right, rows, _jacobian_part(run, 0), vector, columns)
    solve(run.real_solver, run.right)
    expand_solution(at, n, REAL_EIGENVALUE / h, run.right, run.error)
    return size <= max_norm(run.error[: weights.size], weights)


def correct_stages(run: RadauWorkspace, h: float) -> None:
    """Subtract the corrections from W that belong to `run.stage_residuals`.

    Rows q' = v must hold already.
    """
    at, n, residuals = run.reduction, run.form.n, run.stage_residuals
    factors = (T_INVERSE[0, 0], T_INVERSE[0, 1], T_INVERSE[0, 2])
    stage_residuals = (residuals[0], residuals[1], residuals[2])
    combine(run.real_change, factors, stage_residuals)
    combine(run.complex_change, (TO_COMPLEX[0], TO_COMPLEX[1], TO_COMPLEX[2]), stage_residuals)
    reduce_right(at, n, run.real_change, run.right)
    reduce_right(at, n, run.complex_change, run.complex_right)
    solve(run.real_solver, run.right)
    solve(run.complex_solver, run.complex_right)
    subtract_corrections(run, h)


def subtract_corrections(run: Any, h: float) -> None:
    """Subtract the corrections from W that belong to solutions of the reduced equations.

    `run` has the attributes of a `RadauWorkspace`; `run.right` and `run.complex_right` are the
    solutions.
    """
    at, n, w = run.reduction, run.velocities.size, run.w
    expand_solution(at, n, REAL_EIGENVALUE / h, run.right, run.real_change)
    expand_solution(at, n, COMPLEX_EIGENVALUE / h, run.complex_right, run.complex_change)
    split_complex(run.complex_real, run.complex_imaginary, run.complex_change)
    combine(w[0], (1.0, -1.0), (w[0], run.real_change))
    combine(w[1], (1.0, -1.0), (w[1], run.complex_real))
    combine(w[2], (1.0, -1.0), (w[2], run.complex_imaginary))


def estimate_error(run: RadauWorkspace, h: float) -> None:
    """Write the error estimate, filtered to damp stiff components, to `run.error`.

    With y^ = y_n + h (y'_n / gamma + sum_i b^_i Y'_i), of order 3, and e = y^ - y_{n+1}, the filter
    (R_y + (gamma/h) R_y') x = (gamma/h) R_y' e passes slow components and damps fast ones. For
    R = M y' - f(y), this is the estimate of RADAU5. Constraints do not contain y', so their rows of
    R_y' e are zero. In these rows, the right-hand side is R_y e: the error of the prescribed
    motion, which is the only error if all motions are prescribed. Multipliers enter R by their
    derivatives, in the same columns of both matrices, so that their errors do not affect other
    components.
    """
    w, error, difference, n = run.w, run.error, run.difference, run.form.n
    at, rows, columns, rate = run.reduction, run.entry_rows, run.entry_columns, REAL_EIGENVALUE / h
    velocities, right, vector, product = run.velocities, run.right, run.vector, run.product
    combine(
        difference, (1.0 / rate, EMBEDDED[0], EMBEDDED[1], EMBEDDED[2]), (run.yp, w[0], w[1], w[2])
    )
    # In rows q' = v, the right-hand side is rate * e_q. The reduced equations require zeros there:
    # x_v + rate * e_q replaces x_v, and e_v + rate * e_q replaces e_v in the other rows.
    combine(velocities, (1.0, rate), (difference[n : 2 * n], difference[:n]))
    fill(vector, 0.0)
    combine(vector[:n], (1.0,), (velocities,))
    # The parts of R_y in the rows of constraints, and of (gamma/h) R_y' in the others.
    scatter(right, rows, _jacobian_part(run, 2), vector, columns)
    scatter(run.constraint_errors, rows, _jacobian_part(run, 1), vector, columns)
    reduce_unknowns(at, n, difference, vector)
    scatter(product, rows, _jacobian_part(run, 1), vector, columns)
    combine(right, (rate, rate), (right, product))
    scatter(product, rows, _jacobian_part(run, 0), vector, columns)
    first = n + at.corrected.size
    combine(right[first:], (1.0, 1.0), (run.constraint_errors[first:], product[first:]))
    solve(run.real_solver, right)
    expand_solution(at, n, rate, right, error)
    combine(velocities, (rate, -rate), (right[:n], difference[:n]))
    pick(error, at.defined_velocities, velocities, at.defined, 0, at.defined.size)
