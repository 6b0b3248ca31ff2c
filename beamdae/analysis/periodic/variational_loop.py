"""Compiled loop of the variational equations: linearized Radau steps for disturbances.

The functions are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderBuffers, evaluate_jacobian_parts
from beamdae.integrators.radau.coefficients import (
    COMPLEX_EIGENVALUE,
    RATES,
    REAL_EIGENVALUE,
    T_INVERSE,
    TO_COMPLEX,
    T,
)
from beamdae.integrators.radau.stages import factorize_both
from beamdae.native.loop_functions import (
    combine,
    fill,
    max_norm,
    omit_refinement,
    scatter,
    solve,
    split_complex,
)
from beamdae.native.return_codes import DONE, NOT_CONVERGED, NOT_FINITE

Array = np.ndarray

_MAX_ITERATIONS = 30
# Error of the stages, relative to the disturbance at the start of the step.
_ITERATION_TOLERANCE = 1e-8
# The iteration stagnates at its rounding errors if a correction shrinks by less than this factor;
# corrections below this multiple of the tolerance are then accepted.
_STAGNATION_RATE = 0.5
_STAGNATION_FACTOR = 1e3
# Rate of convergence assumed in the first iteration; later iterations measure it.
_FIRST_RATE = 0.9


@dataclass(slots=True)
class VariationalWorkspace:
    """Work arrays of the variational equations for some steps of Radau IIA.

    Attributes
    ----------
    form
        Jacobians R_y and R_y' of the first-order form.
    real_solver, complex_solver
        Linear solvers of the decoupled stage equations; see `radau.coefficients`.
    times, y, yp
        Times [s], states and rates of the run at the stages, three rows per step.
    h
        Steps [s].
    branch
        A time inside the interval [s].
    disturbances
        Disturbances of y, one per row; replaced by those at the end of the steps.
    weights
        Reciprocal natural sizes of (q, v).
    jacobians
        Non-zeros of R_y, then of R_y', one row per stage.
    real_nonzeros, complex_nonzeros, entry_rows, entry_columns
        Non-zeros of the real and the complex matrix, and their rows and columns.
    w, stages, rates, residuals, product
        W, Y, Y' and residuals of the stages of one disturbance, and a work array.
    real_change, complex_change, complex_real, complex_imaginary
        Solutions of the decoupled equations.
    steps, next
        Number of steps, and index of the next step.
    count
        Number of disturbances.
    """

    form: FirstOrderBuffers
    real_solver: Any
    complex_solver: Any
    times: Array
    y: Array
    yp: Array
    h: Array
    disturbances: Array
    weights: Array
    jacobians: Array
    real_nonzeros: Array
    complex_nonzeros: Array
    entry_rows: Array
    entry_columns: Array
    w: Array
    stages: Array
    rates: Array
    residuals: Array
    product: Array
    real_change: Array
    complex_change: Array
    complex_real: Array
    complex_imaginary: Array
    branch: float = 0.0
    steps: int = 0
    next: int = 0
    count: int = 0


def propagate_disturbances(run: VariationalWorkspace) -> int:
    """Propagate the disturbances through the steps from `next` on; return the code."""
    while run.next < run.steps:
        code = _factorize_step(run)
        if code != DONE:
            return code
        for k in range(run.count):
            code = _propagate(run, run.h[run.next], run.disturbances[k])
            if code != DONE:
                return code
        run.next += 1
    return DONE


def _factorize_step(run: VariationalWorkspace) -> int:
    """Evaluate the Jacobians of a step and factorize both matrices at its second stage."""
    h, first = run.h[run.next], 3 * run.next
    for i in range(3):
        t, y, yp = run.times[first + i], run.y[first + i], run.yp[first + i]
        evaluate_jacobian_parts(run.form, t, run.branch, y, yp, run.jacobians[i])
    size = run.real_nonzeros.size
    parts = (run.jacobians[1, :size], run.jacobians[1, size:])
    combine(run.real_nonzeros, (1.0, REAL_EIGENVALUE / h), parts)
    combine(run.complex_nonzeros, (1.0, COMPLEX_EIGENVALUE / h), parts)
    code = factorize_both(run, True)
    if code == DONE:
        # The iteration of the stages is an iterative refinement itself.
        omit_refinement(run.real_solver)
        omit_refinement(run.complex_solver)
    return code


def _propagate(run: VariationalWorkspace, h: float, y: Array) -> int:
    """Replace the disturbance `y` by the one at the end of the step.

    The linear stage equations are solved by the simplified Newton iteration of `radau.stages`.
    """
    w, residuals, weights, nonzeros = run.w, run.residuals, run.weights, run.real_nonzeros.size
    limit = _ITERATION_TOLERANCE * max_norm(y[: weights.size], weights)
    if limit == 0.0:
        return DONE
    for i in range(3):
        fill(w[i], 0.0)
    previous, rate = math.inf, _FIRST_RATE
    for iteration in range(_MAX_ITERATIONS):
        for i in range(3):
            combine(run.stages[i], (1.0, T[i, 0], T[i, 1], T[i, 2]), (y, w[0], w[1], w[2]))
            by_y = run.jacobians[i, :nonzeros]
            scatter(residuals[i], run.entry_rows, by_y, run.stages[i], run.entry_columns)
            if iteration > 0:
                factors = (RATES[i, 0] / h, RATES[i, 1] / h, RATES[i, 2] / h)
                combine(run.rates[i], factors, (w[0], w[1], w[2]))
                by_rate = run.jacobians[i, nonzeros:]
                scatter(run.product, run.entry_rows, by_rate, run.rates[i], run.entry_columns)
                combine(residuals[i], (1.0, 1.0), (residuals[i], run.product))
        stage_residuals = (residuals[0], residuals[1], residuals[2])
        factors = (T_INVERSE[0, 0], T_INVERSE[0, 1], T_INVERSE[0, 2])
        combine(run.real_change, factors, stage_residuals)
        combine(run.complex_change, (TO_COMPLEX[0], TO_COMPLEX[1], TO_COMPLEX[2]), stage_residuals)
        solve(run.real_solver, run.real_change)
        solve(run.complex_solver, run.complex_change)
        split_complex(run.complex_real, run.complex_imaginary, run.complex_change)
        combine(w[0], (1.0, -1.0), (w[0], run.real_change))
        combine(w[1], (1.0, -1.0), (w[1], run.complex_real))
        combine(w[2], (1.0, -1.0), (w[2], run.complex_imaginary))
        size = max(
            max_norm(run.real_change[: weights.size], weights),
            max_norm(run.complex_real[: weights.size], weights),
            max_norm(run.complex_imaginary[: weights.size], weights),
        )
        if not math.isfinite(size):
            return NOT_FINITE
        if iteration > 0:
            rate = size / previous if previous > 0.0 else 0.0
        stagnates = rate > _STAGNATION_RATE and size <= _STAGNATION_FACTOR * limit
        if stagnates or (rate < 1.0 and size * rate <= limit * (1.0 - rate)):
            combine(y, (1.0, T[2, 0], T[2, 1], T[2, 2]), (y, w[0], w[1], w[2]))
            # The equations do not depend on the time integrals of the multipliers.
            fill(y[weights.size :], 0.0)
            return DONE
        previous = size
    return NOT_CONVERGED
