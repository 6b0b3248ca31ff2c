"""Backward sweep over the steps of a Radau run: the transpose of `radau_replay`.

The loop is plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.gradients.weighted_residuals import (
    WeightedResidual,
    add_numbers,
    prepare_weights,
    weigh_residual,
)
from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.analysis.sensitivities.radau_replay import plan_stage_residual
from beamdae.analysis.sensitivities.radau_steps import (
    MAX_ITERATIONS,
    ROUNDING,
    STAGNATION_RATE,
    TOLERANCE,
    RadauSteps,
    StageMatrices,
    restore_stages,
)
from beamdae.analysis.sensitivities.recorded_maps import Gradient
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.kinematic_reduction import KinematicReduction
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.radau.coefficients import (
    COMPLEX_EIGENVALUE,
    RATES,
    REAL_EIGENVALUE,
    T_INVERSE,
    C,
    T,
)
from beamdae.integrators.radau.stages import factorize_both
from beamdae.integrators.radau.stepper import STABILIZED_FORM
from beamdae.native.loop_functions import (
    combine,
    fill,
    max_norm,
    pick,
    solve,
    split_complex,
)
from beamdae.native.return_codes import DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sparse_operators import transpose_pattern

Array = np.ndarray

# Smaller weights have no relative accuracy; those of damped motions decay to it.
_UNDERFLOW = float(np.finfo(float).tiny / np.finfo(float).eps)
_PROBLEMS = {
    NOT_CONVERGED: "the transposed equations of the stages do not converge",
    NOT_FINITE: "the derivatives are not finite",
    SINGULAR: "the matrix is singular",
}


@dataclass(slots=True, kw_only=True)
class RadauAdjoint(RadauSteps):
    """Work arrays of `sweep_backwards`.

    Attributes
    ----------
    real_solver, real_nonzeros, complex_solver, complex_nonzeros
        Linear solvers of the transposed Newton matrices, and their non-zeros.
    entries, transposed_entries
        Indices of the non-zeros of the Newton matrices, and their positions in the transposes.
    residual
        Gradient of the weighted residual of a stage; its motion is (y, y').
    seeds
        Derivatives of the objective with respect to (q, v, lam) at the start and all stages,
        (3 steps + 1, 2n + m).
    y
        Derivatives with respect to y at the end of the current step, as far as it acts through
        later steps.
    weights
        Weights of the residuals of the stages, (3, size).
    by_stages, by_rates
        Derivatives of the weighted residuals with respect to Y and Y', (3, size).
    by_w, total
        Derivatives of the objective with respect to W, alone and with the weighted residuals,
        (3, size).
    complex_total, velocities, complex_velocities
        Work arrays of the transposed reduction.
    right, complex_right, real_part, imaginary_part
        Right-hand sides and solutions of the transposed reduced equations.
    change, full_change
        Correction of the weights of one stage.
    sizes
        Largest corrections and weights of the equations of motion and of both levels of the
        constraints, (2, 3).
    step
        Number of steps that remain.
    """

    real_solver: Any
    real_nonzeros: Array
    complex_solver: Any
    complex_nonzeros: Array
    entries: Array
    transposed_entries: Array
    residual: WeightedResidual
    seeds: Array
    y: Array
    weights: Array
    by_stages: Array
    by_rates: Array
    by_w: Array
    total: Array
    complex_total: Array
    velocities: Array
    complex_velocities: Array
    right: Array
    complex_right: Array
    real_part: Array
    imaginary_part: Array
    change: Array
    full_change: Array
    sizes: Array
    step: int


def sweep_backwards(adjoint: RadauAdjoint) -> int:
    """Transpose all steps, the last one first; return DONE, NEW_PIVOTS or the code of a failure."""
    run = adjoint.run
    while adjoint.step > 0:
        first = adjoint.step - 1
        run.t = adjoint.times[first]
        h = adjoint.times[first + 1] - run.t
        code = restore_stages(adjoint, first, h)
        if code == DONE:
            code = _factorize_transposes(adjoint)
        if code == DONE:
            _set_seeds(adjoint, first, h)
            code = _solve_weights(adjoint, h)
        if code != DONE:
            return code
        _transpose_residuals(adjoint, first, h)
        adjoint.step -= 1
    return DONE


def _factorize_transposes(adjoint: RadauAdjoint) -> int:
    """Factorize the transposes of the matrices of `restore_stages`; return the code."""
    run, of, at = adjoint.run, adjoint.entries, adjoint.transposed_entries
    pick(adjoint.real_nonzeros, at, run.real_nonzeros, of, 0, at.size)
    pick(adjoint.complex_nonzeros, at, run.complex_nonzeros, of, 0, at.size)
    return factorize_both(adjoint)


def _set_seeds(adjoint: RadauAdjoint, first: int, h: float) -> None:
    """Compute the derivatives of the objective with respect to W in step `first`."""
    n = adjoint.run.form.n
    row = 3 * first + 1
    one, two, three = adjoint.seeds[row], adjoint.seeds[row + 1], adjoint.seeds[row + 2]
    m = one.size - 2 * n
    for j in range(3):
        by_w = adjoint.by_w[j]
        combine(by_w, (T[2, j],), (adjoint.y,))
        motion = by_w[: 2 * n]
        factors = (1.0, T[0, j], T[1, j], T[2, j])
        combine(motion, factors, (motion, one[: 2 * n], two[: 2 * n], three[: 2 * n]))
        reactions = by_w[2 * n : 2 * n + m]
        rates = (1.0, RATES[0, j] / h, RATES[1, j] / h, RATES[2, j] / h)
        combine(reactions, rates, (reactions, one[2 * n :], two[2 * n :], three[2 * n :]))


def _solve_weights(adjoint: RadauAdjoint, h: float) -> int:
    """Solve K^T y = -b for the weights y of the residuals of the stages; return the code.

    b are the derivatives of the objective with respect to W, and K W are the linearized residuals.
    The transposed simplified Newton iteration of the method is used. Weights of rows q' - v = 0 are
    eliminated together with the velocities that they define, see `_transpose_residuals`.
    """
    fill(adjoint.weights[0], 0.0)
    fill(adjoint.weights[1], 0.0)
    fill(adjoint.weights[2], 0.0)
    previous = math.inf
    for k in range(MAX_ITERATIONS):
        _set_total(adjoint, h, k > 0)
        _correct_weights(adjoint, h)
        largest, smallest = 0.0, math.inf
        for block in range(3):
            change, size = adjoint.sizes[0, block], adjoint.sizes[1, block]
            if not math.isfinite(change):
                return NOT_FINITE
            if size > _UNDERFLOW:
                largest = max(largest, change / size)
                smallest = min(smallest, change / size)
        rate = largest / previous
        # The first iteration does not reveal the rate of convergence.
        is_converged = k > 0 and rate < 1.0 and largest * rate <= TOLERANCE * (1.0 - rate)
        if is_converged or largest <= TOLERANCE:
            return DONE
        # Weights of some equations may be rounding errors.
        if rate > STAGNATION_RATE and smallest <= ROUNDING:
            return DONE
        previous = largest
    return NOT_CONVERGED


def _set_total(adjoint: RadauAdjoint, h: float, has_weights: bool) -> None:
    """Set `total` to b + K^T y for the current weights y."""
    by_stages, by_rates = adjoint.by_stages, adjoint.by_rates
    if has_weights:
        for i in range(3):
            _weigh_residual(adjoint, i, h)
    for j in range(3):
        total = adjoint.total[j]
        combine(total, (1.0,), (adjoint.by_w[j],))
        if has_weights:
            terms = (total, by_stages[0], by_stages[1], by_stages[2])
            combine(total, (1.0, T[0, j], T[1, j], T[2, j]), terms)
            rates = (1.0, RATES[0, j] / h, RATES[1, j] / h, RATES[2, j] / h)
            combine(total, rates, (total, by_rates[0], by_rates[1], by_rates[2]))


def _weigh_residual(adjoint: RadauAdjoint, i: int, h: float) -> None:
    """Compute the derivatives of the weighted residual of stage `i`."""
    run, n, size = adjoint.run, adjoint.run.form.n, adjoint.run.form.size
    inputs, outputs = adjoint.residual.inputs, adjoint.residual.outputs
    weights = adjoint.weights[i]
    by_stage, by_rate = adjoint.by_stages[i], adjoint.by_rates[i]
    combine(inputs[:size], (1.0,), (adjoint.stages[i],))
    combine(inputs[size : 2 * size], (1.0,), (adjoint.rates[i],))
    weigh_residual(adjoint.residual, run.t + C[i] * h, run.branch, weights)
    combine(by_stage, (1.0,), (outputs[:size],))
    combine(by_rate, (1.0,), (outputs[size : 2 * size],))
    combine(by_stage[n : 2 * n], (1.0, -1.0), (by_stage[n : 2 * n], weights[:n]))
    combine(by_rate[:n], (1.0, 1.0), (by_rate[:n], weights[:n]))


def _correct_weights(adjoint: RadauAdjoint, h: float) -> None:
    """Correct the weights by the transposed Newton iteration, and set `sizes`."""
    n, m = adjoint.scales.size, adjoint.unit_weights.size
    at, total = adjoint.run.reduction, adjoint.total
    _reduce_gradient(at, n, REAL_EIGENVALUE / h, total[0], adjoint.velocities, adjoint.right)
    solve(adjoint.real_solver, adjoint.right)
    combine(adjoint.complex_total, (1.0, -1.0j), (total[1], total[2]))
    _reduce_gradient(
        at,
        n,
        COMPLEX_EIGENVALUE / h,
        adjoint.complex_total,
        adjoint.complex_velocities,
        adjoint.complex_right,
    )
    solve(adjoint.complex_solver, adjoint.complex_right)
    split_complex(adjoint.real_part, adjoint.imaginary_part, adjoint.complex_right)
    change, full, sizes = adjoint.change, adjoint.full_change, adjoint.sizes
    for block in range(3):
        sizes[0, block] = 0.0
        sizes[1, block] = 0.0
    for i in range(3):
        weights, factors = adjoint.weights[i], (-T_INVERSE[0, i], -T_INVERSE[1, i], T_INVERSE[2, i])
        combine(change, factors, (adjoint.right, adjoint.real_part, adjoint.imaginary_part))
        fill(full, 0.0)
        combine(full[n : 2 * n], (1.0,), (change[:n],))
        pick(full, at.corrected, change, at.remaining_velocities, 0, at.corrected.size)
        combine(full[2 * n :], (1.0,), (change[n + at.corrected.size :],))
        combine(weights, (1.0, 1.0), (weights, full))
        first = 2 * n
        sizes[0, 0] = _larger(sizes[0, 0], max_norm(full[n:first], adjoint.scales))
        sizes[1, 0] = _larger(sizes[1, 0], max_norm(weights[n:first], adjoint.scales))
        for block in range(2):
            last = first + m
            change_size = max_norm(full[first:last], adjoint.unit_weights)
            size = max_norm(weights[first:last], adjoint.unit_weights)
            sizes[0, block + 1] = _larger(sizes[0, block + 1], change_size)
            sizes[1, block + 1] = _larger(sizes[1, block + 1], size)
            first = last


def _larger(one: float, other: float) -> float:
    """Return the larger number; NaN if `other` is NaN."""
    return one if one > other else other


def _reduce_gradient(
    at: KinematicReduction, n: int, c: complex, full: Array, velocities: Array, reduced: Array
) -> None:
    """Transpose `expand_solution`."""
    fill(velocities, 0.0)
    pick(velocities, at.defined, full, at.defined_velocities, 0, at.defined.size)
    combine(reduced[:n], (1.0, c), (full[:n], velocities))
    pick(reduced, at.remaining_velocities, full, at.corrected_velocities, 0, at.corrected.size)
    combine(reduced[n + at.corrected.size :], (1.0,), (full[2 * n :],))


def _transpose_residuals(adjoint: RadauAdjoint, first: int, h: float) -> None:
    """Add the derivatives of the weighted residuals to those with respect to y and p.

    The equations of the defined velocities are T^T y_d = (b + K^T y)_v for the weights y_d of the
    rows that define them.
    """
    n, at = adjoint.run.form.n, adjoint.run.reduction
    for i in range(3):
        _weigh_residual(adjoint, i, h)
        add_numbers(adjoint.residual)
    _set_total(adjoint, h, True)
    total, velocities = adjoint.total, adjoint.velocities
    for i in range(3):
        row = 3 * first + 1 + i
        combine(adjoint.y, (1.0, 1.0), (adjoint.y, adjoint.by_stages[i]))
        factors = (T_INVERSE[0, i], T_INVERSE[1, i], T_INVERSE[2, i])
        combine(adjoint.full_change, factors, (total[0], total[1], total[2]))
        fill(velocities, 0.0)
        pick(
            velocities,
            at.defined,
            adjoint.full_change,
            at.defined_velocities,
            0,
            at.defined.size,
        )
        combine(adjoint.y[n : 2 * n], (1.0, -1.0), (adjoint.y[n : 2 * n], velocities))
        motion = adjoint.y[: 2 * n]
        combine(motion, (1.0, 1.0), (motion, adjoint.seeds[row][: 2 * n]))


def transpose_radau_steps(start: StartDerivatives, interval: Interval, seeds: Array) -> Gradient:
    """Return the gradient of an objective with respect to the state at the start of an interval.

    Parameters
    ----------
    start
        Maps of the equations of the interval.
    interval
        States of the run.
    seeds
        Derivatives of the objective with respect to (q, v, lam) at the nodes, (3 steps + 1,
        2n + m); the first row is not used.

    Raises
    ------
    BeamdaeError
        If the transposed equations cannot be solved.
    """
    equations = start.equations
    form = formulate_first_order(equations, STABILIZED_FORM, apart=True)
    stages = StageMatrices.of(form)
    n, m, size, steps = equations.n, equations.m, form.size, len(interval.t) - 1
    reduced = stages.pattern.shape[0]
    transposed_pattern, transposed_entries = transpose_pattern(stages.pattern)
    real = FactorizedMatrix.from_pattern(transposed_pattern)
    complex_ = FactorizedMatrix.from_pattern(transposed_pattern, complex, pivot_source=real)
    make_residual, is_native = prepare_weights(equations, plan_stage_residual, 2 * size, size)

    def make_adjoint(native: bool) -> RadauAdjoint:
        return RadauAdjoint(
            **stages.step_fields(form, interval, native),
            real_solver=real.make_solver(native, "auto"),
            real_nonzeros=real.nonzeros,
            complex_solver=complex_.make_solver(native, "auto"),
            complex_nonzeros=complex_.nonzeros,
            entries=np.arange(stages.pattern.nnz, dtype=np.uint32),
            transposed_entries=transposed_entries,
            residual=make_residual(native),
            seeds=np.ascontiguousarray(seeds),
            y=np.zeros(size),
            weights=np.zeros((3, size)),
            by_stages=np.zeros((3, size)),
            by_rates=np.zeros((3, size)),
            by_w=np.zeros((3, size)),
            total=np.zeros((3, size)),
            complex_total=np.zeros(size, complex),
            velocities=np.zeros(n),
            complex_velocities=np.zeros(n, complex),
            right=np.zeros(reduced),
            complex_right=np.zeros(reduced, complex),
            real_part=np.zeros(reduced),
            imaginary_part=np.zeros(reduced),
            change=np.zeros(reduced),
            full_change=np.zeros(size),
            sizes=np.zeros((2, 3)),
            step=steps,
        )

    def matrices(adjoint: RadauAdjoint) -> list[tuple[Any, FactorizedMatrix]]:
        run = adjoint.run
        return [
            (run.real_solver, stages.real),
            (run.complex_solver, stages.complex_),
            (adjoint.real_solver, real),
            (adjoint.complex_solver, complex_),
        ]

    loop = StepLoop(sweep_backwards, make_adjoint, matrices, form.is_native and is_native)
    code = loop()
    adjoint = loop.work
    if code != DONE:
        raise BeamdaeError(
            f"{derivative_call()}: {_PROBLEMS[code]} after t = {interval.t[adjoint.step - 1]:g} s; "
            "use a "
            "smaller rtol, or check the model."
        )
    state = (adjoint.y[:n], adjoint.y[n : 2 * n], np.zeros(n), np.zeros(m))
    return Gradient(state, adjoint.residual.numbers)
