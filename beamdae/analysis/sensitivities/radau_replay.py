"""Derivatives of the steps of a Radau run, with the step sequence of the run.

The loop is plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.directions import (
    Directions,
    DirectionSums,
    evaluate_direction,
    prepare_directions,
)
from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.analysis.sensitivities.radau_steps import (
    MAX_ITERATIONS,
    MAX_STEP_RATIO,
    RadauSteps,
    StageMatrices,
    judge_corrections,
    measure_block,
    restore_stages,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import (
    formulate_first_order,
    plan_residual,
)
from beamdae.equations.structure import Structure
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.radau.coefficients import C
from beamdae.integrators.radau.stages import (
    correct_stages,
    predict_stages,
    set_stages,
)
from beamdae.integrators.radau.stepper import STABILIZED_FORM
from beamdae.native.loop_functions import combine, max_norm, split_complex
from beamdae.native.return_codes import DONE, NOT_CONVERGED, NOT_FINITE, SINGULAR
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import (
    SumPlan,
)

Array = np.ndarray

_PROBLEMS = {
    NOT_CONVERGED: "the derivatives of the stages do not converge",
    NOT_FINITE: "the derivatives are not finite",
    SINGULAR: "the matrix is singular",
}


@dataclass(slots=True, kw_only=True)
class RadauReplay(RadauSteps):
    """Work arrays of `replay_steps`.

    Attributes
    ----------
    run
        As in `RadauSteps`, and then for the derivatives of the stages, which solve the same
        equations.
    directions, inputs
        Directional derivatives of the residual, and their inputs (y, y', dy, dy').
    y, yp
        Current derivatives of (y, y'), one direction a row.
    weights
        Reciprocal scales of (q, h v), (2n,).
    corrections
        Corrections of W, (3, size).
    last_w
        Transformed stages of the derivatives in the last step, from which those of the next step
        are predicted, (3k, size).
    results
        Derivatives of (q, v, a, lam) at all stages, (3 steps * k, 3n + m).
    last_step
        Length of the last step [s]; 0 in the first step.
    step
        Number of completed steps.
    """

    directions: DirectionSums
    inputs: Array
    y: Array
    yp: Array
    weights: Array
    corrections: Array
    last_w: Array
    results: Array
    last_step: float = 0.0
    step: int = 0


def replay_steps(replay: RadauReplay) -> int:
    """Differentiate all steps; return DONE, NEW_PIVOTS or the code of a failure.

    The linear equations of the derivatives of the stages have three different matrices. They are
    solved by the simplified Newton iteration of the method, whose matrix is that of the second
    stage, with exact directional derivatives of the residual.
    """
    run, count = replay.run, replay.y.shape[0]
    while replay.step < replay.times.size - 1:
        run.t = replay.times[replay.step]
        h = replay.times[replay.step + 1] - run.t
        code = restore_stages(replay, replay.step, h)
        if code != DONE:
            return code
        combine(replay.weights[: run.form.n], (1.0,), (replay.scales,))
        combine(replay.weights[run.form.n :], (h,), (replay.scales,))
        for k in range(count):
            code = _differentiate_stages(replay, h, k)
            if code != DONE:
                return code
            _store_derivatives(replay, k)
        replay.last_step = h
        replay.step += 1
    return DONE


def _differentiate_stages(replay: RadauReplay, h: float, k: int) -> int:
    """Solve for the derivatives of the stages along direction `k`; return the code."""
    run, n, weights = replay.run, replay.run.form.n, replay.weights
    m = replay.unit_weights.size
    combine(run.y, (1.0,), (replay.y[k],))
    combine(run.yp, (1.0,), (replay.yp[k],))
    is_similar = h <= MAX_STEP_RATIO * replay.last_step
    run.step_size.last_step = replay.last_step if is_similar else 0.0
    for i in range(3):
        combine(run.last_w[i], (1.0,), (replay.last_w[3 * k + i],))
    predict_stages(run, h)
    replay.largest = math.inf
    for _ in range(MAX_ITERATIONS):
        set_stages(run, h)
        for i in range(3):
            _evaluate_derivative(replay, run.t + C[i] * h, i, k)
        correct_stages(run, h)
        combine(replay.corrections[0], (1.0,), (run.real_change,))
        split_complex(replay.corrections[1], replay.corrections[2], run.complex_change)
        # The size of the motion is that at the start of the step, or larger.
        replay.sizes[1, 0] = max_norm(run.y[: 2 * n], weights)
        for i in range(3):
            change, w = replay.corrections[i], run.w[i]
            measure_block(replay, 0, change[: 2 * n], w[: 2 * n], weights)
            reactions = change[2 * n : 2 * n + m]
            measure_block(replay, 1, reactions, w[2 * n : 2 * n + m], replay.unit_weights)
        code = judge_corrections(replay)
        if code != NOT_CONVERGED:
            set_stages(run, h)
            return code
    return NOT_CONVERGED


def _evaluate_derivative(replay: RadauReplay, t: float, i: int, k: int) -> None:
    """Write the derivative of the residual of stage `i` along direction `k` to the workspace."""
    run, n, size, inputs = replay.run, replay.run.form.n, replay.run.form.size, replay.inputs
    dy, dyp, residual = run.stages[i], run.rates[i], run.stage_residuals[i]
    combine(inputs[:size], (1.0,), (replay.stages[i],))
    combine(inputs[size : 2 * size], (1.0,), (replay.rates[i],))
    combine(inputs[2 * size : 3 * size], (1.0,), (dy,))
    combine(inputs[3 * size : 4 * size], (1.0,), (dyp,))
    evaluate_direction(replay.directions, k, t, run.branch, inputs, residual)
    combine(residual[:n], (1.0, 1.0, -1.0), (residual[:n], dyp[:n], dy[n : 2 * n]))


def _store_derivatives(replay: RadauReplay, k: int) -> None:
    run, n, count = replay.run, replay.run.form.n, replay.y.shape[0]
    for i in range(3):
        result = replay.results[(3 * replay.step + i) * count + k]
        combine(result[: 2 * n], (1.0,), (run.stages[i][: 2 * n],))
        combine(result[2 * n :], (1.0,), (run.rates[i][n : n + result.size - 2 * n],))
        combine(replay.last_w[3 * k + i], (1.0,), (run.w[i],))
    combine(replay.y[k], (1.0,), (run.stages[2],))
    combine(replay.yp[k], (1.0,), (run.rates[2],))


def plan_stage_residual(structure: Structure) -> SumPlan:
    """Return the plan of the residual of a stage."""
    return plan_residual(structure, STABILIZED_FORM)


def differentiate_radau_steps(
    groups: Sequence[Directions],
    equations: EquationsOfMotion,
    interval: Interval,
    starts: Sequence[Array],
) -> Array:
    """Return the derivatives of (q, v, a, lam) at the start and the stages of a smooth interval.

    Parameters
    ----------
    groups
        Directions.
    equations, interval
        Equations and states of the run.
    starts
        Derivatives of the consistent state (q, v, a, lam) at the start, one direction a row, group
        by group.

    Returns
    -------
    numpy.ndarray
        Derivatives (3 steps + 1, k, 3n + m); the first rows are `starts`.

    Raises
    ------
    BeamdaeError
        If the equations of the derivatives cannot be solved.
    """
    form = formulate_first_order(equations, STABILIZED_FORM, apart=True)
    n, size, count, n_steps = equations.n, form.size, len(starts[0]), len(interval.t) - 1
    matrices_of_stages = StageMatrices.of(form)
    make_directions, is_native = prepare_directions(groups, plan_stage_residual, 2 * size)
    packed = [form.pack(State(*x)) for x in zip(*starts, strict=True)]
    results = np.zeros(((3 * n_steps + 1) * count, 3 * n + equations.m))
    results[:count] = np.hstack(starts)

    def make_replay(native: bool) -> RadauReplay:
        return RadauReplay(
            **matrices_of_stages.step_fields(form, interval, native),
            directions=make_directions(native),
            inputs=np.zeros(4 * size),
            y=np.array([y for y, _ in packed]),
            yp=np.array([yp for _, yp in packed]),
            weights=np.zeros(2 * n),
            corrections=np.zeros((3, size)),
            last_w=np.zeros((3 * count, size)),
            results=results[count:],
        )

    def matrices(replay: RadauReplay) -> list[tuple[Any, FactorizedMatrix]]:
        run = replay.run
        return [
            (run.real_solver, matrices_of_stages.real),
            (run.complex_solver, matrices_of_stages.complex_),
        ]

    loop = StepLoop(replay_steps, make_replay, matrices, form.is_native and is_native)
    code = loop()
    if code != DONE:
        raise BeamdaeError(
            f"{derivative_call()}: {_PROBLEMS[code]} after t = {interval.t[loop.work.step]:g} s; "
            "use a "
            "smaller rtol, or check the model."
        )
    return results.reshape(3 * n_steps + 1, count, -1)
