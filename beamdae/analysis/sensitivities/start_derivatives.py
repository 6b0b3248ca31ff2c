"""Derivatives of consistent states and of the starting values of the generalized-alpha family."""

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
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import StateSums, plan_state_sums
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.integrators.alpha.family import JERK_INTERVAL, STIFF_TIME, AlphaStart
from beamdae.integrators.alpha.workspace import Motion
from beamdae.linear.factorizations import Factorization, create_factorization
from beamdae.symbolic.directional_sums import directional_plan, tangent_plan
from beamdae.symbolic.kernel_sums import Sum, SumPlan, evaluate_sum, set_matrix_factors, set_time
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Coefficients of stiffness, damping and mass in the saddle-point matrix.
_MASS = (0.0, 0.0, 1.0)
_CLOSING = (1.0, 0.0, 1.0)
# Difference of time for matrices that contain the time, relative to the time scale of the laws.
_TIME_DIFFERENCE = 1e-5
# Larger corrections of a differenced equilibrium, relative to the difference, are motions without
# stiffness.
_MAX_EQUILIBRIUM_CORRECTION = 1e-4
# Difference of time for partial derivatives with respect to time, relative to the step.
_STEP_FRACTION = 1e-3
# Stiffnesses of contacts are proportional to the square root of the penetration, whose slope has no
# bound. Up to this penetration [m], starting values are differentiated with constant stiffnesses:
# a slope at a penetration of 1e-15 m, due to rounding, would dominate the derivatives of the run.
# From this penetration on, the effect of the slopes was less than 1e-3 of a derivative.
MIN_STIFF_PENETRATION = 1e-6
# Stored factors and accelerations of states, which all directions need, and stored derivatives of
# matrices, which differ per direction, but are smaller than factors.
_MAX_STATES = 8
_MAX_DIRECTIONS = 32


@cache_on_owner
def _plan_directional_sums(structure: Structure) -> tuple[SumPlan, SumPlan, SumPlan]:
    """Return the directional derivatives of `motion`, `saddle` and `levels` of `StateSums`."""
    sums = plan_state_sums(structure)
    size = 3 * structure.n + structure.m
    return (
        directional_plan(sums.motion, size),
        directional_plan(sums.saddle, size, min_base=MIN_STIFF_PENETRATION),
        directional_plan(sums.levels, size),
    )


@cache_on_owner
def _plan_directional_sum(
    structure: Structure, plan: Callable[[Structure], SumPlan], n_inputs: int, min_base: float
) -> SumPlan:
    return directional_plan(plan(structure), n_inputs, min_base=min_base)


@cache_on_owner
def _plan_tangents(
    structure: Structure, plan: Callable[[Structure], SumPlan], n_inputs: int
) -> SumPlan:
    return tangent_plan(_plan_directional_sum(structure, plan, n_inputs, 0.0), n_inputs)


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
    change of the numbers of the model, (n_p,).
    """

    solver: ConsistencySolver
    moving: Difference | None = None
    _states: _Store = field(default_factory=lambda: _Store(_MAX_STATES), init=False, repr=False)
    _levels_of_states: _Store = field(
        default_factory=lambda: _Store(_MAX_STATES), init=False, repr=False
    )
    _directions: _Store = field(
        default_factory=lambda: _Store(_MAX_DIRECTIONS), init=False, repr=False
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

    def directional_sums(
        self, plan: Callable[[Structure], SumPlan], n_inputs: int, native: bool
    ) -> tuple[Sum, Sum]:
        """Return the sum of `directional_plan`, and that for further directions at a point.

        The second sum gathers tangents alone, see `tangent_plan`, unless operators depend on the
        parameter.
        """
        p = self.equations.p
        first = self.directional_plan(plan, n_inputs).sum(native, p)
        if self.moving is not None:
            return first, first
        further = _plan_tangents(self.equations.structure, plan, n_inputs).sum(native, p)
        further.local = first.local
        return first, further

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the solver."""
        return self.solver.equations

    @property
    def _sums(self) -> StateSums:
        return self.solver.sums

    @cached_property
    def _motion(self) -> Sum:
        return self._plans[0].sum(False, self.equations.p)

    @cached_property
    def _saddle(self) -> Sum:
        return self._plans[1].sum(False, self.equations.p)

    @cached_property
    def _levels(self) -> Sum:
        return self._plans[2].sum(False, self.equations.p)

    @cached_property
    def _plans(self) -> tuple[SumPlan, SumPlan, SumPlan]:
        if self.moving is None:
            return _plan_directional_sums(self.equations.structure)
        size = 3 * self.equations.n + self.equations.m
        motion = self.directional_plan(lambda x: plan_state_sums(x).motion, size)
        saddle = self.directional_plan(
            lambda x: plan_state_sums(x).saddle, size, MIN_STIFF_PENETRATION
        )
        levels = self.directional_plan(lambda x: plan_state_sums(x).levels, size)
        return motion, saddle, levels

    def consistent_state(
        self,
        time: Array,
        at: State,
        v: Array,
        dq: Array,
        dv: Array,
        dp: Array,
        dt: float = 0.0,
    ) -> State:
        """Return the derivative of the consistent state near requested positions and velocities.

        If the time of the restart depends on the parameter, `dq` and `dv` are total derivatives,
        along the moving time. The result is the derivative at fixed time after the restart.

        Parameters
        ----------
        time, at
            (t, branch), and the consistent state.
        v
            Requested velocities.
        dq, dv, dp
            Derivatives of the requested positions, which close the joints except for rounding,
            of the requested velocities, and of the numbers.
        dt
            Derivative of the time of the restart [s].
        """
        dq = self.project_positions(time, at.q, dq, dp, dt)
        dv = self.project_velocities(time, at.q, v, dq, dv, dp, dt)
        dq, dv = dq - dt * at.v, dv - dt * at.a
        dv = self._with_state_rates(time, at, dq, dv, dp)
        along = State(dq, dv, *self._zeros[1:])
        return State(dq, dv, *self.acceleration(time, at, along, dp))

    def moved_state(
        self,
        time: Array,
        at: State,
        v: Array,
        dq: Array,
        dv: Array,
        dp: Array,
        dt: float,
        h: float,
    ) -> State:
        """Return the total derivative of a consistent state along its moving time.

        For the arguments, see `consistent_state`; `h` is the step after the restart [s].
        """
        dq = self.project_positions(time, at.q, dq, dp, dt)
        dv = self.project_velocities(time, at.q, v, dq, dv, dp, dt)
        dv = self._with_state_rates(time, at, dq, dv, dp)
        if dt and len(self.equations.states):
            rates = time_rate(lambda t: self.solver.force(t, at.q, at.v), time, h)
            dv[self.equations.states] -= dt * rates[self.equations.states]
        da, dlam = self.acceleration(time, at, State(dq, dv, *self._zeros[1:]), dp)
        if dt:
            rates = time_rate(
                lambda t: np.concatenate(self.solver.acceleration(t, at.q, at.v)), time, h
            )
            da, dlam = da + dt * rates[: len(da)], dlam + dt * rates[len(da) :]
        return State(dq, dv, da, dlam)

    def project_positions(
        self, time: Array, q: Array, dq: Array, dp: Array, dt: float = 0.0
    ) -> Array:
        """Return dq, changed least so that G dq + dg/dp dp + dg/dt dt = 0."""
        e = self.equations
        if e.m == 0:
            return dq
        gap = self._evaluate_levels(time, State(q, *self._zeros), State(dq, *self._zeros), dp)[0]
        gap_rate = self._constraint_levels(time, q)[1].copy()
        gap_rate[e.nonholonomic_rows] = 0.0
        gap = gap + dt * gap_rate
        factors = self._factorize(time, q, np.zeros(e.n), _CLOSING)
        change = factors.solve(np.concatenate([np.zeros(e.n), -gap]))[: e.n]
        change[e.states] = 0.0
        return dq + change

    def _with_state_rates(self, time: Array, at: State, dq: Array, dv: Array, dp: Array) -> Array:
        """Return dv with the derivatives of `ConsistencySolver.with_state_rates`."""
        states = self.equations.states
        if not len(states):
            return dv
        along = State(dq, dv, *self._zeros[1:])
        change, _ = self._evaluate_motion(time, at._replace(lam=self._zeros[2]), along, dp)
        dv = dv.copy()
        dv[states] -= change[states]
        return dv

    def constraint_gradients(
        self, time: Array, q: Array, dq: Array, dp: Array
    ) -> tuple[Array, Array]:
        """Return G at positions q, and its derivative along (dq, dp), (m, n) each."""
        n, at, along = self.equations.n, State(q, *self._zeros), State(dq, *self._zeros)
        change = self._as_matrix(self._nonzero_changes(time, at, along, dp, _MASS))
        return self.solver.constraint_matrix(time, q).toarray(), change[n:, :n].toarray()

    def correct_equilibrium(self, time: Array, at: State, dq: Array, dp: Array) -> Array:
        """Return the derivative of equilibrium positions, given an approximation dq.

        It solves [[K, G^T + dF/dlam], [G, 0]] (dq, dlam) = -(dF/dp dp + d(G^T lam)/dp dp, dg/dp dp)
        with K = d(F + G^T lam)/dq. If the equilibrium is not unique, dq is returned unchanged.
        """
        e = self.equations
        rest, zeros = State(at.q, *self._zeros), State(dq, *self._zeros)
        force, levels = self._evaluate_motion(time, rest._replace(lam=at.lam), zeros, dp)
        nonzeros = self._nonzero_changes(time, rest, zeros, dp, _MASS)
        gradient = self._as_matrix(nonzeros)[e.n :, : e.n]
        residual = np.concatenate([force + gradient.T @ at.lam, levels[0]])
        matrix = StaticEquations(e, time).matrix(at.q, at.lam)
        try:
            change = splu(matrix).solve(-residual)[: e.n]
        except RuntimeError:
            return dq
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
        dt: float = 0.0,
    ) -> Array:
        """Return the derivative of the consistent velocities nearest to v.

        (dq, dv, dp, dt) are derivatives of the positions, requested velocities, numbers and time.
        """
        e = self.equations
        if e.m == 0:
            return dv
        at, along = State(q, v, *self._zeros[1:]), State(dq, dv, *self._zeros[1:])
        rates, change = self._constraint_rates(time, at, along, dp, dt)
        b, db = (np.concatenate([np.zeros(e.n), -x]) for x in (rates, change))
        return dv + self._solve(time, at, along, dp, _MASS, b, db, dt)[1][: e.n]

    def impact(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        dt: float,
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
        matrix = self._saddle_matrix(time, at)[kept][:, kept]
        nonzeros = self._nonzero_changes(time, at, along, dp, _MASS, dt)
        matrix_change = self._as_matrix(nonzeros)[kept][:, kept]
        factors = splu(sp.csc_array(matrix))
        z = factors.solve(b[kept])
        return along.v + factors.solve(db[kept] - matrix_change @ z)[:n]

    def _constraint_rates(
        self, time: Array, at: State, along: State, dp: Array, dt: float
    ) -> tuple[Array, Array]:
        """Return g_dot at (q, v), and its derivative along (dq, dv, dp, dt), (m,) each."""
        levels = self._constraint_levels(time, at.q, at.v)
        change = self._evaluate_levels(time, at, along, dp)[1]
        if dt:
            # The partial derivative with respect to t is what g_ddot contains beyond that of q.
            motion = State(at.v, *self._zeros)
            change = change + dt * (
                levels[2] - self._evaluate_levels(time, at, motion, 0.0 * dp)[1]
            )
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
        e, coefficients = self.equations, (stiff_time**2, 0.0, 1.0)
        rest = at._replace(a=np.zeros(e.n))
        along = State(along.q, along.v, *self._zeros[1:])
        force, levels = self._evaluate_motion(time, rest, along, dp)
        change = self._nonzero_changes(time, rest, along, dp, coefficients)
        row, column = self._entries
        # The matrix acts on the accelerations, and its block G on the multipliers by G^T.
        total = self._multiply(change, np.concatenate([at.a, self._zeros[2]]))
        reactions = np.concatenate([self._zeros[0], at.lam])
        total[: e.n] += np.bincount(column, change * reactions[row], e.n + e.m)[: e.n]
        total += np.concatenate([force, levels[2]])
        factors = self._factorize(time, at.q, at.v, coefficients, at.lam)
        solution = factors.solve(-total)
        return solution[: e.n], solution[e.n :]

    def normal_jerk(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        delta: float,
        holonomic_only: bool = False,
        dt: float = 0.0,
    ) -> Array:
        """Return the derivative of `ConsistencySolver.evaluate_normal_jerk`.

        It is the derivative along (along, dp, dt), where dt is the derivative of the time [s].
        """
        e = self.equations
        if e.m == 0:
            return np.zeros(e.n)

        def difference(values: list[Array]) -> Array:
            rate = (values[0] - values[1]) / (2.0 * delta)
            if holonomic_only:
                rate[e.nonholonomic_rows] = 0.0
            return np.concatenate([np.zeros(e.n), -rate])

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
                self._evaluate_levels(t, here, direction, dp)[2]
                for t, (here, direction) in zip(times, moved, strict=True)
            ]
        )
        base = State(at.q, at.v, *self._zeros[1:])
        direction = State(along.q, along.v, *self._zeros[1:])
        change = self._solve(time, base, direction, dp, _MASS, b, db)[1][: e.n]
        if dt:
            change = change + dt * time_rate(
                lambda t: self.solver.evaluate_normal_jerk(
                    t, at, delta, holonomic_only=holonomic_only
                ),
                time,
                delta / _STEP_FRACTION,
            )
        return change

    def initial_motion(
        self,
        start: AlphaStart,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        h: float,
        dt: float = 0.0,
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
        if dt:
            ddq = ddq + dt * time_rate(
                lambda t: self.solver.acceleration(t, at.q, at.v, stiff_time=stiff_time)[0], time, h
            )
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
    ) -> tuple[Array, Array]:
        """Return the derivatives of F, (n,), and of (g, g_dot, g_ddot), (3, m)."""
        return self._evaluate(self._motion, time, at, along, dp)

    def _evaluate_levels(self, time: Array, at: State, along: State, dp: Array) -> Array:
        return self._evaluate(self._levels, time, at, along, dp)[1]

    def _evaluate(
        self, total: Sum, time: Array, at: State, along: State, dp: Array
    ) -> tuple[Array, Array]:
        e = self.equations
        result = np.zeros(e.n + 3 * e.m)
        set_time(total, *time)
        evaluate_sum(total, np.concatenate([*at, *along, dp]), result)
        return result[: e.n], result[e.n :].reshape(3, e.m)

    def _as_matrix(self, nonzeros: Array) -> sp.csc_array:
        """Return the matrix with the pattern of the saddle-point matrix."""
        pattern = self._sums.saddle_pattern
        return sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)

    @cached_property
    def _entries(self) -> tuple[Array, Array]:
        """Rows and columns of the non-zeros of the saddle-point matrix."""
        pattern = self._sums.saddle_pattern
        return pattern.indices, column_indices(pattern)

    def _multiply(self, nonzeros: Array, x: Array) -> Array:
        """Return A x for non-zeros of the saddle-point matrix, without building the matrix."""
        row, column = self._entries
        return np.bincount(row, nonzeros * x[column], len(x))

    def _nonzero_changes(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        coefficients: tuple[float, float, float],
        dt: float = 0.0,
    ) -> Array:
        """Return the derivative of the non-zeros of the saddle-point matrix."""
        nonzeros = self._differentiate_nonzeros(time, at, along, dp, coefficients)
        if dt:
            # Matrices that contain the time are rare; this derivative is zero for the others.
            delta = _TIME_DIFFERENCE * (self.equations.time_scale or 1.0)
            ahead, behind = (
                self.solver.saddle_matrix(time + np.array([d, 0.0]), at.q, at.v, at.a, coefficients)
                for d in (delta, -delta)
            )
            nonzeros = nonzeros + dt * (ahead - behind) / (2.0 * delta)
        return nonzeros

    def _differentiate_nonzeros(
        self,
        time: Array,
        at: State,
        along: State,
        dp: Array,
        coefficients: tuple[float, float, float],
    ) -> Array:
        """Return the derivative of the non-zeros of the saddle-point matrix at fixed time.

        Velocities, accelerations and the jerk need that of the same matrix [[M, G^T], [G, 0]]. It
        does not depend on the multipliers if there is no friction.
        """
        if coefficients == _MASS and all(x.rows is None for x in self.equations.forces):
            at, along = (x._replace(lam=self._zeros[2]) for x in (at, along))
        total, inputs = self._saddle, np.concatenate([*at, *along, dp])

        def build() -> Array:
            nonzeros = np.zeros(self._sums.saddle_pattern.nnz)
            set_time(total, *time)
            set_matrix_factors(total, *coefficients, c_l=1.0, c_h=1.0, c_r=1.0)
            evaluate_sum(total, inputs, nonzeros)
            return nonzeros

        return self._directions.get(coefficients, (time, inputs), build)

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
        coefficients: tuple[float, float, float],
        b: Array,
        db: Array,
        dt: float = 0.0,
    ) -> tuple[Array, Array]:
        """Return z and dz with A z = b and A dz = db - dA z."""
        factors = self._factorize(time, at.q, at.v, coefficients)
        z = factors.solve(b)
        change = self._nonzero_changes(time, at, along, dp, coefficients, dt)
        return z, factors.solve(db - self._multiply(change, z))

    def _saddle_matrix(self, time: Array, at: State) -> sp.csc_array:
        """Return [[M, G^T], [G, 0]]."""
        pattern = self._sums.saddle_pattern
        nonzeros = self.solver.saddle_matrix(time, at.q, at.v, None, _MASS)
        return sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)


def time_rate(function: Callable[[Array], Array], time: Array, h: float) -> Array:
    """Return the partial derivative of a function of (t, branch) with respect to t.

    `h` is a step of the run [s], which resolves the laws.
    """
    delta = _STEP_FRACTION * h
    ahead, behind = (function(time + np.array([d, 0.0])) for d in (delta, -delta))
    return (ahead - behind) / (2.0 * delta)
