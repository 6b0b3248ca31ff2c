"""Derivatives of the steps of a generalized-alpha run, with the step sequence of the run.

The loop is plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from beamdae.analysis.sensitivities.alpha_steps import (
    AlphaSteps,
    copy_state,
    factorize_ahead,
    group_equal_steps,
    prepare_steps,
    step_length,
)
from beamdae.analysis.sensitivities.directions import (
    Directions,
    DirectionSums,
    differentiate_map,
    evaluate_direction,
    prepare_directions,
)
from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives, time_rate
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.step_equations import (
    StepEquations,
    StepPrediction,
    formulate_step,
    plan_step_sums,
)
from beamdae.equations.structure import Structure
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha.family import (
    AlphaStart,
    family_parameters,
)
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.native.loop_functions import combine, solve
from beamdae.native.return_codes import DONE
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import (
    SumPlan,
)

Array = np.ndarray


@dataclass(slots=True, kw_only=True)
class ReplayWorkspace(AlphaSteps):
    """Work arrays of `replay_steps`.

    Attributes
    ----------
    directions, inputs
        Directional derivatives of the residual, and their inputs (motion, its direction).
    last
        Number of steps after which the length of the step changes, or the interval ends.
    shifts, time_rates
        Derivatives of the time of all steps (k,) [s], and partial derivatives of the residual with
        respect to time at the steps, (steps, n + m).
    q, v, ddq, a, lam
        Current derivatives of the motion, one direction a row. `a` is the algorithmic acceleration.
    results
        Derivatives of (q, v, q'', lam) after the steps, (steps * k, 3n + m).
    step
        Number of completed steps.
    """

    directions: DirectionSums
    inputs: Array
    last: int = 0
    shifts: Array
    time_rates: Array
    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    results: Array
    step: int = 0


def replay_steps(run: ReplayWorkspace) -> int:
    """Differentiate the steps of equal length; return DONE, NEW_PIVOTS or SINGULAR.

    In each step, the derivatives of the residual along the predicted derivatives are the right-hand
    sides of linear systems with the exact iteration matrix at the end of the step.
    """
    n, m, h, beta, gamma = run.form.n, run.form.m, run.h, run.beta, run.gamma
    c = run.coefficients
    motion = 4 * n + 2 * m
    inputs, change = run.inputs, run.change
    # The predicted derivatives.
    q_predicted, v_predicted = inputs[motion : motion + n], inputs[motion + n : motion + 2 * n]
    factor = 1.0 / (1.0 - run.alpha_m)
    count = run.shifts.size
    while run.step < run.last:
        code = factorize_ahead(run, run.step + 1, 1, run.last - run.step)
        if code != DONE:
            return code
        t = run.times[run.step + 1]
        copy_state(run, run.step + 1, inputs[: 3 * n + m])
        for k in range(count):
            q, v, ddq, a, lam = run.q[k], run.v[k], run.ddq[k], run.a[k], run.lam[k]
            combine(run.a_predicted, (factor * run.alpha_f, -factor * run.alpha_m), (ddq, a))
            positions = (1.0, h, h * h * (0.5 - beta), h * h * beta)
            combine(q_predicted, positions, (q, v, a, run.a_predicted))
            velocities = (1.0, h * (1.0 - gamma), h * gamma)
            combine(v_predicted, velocities, (v, a, run.a_predicted))
            evaluate_direction(run.directions, k, t, run.branch, inputs, change)
            combine(change[:n], (c[2],), (change[:n],))
            for i in run.form.velocity_rows:
                change[i] /= c[0]
            if run.shifts[k] != 0.0:
                combine(change, (1.0, run.shifts[k]), (change, run.time_rates[run.step]))
            solve(run.linear, change)
            combine(q, (1.0, -1.0), (q_predicted, change[:n]))
            combine(v, (1.0, -c[0]), (v_predicted, change[:n]))
            combine(ddq, (-c[1],), (change[:n],))
            combine(a, (1.0, -1.0 / c[2]), (run.a_predicted, change[:n]))
            combine(lam, (-1.0 / c[2],), (change[n:],))
            result = run.results[run.step * count + k]
            combine(result[:n], (1.0,), (q,))
            combine(result[n : 2 * n], (1.0,), (v,))
            combine(result[2 * n : 3 * n], (1.0,), (ddq,))
            combine(result[3 * n :], (1.0,), (lam,))
        run.step += 1
    return DONE


def differentiate_alpha_steps(
    method: GeneralizedAlpha,
    groups: Sequence[Directions],
    equations: EquationsOfMotion,
    interval: Interval,
    starts: Sequence[Array],
    shifts: Array,
) -> Array:
    """Return the derivatives of (q, v, q'', lam) at the start and steps of a smooth interval.

    If the time t of the start depends on a parameter, all steps are moved with it. Derivatives s
    at fixed times follow from those along the moved steps, s + x' dt. Moving the state instead, by
    -x' dt at the start, would be wrong for motions that are too fast for the steps: x' is large
    there, and the steps do not damp it as fast as they damp the motion.

    Parameters
    ----------
    method
        Settings of the run, in the index-3 form.
    groups
        Directions.
    equations, interval
        Equations and states of the run.
    starts
        Derivatives of the consistent state (q, v, a, lam) along the moved start, one direction a
        row, group by group.
    shifts
        Derivatives of the time of the start, (k,) [s].

    Returns
    -------
    numpy.ndarray
        Derivatives (steps + 1, k, 3n + m) along the moved steps; the first rows are `starts`.

    Raises
    ------
    BeamdaeError
        If the iteration matrix is singular at a step.
    """
    times, states, form = interval.t, interval.state, formulate_step(equations, False)
    n, m, steps, count = equations.n, equations.m, len(times) - 1, len(shifts)
    parts = list(pairwise(group_equal_steps(times)))
    member = family_parameters(method.family, method.rho_inf)
    time, at = np.array([times[0], interval.branch]), State(*(x[0] for x in states))
    h = step_length(times, *parts[0])
    start = AlphaStart(member, groups[0].maps.solver, True, method.start == "cured")
    first_q, first_v, first_ddq, first_a = differentiate_map(
        groups, starts, shifts, StartDerivatives.initial_motion, start, time, at, h
    )
    make_directions, is_native = prepare_directions(groups, plan_step_residual, 4 * n + 2 * m)
    matrix = FactorizedMatrix.from_pattern(form.pattern)
    make_fields = prepare_steps(form, form.sums[2], matrix, member, interval)
    results = np.zeros(((steps + 1) * count, 3 * n + m))
    results[:count] = np.hstack(starts)

    def make_workspace(native: bool) -> ReplayWorkspace:
        return ReplayWorkspace(
            **make_fields(native),
            directions=make_directions(native),
            inputs=np.zeros(2 * (4 * n + 2 * m)),
            shifts=shifts,
            time_rates=np.zeros((steps, n + m)),
            q=first_q.copy(),
            v=first_v.copy(),
            ddq=first_ddq.copy(),
            a=first_a.copy(),
            lam=starts[-1].copy(),
            results=results[count:],
        )

    def matrices(run: ReplayWorkspace) -> list[tuple[Any, FactorizedMatrix]]:
        return [(run.linear, matrix)]

    loop = StepLoop(replay_steps, make_workspace, matrices, form.is_native and is_native)
    run = loop.work
    for first, last in parts:
        h = step_length(times, first, last)
        if first > 0:
            at, time = State(*(x[first] for x in states)), np.array([times[first], interval.branch])
            ratio, square = h / run.h, (h * h - run.h * run.h) * member.defect
            motion, jerk_map = (run.q, run.v, run.ddq), StartDerivatives.jerk_map
            (jerks,) = differentiate_map(groups, motion, shifts, jerk_map, time, at, h)
            run.v += square * jerks
            run.a[:] = (1.0 - ratio) * run.ddq + ratio * run.a
        run.coefficients[:] = member.coefficients(h)
        if shifts.any():
            run.time_rates[first:last] = evaluate_time_rates(
                form, interval, first, last, run.coefficients, h
            )
        run.h, run.last, run.staged, run.lane = h, last, 0, 0
        if loop() != DONE:
            raise BeamdaeError(
                f"{derivative_call()}: the iteration matrix is singular at t = "
                f"{times[run.step + 1]:g} s; use a smaller step, or check the model."
            )
    return results.reshape(steps + 1, count, 3 * n + m)


def plan_step_residual(structure: Structure) -> SumPlan:
    """Return the plan of the residual of a step."""
    return plan_step_sums(structure, False)[1][0]


def evaluate_time_rates(
    form: StepEquations, interval: Interval, first: int, last: int, coefficients: Array, h: float
) -> Array:
    """Return the derivatives of the residual by time in steps of length `h` [s], (steps, n + m)."""
    rates = np.zeros((last - first, form.size))
    for k in range(first, last):
        q, v, a, lam = (x[k + 1] for x in interval.state)
        at = StepPrediction(q, v, a, q, coefficients)
        x = np.concatenate([0.0 * q, coefficients[2] * lam])
        time = np.array([interval.t[k + 1], interval.branch])
        rates[k - first] = time_rate(partial(_residual_at, form, at, x), time, h)
    return rates


def _residual_at(form: StepEquations, at: StepPrediction, x: Array, time: Array) -> Array:
    return form.residual(time, at, x)
