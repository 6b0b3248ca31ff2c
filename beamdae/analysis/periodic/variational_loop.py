"""Compiled loop of the variational equations: linearized Radau steps for disturbances.

The steps propagate a block of disturbances at a time, one per vector lane: factors and matrices
are read once per block. Vectors hold the first entry of all lanes, then the second one; indices
and `KinematicReduction` refer to such vectors.

The functions are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.formulations.first_order import FirstOrderBuffers, evaluate_jacobian_parts
from beamdae.equations.formulations.kinematic_reduction import KinematicReduction, reduce_unknowns
from beamdae.integrators.radau.coefficients import (
    COMPLEX_EIGENVALUE,
    REAL_EIGENVALUE,
    T_INVERSE,
    TO_COMPLEX,
    T,
)
from beamdae.integrators.radau.stages import (
    factorize_both,
    predict_stages,
    set_stages,
    subtract_corrections,
)
from beamdae.integrators.radau.workspace import StepSizeState
from beamdae.linear.lane_operations import LANES, multiply_rows
from beamdae.native.loop_functions import combine, fill, max_norm, solve_lanes
from beamdae.native.return_codes import DONE, NOT_CONVERGED, NOT_FINITE

Array = np.ndarray

_MAX_ITERATIONS = 20
# The iteration stagnates at its rounding errors if a correction shrinks by less than this factor;
# corrections below this multiple of the tolerance are then accepted.
_STAGNATION_RATE = 0.5
_STAGNATION_FACTOR = 1e3
# Rate of convergence assumed in the first iteration of a step; later iterations measure it.
_FIRST_RATE = 0.9
# Disturbances whose size is smaller have decayed; products with tolerances would underflow.
_MIN_SIZE = 1e-280


@dataclass(slots=True)
class VariationalWorkspace:
    """Work arrays of the variational equations for some steps of Radau IIA.

    Fields with names of `RadauWorkspace` are those of a block of disturbances; `yp` is zero.

    Attributes
    ----------
    form
        First-order form whose Jacobian has the parts of the reduced matrices, see
        `reduce_kinematics`.
    real_solver, complex_solver, reduction
        Linear solvers of the decoupled stage equations, see `radau.coefficients`; their unknowns
        and equations, with the indices of all lanes.
    step_size
        Its `last_step` is the last step [s], 0 before the first step.
    times, states, state_rates, h, branch
        Times [s], states and rates of the run at the stages, three rows per step; steps [s], and a
        time inside the interval [s].
    disturbances, ends, disturbances_w, ends_w
        Disturbances of y at the start and at the end of a step, one block per row, and W in the
        last and in the current step, three rows per block.
    scales, weights
        Reciprocal natural sizes of (q, v), and reciprocal errors of the stages of the block.
    jacobians, real_nonzeros, complex_nonzeros
        Parts of the reduced matrices, one row per stage, and non-zeros of both matrices.
    row_starts, entry_columns, entry_sources
        All parts side by side, by rows, as in `lane_operations.multiply_rows`: starts of the rows,
        columns, and indices of the entries in a row of `jacobians`.
    residuals, unknowns
        Reduced residuals of the stages, and factors of the parts: reduced stage, reduced rates, and
        accelerations.
    tolerance, rate
        Error of the stages, relative to the disturbance at the start of the step, and largest rate
        of convergence in the current step.
    steps, next, count
        Number of steps, index of the next step, and number of blocks.
    """

    form: FirstOrderBuffers
    real_solver: Any
    complex_solver: Any
    reduction: KinematicReduction
    step_size: StepSizeState
    times: Array
    states: Array
    state_rates: Array
    h: Array
    disturbances: Array
    ends: Array
    disturbances_w: Array
    ends_w: Array
    scales: Array
    weights: Array
    jacobians: Array
    real_nonzeros: Array
    complex_nonzeros: Array
    row_starts: Array
    entry_columns: Array
    entry_sources: Array
    y: Array
    yp: Array
    w: Array
    last_w: Array
    stages: Array
    rates: Array
    right: Array
    complex_right: Array
    extrapolation: Array
    velocities: Array
    real_change: Array
    complex_change: Array
    complex_real: Array
    complex_imaginary: Array
    residuals: Array
    unknowns: Array
    tolerance: float = 0.0
    rate: float = 0.0
    branch: float = 0.0
    steps: int = 0
    next: int = 0
    count: int = 0


def propagate_disturbances(run: VariationalWorkspace) -> int:
    """Propagate the disturbances through the steps from `next` on; return the code.

    A step that fails leaves the disturbances unchanged.
    """
    while run.next < run.steps:
        h = run.h[run.next]
        code = _factorize_step(run, h)
        if code != DONE:
            return code
        run.rate = 0.0
        for k in range(run.count):
            code = _propagate(run, h, k)
            if code != DONE:
                return code
        for k in range(run.count):
            combine(run.disturbances[k], (1.0,), (run.ends[k],))
            for i in range(3):
                combine(run.disturbances_w[3 * k + i], (1.0,), (run.ends_w[3 * k + i],))
        run.step_size.last_step = h
        run.next += 1
    return DONE


def _factorize_step(run: VariationalWorkspace, h: float) -> int:
    """Evaluate the Jacobians of a step and factorize both matrices at its second stage."""
    first, size = 3 * run.next, run.real_nonzeros.size
    for i in range(3):
        t, y, yp = run.times[first + i], run.states[first + i], run.state_rates[first + i]
        evaluate_jacobian_parts(run.form, t, run.branch, y, yp, run.jacobians[i])
    middle = run.jacobians[1]
    parts = (middle[:size], middle[size : 2 * size], middle[2 * size : 3 * size])
    rate, complex_rate = REAL_EIGENVALUE / h, COMPLEX_EIGENVALUE / h
    combine(run.real_nonzeros, (1.0, rate, rate * rate), parts)
    combine(run.complex_nonzeros, (1.0, complex_rate, complex_rate * complex_rate), parts)
    return factorize_both(run)


def _propagate(run: VariationalWorkspace, h: float, k: int) -> int:
    """Write block `k` of the disturbances at the end of the step to `ends`.

    The linear stage equations are solved by the simplified Newton iteration of `radau.stages`. It
    begins with the extrapolation of the last step.
    """
    w, weights, residuals = run.w, run.weights, run.residuals
    combine(run.y, (1.0,), (run.disturbances[k],))
    for i in range(3):
        combine(run.last_w[i], (1.0,), (run.disturbances_w[3 * k + i],))
    predict_stages(run, h)
    _set_weights(run)
    # All disturbances have the same iteration matrix.
    previous, rate = math.inf, (run.rate if run.rate > 0.0 else _FIRST_RATE)
    for iteration in range(_MAX_ITERATIONS):
        set_stages(run, h)
        for i in range(3):
            _multiply_parts(run, i)
        stage_residuals = (residuals[0], residuals[1], residuals[2])
        factors = (T_INVERSE[0, 0], T_INVERSE[0, 1], T_INVERSE[0, 2])
        combine(run.right, factors, stage_residuals)
        complex_factors = (TO_COMPLEX[0], TO_COMPLEX[1], TO_COMPLEX[2])
        combine(run.complex_right, complex_factors, stage_residuals)
        solve_lanes(run.real_solver, run.right)
        solve_lanes(run.complex_solver, run.complex_right)
        subtract_corrections(run, h)
        size = max(
            max_norm(run.real_change[: weights.size], weights),
            max_norm(run.complex_real[: weights.size], weights),
            max_norm(run.complex_imaginary[: weights.size], weights),
        )
        if not math.isfinite(size):
            return NOT_FINITE
        if iteration > 0:
            rate = size / previous if previous > 0.0 else 0.0
        stagnates = rate > _STAGNATION_RATE and size <= _STAGNATION_FACTOR
        if stagnates or (rate < 1.0 and size * rate <= 1.0 - rate):
            if iteration > 0:
                run.rate = max(run.rate, rate)
            combine(run.ends[k], (1.0, T[2, 0], T[2, 1], T[2, 2]), (run.y, w[0], w[1], w[2]))
            # The equations do not depend on the time integrals of the multipliers.
            fill(run.ends[k, weights.size :], 0.0)
            for i in range(3):
                combine(run.ends_w[3 * k + i], (1.0,), (w[i],))
            return DONE
        previous = size
    return NOT_CONVERGED


def _set_weights(run: VariationalWorkspace) -> None:
    """Set the weights in which errors of the stages are at most 1 in each lane.

    They are relative to the disturbance of the lane, which is zero in lanes without one.
    """
    for lane in range(LANES):
        size = run.tolerance * max_norm(run.y[lane : run.weights.size : LANES], run.scales)
        factor = 1.0 / size if size > _MIN_SIZE else 0.0
        combine(run.weights[lane::LANES], (factor,), (run.scales,))


def _multiply_parts(run: VariationalWorkspace, i: int) -> None:
    """Set the residual of stage `i` to the sum of all parts times their unknowns.

    The parts act on the stage, on its rates, and on accelerations; q' = v holds for defined
    velocities.
    """
    at, n, size, unknowns = run.reduction, run.velocities.size, run.right.size, run.unknowns
    reduce_unknowns(at, n, run.stages[i], unknowns[:size])
    reduce_unknowns(at, n, run.rates[i], unknowns[size : 2 * size])
    combine(unknowns[2 * size :], (1.0,), (run.rates[i, n : 2 * n],))
    starts, columns, sources = run.row_starts, run.entry_columns, run.entry_sources
    multiply_rows(run.residuals[i], starts, columns, run.jacobians[i], sources, unknowns)
