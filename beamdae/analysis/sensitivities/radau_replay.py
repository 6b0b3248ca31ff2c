"""Derivatives of the steps of a Radau run, with the step sequence of the run.

The loop is plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.sensitivities.alpha_steps import STEPS_PER_TEST
from beamdae.analysis.sensitivities.further_forces import FurtherForces
from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import (
    FirstOrderForm,
    evaluate_residual,
    formulate_first_order,
    plan_residual,
)
from beamdae.equations.formulations.kinematic_reduction import (
    KinematicReduction,
    reduce_kinematics,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.structure import Structure
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.error_control import MotionScales
from beamdae.integrators.radau.coefficients import T_INVERSE, A, C
from beamdae.integrators.radau.stages import (
    correct_stages,
    derive_velocities,
    factorize_matrices,
    predict_stages,
    set_stages,
)
from beamdae.integrators.radau.stepper import STABILIZED_FORM, StepTolerance, make_workspace
from beamdae.integrators.radau.workspace import RadauWorkspace
from beamdae.native.loop_functions import combine, fill, max_norm
from beamdae.native.return_codes import DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import (
    Sum,
    SumPlan,
    evaluate_sum,
    evaluate_with_data,
    set_time,
)

Array = np.ndarray

# Newton iterations of the stages of the run, which are converged except for the corrections of
# positions; the run does not store these.
_STAGE_ITERATIONS = 2
# The derivatives of the stages are converged to this fraction of their size, ...
_TOLERANCE = 1e-12
# ... or to rounding errors: corrections below this fraction that do not decrease by half.
_ROUNDING = 1e-7
_STAGNATION_RATE = 0.5
# Rounding error of positions, relative to the characteristic length.
_POSITION_ROUNDING = 1e-16
_MAX_ITERATIONS = 60
# Factors are tested if the length of the step has changed by this factor since the last test.
_MAX_STEP_RATIO = 1.5
# Value of `tested` if the factors of the current step were tested.
JUST_TESTED = 1
_PROBLEMS = {
    NOT_CONVERGED: "the derivatives of the stages do not converge",
    NOT_FINITE: "the derivatives are not finite",
    SINGULAR: "the matrix is singular",
}


@dataclass(frozen=True)
class StageMatrices:
    """Newton matrices of the stages of a Radau run.

    Attributes
    ----------
    pattern, jacobian, reduction
        See `reduce_kinematics`.
    real, complex_
        The two matrices.
    """

    pattern: sp.csc_array
    jacobian: SumPlan
    reduction: KinematicReduction
    real: FactorizedMatrix
    complex_: FactorizedMatrix

    @classmethod
    def of(cls, form: FirstOrderForm) -> StageMatrices:
        """Return the matrices of a form, not yet evaluated."""
        pattern, jacobian, reduction = reduce_kinematics(form)
        real = FactorizedMatrix.from_pattern(pattern)
        complex_ = FactorizedMatrix.from_pattern(pattern, complex, pivot_source=real)
        return cls(pattern, jacobian, reduction, real, complex_)

    def make_workspace(self, form: FirstOrderForm, native: bool) -> RadauWorkspace:
        """Return work arrays for the stages."""
        equations = form.equations
        scales = equations.position_scales
        motion = MotionScales(scales, scales, 1.0, 1.0)
        buffers = form.buffers(native)
        buffers.jacobian = self.jacobian.sum(native, equations.p)
        return make_workspace(
            form,
            buffers,
            self.pattern,
            self.reduction,
            (self.real.make_solver(native, "auto"), self.real.nonzeros),
            (self.complex_.make_solver(native, "auto"), self.complex_.nonzeros),
            StepTolerance(1.0, motion, np.ones(equations.n, bool)),
            math.inf,
        )


@dataclass(slots=True)
class RadauReplay:
    """Work arrays of `replay_steps`.

    Attributes
    ----------
    run
        Work arrays of the stages of the run, and then of their derivatives, which solve the same
        equations.
    directional, local, inputs
        Directional derivative of the residual, its local inputs by direction, see
        `direction_inputs`, and its inputs (y, y', dy, dy').
    further, further_inputs, further_residuals, further_numbers, is_further
        Directional derivative with further forces, its inputs and its results at the stages,
        (3, size), and the numbers and the directions that have them, see `FurtherForces`.
    stages, rates
        Stages Y and Y' of the run, (3, size).
    times, rows
        Start and steps of the interval (steps + 1,) [s], and states (q, v, a, lam) at its start and
        at all stages, (3 steps + 1, 3n + m).
    negligible
        Changes of scaled positions that are rounding errors, (k,).
    y, yp
        Current derivatives of (y, y'), one direction a row.
    scales, weights, unit_weights
        Reciprocal scales of the coordinates, (n,), and of (q, h v), (2n,); ones (m,).
    last_w
        Transformed stages of the derivatives in the last step, from which those of the next step
        are predicted, (3k, size).
    results
        Derivatives of (q, v, a, lam) at all stages, (3 steps * k, 3n + m).
    last_step
        Length of the last step [s]; 0 in the first step.
    step, direction
        Number of completed steps, and number of directions that are completed in the next step.
    tested
        Number of steps since the last test of the factors; 0 if the next factors are tested.
    tested_step
        Length of the step whose factors were tested last [s].
    """

    run: RadauWorkspace
    directional: Sum
    local: Array
    inputs: Array
    further: Sum
    further_inputs: Array
    further_residuals: Array
    further_numbers: Array
    is_further: Array
    stages: Array
    rates: Array
    times: Array
    rows: Array
    negligible: Array
    y: Array
    yp: Array
    scales: Array
    weights: Array
    unit_weights: Array
    last_w: Array
    results: Array
    last_step: float = 0.0
    step: int = 0
    direction: int = 0
    tested: int = 0
    tested_step: float = 0.0


def replay_steps(replay: RadauReplay) -> int:
    """Differentiate all steps; return DONE, NEW_PIVOTS or the code of a failure.

    The linear equations of the derivatives of the stages have three different matrices. They are
    solved by the simplified Newton iteration of the method, whose matrix is that of the second
    stage, with exact directional derivatives of the residual.
    """
    run, count = replay.run, replay.local.shape[0]
    while replay.step < replay.times.size - 1:
        run.t = replay.times[replay.step]
        h = replay.times[replay.step + 1] - run.t
        schedule_test(replay, h)
        code = restore_stages(replay, replay.step, h)
        if code != DONE:
            replay.tested = 0
            return code
        replay.tested = (replay.tested + 1) % STEPS_PER_TEST
        combine(replay.weights[: run.form.n], (1.0,), (replay.scales,))
        combine(replay.weights[run.form.n :], (h,), (replay.scales,))
        while replay.direction < count and code == DONE:
            code = _differentiate_stages(replay, h, replay.direction)
            if code == DONE:
                _store_derivatives(replay, replay.direction)
                replay.direction += 1
        if code == DONE:
            replay.direction = 0
            replay.last_step = h
            replay.step += 1
        elif replay.tested == JUST_TESTED:
            return code
        else:
            # Solutions with factors that were not tested may be inaccurate: test them.
            replay.tested = 0
    return DONE


def schedule_test(replay: Any, h: float) -> None:
    """Request a test of the factors of a step if its length `h` [s] has changed since the last.

    `replay` is a `RadauReplay`, or has its attributes `tested` and `tested_step`.
    """
    ratio = h / replay.tested_step if replay.tested > 0 else 0.0
    if not 1.0 / _MAX_STEP_RATIO < ratio < _MAX_STEP_RATIO:
        replay.tested, replay.tested_step = 0, h


def restore_stages(replay: Any, step: int, h: float) -> int:
    """Compute the stages of a step of length `h` [s] of a replayed run; return the code.

    `replay` is a `RadauReplay`, or has its attributes `run`, `rows`, `stages`, `rates` and
    `tested`. The Newton matrices of `replay.run` are factorized at these stages.
    """
    run, n = replay.run, replay.run.form.n
    m = replay.rows.shape[1] - 3 * n
    first = 3 * step
    start = replay.rows[first]
    stages = run.stages
    reactions = (
        replay.rows[first + 1][3 * n :],
        replay.rows[first + 2][3 * n :],
        replay.rows[first + 3][3 * n :],
    )
    fill(run.y, 0.0)
    combine(run.y[: 2 * n], (1.0,), (start[: 2 * n],))
    for i in range(3):
        row = replay.rows[first + 1 + i]
        fill(stages[i], 0.0)
        combine(stages[i][: 2 * n], (1.0, -1.0), (row[: 2 * n], start[: 2 * n]))
        factors = (h * A[i, 0], h * A[i, 1], h * A[i, 2])
        combine(stages[i][2 * n : 2 * n + m], factors, reactions)
    for i in range(3):
        factors = (T_INVERSE[i, 0], T_INVERSE[i, 1], T_INVERSE[i, 2])
        combine(run.w[i], factors, (stages[0], stages[1], stages[2]))
    derive_velocities(run, h)
    set_stages(run, h)
    code = factorize_matrices(run, h, replay.tested == 0)
    if code != DONE:
        return code
    for _ in range(_STAGE_ITERATIONS):
        for i in range(3):
            t, residual = run.t + C[i] * h, run.stage_residuals[i]
            evaluate_residual(run.form, t, run.branch, run.stages[i], run.rates[i], residual)
        correct_stages(run, h)
        set_stages(run, h)
    for i in range(3):
        combine(replay.stages[i], (1.0,), (run.stages[i],))
        combine(replay.rates[i], (1.0,), (run.rates[i],))
    return DONE


def _differentiate_stages(replay: RadauReplay, h: float, k: int) -> int:
    """Solve for the derivatives of the stages along direction `k`; return the code."""
    run, n, weights = replay.run, replay.run.form.n, replay.weights
    m = replay.unit_weights.size
    combine(run.y, (1.0,), (replay.y[k],))
    combine(run.yp, (1.0,), (replay.yp[k],))
    if replay.is_further[k] == 1:
        _evaluate_further_forces(replay, h, k)
    is_similar = h <= _MAX_STEP_RATIO * replay.last_step
    run.step_size.last_step = replay.last_step if is_similar else 0.0
    for i in range(3):
        combine(run.last_w[i], (1.0,), (replay.last_w[3 * k + i],))
    predict_stages(run, h)
    previous = math.inf
    for _ in range(_MAX_ITERATIONS):
        set_stages(run, h)
        for i in range(3):
            _evaluate_derivative(replay, run.t + C[i] * h, i, k)
            if replay.is_further[k] == 1:
                residual = run.stage_residuals[i]
                combine(residual, (1.0, 1.0), (residual, replay.further_residuals[i]))
        correct_stages(run, h)
        change = _largest_change(run, 0, 2 * n, weights)
        reaction_change = _largest_change(run, 2 * n, 2 * n + m, replay.unit_weights)
        if not math.isfinite(change):
            return NOT_FINITE
        total, reactions = max_norm(run.y[: 2 * n], weights), 0.0
        for i in range(3):
            total = max(total, max_norm(run.w[i][: 2 * n], weights))
            reactions = max(reactions, max_norm(run.w[i][2 * n : 2 * n + m], replay.unit_weights))
        rate = change / previous
        is_converged = rate < 1.0 and change * rate <= _TOLERANCE * total * (1.0 - rate)
        # The first iteration does not reveal the rate of convergence.
        is_converged = (previous < math.inf and is_converged) or change <= _TOLERANCE * total
        # If a parameter changes only reactions, or nothing, derivatives of positions are rounding
        # errors.
        is_small = (
            change <= max(_ROUNDING * total, replay.negligible[k])
            or 0.0 < reaction_change <= _ROUNDING * reactions
        )
        if is_converged or (rate > _STAGNATION_RATE and is_small):
            set_stages(run, h)
            return DONE
        previous = change
    return NOT_CONVERGED


def _evaluate_further_forces(replay: RadauReplay, h: float, k: int) -> None:
    """Evaluate the derivatives of further forces along direction `k` at all stages."""
    run, size, inputs = replay.run, replay.run.form.size, replay.further_inputs
    combine(inputs[4 * size :], (1.0,), (replay.further_numbers[k],))
    for i in range(3):
        combine(inputs[:size], (1.0,), (replay.stages[i],))
        combine(inputs[size : 2 * size], (1.0,), (replay.rates[i],))
        set_time(replay.further, run.t + C[i] * h, run.branch)
        evaluate_sum(replay.further, inputs, replay.further_residuals[i])


def _largest_change(run: RadauWorkspace, first: int, last: int, weights: Array) -> float:
    """Return the largest weighted correction of these components of W."""
    real = max_norm(run.real_change[first:last], weights)
    return max(real, max_norm(run.complex_change[first:last], weights))


def _evaluate_derivative(replay: RadauReplay, t: float, i: int, k: int) -> None:
    """Write the derivative of the residual of stage `i` along direction `k` to the workspace."""
    run, n, size, inputs = replay.run, replay.run.form.n, replay.run.form.size, replay.inputs
    dy, dyp, residual = run.stages[i], run.rates[i], run.stage_residuals[i]
    combine(inputs[:size], (1.0,), (replay.stages[i],))
    combine(inputs[size : 2 * size], (1.0,), (replay.rates[i],))
    combine(inputs[2 * size : 3 * size], (1.0,), (dy,))
    combine(inputs[3 * size : 4 * size], (1.0,), (dyp,))
    set_time(replay.directional, t, run.branch)
    evaluate_with_data(replay.directional, replay.local[k], inputs, residual)
    combine(residual[:n], (1.0, 1.0, -1.0), (residual[:n], dyp[:n], dy[n : 2 * n]))


def _store_derivatives(replay: RadauReplay, k: int) -> None:
    run, n, count = replay.run, replay.run.form.n, replay.local.shape[0]
    for i in range(3):
        result = replay.results[(3 * replay.step + i) * count + k]
        combine(result[: 2 * n], (1.0,), (run.stages[i][: 2 * n],))
        combine(result[2 * n :], (1.0,), (run.rates[i][n : n + result.size - 2 * n],))
        combine(replay.last_w[3 * k + i], (1.0,), (run.w[i],))
    combine(replay.y[k], (1.0,), (run.stages[2],))
    combine(replay.yp[k], (1.0,), (run.rates[2],))


def _plan_residual(structure: Structure) -> SumPlan:
    return plan_residual(structure, STABILIZED_FORM)


def differentiate_radau_steps(
    derivatives: StartDerivatives,
    interval: Interval,
    starts: list[State],
    numbers: Array,
    steps: Array,
    further: FurtherForces,
) -> Array:
    """Return the derivatives of (q, v, a, lam) at the start and the stages of a smooth interval.

    Parameters
    ----------
    derivatives
        Derivatives of consistent states of the equations of the interval.
    interval
        States of the run.
    starts
        Derivatives of the consistent state at the start, one per direction.
    numbers
        Derivatives of p, one direction a row, (k, n_p).
    steps
        Small changes of the parameters, (k,); derivatives that lead to changes of positions below
        rounding errors are negligible.
    further
        Forces that are missing in the equations of the steps.

    Returns
    -------
    numpy.ndarray
        Derivatives (3 steps + 1, k, 3n + m); the first rows are `starts`.

    Raises
    ------
    BeamdaeError
        If the equations of the derivatives cannot be solved.
    """
    equations = derivatives.equations
    form = formulate_first_order(equations, STABILIZED_FORM, apart=True)
    n, size, count, n_steps = equations.n, form.size, len(numbers), len(interval.t) - 1
    matrices_of_stages = StageMatrices.of(form)

    def directional(x: StartDerivatives) -> SumPlan:
        return x.directional_plan(_plan_residual, 2 * size)

    plan = further_plan = directional(derivatives)
    if further.is_present.any():
        further_plan = directional(StartDerivatives(ConsistencySolver(further.equations)))
    scales = equations.position_scales
    packed = [form.pack(x) for x in starts]
    results = np.zeros(((3 * n_steps + 1) * count, 3 * n + equations.m))
    results[:count] = [np.concatenate(x) for x in starts]

    def make_replay(native: bool) -> RadauReplay:
        run = matrices_of_stages.make_workspace(form, native)
        run.branch = interval.branch
        directional, local = derivatives.direction_sum(plan, 2 * size, native, numbers)
        return RadauReplay(
            run=run,
            directional=directional,
            local=local,
            inputs=np.zeros(4 * size),
            further=further_plan.sum(native, further.equations.p),
            further_inputs=np.zeros(4 * size + further.numbers.shape[1]),
            further_residuals=np.zeros((3, size)),
            further_numbers=np.ascontiguousarray(further.numbers),
            is_further=further.is_present,
            stages=np.zeros((3, size)),
            rates=np.zeros((3, size)),
            times=np.ascontiguousarray(interval.t),
            rows=np.ascontiguousarray(np.hstack(interval.rows)),
            negligible=_POSITION_ROUNDING / steps,
            y=np.array([y for y, _ in packed]),
            yp=np.array([yp for _, yp in packed]),
            scales=1.0 / scales,
            weights=np.zeros(2 * n),
            unit_weights=np.ones(equations.m),
            last_w=np.zeros((3 * count, size)),
            results=results[count:],
        )

    def matrices(replay: RadauReplay) -> list[tuple[Any, FactorizedMatrix]]:
        run = replay.run
        return [
            (run.real_solver, matrices_of_stages.real),
            (run.complex_solver, matrices_of_stages.complex_),
        ]

    is_native = form.is_native and plan.is_native and further_plan.is_native
    loop = StepLoop(replay_steps, make_replay, matrices, is_native)
    code = loop()
    if code != DONE:
        raise BeamdaeError(
            f"{derivative_call()}: {_PROBLEMS[code]} after t = {interval.t[loop.work.step]:g} s; "
            "use a "
            "smaller rtol, or check the model."
        )
    return results.reshape(3 * n_steps + 1, count, -1)
