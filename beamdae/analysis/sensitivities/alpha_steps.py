"""Steps of a generalized-alpha run that are differentiated, and the matrices at their ends.

The functions of a workspace are plain Python over arrays; `native.loops` compiles them if possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.step_equations import (
    StepEquations,
    StepMatrix,
    evaluate_matrices,
    evaluate_matrix_at_state,
    set_lane,
)
from beamdae.integrators.alpha.family import AlphaParameters
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.linear.lane_operations import LANES
from beamdae.native.batch_elimination import BatchSolver, factorize_batch, select_factors
from beamdae.native.loop_functions import combine, factorize
from beamdae.native.return_codes import DONE
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import SumPlan
from beamdae.symbolic.sums.lane_sums import LaneSum, create_lane_sum, empty_lane_sum, has_lane_code

Array = np.ndarray

# Two steps are equal if they differ by less than this fraction of the step, or by a few rounding
# errors of the time.
_SAME_STEP = 1e-9
_TIME_ROUNDING = 8.0 * float(np.finfo(float).eps)
# Non-zeros of the largest matrix of which several are factorized together: larger ones do not fit
# into the processor caches.
_MAX_BATCH_NONZEROS = 16000


@dataclass(slots=True, kw_only=True)
class AlphaSteps:
    """Work arrays of a loop over the steps of a run.

    Attributes
    ----------
    form, lanes, linear, nonzeros
        Equations of a step, their matrices at several steps, and the linear solver and non-zeros of
        the matrix.
    alpha_m, alpha_f, gamma, beta
        Parameters of the method; see `family.AlphaParameters`.
    coefficients
        Factors (c_v, c_a, c_f) of `StepEquations`.
    h, branch
        Step, and a time inside the interval [s].
    times, states, first_column, row
        Times (steps + 1,) [s] and states at the start and after the steps, see `join_states`, and
        work array for one state (q, v, a, lam), (3n + m,).
    a_predicted, change
        Work array for the predicted algorithmic acceleration, (n,), and right-hand side or solution
        of a step, (n + m,).
    max_batch
        Number of steps whose matrices are factorized together, 1 or `LANES`.
    staged, lane
        Number of matrices that were factorized together, and index of the next one of these.
    """

    form: StepMatrix
    lanes: LaneSum
    linear: Any
    nonzeros: Array
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    coefficients: Array
    h: float = 0.0
    branch: float
    times: Array
    states: Array
    first_column: int
    row: Array
    a_predicted: Array
    change: Array
    max_batch: int
    staged: int = 0
    lane: int = 0


def prepare_steps(
    form: StepEquations,
    plan: SumPlan,
    matrix: FactorizedMatrix,
    member: AlphaParameters,
    interval: Interval,
) -> Callable[[bool], dict[str, Any]]:
    """Return a function that returns the fields of `AlphaSteps`, for machine code or not.

    Parameters
    ----------
    form
        Equations of a step.
    plan, matrix
        Sum of the matrix, or of its transpose, and its factors.
    member
        Parameters of the method.
    interval
        States of the run.
    """
    n, m, p = form.equations.n, form.equations.m, form.equations.p
    rows, first_column = join_states(interval.state)

    def make_fields(native: bool) -> dict[str, Any]:
        linear, max_batch, lanes = _make_step_solver(native, matrix, plan, 4 * n + 2 * m, p)
        return {
            "form": form.matrix_buffers(native, plan),
            "lanes": lanes,
            "linear": linear,
            "nonzeros": matrix.nonzeros,
            "alpha_m": member.alpha_m,
            "alpha_f": member.alpha_f,
            "gamma": member.gamma,
            "beta": member.beta,
            "coefficients": np.zeros(3),
            "branch": float(interval.branch),
            "times": np.ascontiguousarray(interval.t),
            "states": rows,
            "first_column": first_column,
            "row": np.zeros(3 * n + m),
            "a_predicted": np.zeros(n),
            "change": np.zeros(n + m),
            "max_batch": max_batch,
        }

    return make_fields


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


def copy_state(run: AlphaSteps, k: int, row: Array) -> None:
    """Write state `k` to `row`."""
    combine(row, (1.0,), (run.states[k][run.first_column : run.first_column + row.size],))


def factorize_ahead(run: AlphaSteps, step: int, direction: int, remaining: int) -> int:
    """Provide the factors of a step; return DONE, NEW_PIVOTS or SINGULAR.

    If there are none left, the matrices of the next steps are factorized together. Matrices that do
    not suit the pivots of the others are factorized one by one.

    Parameters
    ----------
    run
        The work arrays.
    step
        Index of the state at the end of the step.
    direction
        1 if later steps follow, -1 if earlier ones.
    remaining
        Number of steps of equal length that remain.
    """
    if run.lane == run.staged:
        run.lane = run.staged = 0
        if 1 < run.max_batch <= remaining and run.linear.plan.rows.size > 0:
            _factorize_lanes(run, step, direction)
            run.staged = run.max_batch
    if run.lane < run.staged and select_factors(run.linear, run.lane):
        run.lane += 1
        return DONE
    run.lane = run.staged = 0
    copy_state(run, step, run.row)
    evaluate_matrix_at_state(
        run.form, run.times[step], run.branch, run.coefficients, run.row, run.nonzeros
    )
    return factorize(run.linear, run.nonzeros)


def _factorize_lanes(run: AlphaSteps, step: int, direction: int) -> None:
    """Factorize the matrices of `LANES` steps."""
    first, size, lam_factor = run.first_column, run.row.size, run.coefficients[2]
    for lane in range(LANES):
        k = step + direction * lane
        row = run.states[k][first : first + size]
        set_lane(run.lanes, lane, run.times[k], row, run.form.n, lam_factor)
    evaluate_matrices(run.lanes, run.branch, run.coefficients, run.linear.batch.entries)
    factorize_batch(run.linear)


def _make_step_solver(
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


def group_equal_steps(times: Array) -> Array:
    """Return the indices of the times at which the length of the step changes, and of both ends."""
    h = np.diff(times)
    rounding = _SAME_STEP * h + _TIME_ROUNDING * np.max(np.abs(times))
    changes = 1 + np.flatnonzero(np.abs(np.diff(h)) > rounding[1:])
    return np.concatenate([[0], changes, [len(h)]])


def step_length(times: Array, first: int, last: int) -> float:
    """Return the length of the steps between two indices [s]."""
    return float((times[last] - times[first]) / (last - first))
