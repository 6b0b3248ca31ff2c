"""Derivatives of consistent states and of the start of generalized-alpha runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.operator_changes import directional_plan_along
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.formulations.sums import InputLayout, assemble_motion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import (
    SECOND_DIFFERENCE,
    StateSums,
    plan_constraint_levels,
    plan_state_sums,
)
from beamdae.equations.structure import Structure, cache_on_owner, share_plans
from beamdae.integrators.alpha.family import JERK_INTERVAL, STIFF_TIME, AlphaStart
from beamdae.integrators.alpha.workspace import Motion
from beamdae.linear.factorizations import Factorization, create_factorization
from beamdae.symbolic.sparse_operators import column_indices
from beamdae.symbolic.sums.directional_sums import (
    StackedSum,
    direction_inputs,
    directional_plan,
    motion_plan,
)
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan

Array = np.ndarray
Numbers = float | Array

# Coefficients of stiffness, damping and mass in the saddle-point matrix.
_MASS = (0.0, 0.0, 1.0)
_CLOSING = (1.0, 0.0, 1.0)
# Difference of time for matrices that contain the time, relative to the time scale of the laws.
_TIME_DIFFERENCE = 1e-5
# Larger corrections of a differenced equilibrium, relative to the difference, are motions without
# stiffness.
_MAX_EQUILIBRIUM_CORRECTION = 1e-4
# Larger errors of a solution of the static equations show that the equilibrium is not unique. Those
# of stiff beams reach 1e-7. The second limit applies to the same equilibrium, perhaps with other
# rounding errors.
_MAX_EQUILIBRIUM_ERROR = 1e-6
_MAX_CORRECTED_EQUILIBRIUM_ERROR = 1e-5
# Difference of time for partial derivatives with respect to time, relative to the step.
_STEP_FRACTION = 1e-3
# Stiffnesses of contacts are proportional to the square root of the penetration, whose slope has no
# bound. Up to this penetration [m], starting values are differentiated with constant stiffnesses:
# a slope at a penetration of 1e-15 m, due to rounding, would dominate the derivatives of the run.
# From this penetration on, the effect of the slopes was less than 1e-3 of a derivative.
MIN_STIFF_PENETRATION = 1e-6
# Stored factors and accelerations of states, which all directions need.
_MAX_STATES = 8


@share_plans
def _plan_motion(structure: Structure) -> SumPlan:
    """Return the plan of (F, g, g_dot, g_ddot, G^T lam) with the inputs (q, v, a, lam)."""
    n = structure.n
    layout = InputLayout(q=0, v=n, a=2 * n, lam=3 * n)
    return assemble_motion(structure, layout, with_reactions=True).vector()


@cache_on_owner
def _plan_smooth_motion(structure: Structure) -> SumPlan:
    return plan_state_sums(structure).smooth_motion


@cache_on_owner
def _plan_gradients(structure: Structure) -> SumPlan:
    return plan_state_sums(structure).gradients


@cache_on_owner
def _plan_change(structure: Structure) -> SumPlan:
    """Return the plan of the derivative of the motion along a change of the state."""
    return directional_plan(_plan_motion(structure), 3 * structure.n + structure.m)


@cache_on_owner
def _plan_directional_sum(
    structure: Structure, plan: Callable[[Structure], SumPlan], n_inputs: int, min_base: float
) -> SumPlan:
    return directional_plan(plan(structure), n_inputs, min_base=min_base)


@dataclass(eq=False)
class _Store:
    """Results by the arrays that they depend on; all are removed if there are `limit` of them."""

    limit: int
    results: dict[Any, Any] = field(default_factory=dict)

    def get(
        self, key: tuple[Any, ...], arrays: Sequence[Array | None], build: Callable[[], Any]
    ) -> Any:
        """Return the result for a key and arrays, built if it is not stored."""
        key = (*key, *(None if x is None else x.tobytes() for x in arrays))
        if key not in self.results:
            if len(self.results) >= self.limit:
                self.results.clear()
            self.results[key] = build()
        return self.results[key]


def factorize_equilibrium(matrix: sp.csc_array) -> tuple[Any, sp.csc_array, float]:
    """Return the factors of static equations (None if singular), the matrix, and their error.

    The error is that of a solution, relative to its entries. It is large if the equilibrium is not
    unique.
    """
    try:
        factors = splu(matrix)
    except RuntimeError:
        return None, matrix, np.inf
    expected = np.ones(matrix.shape[0])
    return factors, matrix, float(np.max(np.abs(factors.solve(matrix @ expected) - expected)))


def has_unique_equilibrium(equations: EquationsOfMotion, time: Array) -> bool:
    """Return True if derivatives of the equilibrium at the start follow from static equations."""
    at = ConsistencySolver(equations).state(time, equations.q0, np.zeros(equations.n))
    matrix = StaticEquations(equations, time).matrix(at.q, at.lam)
    return factorize_equilibrium(matrix)[-1] <= _MAX_EQUILIBRIUM_ERROR


@dataclass(frozen=True)
class StartDerivatives:
    """Derivatives of consistent states along directions of the state and of the numbers p.

    The consistent velocities, accelerations, multipliers and jerks are solutions z of saddle-point
    systems A z = b (see `ConsistencySolver`), so that A dz = db - dA z. The derivatives dA and db
    are exact directional derivatives of the kernels.

    Attributes
    ----------
    solver
        Solver for consistent states.
    moving
        Models at neighboring values of the parameter of all directions, if operators of joints
        depend on it; otherwise None.

    Times are arrays (t, branch). A direction is a change of the state together with `dp`, the
    change of the numbers of the model, (n_p,), and perhaps `dt`, the change of the time [s].
    Several directions are differentiated together: their arrays have a leading axis (k, ...), as do
    the results. One call for five directions takes little longer than one for a single direction.
    """

    solver: ConsistencySolver
    moving: Difference | None = None
    _states: _Store = field(default_factory=lambda: _Store(_MAX_STATES), init=False, repr=False)
    _levels_of_states: _Store = field(
        default_factory=lambda: _Store(_MAX_STATES), init=False, repr=False
    )

    def directional_plan(
        self,
        plan: Callable[[Structure], SumPlan],
        n_inputs: int,
        min_base: float = 0.0,
    ) -> SumPlan:
        """Return the directional derivative of a sum with inputs of size `n_inputs`.

        `plan` returns the plan of the sum of a structure; it is a function of a module, because
        plans are cached by function. For `min_base`, see `expand_powers`.
        """
        if self.moving is not None:
            return directional_plan_along(
                self.moving, lambda e: plan(e.structure), n_inputs, min_base
            )
        return _plan_directional_sum(self.equations.structure, plan, n_inputs, min_base)

    def direction_sum(
        self, plan: SumPlan, n_inputs: int, native: bool, numbers: Array
    ) -> tuple[Sum, Array]:
        """Return the sum and the inputs of all directions for `evaluate_with_data`.

        `plan` is a result of `directional_plan`; `numbers` are the derivatives of p, one direction
        a row.
        """
        p = self.equations.p
        total = motion_plan(plan, n_inputs).sum(native, p)
        return total, direction_inputs(plan, n_inputs, p, numbers)

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the solver."""
        return self.solver.equations

    @property
    def _sums(self) -> StateSums:
        return self.solver.sums

    def _stack(
        self, plan: Callable[[Structure], SumPlan], n_inputs: int, min_base: float = 0.0
    ) -> StackedSum:
        return StackedSum(self.directional_plan(plan, n_inputs, min_base), self.equations.p)

    @property
    def _state_size(self) -> int:
        """Number of entries of the state (q, v, a, lam)."""
        return 3 * self.equations.n + self.equations.m

    @cached_property
    def _motion(self) -> StackedSum:
        return self._stack(_plan_motion, self._state_size)

    @cached_property
    def _smooth_motion(self) -> StackedSum:
        return self._stack(_plan_smooth_motion, self._state_size)

    @cached_property
    def _levels(self) -> StackedSum:
        return self._stack(plan_constraint_levels, self._state_size)

    @cached_property
    def _gradients(self) -> StackedSum:
        return self._stack(_plan_gradients, self._state_size)

    @cached_property
    def _change(self) -> StackedSum:
        n_inputs = 2 * self._state_size + len(self.equations.p)
        return self._stack(_plan_change, n_inputs, MIN_STIFF_PENETRATION)

    def consistent_state(
        self,
        time: Array,
        at: State,
        v: Array,
        dq: Array,
        dv: Array,
        dp: Array,
    ) -> State:
        """Return the derivative of the consistent state near requested positions and velocities.

        Parameters
        ----------
        time, at
            (t, branch), and the consistent state.
        v
            Requested velocities.
        dq, dv, dp
            Derivatives of the requested positions, which close the joints except for rounding,
            of the requested velocities, and of the numbers.
        """
        dq = self.project_positions(time, at.q, dq, dp, 0.0)
        dv = self.project_velocities(time, at.q, v, dq, dv, dp, 0.0)
        return self._state_at_fixed_time(time, at, dq, dv, dp, 0.0)

    def _state_at_fixed_time(
        self, time: Array, at: State, dq: Array, dv: Array, dp: Array, dt: Numbers
    ) -> State:
        """Return the derivative of the state at fixed time, for (dq, dv) along a moving time."""
        dq, dv = dq - np.multiply.outer(dt, at.v), dv - np.multiply.outer(dt, at.a)
        dv = self._with_state_rates(time, at, dq, dv, dp)
        along = State(dq, dv, *self._zeros[1:])
        return State(dq, dv, *self.acceleration(time, at, along, dp))

    def restart_states(
        self,
        time: Array,
        at: State,
        v: Array,
        dq: Array,
        dv: Array,
        dp: Array,
        dt: Numbers,
        h: float,
    ) -> tuple[State, State]:
        """Return the derivatives of a consistent state along its moving time, and at fixed time.

        For the arguments, see `consistent_state`; `dq` and `dv` are derivatives along the moving
        time, `dt` is that of the time of the restart [s], and `h` the step after it [s].
        """
        dq = self.project_positions(time, at.q, dq, dp, dt)
        dv = self.project_velocities(time, at.q, v, dq, dv, dp, dt)
        first = self._state_at_fixed_time(time, at, dq, dv, dp, dt)
        if not np.any(dt):
            return first, first
        dv = self._with_state_rates(time, at, dq, dv, dp)
        if len(self.equations.states):
            rates = time_rate(lambda t: self.solver.force(t, at.q, at.v), time, h)
            states = self.equations.states
            dv[..., states] -= np.multiply.outer(dt, rates[states])
        da, dlam = self.acceleration(time, at, State(dq, dv, *self._zeros[1:]), dp)
        rates = time_rate(
            lambda t: np.concatenate(self.solver.acceleration(t, at.q, at.v)), time, h
        )
        a_rate, lam_rate = np.split(np.multiply.outer(dt, rates), [self.equations.n], axis=-1)
        return State(dq, dv, da + a_rate, dlam + lam_rate), first

    def project_positions(
        self, time: Array, q: Array, dq: Array, dp: Array, dt: Numbers = 0.0
    ) -> Array:
        """Return dq, changed least so that G dq + dg/dp dp + dg/dt dt = 0."""
        e = self.equations
        if e.m == 0:
            return dq
        levels = self._evaluate_levels(time, State(q, *self._zeros), State(dq, *self._zeros), dp)
        gap_rate = self._constraint_levels(time, q)[1].copy()
        gap_rate[e.nonholonomic_rows] = 0.0
        gap = levels[..., 0, :] + np.multiply.outer(dt, gap_rate)
        factors = self._factorize(time, q, np.zeros(e.n), _CLOSING)
        change = _solve_each(factors, self._constraint_rows(-gap))[..., : e.n]
        change[..., e.states] = 0.0
        return dq + change

    def _with_state_rates(self, time: Array, at: State, dq: Array, dv: Array, dp: Array) -> Array:
        """Return dv with the derivatives of `ConsistencySolver.with_state_rates`."""
        states = self.equations.states
        if not len(states):
            return dv
        along = State(dq, dv, *self._zeros[1:])
        change = self._evaluate_motion(time, at._replace(lam=self._zeros[2]), along, dp)[0]
        dv = dv.copy()
        dv[..., states] -= change[..., states]
        return dv

    def constraint_gradients(
        self, time: Array, q: Array, dq: Array, dp: Array
    ) -> tuple[Array, Array]:
        """Return G at positions q, and its derivative along (dq, dp), (m, n) each."""
        at, along, pattern = State(q, *self._zeros), State(dq, *self._zeros), self._gradient_pattern
        change = self._evaluate(self._gradients, time, (*at, *along, dp), pattern.nnz)
        matrix = sp.csc_array((change, pattern.indices, pattern.indptr), shape=pattern.shape)
        return self.solver.constraint_matrix(time, q).toarray(), matrix.toarray()

    def correct_equilibrium(self, time: Array, at: State, dq: Array, dp: Array) -> Array:
        """Return the derivative of equilibrium positions, given an approximation dq.

        It solves [[K, G^T + dF/dlam], [G, 0]] (dq, dlam) = -(dF/dp dp + d(G^T lam)/dp dp, dg/dp dp)
        with K = d(F + G^T lam)/dq. If the equilibrium is not unique, dq is corrected only if the
        correction is small.
        """
        e = self.equations
        rest, zeros = State(at.q, *self._zeros), State(dq, *self._zeros)
        rest = rest._replace(lam=at.lam)
        force, levels, reactions = self._evaluate_motion(time, rest, zeros, dp)
        residual = np.concatenate([force + reactions, levels[0]])
        factors, matrix, error = self._states.get(
            ("equilibrium",),
            (time, at.q, at.lam),
            lambda: factorize_equilibrium(StaticEquations(e, time).matrix(at.q, at.lam)),
        )
        if factors is None:
            return dq
        solution = factors.solve(-residual)
        if error <= _MAX_CORRECTED_EQUILIBRIUM_ERROR:
            return dq + (solution + factors.solve(-residual - matrix @ solution))[: e.n]
        change = solution[: e.n]
        size = np.max(np.abs(dq), initial=0.0)
        is_small = np.max(np.abs(change), initial=0.0) <= _MAX_EQUILIBRIUM_CORRECTION * size
        return dq + change if is_small else dq

    def project_velocities(
        self,
        time: Array,
        q: Array,
        v: Array,
        dq: Array,
        dv: Array,
        dp: Array,
        dt: Numbers = 0.0,
    ) -> Array:
        """Return the derivative of the consistent velocities nearest to v.

        (dq, dv, dp, dt) are derivatives of the positions, requested velocities, numbers and time.
        """
        e = self.equations
        if e.m == 0:
            return dv
        at, along = State(q, v, *self._zeros[1:]), State(dq, dv, *self._zeros[1:])
        rates, change = self._constraint_rates(time, at, along, dp, dt)
        b, db = self._constraint_rows(-rates), self._constraint_rows(-change)
        return dv + self._solve(time, at, along, dp, b, db, dt)[1][..., : e.n]

    def impact(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        dt: Numbers,
        active: Array,
        restitution: tuple[Array, Array],
    ) -> Array:
        """Return the derivative of the velocities after an impact, see `impacts.apply_impact`.

        Parameters
        ----------
        time, at
            (t, branch), and the state before the impact.
        along, dp, dt
            Total derivatives of this state, and derivatives of the numbers and of the time [s].
        active
            Indices of the constraints that act.
        restitution
            Coefficients of restitution of all constraints and their derivatives, (m,) each.
        """
        n = self.equations.n
        rates, change = self._constraint_rates(time, at, along, dp, dt)
        coefficients, by_parameter = restitution
        zeros = np.zeros(n)
        b = np.concatenate([zeros, -(1.0 + coefficients) * rates])
        db = np.concatenate([zeros, -(1.0 + coefficients) * change - by_parameter * rates])
        kept = np.concatenate([np.arange(n), n + active])
        factors = splu(sp.csc_array(self._saddle_matrix(time, at)[kept][:, kept]))
        z = np.zeros(len(b))
        z[kept] = factors.solve(b[kept])
        change = self._multiply_change(time, at, along, dp, z, dt)
        return along.v + factors.solve((db - change)[kept])[:n]

    def _constraint_rates(
        self, time: Array, at: State, along: State, dp: Array, dt: Numbers
    ) -> tuple[Array, Array]:
        """Return g_dot at (q, v), and its derivative along (dq, dv, dp, dt), (m,) each."""
        levels = self._constraint_levels(time, at.q, at.v)
        change = self._evaluate_levels(time, at, along, dp)[..., 1, :]
        if np.any(dt):
            # The partial derivative with respect to t is what g_ddot contains beyond that of q.
            motion, still = State(at.v, *self._zeros), np.zeros(dp.shape[-1])
            rates = levels[2] - self._evaluate_levels(time, at, motion, still)[1]
            change = change + np.multiply.outer(dt, rates)
        return levels[1], change

    def acceleration(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        stiff_time: float = 0.0,
    ) -> tuple[Array, Array]:
        """Return the derivatives of `ConsistencySolver.acceleration` along (dq, dv, dp).

        `at.a` and `at.lam` are the consistent accelerations and multipliers for this `stiff_time`;
        `along.a` and `along.lam` are ignored.
        """
        n = self.equations.n
        along = State(along.q, along.v, *self._zeros[1:])
        force, levels, reactions = self._evaluate_motion(time, at, along, dp)
        if stiff_time:
            rest, direction = at._replace(a=np.zeros(n)), State(stiff_time**2 * at.a, *self._zeros)
            force = force + self._evaluate_change(time, rest, direction, along, dp)[0]
            force = force + self._force_change(time, rest, along, dp, stiff_time)
        total = np.concatenate([force + reactions, levels[..., 2, :]], axis=-1)
        coefficients = (stiff_time**2, 0.0, 1.0)
        factors = self._factorize(time, at.q, at.v, coefficients, at.lam)
        solution = _solve_each(factors, -total)
        return solution[..., :n], solution[..., n:]

    def _force_change(self, time: Array, at: State, along: State, dp: Array, delta: float) -> Array:
        """Return the derivative of `ConsistencySolver.evaluate_force_change`."""
        e, result = self.equations, np.zeros(1)
        velocities, changes = (delta * e.without_states(x.v) for x in (at, along))
        for factor, shift in SECOND_DIFFERENCE:
            here = State(at.q + shift * velocities, at.v, *self._zeros[1:])
            direction = State(along.q + shift * changes, along.v, *self._zeros[1:])
            values = (*here, *direction, dp)
            motion = self._evaluate(self._smooth_motion, time, values, e.n + 3 * e.m)
            result = result + factor * motion[..., : e.n]
        return e.without_states(result)

    def normal_jerk(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        delta: float,
        holonomic_only: bool = False,
        dt: Numbers = 0.0,
    ) -> Array:
        """Return the derivative of `ConsistencySolver.evaluate_normal_jerk`.

        It is the derivative along (along, dp, dt), where dt is the derivative of the time [s].
        """
        e = self.equations
        if e.m == 0:
            return np.zeros_like(along.q)

        def difference(values: list[Array]) -> Array:
            rate = (values[0] - values[1]) / (2.0 * delta)
            if holonomic_only:
                rate[..., e.nonholonomic_rows] = 0.0
            return self._constraint_rows(-rate)

        def move(x: State, d: float) -> State:
            return State(x.q + d * x.v + 0.5 * d**2 * x.a, x.v + d * x.a, x.a, self._zeros[2])

        times = [time + np.array([d, 0.0]) for d in (delta, -delta)]
        moved = [(move(at, d), move(along, d)) for d in (delta, -delta)]
        b = difference(
            [
                self._constraint_levels(t, *here[:3])[2]
                for t, (here, _) in zip(times, moved, strict=True)
            ]
        )
        db = difference(
            [
                self._evaluate_levels(t, here, direction, dp)[..., 2, :]
                for t, (here, direction) in zip(times, moved, strict=True)
            ]
        )
        base = State(at.q, at.v, *self._zeros[1:])
        direction = State(along.q, along.v, *self._zeros[1:])
        change = self._solve(time, base, direction, dp, b, db)[1][..., : e.n]
        if np.any(dt):
            rate = time_rate(
                lambda t: self.solver.evaluate_normal_jerk(
                    t, at, delta, holonomic_only=holonomic_only
                ),
                time,
                delta / _STEP_FRACTION,
            )
            change = change + np.multiply.outer(dt, rate)
        return change

    def initial_motion(
        self,
        start: AlphaStart,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        h: float,
        dt: Numbers = 0.0,
    ) -> Motion:
        """Return the derivatives of `AlphaStart.initial_motion` for steps `h` [s].

        `at` is the consistent state, `along` its total derivative and `dt` that of the time [s].
        """
        v, ddq = np.array(along.v), np.array(along.a)
        if not start.cured:
            return Motion(along.q, v, ddq, ddq.copy(), along.lam, h)
        interval, stiff_time = JERK_INTERVAL * h, STIFF_TIME * h
        jerk = self.normal_jerk(time, at, along, dp, interval, dt=dt)
        accelerations = self._states.get(
            ("reduced", stiff_time),
            (time, at.q, at.v),
            lambda: self.solver.acceleration(time, at.q, at.v, stiff_time=stiff_time),
        )
        reduced = State(at.q, at.v, *accelerations)
        ddq, _ = self.acceleration(time, reduced, along, dp, stiff_time)
        if np.any(dt):
            rate = time_rate(
                lambda t: self.solver.acceleration(t, at.q, at.v, stiff_time=stiff_time)[0], time, h
            )
            ddq = ddq + np.multiply.outer(dt, rate)
        if start.index3:
            position_jerk = jerk
            if self.equations.nonholonomic_rows.size:
                position_jerk = self.normal_jerk(
                    time, at, along, dp, interval, holonomic_only=True, dt=dt
                )
            v += h**2 * start.member.defect * position_jerk
        return Motion(along.q, v, ddq, ddq + start.member.shift * h * jerk, along.lam, h)

    @property
    def _zeros(self) -> tuple[Array, Array, Array]:
        """Zero velocities, accelerations and multipliers."""
        e = self.equations
        return np.zeros(e.n), np.zeros(e.n), np.zeros(e.m)

    def _evaluate_motion(
        self, time: Array, at: State, along: State, dp: Array
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives of F, (..., n), (g, g_dot, g_ddot), (..., 3, m), and G^T lam."""
        return self._evaluate_parts(self._motion, time, (*at, *along, dp))

    def _evaluate_change(
        self, time: Array, at: State, direction: State, along: State, dp: Array
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives of the derivatives along `direction`, see `_evaluate_motion`."""
        still = np.zeros(dp.shape[-1])
        none = np.zeros(self._state_size + len(still))
        inputs = (*at, *direction, still, *along, none, dp)
        return self._evaluate_parts(self._change, time, inputs)

    def _evaluate_parts(
        self, total: StackedSum, time: Array, inputs: Sequence[Array]
    ) -> tuple[Array, Array, Array]:
        n, m = self.equations.n, self.equations.m
        result = self._evaluate(total, time, inputs, 2 * n + 3 * m)
        force, levels, reactions = np.split(result, [n, n + 3 * m], axis=-1)
        return force, levels.reshape(*levels.shape[:-1], 3, m), reactions

    def _evaluate_levels(self, time: Array, at: State, along: State, dp: Array) -> Array:
        """Return the derivatives of (g, g_dot, g_ddot), (..., 3, m)."""
        n, m = self.equations.n, self.equations.m
        result = self._evaluate(self._levels, time, (*at, *along, dp), n + 3 * m)[..., n:]
        return result.reshape(*result.shape[:-1], 3, m)

    def _evaluate(
        self, total: StackedSum, time: Array, inputs: Sequence[Array], size: int
    ) -> Array:
        """Return a sum (..., size) at concatenated inputs, each with or without leading axes."""
        axes = np.broadcast_shapes(*(x.shape[:-1] for x in inputs))
        rows = [np.broadcast_to(x, (*axes, x.shape[-1])) for x in inputs]
        return total(time, np.concatenate(rows, axis=-1), size)

    @property
    def _gradient_pattern(self) -> sp.csc_array:
        return self._sums.gradient_pattern

    def _multiply(self, nonzeros: Array, x: Array) -> Array:
        """Return A x for non-zeros of the saddle-point matrix, without building the matrix."""
        pattern = self._sums.saddle_pattern
        return np.bincount(pattern.indices, nonzeros * x[column_indices(pattern)], len(x))

    def _constraint_rows(self, right: Array) -> Array:
        """Return right-hand sides of the saddle-point system that vanish in the rows of forces."""
        return np.concatenate([np.zeros((*right.shape[:-1], self.equations.n)), right], axis=-1)

    def _multiply_change(
        self, time: Array, at: State, along: State, dp: Array, z: Array, dt: Numbers
    ) -> Array:
        """Return dA z, where dA is the derivative of A = [[M, G^T + dF/dlam], [G, 0]].

        M a and G^T lam are linear in a and lam, so that the product is a derivative of the motion.
        """
        if not z.any():
            return np.zeros((*np.broadcast_shapes(along.q.shape[:-1], dp.shape[:-1]), len(z)))
        n, base = self.equations.n, State(at.q, at.v, *self._zeros[1:])
        direction = State(*self._zeros[:2], z[:n], z[n:])
        force, levels, reactions = self._evaluate_change(time, base, direction, along, dp)
        result = np.concatenate([force + reactions, levels[..., 2, :]], axis=-1)
        if np.any(dt):
            # Matrices that contain the time are rare; this derivative is zero for the others.
            delta = _TIME_DIFFERENCE * (self.equations.time_scale or 1.0)
            ahead, behind = (
                self.solver.saddle_matrix(time + np.array([d, 0.0]), at.q, at.v, None, _MASS)
                for d in (delta, -delta)
            )
            rate = self._multiply((ahead - behind) / (2.0 * delta), z)
            result = result + np.multiply.outer(dt, rate)
        return result

    def _constraint_levels(
        self, time: Array, q: Array, v: Array | None = None, a: Array | None = None
    ) -> Array:
        """Return `ConsistencySolver.constraint_levels`, the same for all directions."""
        return self._levels_of_states.get(
            (), (time, q, v, a), lambda: self.solver.constraint_levels(time, q, v, a)
        )

    def _factorize(
        self,
        time: Array,
        q: Array,
        v: Array,
        coefficients: tuple[float, float, float],
        lam: Array | None = None,
    ) -> Factorization:
        def build() -> Factorization:
            factors = create_factorization(self._sums.saddle_pattern)
            factors.factorize(self.solver.saddle_matrix(time, q, v, None, coefficients, lam))
            return factors

        return self._states.get(("factors", coefficients), (time, q, v, lam), build)

    def _solve(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        b: Array,
        db: Array,
        dt: Numbers = 0.0,
    ) -> tuple[Array, Array]:
        """Return z and dz with A z = b and A dz = db - dA z."""
        factors = self._factorize(time, at.q, at.v, _MASS)
        z = factors.solve(b)
        return z, _solve_each(factors, db - self._multiply_change(time, at, along, dp, z, dt))

    def _saddle_matrix(self, time: Array, at: State) -> sp.csc_array:
        """Return [[M, G^T], [G, 0]]."""
        pattern = self._sums.saddle_pattern
        nonzeros = self.solver.saddle_matrix(time, at.q, at.v, None, _MASS)
        return sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)


def differentiate_together(
    derivatives: Sequence[StartDerivatives],
    function: Callable[..., Sequence[Array]],
    *directions: Sequence[Array | float] | Array,
) -> list[tuple[Array, ...]]:
    """Return the results of `function` for each direction.

    Parameters
    ----------
    derivatives
        Derivatives of consistent states, one per direction.
    function
        Function of a `StartDerivatives` and of arrays with one entry per direction that returns
        arrays with one row per direction. It is called once for all directions with the same
        derivatives.
    *directions
        Arrays or numbers, one per direction.
    """
    results: list[tuple[Array, ...]] = [()] * len(derivatives)
    for first in {id(x): x for x in derivatives}.values():
        members = [k for k, x in enumerate(derivatives) if x is first]
        values = function(first, *(np.array([x[k] for k in members]) for x in directions))
        for i, k in enumerate(members):
            results[k] = tuple(x[i] for x in values)
    return results


def _solve_each(factors: Factorization, right: Array) -> Array:
    """Return the solutions for right-hand sides (..., size)."""
    rows = right.reshape(-1, right.shape[-1])
    return np.array([factors.solve(x) for x in rows]).reshape(right.shape)


def time_rate(function: Callable[[Array], Array], time: Array, h: float) -> Array:
    """Return the partial derivative of a function of (t, branch) with respect to t.

    `h` is a step of the run [s], which resolves the laws.
    """
    delta = _STEP_FRACTION * h
    ahead, behind = (function(time + np.array([d, 0.0])) for d in (delta, -delta))
    return (ahead - behind) / (2.0 * delta)
