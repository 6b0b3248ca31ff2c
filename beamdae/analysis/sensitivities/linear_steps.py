"""Linear steps: derivatives of the steps of a run, forward and backward.

Every method takes steps of one form. With the motion z = (q, v, q'', a) before a step, a step of s
stages predicts their positions and velocities P z, solves the linearized equations

    M u = r,    r = F_q (P z)_q + F_v (P z)_v + F_p dp + F_t dt,

with its own matrix M for the corrections u of all stages. The corrections of velocities are
w = V u_q, except where joints make them unknowns, too; the states of all stages and the algorithmic
acceleration a after the step are linear in (z, u_q, w), and multipliers in u_lam.

`StepTables` contains these numbers for generalized-alpha, which has one stage, and for Radau IIA.
The transposed equations, solved from the last step to the first, give the gradient of an objective;
Sandu, Daescu & Carmichael, Atmos. Environ. 37 (2003) 5083, doi:10.1016/j.atmosenv.2003.08.019.

The loops are in `linear_steps.c`.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator

from beamdae.analysis.sensitivities.neighbors import derivative_call
from beamdae.analysis.sensitivities.start_derivatives import (
    Directions,
    StartDerivatives,
    plan_transpose,
)
from beamdae.core.return_codes import DONE
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.first_order import (
    formulate_first_order,
    plan_residual,
    reduce_kinematics,
)
from beamdae.equations.formulations.step_equations import formulate_step, plan_step_sums
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.structure import Structure
from beamdae.errors import BeamdaeError
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.integrators.alpha.family import AlphaParameters, family_parameters
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.integrators.radau.coefficients import A, C
from beamdae.integrators.radau.stepper import STABILIZED_FORM
from beamdae.linear.elimination import LANES, aligned_zeros
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sums.kernel_sums import SumPlan
from beamdae.symbolic.sums.sum_derivatives import direction_inputs, motion_plan

Array = np.ndarray

# Two steps are equal if they differ by less than this fraction of the step, or by a few rounding
# errors of the time.
_SAME_STEP = 1e-9
_TIME_ROUNDING = 8.0 * float(np.finfo(float).eps)


class StepTables(NamedTuple):
    """Coefficients of steps, one step a row; see the module.

    Attributes
    ----------
    by_motion, by_corrections
        Prediction of (q, v, a) of each stage and of the algorithmic acceleration after the step, by
        z, and its corrections, by u_q and w of all stages, (steps, 3s + 1, 4 and 2s).
    velocity, reaction
        V, and the multipliers by u_lam, (steps, s, s).
    blocks
        Shares of the parts of the matrix of stage i in block (i, j) of M, (steps, s s, parts).
    factors
        Matrix factors of kernels, and the factor of multipliers in the matrix, (steps, 7).
    """

    by_motion: Array
    by_corrections: Array
    velocity: Array
    reaction: Array
    blocks: Array
    factors: Array


def _tabulate_alpha(member: AlphaParameters, h: Array) -> StepTables:
    """Return the coefficients of generalized-alpha for steps `h` [s]."""
    (c_v, c_a, c_f), count, f = member.coefficients(h), len(h), 1.0 / (1.0 - member.alpha_m)
    by_motion, by_corrections = np.zeros((count, 4, 4)), np.zeros((count, 4, 2))
    by_motion[:, 3, 2:] = f * member.alpha_f, -f * member.alpha_m
    # The positions and velocities of the second and third formula of `AlphaParameters`.
    gains = h * h * member.beta, h * member.gamma
    others = (1.0, h, 0.0, 0.5 * h * h - gains[0]), (0.0, 1.0, 0.0, h - gains[1])
    for k in range(2):
        for b in range(4):
            by_motion[:, k, b] = others[k][b] + gains[k] * by_motion[:, 3, b]
    by_corrections[:, 0, 0] = by_corrections[:, 1, 1] = -1.0
    by_corrections[:, 2, 1], by_corrections[:, 3, 0] = -c_a / c_v, -1.0 / c_f
    velocity, reaction = (x[:, None, None] for x in (c_v, -1.0 / c_f))
    factors = np.stack([c_f, c_f * c_v, c_f * c_a, np.ones(count), 1.0 / c_v, 1.0 / c_f, c_f], -1)
    blocks = np.ones((count, 1, 1))
    return StepTables(by_motion, by_corrections, velocity, reaction, blocks, factors)


def _tabulate_radau(h: Array) -> StepTables:
    """Return the coefficients of Radau IIA for steps `h` [s]."""
    steps, s, rates = len(h), len(C), np.linalg.inv(A) / h[:, None, None]
    by_motion, by_corrections = (np.zeros((steps, 3 * s + 1, k)) for k in (4, 2 * s))
    i = np.arange(s)
    by_motion[:, 3 * i, 0] = by_motion[:, 3 * i + 1, 1] = 1.0
    by_motion[:, 3 * i, 1] = h[:, None] * C
    by_corrections[:, 3 * i, i] = by_corrections[:, 3 * i + 1, s + i] = -1.0
    by_corrections[:, 3 * i + 2, s:] = -rates
    blocks = np.stack([np.broadcast_to(np.eye(s), rates.shape), rates, rates @ rates], -1)
    blocks, factors = blocks.reshape(steps, s * s, 3), np.ones((steps, 7))
    return StepTables(by_motion, by_corrections, rates, -rates, blocks, factors)


# Matrices M of a run, and positions of the entries of their blocks, by the pattern of the blocks
# and whether they are transposed; pivots of the last interval are tried first.
Matrices = dict[tuple[int, bool], tuple[FactorizedMatrix, Array, sp.csc_array]]


def _plan_step_residual(structure: Structure) -> SumPlan:
    return plan_step_sums(structure, False)[1][0]


def _plan_stage_residual(structure: Structure) -> SumPlan:
    return plan_residual(structure, STABILIZED_FORM)


class _Steps:
    """Steps of an interval, and the corrections of generalized-alpha between them.

    Attributes
    ----------
    equations, interval, count, steps, tables
        Equations, states, number, lengths [s] and coefficients of the steps.
    parts
        Indices of the first step and after the last one of parts with equal steps.
    residual, n_inputs, size
        Function of a module that returns the plan of the residual of a stage, and the sizes of its
        inputs and of the residual. The inputs begin with (q, v).
    rows, corrected
        Rows of the residual that are solved, (k,), and coordinates whose velocities are unknowns,
        because joints correct q' = v.
    nodes
        Times of the stages in a step of length 1, (s,).
    """

    def __init__(
        self,
        method: GeneralizedAlpha | Radau,
        equations: EquationsOfMotion,
        interval: Interval,
        matrices: Matrices,
    ) -> None:
        n, m = equations.n, equations.m
        self.equations, self.interval, self._matrices = equations, interval, matrices
        self.count, self.is_alpha = len(interval.t) - 1, isinstance(method, GeneralizedAlpha)
        self.parts, self.steps = [(0, self.count)], np.diff(interval.t)
        if isinstance(method, GeneralizedAlpha):
            self.parts = list(pairwise(_group_equal_steps(interval.t)))
            for first, last in self.parts:
                length = float((interval.t[last] - interval.t[first]) / (last - first))
                self.steps[first:last] = length
            self.member = family_parameters(method.family, method.rho_inf)
            self.tables = _tabulate_alpha(self.member, self.steps)
            self._is_cured = method.start == "cured"
            step = formulate_step(equations, False)
            self._matrix, self._pattern = step.sums[2], step.pattern
            self.residual, self.n_inputs, self.size = _plan_step_residual, 4 * n + 2 * m, n + m
            self._acceleration_at, self.nodes = 2 * n, np.ones(1)
            self.rows, self.corrected = np.arange(n + m), np.arange(0)
            return
        self.tables = _tabulate_radau(self.steps)
        form = formulate_first_order(equations, STABILIZED_FORM, apart=True)
        self._pattern, self._matrix, reduction = reduce_kinematics(form)
        self.residual, self.n_inputs, self.size = _plan_stage_residual, 2 * form.size, form.size
        self._acceleration_at, self.nodes = form.size + n, C
        self.corrected = reduction.corrected.astype(int)
        rows = np.arange(n, 2 * n), self.corrected, np.arange(2 * n, form.size)
        self.rows = np.concatenate(rows)

    def node(self, k: int) -> tuple[Array, State]:
        """Return (t, branch) and the state at the start of step `k`."""
        x = self.interval
        return np.array([x.t[k], x.branch]), State(*(y[k] for y in x.state))

    def initial_motion(self, maps: StartDerivatives) -> LinearOperator:
        """Return the map to the starting values of generalized-alpha."""
        return maps.initial_motion(self.member, self._is_cured, *self.node(0), float(self.steps[0]))

    def change_step(self, k: int, maps: StartDerivatives) -> tuple[float, float, LinearOperator]:
        """Return the ratio of the step `k` to the one before, and the correction of velocities.

        The correction is the factor of the jerk, and the map to the jerk.
        """
        before, after = self.steps[k - 1 : k + 1]
        square = (after * after - before * before) * self.member.defect
        return after / before, square, maps.jerk_map(*self.node(k), float(after))

    def _scales(self, step: int) -> Array:
        """Return the scales of the rows of the residual."""
        e, scales = self.equations, np.ones(len(self.rows))
        if self.is_alpha:
            scales[: e.n] = self.tables.factors[step, 6]
            scales[e.n + e.nonholonomic_rows] = 1.0 / self.tables.velocity[step, 0, 0]
        return scales

    def make_loop(
        self, loop: str, plan: SumPlan, e: EquationsOfMotion, **fields: Any
    ) -> StepLoop[Workspace]:
        """Return a loop; `plan` is that of its sum `change`, for the numbers of `e`."""
        s, n, nnz = len(self.nodes), e.n, self._pattern.nnz
        key = id(self._pattern), loop == "backward"
        if key in self._matrices:
            source, targets, _ = self._matrices[key]
            source.pivot_source = None  # Runs may have thousands of intervals.
            matrix = FactorizedMatrix.from_pattern(source.pattern, pivot_source=source)
        else:
            pattern, targets = _join_blocks(self._pattern, s, loop == "backward")
            matrix = FactorizedMatrix.from_pattern(pattern)
        self._matrices[key] = matrix, targets, self._pattern  # whose id is not reused
        sizes = self.n_inputs, self.size
        n_further, n_result = sizes[::-1] if loop == "backward" else sizes
        common = {
            "n": n,
            "m": e.m,
            "branch": float(self.interval.branch),
            "times": np.ascontiguousarray(self.interval.t),
            "nodes": self.nodes,
            "states": np.hstack(self.interval.rows),
            "tables": self.tables,
            "parts": np.zeros(self.tables.blocks.shape[-1] * nnz + (s > 1)),
            "block": np.zeros(nnz),
            "nonzeros": matrix.nonzeros,
            "targets": targets,
            "entries": np.arange(max(nnz, len(self.rows)), dtype=np.uint32),
            "inputs": np.zeros(self.n_inputs + n_further),
            "n_inputs": self.n_inputs,
            "acceleration_at": self._acceleration_at,
            "rows": self.rows.astype(np.uint32),
            "scales": np.ones(len(self.rows)),
            "corrected": self.corrected.astype(np.uint32),
            "right": np.zeros((1, s * len(self.rows))),
            "corrections": np.zeros((2 * s, n)),
            "after": np.zeros((3 * s + 1, n)),
            "result": np.zeros(n_result + (len(e.p) if loop == "backward" else 0)),
            **fields,
        }

        work = Workspace(
            "LinearSteps",
            matrix=self._matrix.sum(True, self.equations.p),
            linear=matrix.make_solver(),
            change=plan.sum(True, e.p),
            **common,
        )
        return StepLoop(loop, work, (work.linear, matrix))

    def run(self, call: str, loop: StepLoop[Workspace], first: int, last: int) -> None:
        """Run a loop from step `first` to step `last`, which may be before it.

        `call` is the function that the user called, for messages.
        """
        run = loop.work
        run.step, run.last = int(first), int(last)
        run.scales[:] = self._scales(min(first, last))
        code = loop()
        if code != DONE or not np.all(np.isfinite(run.motion)):
            raise BeamdaeError(
                f"{call}: the matrix of the step after t = "
                f"{self.interval.t[min(run.step, self.count - 1)]:g} s is singular, or derivatives "
                "are not finite; use smaller steps or tolerances, or check the model."
            )


def differentiate_steps(
    method: GeneralizedAlpha | Radau,
    directions: Directions,
    equations: EquationsOfMotion,
    interval: Interval,
    starts: Array,
    shifts: Array,
    matrices: Matrices,
) -> Array:
    """Return the derivatives of (q, v, a, lam) at the start and the stages of a smooth interval.

    If the time t of the start depends on a parameter, all steps are moved with it. Derivatives s
    at fixed times follow from those along the moved steps, s + x' dt. Moving the state instead, by
    -x' dt at the start, would be wrong for motions that are too fast for the steps: x' is large
    there, and the steps do not damp it as fast as they damp the motion.

    Parameters
    ----------
    method
        Settings of the run.
    directions
        Directions of parameters.
    equations, interval
        Equations and states of the run.
    starts
        Derivatives (k, 3n + m) of the consistent state (q, v, a, lam) along the moved start.
    shifts
        Derivatives of the time of the start, (k,) [s].
    matrices
        Matrices of the other intervals.

    Returns
    -------
    numpy.ndarray
        Derivatives (stages + 1, k, 3n + m) along the moved steps; the first rows are `starts`.

    Raises
    ------
    BeamdaeError
        If the matrix is singular at a step.
    """
    steps = _Steps(method, equations, interval, matrices)
    maps, n, count = directions.maps, equations.n, len(shifts)
    motion = np.zeros((count, 4, n))
    if steps.is_alpha:
        along = maps.along(steps.initial_motion(maps), starts, directions.numbers, shifts)
        motion[:] = along.reshape(motion.shape)
    else:
        motion[:, :2] = starts[:, : 2 * n].reshape(count, 2, n)
    stages = steps.count * len(steps.nodes)
    results = np.zeros(((stages + 1) * count, 3 * n + equations.m))
    results[:count] = starts

    rates = _time_rates(steps, maps) if shifts.any() else None
    loop = _make_forward_loop(steps, directions, motion, shifts, rates, results[count:])
    z = loop.work.motion.reshape(count, 4, n)
    for first, last in steps.parts:
        if first > 0:
            ratio, square, jerk_map = steps.change_step(first, maps)
            state = z[:, :3].reshape(count, -1)
            jerks = maps.along(jerk_map, state, directions.numbers, shifts)
            z[:, 1] += square * jerks
            z[:, 3] = (1.0 - ratio) * z[:, 2] + ratio * z[:, 3]
        steps.run(derivative_call(), loop, first, last)
    return results.reshape(stages + 1, count, -1)


def propagate_disturbances(
    equations: EquationsOfMotion, interval: Interval, disturbances: Array, matrices: Matrices
) -> Array:
    """Return the disturbances of (q, v) at the end of an interval, one a row, (k, 2 n).

    Parameters
    ----------
    equations, interval
        Equations and states of a run of `Radau`.
    disturbances
        Those at the start, (k, 2 n).
    matrices
        Matrices of the other intervals.

    Raises
    ------
    BeamdaeError
        If the matrix is singular at a step.
    """
    steps, count, n = _Steps(Radau(), equations, interval, matrices), len(disturbances), equations.n
    maps = StartDerivatives(ConsistencySolver(equations))
    directions = Directions(maps, np.arange(count), np.zeros((count, len(equations.p))))
    motion = np.zeros((count, 4, n))
    motion[:, :2] = disturbances.reshape(count, 2, n)
    loop = _make_forward_loop(
        steps, directions, motion, np.zeros(count), None, np.zeros((0, 3 * n + equations.m))
    )
    steps.run("periodic", loop, 0, steps.count)
    return loop.work.motion.reshape(count, 4, n)[:, :2].reshape(count, 2 * n)


def _make_forward_loop(
    steps: _Steps,
    directions: Directions,
    motion: Array,
    shifts: Array,
    time_rates: Array | None,
    results: Array,
) -> StepLoop[Workspace]:
    """Return the loop for directions from `motion` (k, 4, n) on; None for no rates of time."""
    maps, (count, _, n), s = directions.maps, motion.shape, len(steps.nodes)
    plan = maps.plan_along(steps.residual, steps.n_inputs)
    size = s * len(steps.rows)
    return steps.make_loop(
        "forward",
        motion_plan(plan, steps.n_inputs),
        maps.equations,
        motion=motion.reshape(-1, n).copy(),
        data=direction_inputs(plan, steps.n_inputs, maps.equations.p, directions.numbers),
        shifts=shifts,
        time_rates=np.zeros((0, steps.size)) if time_rates is None else time_rates,
        stages=results,
        right=np.zeros((count, size)),
        lanes=aligned_zeros(4 * LANES * size),
        after=np.zeros((count * (3 * s + 1), n)),
    )


def _time_rates(steps: _Steps, maps: StartDerivatives) -> Array:
    """Return the time derivatives of the residuals of steps of generalized-alpha, by steps."""
    x, rates = np.zeros(steps.n_inputs), []
    for k, h in enumerate(steps.steps.tolist(), 1):
        time, at = steps.node(k)
        x[: sum(map(len, at))] = np.concatenate(at)
        rates.append(maps.differentiate(steps.residual, time, x, steps.size, h).time_rate)
    return np.array(rates)


def transpose_steps(
    method: GeneralizedAlpha | Radau,
    start: StartDerivatives,
    interval: Interval,
    seeds: Array,
    matrices: Matrices,
) -> tuple[Array, Array]:
    """Return the gradient of an objective by the state at the start of an interval, and by p.

    Parameters
    ----------
    method
        Settings of the run.
    start
        Maps of the equations of the interval.
    interval
        States of the run.
    seeds
        Derivatives of the objective with respect to (q, v, lam) at the stages, (stages, 2n + m).
    matrices
        Matrices of the other intervals.

    Raises
    ------
    BeamdaeError
        If the matrix is singular at a step.
    """
    e = start.equations
    steps = _Steps(method, e, interval, matrices)
    plan = plan_transpose(e.structure, steps.residual, steps.n_inputs)

    loop = steps.make_loop(
        "backward",
        plan,
        e,
        motion=np.zeros((4, e.n)),
        stages=np.ascontiguousarray(seeds),
        numbers=np.zeros(len(e.p)),
    )
    run, numbers = loop.work, np.zeros(len(e.p))
    for first, last in reversed(steps.parts):
        if last < steps.count:
            ratio, square, jerk_map = steps.change_step(last, start)
            by_state, by_numbers = start.gradient(jerk_map, square * run.motion[1])
            numbers += by_numbers
            run.motion[:3] += by_state[: 3 * e.n].reshape(3, e.n)
            run.motion[2] += (1.0 - ratio) * run.motion[3]
            run.motion[3] *= ratio
        steps.run(derivative_call(), loop, last, first)
    numbers += run.numbers
    if not steps.is_alpha:
        return np.concatenate([*run.motion[:2], np.zeros(e.n + e.m)]), numbers
    by_start, by_numbers = start.gradient(steps.initial_motion(start), run.motion.ravel())
    return by_start, numbers + by_numbers


def _join_blocks(pattern: sp.csc_array, s: int, transposed: bool) -> tuple[sp.csc_array, Array]:
    """Return the pattern of s x s blocks, or its transpose, and the positions of their entries."""
    size, count = pattern.shape[0], s * s * pattern.nnz
    i, j = np.divmod(np.arange(s * s)[:, None], s)
    columns = np.repeat(np.arange(size), np.diff(pattern.indptr))
    places = (i * size + pattern.indices).ravel(), (j * size + columns).ravel()
    # Data are the numbers of the entries.
    numbers, shape = np.arange(count), (s * size, s * size)
    whole = sp.csc_array((numbers, places[::-1] if transposed else places), shape=shape)
    whole.sort_indices()
    targets = np.empty(count, np.uint32)
    targets[whole.data] = numbers
    joined = sp.csc_array((np.ones(count), whole.indices, whole.indptr), shape=shape)
    return joined, targets.reshape(s * s, -1)


def _group_equal_steps(times: Array) -> Array:
    """Return the indices of the times at which the length of the step changes, and of both ends."""
    h = np.diff(times)
    rounding = _SAME_STEP * h + _TIME_ROUNDING * np.max(np.abs(times))
    changes = 1 + np.flatnonzero(np.abs(np.diff(h)) > rounding[1:])
    return np.concatenate([[0], changes, [len(h)]])
