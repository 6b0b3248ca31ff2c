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

from beamdae.analysis.sensitivities.further_forces import FurtherForces
from beamdae.analysis.sensitivities.model_differences import derivative_call
from beamdae.analysis.sensitivities.start_derivatives import (
    StartDerivatives,
    differentiate_together,
    time_rate,
)
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import (
    StepEquations,
    StepMatrix,
    StepPrediction,
    evaluate_matrices,
    evaluate_matrix_at_state,
    formulate_step,
    plan_step_sums,
    set_lane,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.structure import Structure
from beamdae.errors import BeamdaeError
from beamdae.integrators.alpha.family import (
    JERK_INTERVAL,
    AlphaParameters,
    AlphaStart,
    family_parameters,
)
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.linear.lane_operations import LANES
from beamdae.native.batch_elimination import (
    BatchSolver,
    factorize_batch,
    select_factors,
)
from beamdae.native.loop_functions import combine, eliminate, factorize, solve
from beamdae.native.return_codes import DONE
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import (
    Sum,
    SumPlan,
    evaluate_sum,
    evaluate_with_data,
    set_time,
)
from beamdae.symbolic.sums.lane_sums import LaneSum, create_lane_sum, empty_lane_sum, has_lane_code

Array = np.ndarray

# Two steps are equal if they differ by less than this fraction of the step, or by a few rounding
# errors of the time.
_SAME_STEP = 1e-9
_TIME_ROUNDING = 8.0 * float(np.finfo(float).eps)


# Steps per test of the factors, whose accuracy changes slowly. The test takes a third of the time
# of a factorization, or as long as three of those of several matrices together.
STEPS_PER_TEST = 8
_STEPS_PER_BATCH_TEST = 32
# Non-zeros of the largest matrix of which several are factorized together: larger ones do not fit
# into the processor caches.
_MAX_BATCH_NONZEROS = 16000


@dataclass(slots=True)
class ReplayWorkspace:
    """Work arrays of `replay_steps`.

    Attributes
    ----------
    form, lanes, linear, nonzeros
        Equations of a step, their matrices at several steps, and the linear solver and non-zeros of
        the matrix.
    directional, local, inputs
        Directional derivative of the residual, its local inputs by direction, see
        `direction_inputs`, and its inputs (motion, its direction).
    further, further_inputs, residual, further_numbers, is_further
        Directional derivative with further forces, its inputs and its result, and the numbers and
        the directions that have them, see `FurtherForces`.
    alpha_m, alpha_f, gamma, beta
        Parameters of the method; see `family.AlphaParameters`.
    coefficients
        Factors (c_v, c_a, c_f) of `StepEquations`.
    h, branch
        Step, and a time inside the interval [s].
    last
        Number of steps after which the length of the step changes, or the interval ends.
    times, states, first_column, row
        Times (steps + 1,) [s] and states at the start and after the steps, see `join_states`, and
        work array for one state (q, v, a, lam), (3n + m,).
    shifts, time_rates
        Derivatives of the time of all steps (k,) [s], and partial derivatives of the residual with
        respect to time at the steps, (steps, n + m).
    q, v, ddq, a, lam
        Current derivatives of the motion, one direction a row. `a` is the algorithmic acceleration.
    a_predicted, change
        Predicted derivative of `a`, and right-hand side or solution of a step.
    results
        Derivatives of (q, v, q'', lam) after the steps, (steps * k, 3n + m).
    max_batch
        Number of steps whose matrices are factorized together, 1 or `LANES`.
    step
        Number of completed steps.
    tested
        Number of steps since the last test of the factors; 0 if the next factors are tested.
    staged, lane
        Number of matrices that were factorized last, 0 if there are no pivots, and index of the
        next one of these.
    """

    form: StepMatrix
    lanes: LaneSum
    linear: Any
    nonzeros: Array
    directional: Sum
    local: Array
    inputs: Array
    further: Sum
    further_inputs: Array
    residual: Array
    further_numbers: Array
    is_further: Array
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    coefficients: Array
    h: float
    last: int
    branch: float
    times: Array
    states: Array
    first_column: int
    row: Array
    shifts: Array
    time_rates: Array
    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    a_predicted: Array
    change: Array
    results: Array
    max_batch: int
    step: int = 0
    tested: int = 0
    staged: int = 0
    lane: int = 0


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
    count = run.local.shape[0]
    while run.step < run.last:
        code = factorize_ahead(run, run.step + 1, 1, run.last - run.step)
        if code != DONE:
            return code
        t = run.times[run.step + 1]
        copy_state(run, run.step + 1, inputs[: 3 * n + m])
        set_time(run.directional, t, run.branch)
        for k in range(count):
            q, v, ddq, a, lam = run.q[k], run.v[k], run.ddq[k], run.a[k], run.lam[k]
            combine(run.a_predicted, (factor * run.alpha_f, -factor * run.alpha_m), (ddq, a))
            positions = (1.0, h, h * h * (0.5 - beta), h * h * beta)
            combine(q_predicted, positions, (q, v, a, run.a_predicted))
            velocities = (1.0, h * (1.0 - gamma), h * gamma)
            combine(v_predicted, velocities, (v, a, run.a_predicted))
            evaluate_with_data(run.directional, run.local[k], inputs, change)
            if run.is_further[k] == 1:
                _add_further_forces(run, t, k)
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


def _add_further_forces(run: ReplayWorkspace, t: float, k: int) -> None:
    """Add the derivatives of further forces along direction `k` to `change`."""
    inputs, size = run.further_inputs, run.row.size
    combine(inputs[:size], (1.0,), (run.inputs[:size],))
    combine(inputs[inputs.size - run.further_numbers.shape[1] :], (1.0,), (run.further_numbers[k],))
    set_time(run.further, t, run.branch)
    evaluate_sum(run.further, inputs, run.residual)
    combine(run.change, (1.0, 1.0), (run.change, run.residual))


def join_states(states: State) -> tuple[Array, int]:
    """Return states (q, v, a, lam) as rows of a contiguous array, and where the columns begin.

    The states of a run are parts of such rows: copying all of them takes as long as hundreds of
    steps.
    """
    parts = [x for x in states if x.shape[1]]
    base = parts[0].base
    if base is not None and base.ndim == 2 and base.flags.c_contiguous:
        starts = [(x.ctypes.data - base.ctypes.data) // base.itemsize for x in parts]
        ends = starts[0] + np.cumsum([x.shape[1] for x in parts])
        is_joined = all(x.base is base and x.strides == base.strides for x in parts)
        if is_joined and starts[1:] == ends[:-1].tolist():
            row, column = divmod(starts[0], base.shape[1])
            return base[row : row + len(parts[0])], column
    return np.hstack(states), 0


def copy_state(run: Any, k: int, row: Array) -> None:
    """Write state `k` to `row`; for `run`, see `factorize_ahead`."""
    combine(row, (1.0,), (run.states[k][run.first_column : run.first_column + row.size],))


def factorize_ahead(run: Any, step: int, direction: int, remaining: int) -> int:
    """Provide the factors of a step; return DONE, NEW_PIVOTS or SINGULAR.

    If there are none left, the matrices of the next steps are factorized together.

    Parameters
    ----------
    run
        A `ReplayWorkspace`, or a workspace with its attributes that this function uses.
    step
        Index of the state at the end of the step.
    direction
        1 if later steps follow, -1 if earlier ones.
    remaining
        Number of steps of equal length that remain.
    """
    if run.lane == run.staged:
        count = run.max_batch if run.max_batch <= remaining else 1
        # The first pivots, and others that do not suit a batch, are tried for one matrix.
        if count == 1 or run.staged == 0 or _factorize_lanes(run, step, direction) != DONE:
            count = 1
            copy_state(run, step, run.row)
            evaluate_matrix_at_state(
                run.form, run.times[step], run.branch, run.coefficients, run.row, run.nonzeros
            )
            code = factorize_step(run)
            if code != DONE:
                run.staged = run.lane = 0
                return code
        run.staged, run.lane = count, 0
    elif run.staged > 1:
        select_factors(run.linear.factors, run.linear.batch, run.lane)
    run.lane += 1
    return DONE


def _factorize_lanes(run: Any, step: int, direction: int) -> int:
    """Factorize the matrices of `LANES` steps; return DONE, NEW_PIVOTS or SINGULAR."""
    first, size, lam_factor = run.first_column, run.row.size, run.coefficients[2]
    for lane in range(LANES):
        k = step + direction * lane
        row = run.states[k][first : first + size]
        set_lane(run.lanes, lane, run.times[k], row, run.form.n, lam_factor)
    evaluate_matrices(run.lanes, run.branch, run.coefficients, run.linear.batch.entries)
    code = factorize_batch(run.linear, run.tested == 0)
    run.tested += LANES
    if code != DONE or run.tested >= _STEPS_PER_BATCH_TEST:
        run.tested = 0
    return code


def make_step_solver(
    native: bool, matrix: FactorizedMatrix, plan: SumPlan, n_inputs: int, p: Array
) -> tuple[Any, int, LaneSum]:
    """Return the linear solver of a loop over known steps, its `max_batch`, and its `lanes`.

    `plan` is that of the matrix, with `n_inputs` inputs, and `p` are the numbers of the model.
    """
    is_small = len(matrix.nonzeros) <= _MAX_BATCH_NONZEROS
    if native and is_small and has_lane_code(plan):
        return BatchSolver.empty(float), LANES, create_lane_sum(plan, n_inputs, native, p)
    linear = BatchSolver.empty(float) if native else matrix.make_solver(native, "auto")
    return linear, 1, empty_lane_sum()


def factorize_step(run: Any) -> int:
    """Factorize the matrix of a step; return DONE, NEW_PIVOTS or SINGULAR.

    `run` is a `ReplayWorkspace`, or has its attributes `linear`, `nonzeros` and `tested`.
    """
    if run.tested == 0:
        code = factorize(run.linear, run.nonzeros)
    else:
        code = eliminate(run.linear, run.nonzeros)
    run.tested = (run.tested + 1) % STEPS_PER_TEST if code == DONE else 0
    return code


def differentiate_alpha_steps(
    method: GeneralizedAlpha,
    along: StartDerivatives,
    derivatives: Sequence[StartDerivatives],
    interval: Interval,
    starts: list[State],
    numbers: Array,
    shifts: list[float],
    further: FurtherForces,
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
    along
        Derivatives of the equations of the steps.
    derivatives
        Derivatives of starting values and of the jerk, which corrects velocities where the length
        of the step changes, one per direction.
    interval
        States of the run.
    starts
        Derivatives of the consistent state along the moved start, one per direction.
    shifts
        Derivatives of the time of the start, one per direction [s].
    further
        Forces that are missing in the equations of the steps.

    Returns
    -------
    numpy.ndarray
        Derivatives (steps + 1, k, 3n + m) along the moved steps; the first rows are `starts`.

    Raises
    ------
    BeamdaeError
        If the iteration matrix is singular at a step.
    """
    equations, times, states = along.equations, interval.t, interval.state
    form = formulate_step(equations, False)
    n, m, steps, count = equations.n, equations.m, len(times) - 1, len(numbers)
    groups = list(pairwise(group_equal_steps(times)))
    member = family_parameters(method.family, method.rho_inf)
    all_numbers = [
        x if present else y
        for x, y, present in zip(further.numbers, numbers, further.is_present, strict=True)
    ]
    time, at = np.array([times[0], interval.branch]), State(*(x[0] for x in states))
    h = _step_length(times, *groups[0])
    is_cured = method.start == "cured"

    def start_motion(
        x: StartDerivatives, q: Array, v: Array, a: Array, lam: Array, dp: Array, dt: Array
    ) -> tuple[Array, ...]:
        start = AlphaStart(member, x.solver, True, is_cured)
        motion = x.initial_motion(start, time, at, State(q, v, a, lam), dp, h, dt)
        return motion.q, motion.v, motion.ddq, motion.a, motion.lam

    motions = differentiate_together(
        derivatives, start_motion, *zip(*starts, strict=True), all_numbers, shifts
    )
    first_q, first_v, first_ddq, first_a, first_lam = map(np.array, zip(*motions, strict=True))

    def directional(x: StartDerivatives) -> SumPlan:
        return x.directional_plan(_plan_residual, 4 * n + 2 * m)

    plan = further_plan = directional(along)
    if further.is_present.any():
        further_plan = directional(StartDerivatives(ConsistencySolver(further.equations)))
    matrix = FactorizedMatrix.from_pattern(form.pattern)

    rows, first_column = join_states(states)
    results = np.zeros(((steps + 1) * count, 3 * n + m))
    results[:count] = [np.concatenate(x) for x in starts]

    def make_workspace(native: bool) -> ReplayWorkspace:
        linear, max_batch, lanes = make_step_solver(
            native, matrix, form.sums[2], 4 * n + 2 * m, equations.p
        )
        directional, local = along.direction_sum(plan, 4 * n + 2 * m, native, numbers)
        return ReplayWorkspace(
            form=form.matrix_buffers(native),
            lanes=lanes,
            linear=linear,
            nonzeros=matrix.nonzeros,
            directional=directional,
            local=local,
            inputs=np.zeros(2 * (4 * n + 2 * m)),
            further=further_plan.sum(native, further.equations.p),
            further_inputs=np.zeros(2 * (4 * n + 2 * m) + further.numbers.shape[1]),
            residual=np.zeros(n + m),
            further_numbers=np.ascontiguousarray(further.numbers),
            is_further=further.is_present,
            alpha_m=member.alpha_m,
            alpha_f=member.alpha_f,
            gamma=member.gamma,
            beta=member.beta,
            coefficients=np.zeros(3),
            h=0.0,
            last=0,
            branch=float(interval.branch),
            times=np.ascontiguousarray(times),
            states=rows,
            first_column=first_column,
            row=np.zeros(3 * n + m),
            shifts=np.array(shifts),
            time_rates=np.zeros((steps, n + m)),
            q=first_q,
            v=first_v,
            ddq=first_ddq,
            a=first_a,
            lam=first_lam,
            a_predicted=np.zeros(n),
            change=np.zeros(n + m),
            results=results[count:],
            max_batch=max_batch,
        )

    def matrices(run: ReplayWorkspace) -> list[tuple[Any, FactorizedMatrix]]:
        return [(run.linear, matrix)]

    is_native = form.is_native and plan.is_native and further_plan.is_native
    loop = StepLoop(replay_steps, make_workspace, matrices, is_native)
    run = loop.work
    for first, last in groups:
        h = _step_length(times, first, last)
        if first > 0:
            at, time = State(*(x[first] for x in states)), np.array([times[first], interval.branch])
            _change_step(run, member, derivatives, all_numbers, time, at, h)
        run.coefficients[:] = member.coefficients(h)
        if any(shifts):
            _set_time_rates(run, form, states, first, last, h)
        run.h, run.last, run.tested = h, last, 0
        if loop() != DONE:
            raise BeamdaeError(
                f"{derivative_call()}: the iteration matrix is singular at t = "
                f"{times[run.step + 1]:g} s; use a smaller step, or check the model."
            )
    return results.reshape(steps + 1, count, 3 * n + m)


def _plan_residual(structure: Structure) -> SumPlan:
    return plan_step_sums(structure, False)[1][0]


def _set_time_rates(
    run: ReplayWorkspace, form: StepEquations, states: State, first: int, last: int, h: float
) -> None:
    """Set the derivatives of the residual with respect to time in steps of length `h` [s]."""
    n, coefficients = form.equations.n, run.coefficients
    for k in range(first, last):
        q, v, a, lam = (x[k + 1] for x in states)
        at = StepPrediction(q, v, a, q, coefficients)
        x = np.concatenate([np.zeros(n), coefficients[2] * lam])
        time = np.array([run.times[k + 1], run.branch])
        run.time_rates[k] = time_rate(partial(_residual_at, form, at, x), time, h)


def _residual_at(form: StepEquations, at: StepPrediction, x: Array, time: Array) -> Array:
    return form.residual(time, at, x)


def group_equal_steps(times: Array) -> Array:
    """Return the indices of the times at which the length of the step changes, and of both ends."""
    h = np.diff(times)
    rounding = _SAME_STEP * h + _TIME_ROUNDING * np.max(np.abs(times))
    changes = 1 + np.flatnonzero(np.abs(np.diff(h)) > rounding[1:])
    return np.concatenate([[0], changes, [len(h)]])


def _step_length(times: Array, first: int, last: int) -> float:
    return float((times[last] - times[first]) / (last - first))


def _change_step(
    run: ReplayWorkspace,
    member: AlphaParameters,
    derivatives: Sequence[StartDerivatives],
    numbers: Sequence[Array],
    time: Array,
    at: State,
    h: float,
) -> None:
    """Convert the derivatives to the step length `h` [s], as the step loop converts the motion."""
    ratio, square = h / run.h, (h * h - run.h * run.h) * member.defect

    def differentiate(
        x: StartDerivatives, q: Array, v: Array, a: Array, lam: Array, dp: Array, dt: Array
    ) -> tuple[Array]:
        along, interval = State(q, v, a, lam), JERK_INTERVAL * h
        return (x.normal_jerk(time, at, along, dp, interval, holonomic_only=True, dt=dt),)

    jerks = differentiate_together(
        derivatives, differentiate, run.q, run.v, run.ddq, run.lam, numbers, run.shifts
    )
    run.v += square * np.array([jerk for (jerk,) in jerks])
    run.a[:] = (1.0 - ratio) * run.ddq + ratio * run.a
