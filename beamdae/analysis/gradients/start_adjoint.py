"""Transposed derivatives of consistent states and of the start of generalized-alpha runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.operator_changes import directional_plan_along
from beamdae.analysis.sensitivities.start_derivatives import MIN_STIFF_PENETRATION
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import (
    SECOND_DIFFERENCE,
    Recent,
    StateSums,
    plan_constraint_levels,
    plan_state_sums,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.integrators.alpha.family import JERK_INTERVAL, STIFF_TIME, AlphaStart
from beamdae.linear.factorizations import Factorization, create_factorization
from beamdae.symbolic.sparse_operators import column_indices, transpose_pattern
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator
from beamdae.symbolic.sums.transposed_sums import transposed_plan

Array = np.ndarray

# Coefficients of stiffness, damping and mass in the saddle-point matrix.
_MASS = (0.0, 0.0, 1.0)
_CLOSING = (1.0, 0.0, 1.0)
# Larger errors of a solution of the static equations show that the equilibrium is not unique.
_MAX_EQUILIBRIUM_ERROR = 1e-6
_EQUILIBRATION_STEPS = 8  # each takes the square root of the ratios of the largest entries


def _compute_scales(matrix: sp.csc_array) -> Array:
    """Return scales of rows and columns with which the largest entry of each is near 1.

    See D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices,
    RAL-TR-2001-034. Rows and columns have the same scales, as in symmetric matrices.
    """
    magnitudes, scales = abs(matrix).tocoo(), np.ones(matrix.shape[0])
    rows, columns = magnitudes.coords
    for _ in range(_EQUILIBRATION_STEPS):
        values = magnitudes.data * scales[rows] * scales[columns]
        largest = np.zeros(len(scales))
        np.maximum.at(largest, rows, values)
        np.maximum.at(largest, columns, values)
        scales /= np.sqrt(np.where(largest > 0.0, largest, 1.0))
    return scales


@cache_on_owner
def _plan_transposed_sums(structure: Structure) -> tuple[SumPlan, ...]:
    """Return the transposed derivatives of four sums of `StateEvaluator`.

    They are `motion`, `saddle`, the levels of constraints and `smooth_motion`.
    """
    sums = plan_state_sums(structure)
    size = 3 * structure.n + structure.m
    motion, is_smooth = transposed_plan(sums.motion, size), sums.smooth_motion is sums.motion
    return (
        motion,
        transposed_plan(sums.saddle, size, MIN_STIFF_PENETRATION),
        transposed_plan(plan_constraint_levels(structure), size),
        motion if is_smooth else transposed_plan(sums.smooth_motion, size),
    )


@cache_on_owner
def _transpose_saddle_pattern(structure: Structure) -> tuple[sp.csc_array, Array]:
    """Return `transpose_pattern` of the saddle-point matrix."""
    return transpose_pattern(plan_state_sums(structure).saddle_pattern)


@dataclass
class StartAdjoint:
    """Transposes of the methods of `StartDerivatives`, for one state at a time.

    The methods take derivatives of an objective with respect to the results of the transposed
    methods, and return those with respect to their arguments. Derivatives with respect to the
    numbers p of the model are added to `numbers`.

    Attributes
    ----------
    solver
        Solver for consistent states.
    numbers
        Derivatives of the objective with respect to p, (n_p,).
    moving
        Models at neighboring values of a parameter on which operators of joints depend; None if
        they are constant.
    along_operators
        Derivative of the objective with respect to this parameter through these operators.
    """

    solver: ConsistencySolver
    numbers: Array
    moving: Difference | None = None
    along_operators: float = 0.0
    _recent_nonzeros: Recent = field(default_factory=Recent, init=False, repr=False)
    _recent_factors: dict[int, tuple[Array, Factorization]] = field(
        default_factory=dict, init=False, repr=False
    )

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the solver."""
        return self.solver.equations

    @property
    def _sums(self) -> StateSums:
        return self.solver.sums

    def moved_plan(
        self,
        plan: Callable[[EquationsOfMotion], SumPlan],
        n_inputs: int,
        min_base: float = 0.0,
    ) -> SumPlan | None:
        """Return the derivative of a sum along `moving`; None if operators are constant.

        `plan` returns the plan of the sum of equations, with inputs x of size `n_inputs`. The
        inputs of the result are (x, dx, dp); with zero dx and dp, it is the derivative through the
        operators alone. For `min_base`, see `expand_powers`.
        """
        if self.moving is None:
            return None
        return directional_plan_along(self.moving, plan, n_inputs, min_base)

    @cached_property
    def _moved_sums(self) -> dict[int, SumEvaluator]:
        """Derivatives of the transposed sums along `moving`, by id of the transposed sum."""
        if self.moving is None:
            return {}
        size, p = 3 * self.equations.n + self.equations.m, self.equations.p
        motion = self.moved_plan(lambda e: plan_state_sums(e.structure).motion, size)
        saddle = self.moved_plan(
            lambda e: plan_state_sums(e.structure).saddle, size, MIN_STIFF_PENETRATION
        )
        levels = self.moved_plan(lambda e: plan_constraint_levels(e.structure), size)
        smooth = self.moved_plan(lambda e: plan_state_sums(e.structure).smooth_motion, size)
        plans = (
            (self._motion, motion),
            (self._saddle, saddle),
            (self._levels, levels),
            (self._smooth_motion, smooth),
        )
        return {
            id(total): SumEvaluator.borrow(plan, p, self)
            for total, plan in plans
            if plan is not None
        }

    @cached_property
    def _motion(self) -> SumEvaluator:
        return self._borrow(_plan_transposed_sums(self.equations.structure)[0])

    @cached_property
    def _saddle(self) -> SumEvaluator:
        return self._borrow(_plan_transposed_sums(self.equations.structure)[1])

    @cached_property
    def _levels(self) -> SumEvaluator:
        return self._borrow(_plan_transposed_sums(self.equations.structure)[2])

    @cached_property
    def _smooth_motion(self) -> SumEvaluator:
        return self._borrow(_plan_transposed_sums(self.equations.structure)[3])

    def _borrow(self, plan: SumPlan) -> SumEvaluator:
        return SumEvaluator.borrow(plan, self.equations.p, self)

    def initial_motion(
        self,
        start: AlphaStart,
        time: Array,
        at: State,
        by_motion: tuple[Array, Array, Array, Array],
        h: float,
    ) -> State:
        """Transpose `StartDerivatives.initial_motion`.

        Parameters
        ----------
        start, time, at, h
            See `StartDerivatives.initial_motion`.
        by_motion
            Derivatives with respect to q, v, q'' and the algorithmic acceleration.

        Returns
        -------
        State
            Derivatives with respect to the consistent state `at`.
        """
        e = self.equations
        q, v, ddq, a = (x.copy() for x in by_motion)
        result = State(q, v, np.zeros(e.n), np.zeros(e.m))
        if not start.cured:
            return result._replace(a=ddq + a)
        interval, stiff_time = JERK_INTERVAL * h, STIFF_TIME * h
        reduced = State(
            at.q, at.v, *self.solver.acceleration(time, at.q, at.v, stiff_time=stiff_time)
        )
        result = _add(result, self.acceleration(time, reduced, ddq + a, result.lam, stiff_time))
        jerk = start.member.shift * h * a
        defect = h**2 * start.member.defect * v if start.index3 else np.zeros(e.n)
        if e.nonholonomic_rows.size:
            by_positions = self.normal_jerk(time, at, defect, interval, holonomic_only=True)
            result = _add(result, by_positions)
        else:
            jerk = jerk + defect
        return _add(result, self.normal_jerk(time, at, jerk, interval))

    def consistent_state(
        self, time: Array, at: State, v: Array, by_state: State
    ) -> tuple[Array, Array]:
        """Transpose `StartDerivatives.consistent_state`.

        Parameters
        ----------
        time, at, v
            See `StartDerivatives.consistent_state`.
        by_state
            Derivatives with respect to the consistent state `at`.

        Returns
        -------
        tuple of numpy.ndarray
            Derivatives with respect to the requested positions and velocities, (n,) each.
        """
        result = _add(by_state, self.acceleration(time, at, by_state.a, by_state.lam))
        result = self._with_state_rates(time, at, result)
        by_q, by_v = self.project_velocities(time, at.q, v, result.v)
        return self.project_positions(time, at.q, result.q + by_q), by_v

    def _with_state_rates(self, time: Array, at: State, by_state: State) -> State:
        """Transpose `StartDerivatives._with_state_rates`."""
        e, weights = self.equations, np.zeros(self.equations.n)
        if not len(e.states):
            return by_state
        weights[e.states] = -by_state.v[e.states]
        at = at._replace(lam=np.zeros(e.m))
        result = self._weigh_motion(time, at, weights, np.zeros((3, e.m)))
        return by_state._replace(q=by_state.q + result.q, v=by_state.v + result.v)

    def project_positions(self, time: Array, q: Array, by_q: Array) -> Array:
        """Transpose `StartDerivatives.project_positions`."""
        e = self.equations
        if e.m == 0:
            return by_q
        zeros, by_moving = np.zeros(e.n), by_q.copy()
        by_moving[e.states] = 0.0
        weights = self._solve_transposed(time, q, zeros, _CLOSING, by_moving)
        levels = np.zeros((3, e.m))
        levels[0] = -weights[e.n :]
        state = State(q, zeros, zeros, np.zeros(e.m))
        return by_q + self._weigh_motion(time, state, zeros, levels).q

    def project_velocities(
        self, time: Array, q: Array, v: Array, by_v: Array
    ) -> tuple[Array, Array]:
        """Transpose `StartDerivatives.project_velocities` with respect to q and v."""
        e = self.equations
        if e.m == 0:
            return np.zeros(e.n), by_v
        g_dot = self.solver.constraint_levels(time, q, v)[1]
        z = self._factorize(time, q, v, _MASS).solve(np.concatenate([np.zeros(e.n), -g_dot]))
        weights = self._solve_transposed(time, q, v, _MASS, by_v)
        levels = np.zeros((3, e.m))
        levels[1] = -weights[e.n :]
        at = State(q, v, np.zeros(e.n), np.zeros(e.m))
        result = self._weigh_motion(time, at, np.zeros(e.n), levels)
        result = _add(result, self._weigh_matrix(time, at, _MASS, -weights, z))
        return result.q, by_v + result.v

    def impact(
        self,
        time: Array,
        at: State,
        by_v: Array,
        active: Array,
        coefficients: Array,
    ) -> tuple[Array, Array, Array]:
        """Transpose `StartDerivatives.impact`.

        Parameters
        ----------
        time, at, active
            See `StartDerivatives.impact`.
        by_v
            Derivatives with respect to the velocities after the impact, (n,).
        coefficients
            Coefficients of restitution of all constraints, (m,).

        Returns
        -------
        tuple of numpy.ndarray
            Derivatives with respect to the positions and velocities before the impact, (n,) each,
            and to the coefficients of restitution, (m,).
        """
        e = self.equations
        n, m = e.n, e.m
        kept = np.concatenate([np.arange(n), n + active])
        pattern = self._sums.saddle_pattern
        nonzeros = self.solver.saddle_matrix(time, at.q, at.v, None, _MASS)
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
        factors = splu(sp.csc_array(matrix[kept][:, kept]))
        rates = self.solver.constraint_levels(time, at.q, at.v)[1]
        changes, seeds = np.zeros((2, n + m))
        changes[n + active] = -(1.0 + coefficients[active]) * rates[active]
        seeds[:n] = by_v
        z, weights = np.zeros((2, n + m))
        z[kept] = factors.solve(changes[kept])
        weights[kept] = factors.solve(seeds[kept], trans="T")
        by_rates = weights[n:]
        levels = np.zeros((3, m))
        levels[1] = -(1.0 + coefficients) * by_rates
        result = self._weigh_motion(time, at, np.zeros(n), levels)
        result = _add(result, self._weigh_matrix(time, at, _MASS, -weights, z))
        return result.q, by_v + result.v, -by_rates * rates

    def acceleration(
        self, time: Array, at: State, by_a: Array, by_lam: Array, stiff_time: float = 0.0
    ) -> State:
        """Transpose `StartDerivatives.acceleration` with respect to q and v."""
        e, coefficients = self.equations, (stiff_time**2, 0.0, 1.0)
        rest = at._replace(a=np.zeros(e.n))
        weights = -self._solve_transposed(time, at.q, at.v, coefficients, by_a, by_lam, lam=at.lam)
        levels = np.zeros((3, e.m))
        levels[2] = weights[e.n :]
        result = self._weigh_motion(time, rest, weights[: e.n], levels)
        # The matrix acts on the accelerations, and its block G on the multipliers by G^T.
        z = np.concatenate([at.a, np.zeros(e.m)])
        reactions = np.concatenate([np.zeros(e.n), at.lam])
        by_forces = np.concatenate([weights[: e.n], np.zeros(e.m)])
        by_matrix = self._weigh_matrix(time, rest, coefficients, weights, z, reactions, by_forces)
        result = State(result.q + by_matrix.q, result.v + by_matrix.v, rest.a, np.zeros(e.m))
        if stiff_time > 0.0:
            result = _add(result, self._force_change(time, at, weights[: e.n], stiff_time))
        return result

    def _force_change(self, time: Array, at: State, by_change: Array, delta: float) -> State:
        """Transpose `StartDerivatives._force_change` with respect to q and v."""
        e = self.equations
        zeros = State(np.zeros(e.n), np.zeros(e.n), np.zeros(e.n), np.zeros(e.m))
        step, weights = delta * e.without_states(at.v), np.zeros(e.n + 3 * e.m)
        result = zeros
        for factor, shift in SECOND_DIFFERENCE:
            here = zeros._replace(q=at.q + shift * step, v=at.v)
            weights[: e.n] = factor * e.without_states(by_change)
            by_q, by_v, _, _ = self._weigh(self._smooth_motion, time, here, weights)
            by_step = shift * delta * e.without_states(by_q)
            result = _add(result, zeros._replace(q=by_q, v=by_v + by_step))
        return result

    def normal_jerk(
        self, time: Array, at: State, by_jerk: Array, delta: float, holonomic_only: bool = False
    ) -> State:
        """Transpose `StartDerivatives.normal_jerk` with respect to the state `at`."""
        e = self.equations
        result = State(np.zeros(e.n), np.zeros(e.n), np.zeros(e.n), np.zeros(e.m))
        if e.m == 0:
            return result
        jerk_terms = np.zeros((2, e.m))
        by_rate = self._solve_transposed(time, at.q, at.v, _MASS, by_jerk)
        weights = np.zeros(e.m)
        weights[:] = -by_rate[e.n :]
        if holonomic_only:
            weights[e.nonholonomic_rows] = 0.0
        for k, d in enumerate((delta, -delta)):
            moved = State(at.q + d * at.v + 0.5 * d**2 * at.a, at.v + d * at.a, at.a, np.zeros(e.m))
            moved_time = time + np.array([d, 0.0])
            jerk_terms[k] = self.solver.constraint_levels(moved_time, *moved[:3])[2]
            levels = np.zeros((3, e.m))
            levels[2] = weights / (2.0 * d)
            by_q, by_v, by_a, _ = self._weigh_motion(moved_time, moved, np.zeros(e.n), levels)
            result = _add(
                result,
                State(by_q, d * by_q + by_v, 0.5 * d**2 * by_q + d * by_v + by_a, np.zeros(e.m)),
            )
        rate = (jerk_terms[0] - jerk_terms[1]) / (2.0 * delta)
        if holonomic_only:
            rate[e.nonholonomic_rows] = 0.0
        z = self._factorize(time, at.q, at.v, _MASS).solve(np.concatenate([np.zeros(e.n), -rate]))
        base = State(at.q, at.v, np.zeros(e.n), np.zeros(e.m))
        by_matrix = self._weigh_matrix(time, base, _MASS, -by_rate, z)
        return _add(result, State(by_matrix.q, by_matrix.v, np.zeros(e.n), np.zeros(e.m)))

    def equilibrium(
        self, time: Array, at: State, by_q: Array, by_lam: Array | None = None
    ) -> Array | None:
        """Return the gradient (n_p,) of an objective of an equilibrium with respect to p.

        Return None if the equilibrium is not unique.

        Parameters
        ----------
        time, at
            (t, branch), and the equilibrium.
        by_q, by_lam
            Derivatives of the objective with respect to the positions, and to the multipliers; None
            for zero.
        """
        e = self.equations
        static = StaticEquations(e, time)
        pattern, positions = transpose_pattern(static.pattern)
        nonzeros = np.empty(pattern.nnz)
        nonzeros[positions] = static.tangent(at.q, at.lam)
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
        expected = np.ones(e.n + e.m)
        # Condition numbers of static equations reach 1e12, those of scaled ones 1e8: without
        # scales, a steel leaf spring of 8 elements had errors of 5e-6, and 1e-9 with scales.
        scales = _compute_scales(matrix)
        matrix = sp.csc_array(sp.diags_array(scales) @ matrix @ sp.diags_array(scales))
        try:
            factors = splu(matrix)
        except RuntimeError:
            return None
        # A motion without stiffness makes this solution inaccurate.
        if np.max(np.abs(factors.solve(matrix @ expected) - expected)) > _MAX_EQUILIBRIUM_ERROR:
            return None
        seeds = scales * np.concatenate([by_q, np.zeros(e.m) if by_lam is None else by_lam])
        weights = -factors.solve(seeds)
        weights -= factors.solve(seeds + matrix @ weights)
        weights *= scales
        zeros, before = np.zeros(e.n), self.numbers
        self.numbers = np.zeros_like(before)
        levels = np.zeros((3, e.m))
        levels[0] = weights[e.n :]
        rest = State(at.q, zeros, zeros, at.lam)
        self._weigh_motion(time, rest, weights[: e.n], levels)
        reactions = np.concatenate([zeros, at.lam])
        by_forces = np.concatenate([weights[: e.n], np.zeros(e.m)])
        nothing = np.zeros(e.n + e.m)
        rest = rest._replace(lam=np.zeros(e.m))
        self._weigh_matrix(time, rest, _MASS, nothing, nothing, reactions, by_forces)
        result, self.numbers = self.numbers, before
        return result

    def _weigh_motion(self, time: Array, at: State, by_force: Array, by_levels: Array) -> State:
        """Return the gradient, a State, of by_force . F + by_levels . (g, g_dot, g_ddot).

        The gradient with respect to p is added to `numbers`.
        """
        total = self._motion if by_force.any() else self._levels
        return self._weigh(total, time, at, np.concatenate([by_force, by_levels.ravel()]))

    def _weigh_matrix(
        self,
        time: Array,
        at: State,
        coefficients: tuple[float, float, float],
        left: Array,
        right: Array,
        reactions: Array | None = None,
        by_forces: Array | None = None,
    ) -> State:
        """Return the gradient, a State, of left^T A right with the saddle-point matrix A.

        With (0, lam) = `reactions` and (y, 0) = `by_forces`, y^T G^T lam is added.
        """
        pattern = self._sums.saddle_pattern
        row, column = pattern.indices, column_indices(pattern)
        weights = left[row] * right[column]
        if reactions is not None and by_forces is not None:
            weights += reactions[row] * by_forces[column]
        return self._weigh_nonzeros(time, at, coefficients, weights)

    def weigh_constraint_matrix(self, time: Array, q: Array, weights: Array) -> Array:
        """Return the gradient (n,) with respect to q of the sum of weights * G, (m, n) each.

        It is the transpose of `StartDerivatives.constraint_gradients`.
        """
        n, m, pattern = self.equations.n, self.equations.m, self._sums.saddle_pattern
        row, column = pattern.indices, column_indices(pattern)
        is_gradient = (row >= n) & (column < n)
        by_nonzeros = np.zeros(len(row))
        by_nonzeros[is_gradient] = weights[row[is_gradient] - n, column[is_gradient]]
        at = State(q, np.zeros(n), np.zeros(n), np.zeros(m))
        return self._weigh_nonzeros(time, at, _MASS, by_nonzeros).q

    def _weigh_nonzeros(
        self,
        time: Array,
        at: State,
        coefficients: tuple[float, float, float],
        weights: Array,
    ) -> State:
        """Return the gradient, a State, of the sum of weights * non-zeros of the matrix."""
        for total in (self._saddle, self._moved_sums.get(id(self._saddle))):
            if total is not None:
                set_matrix_factors(total, *coefficients, c_l=1.0, c_h=1.0, c_r=1.0)
        return self._weigh(self._saddle, time, at, weights)

    def _weigh(self, total: SumEvaluator, time: Array, at: State, weights: Array) -> State:
        n, size = self.equations.n, 3 * self.equations.n + self.equations.m
        set_time(total, *time)
        result = total(np.concatenate([*at, weights]), size + len(self.numbers))
        self.numbers += result[size:]
        moved = self._moved_sums.get(id(total))
        if moved is not None:
            set_time(moved, *time)
            change = moved(np.concatenate([*at, np.zeros(len(result))]), len(weights))
            self.along_operators += float(weights @ change)
        return State(*np.split(result[:size], [n, 2 * n, 3 * n]))

    def _factorize(
        self, time: Array, q: Array, v: Array, coefficients: tuple[float, float, float]
    ) -> Factorization:
        nonzeros = self._saddle_nonzeros(time, q, v, coefficients)
        return self._factors(self._sums.saddle_pattern, nonzeros)

    def _solve_transposed(
        self,
        time: Array,
        q: Array,
        v: Array,
        coefficients: tuple[float, float, float],
        by_motion: Array,
        by_lam: Array | None = None,
        lam: Array | None = None,
    ) -> Array:
        """Return A^-T (by_motion, by_lam) with the saddle-point matrix A."""
        pattern, positions = _transpose_saddle_pattern(self.equations.structure)
        nonzeros = np.empty(pattern.nnz)
        nonzeros[positions] = self._saddle_nonzeros(time, q, v, coefficients, lam)
        rest = np.zeros(self.equations.m) if by_lam is None else by_lam
        return self._factors(pattern, nonzeros).solve(np.concatenate([by_motion, rest]))

    def _saddle_nonzeros(
        self,
        time: Array,
        q: Array,
        v: Array,
        coefficients: tuple[float, float, float],
        lam: Array | None = None,
    ) -> Array:
        """Return the non-zeros of the saddle-point matrix A; consecutive calls often repeat them.

        Without friction and without a stiffness term, A does not depend on the multipliers.
        """
        if coefficients[0] == 0.0 and all(term.rows is None for term in self.equations.forces):
            lam = None
        parts = [time, q, v, np.array(coefficients), np.zeros(0) if lam is None else lam]
        return self._recent_nonzeros.get(
            np.concatenate(parts),
            lambda: self.solver.saddle_matrix(time, q, v, None, coefficients, lam),
        )

    def _factors(self, pattern: sp.csc_array, nonzeros: Array) -> Factorization:
        """Return the factors of a matrix; those of the last matrix of a pattern are kept."""
        known = self._recent_factors.get(id(pattern))
        if known is not None and np.array_equal(known[0], nonzeros):
            return known[1]
        factors = create_factorization(pattern)
        factors.factorize(nonzeros)
        self._recent_factors[id(pattern)] = nonzeros, factors
        return factors


def _add(one: State, other: State) -> State:
    return State(*(x + y for x, y in zip(one, other, strict=True)))
