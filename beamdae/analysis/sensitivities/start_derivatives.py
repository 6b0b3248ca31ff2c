"""Derivatives of consistent states, impacts and the start of generalized-alpha runs.

The maps are recorded once, see `recorded_maps`; their derivatives are applied forward or
transposed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.operator_changes import directional_plan_along
from beamdae.analysis.sensitivities.recorded_maps import (
    DifferentiableSum,
    Record,
    Term,
    Variable,
    plan_direction,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.formulations.sums import InputLayout, assemble_motion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import (
    MASS_COEFFICIENTS,
    SECOND_DIFFERENCE,
    Coefficients,
    plan_constraint_levels,
    plan_state_sums,
)
from beamdae.equations.structure import Structure, cache_on_owner, share_plans
from beamdae.integrators.alpha.family import JERK_INTERVAL, STIFF_TIME, AlphaStart
from beamdae.linear.factorizations import create_factorization
from beamdae.symbolic.sparse_operators import transpose_pattern
from beamdae.symbolic.sums.directional_sums import directional_plan
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray

# Coefficients of stiffness, damping and mass in the matrix that closes joints.
_CLOSING = (1.0, 0.0, 1.0)
# Larger corrections of a differenced equilibrium, relative to the difference, are motions without
# stiffness.
_MAX_EQUILIBRIUM_CORRECTION = 1e-4
# Larger errors of a solution of the static equations show that the equilibrium is not unique. Those
# of stiff beams reach 1e-7.
_MAX_EQUILIBRIUM_ERROR = 1e-6
_EQUILIBRATION_STEPS = 8  # each takes the square root of the ratios of the largest entries
# Difference of time for partial derivatives with respect to time, relative to the step.
_STEP_FRACTION = 1e-3
# Stiffnesses of contacts are proportional to the square root of the penetration, whose slope has no
# bound. Up to this penetration [m], starting values are differentiated with constant stiffnesses:
# a slope at a penetration of 1e-15 m, due to rounding, would dominate the derivatives of the run.
# From this penetration on, the effect of the slopes was less than 1e-3 of a derivative.
MIN_STIFF_PENETRATION = 1e-6
# Stored factors of states, which several maps need.
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


class StaticFactors:
    """Factors of the tangent of static equations.

    Condition numbers of static equations reach 1e12, those of scaled ones 1e8: without scales, a
    steel leaf spring of 8 elements had errors of 5e-6, and 1e-9 with scales. Rows and columns have
    the same scales, with which the largest entry of each is near 1; D. Ruiz, A scaling algorithm to
    equilibrate both rows and columns norms in matrices, RAL-TR-2001-034.

    Attributes
    ----------
    is_unique
        False if the equilibrium is not unique: a motion without stiffness makes solutions
        inaccurate.
    is_singular
        True if there are no factors.
    """

    def __init__(self, equations: EquationsOfMotion, time: Array, at: State) -> None:
        matrix = StaticEquations(equations, time).matrix(at.q, at.lam)
        magnitudes, scales = abs(matrix).tocoo(), np.ones(matrix.shape[0])
        rows, columns = magnitudes.coords
        for _ in range(_EQUILIBRATION_STEPS):
            values = magnitudes.data * scales[rows] * scales[columns]
            largest = np.zeros(len(scales))
            np.maximum.at(largest, rows, values)
            np.maximum.at(largest, columns, values)
            scales /= np.sqrt(np.where(largest > 0.0, largest, 1.0))
        self._scales = scales
        self._matrix = sp.csc_array(sp.diags_array(scales) @ matrix @ sp.diags_array(scales))
        self.is_singular, self.is_unique = False, False
        try:
            self._factors = splu(self._matrix)
        except RuntimeError:
            self.is_singular = True
            return
        expected = np.ones(len(scales))
        error = self._factors.solve(self._matrix @ expected) - expected
        self.is_unique = bool(np.max(np.abs(error)) <= _MAX_EQUILIBRIUM_ERROR)

    def solve(self, right: Array, transposed: bool) -> Array:
        """Return the solution of the equations or of the transposed ones, with one refinement."""
        trans, matrix = ("T", self._matrix.T) if transposed else ("N", self._matrix)
        right = self._scales * right
        solution = self._factors.solve(right, trans)
        solution += self._factors.solve(right - matrix @ solution, trans)
        return self._scales * solution


def has_unique_equilibrium(equations: EquationsOfMotion, time: Array) -> bool:
    """Return True if derivatives of the equilibrium at the start follow from static equations."""
    at = ConsistencySolver(equations).state(time, equations.q0, np.zeros(equations.n))
    return StaticFactors(equations, time, at).is_unique


@dataclass(frozen=True)
class StartDerivatives:
    """Records of the maps to consistent states, and sums along directions.

    Attributes
    ----------
    solver
        Solver for consistent states.
    moving
        Models at neighboring values of the parameter of all directions, if operators of joints
        depend on it; otherwise None.

    Times are arrays (t, branch).
    """

    solver: ConsistencySolver
    moving: Difference | None = None
    _factors: dict[Any, Callable[[Array, bool], Array]] = field(
        default_factory=dict, init=False, repr=False
    )

    def directional_plan(self, plan: Callable[[Structure], SumPlan], n_inputs: int) -> SumPlan:
        """Return the directional derivative of a sum with inputs of size `n_inputs`.

        `plan` returns the plan of the sum of a structure; it is a function of a module, because
        plans are cached by function.
        """
        if self.moving is not None:
            return directional_plan_along(self.moving, lambda e: plan(e.structure), n_inputs)
        return plan_direction(self.equations.structure, plan, n_inputs)

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the solver."""
        return self.solver.equations

    def _sum(
        self, plan: Callable[[Structure], SumPlan], size: int, *, of_change: bool = False
    ) -> DifferentiableSum:
        e = self.equations
        n_inputs = 3 * e.n + e.m
        if of_change:
            n_inputs = 2 * n_inputs + len(e.p)
        min_base = MIN_STIFF_PENETRATION if of_change else 0.0
        return DifferentiableSum(e, plan, n_inputs, size, self.moving, min_base)

    @cached_property
    def _motion(self) -> DifferentiableSum:
        return self._sum(_plan_motion, 2 * self.equations.n + 3 * self.equations.m)

    @cached_property
    def _smooth_motion(self) -> DifferentiableSum:
        return self._sum(_plan_smooth_motion, self.equations.n + 3 * self.equations.m)

    @cached_property
    def _levels(self) -> DifferentiableSum:
        return self._sum(plan_constraint_levels, self.equations.n + 3 * self.equations.m)

    @cached_property
    def _gradients(self) -> DifferentiableSum:
        return self._sum(_plan_gradients, self.solver.sums.gradient_pattern.nnz)

    @cached_property
    def _change(self) -> DifferentiableSum:
        size = 2 * self.equations.n + 3 * self.equations.m
        return self._sum(_plan_change, size, of_change=True)

    def start_map(self, time: Array, at: State, v: Array) -> Record:
        """Return the map from requested (q, v) to the consistent state (q, v, a, lam).

        Parameters
        ----------
        time, at
            (t, branch), and the consistent state, whose positions close the joints except for
            rounding.
        v
            Requested velocities.
        """
        record = self._record(time, 0.0)
        record.inputs = request = record.variables(at.q, v)
        consistent = self._project(record, at, *request, moves=False)
        record.outputs = self._complete(record, at, *consistent, moves=False)
        return record

    def restart_map(self, time: Array, at: State, v: Array, h: float) -> Record:
        """Return the map of `start_map` with a moving time, for a step `h` [s] after it.

        The inputs are those along the moving time. The outputs are the consistent state along the
        moving time, (q, v, a, lam), and that at fixed time.
        """
        record = self._record(time, h)
        record.inputs = request = record.variables(at.q, v)
        moved_q, moved_v = self._project(record, at, *request, moves=True)
        q = record.combine((1.0, moved_q), (-at.v, record.shift), value=at.q)
        v_fixed = record.combine((1.0, moved_v), (-at.a, record.shift), value=at.v)
        record.outputs = (
            *self._complete(record, at, moved_q, moved_v, moves=True),
            *self._complete(record, at, q, v_fixed, moves=False),
        )
        return record

    def impact_map(
        self, time: Array, at: State, active: Array, restitution: Array, h: float
    ) -> Record:
        """Return the map from (q, v, restitution) to v after an impact, see `apply_impact`.

        Parameters
        ----------
        time, at
            (t, branch), and the state before the impact.
        active
            Indices of the constraints that act.
        restitution
            Coefficients of restitution of all constraints, (m,).
        h
            Step of the run [s].
        """
        n, rates = self.equations.n, self.solver.constraint_levels(time, at.q, at.v)[1]
        kept = np.concatenate([np.arange(n), n + active])
        pattern = self.solver.sums.saddle_pattern
        nonzeros = self.solver.saddle_matrix(time, at.q, at.v, None, MASS_COEFFICIENTS)
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
        factors = splu(sp.csc_array(matrix[kept][:, kept]))

        def solve(right: Array, transposed: bool) -> Array:
            solution = np.zeros(len(right))
            solution[kept] = factors.solve(right[kept], "T" if transposed else "N")
            return solution

        record = self._record(time, h)
        record.inputs = q, v, e = record.variables(at.q, at.v, restitution)
        right = np.concatenate([np.zeros(n), -(1.0 + restitution) * rates])
        rate = self._level(record, 1, q, v, moves=True)
        opening = record.combine((1.0 + restitution, rate), (rates, e))
        record.outputs = (self._correct(record, solve, right, q, v, opening, moves=True),)
        return record

    def gradient_map(self, time: Array, q: Array) -> Record:
        """Return the map from q to the non-zeros of G on `sums.gradient_pattern`."""
        record = self._record(time, 0.0)
        record.inputs = variables = record.variables(q)
        rest = record.variables(*self.solver.rest_state(q)[1:])
        record.outputs = (record.evaluate(self._gradients, (*variables, *rest)),)
        return record

    def initial_motion(self, start: AlphaStart, time: Array, at: State, h: float) -> Record:
        """Return the map of `AlphaStart.initial_motion` for steps `h` [s].

        It maps the state (q, v, a, lam) to (q, v, q'', algorithmic acceleration).
        """
        record = self._record(time, h)
        record.inputs = q, v, a, _ = record.variables(*at)
        record.outputs = q, v, a, a
        if not start.cured:
            return record
        interval, stiff_time = JERK_INTERVAL * h, STIFF_TIME * h
        jerk = self._normal_jerk(record, q, v, a, interval, holonomic_only=False)
        solution = self.solver.acceleration(time, at.q, at.v, stiff_time=stiff_time)
        ddq, _ = self._accelerations(record, q, v, *solution, moves=True, stiff_time=stiff_time)
        if start.index3:
            position_jerk = jerk
            if self.equations.nonholonomic_rows.size:
                position_jerk = self._normal_jerk(record, q, v, a, interval, holonomic_only=True)
            v = record.combine((1.0, v), (h**2 * start.member.defect, position_jerk))
        record.outputs = q, v, ddq, record.combine((1.0, ddq), (start.member.shift * h, jerk))
        return record

    def jerk_map(self, time: Array, at: State, h: float) -> Record:
        """Return the map from (q, v, a) to the normal jerk that corrects steps `h` [s]."""
        record = self._record(time, h)
        record.inputs = q, v, a = record.variables(*at[:3])
        jerk = self._normal_jerk(record, q, v, a, JERK_INTERVAL * h, holonomic_only=True)
        record.outputs = (jerk,)
        return record

    def correct_equilibrium(self, time: Array, at: State, dq: Array, dp: Array) -> Array:
        """Return the derivative of equilibrium positions, given an approximation dq.

        It solves [[K, G^T + dF/dlam], [G, 0]] (dq, dlam) = -(dF/dp dp + d(G^T lam)/dp dp, dg/dp dp)
        with K = d(F + G^T lam)/dq. If the equilibrium is not unique, dq is corrected only if the
        correction is small.
        """
        factors = StaticFactors(self.equations, time, at)
        if factors.is_singular:
            return dq
        # The residual along (dq, dp) corrects dq.
        record = self._equilibrium_map(time, at, factors)
        change = record.along([dq[None]], dp[None])[0][0] - dq
        size = np.max(np.abs(dq), initial=0.0)
        is_small = np.max(np.abs(change), initial=0.0) <= _MAX_EQUILIBRIUM_CORRECTION * size
        return dq + change if factors.is_unique or is_small else dq

    def equilibrium_gradient(
        self, time: Array, at: State, by_q: Array, by_lam: Array
    ) -> Array | None:
        """Return the gradient (n_p,) of an objective of an equilibrium with respect to p.

        Return None if the equilibrium is not unique.

        Parameters
        ----------
        time, at
            (t, branch), and the equilibrium.
        by_q, by_lam
            Derivatives of the objective with respect to the positions and the multipliers.
        """
        factors = StaticFactors(self.equations, time, at)
        if not factors.is_unique:
            return None
        return self._equilibrium_map(time, at, factors).transposed(by_q, by_lam).numbers

    def _equilibrium_map(self, time: Array, at: State, factors: StaticFactors) -> Record:
        """Return the map from approximate positions to those of the equilibrium, (q, lam)."""
        e, record = self.equations, self._record(time, 0.0)
        record.inputs = (q,) = record.variables(at.q)
        zeros = np.zeros(e.n)
        rest = record.variables(zeros, zeros, at.lam)
        motion = record.evaluate(self._motion, (q, *rest))
        force, reactions = self._forces(record, motion)
        solution = record.solve(
            factors.solve,
            e.n + e.m,
            (record.combine((1.0, force), (1.0, reactions)), slice(e.n)),
            (record.take(motion, slice(e.n, e.n + e.m)), slice(e.n, None)),
        )
        record.outputs = (
            record.combine((1.0, q), (-1.0, record.take(solution, slice(e.n)))),
            record.combine((-1.0, record.take(solution, slice(e.n, None)))),
        )
        return record

    def _record(self, time: Array, h: float) -> Record:
        return Record(len(self.equations.p), time, _STEP_FRACTION * h)

    def _project(
        self, record: Record, at: State, q: Variable, v: Variable, *, moves: bool
    ) -> tuple[Variable, Variable]:
        """Return consistent positions and velocities."""
        q = self._close(record, at.q, q, moves=moves)
        if self.equations.m == 0:
            return q, v
        rates = self.solver.constraint_levels(record.time, at.q, v.point)[1]
        right = np.concatenate([np.zeros(self.equations.n), -rates])
        rate = self._level(record, 1, q, v, moves=moves)
        solve = self._factorize(record.time, at.q, v.point, MASS_COEFFICIENTS)
        v = self._correct(record, solve, right, q, v, rate, moves)
        return q, replace(v, value=at.v)

    def _close(self, record: Record, at: Array, q: Variable, *, moves: bool) -> Variable:
        """Return positions that close the joints; states do not change."""
        e = self.equations
        if e.m == 0:
            return q
        gap = self._level(record, 0, q, moves=moves)
        solve = self._factorize(record.time, at, np.zeros(e.n), _CLOSING)
        change = record.solve(solve, e.n + e.m, (gap, slice(e.n, None)))
        moving = -e.without_states(np.ones(e.n))
        return record.combine((1.0, q), (moving, record.take(change, slice(e.n))), value=at)

    def _complete(
        self, record: Record, at: State, q: Variable, v: Variable, *, moves: bool
    ) -> tuple[Variable, ...]:
        """Return the state at consistent (q, v), with the rates of first-order states."""
        e = self.equations
        if len(e.states):
            rest = record.variables(at.a, np.zeros(e.m))
            motion = record.evaluate(self._motion, (q, v, *rest), moves=moves)
            of_states = e.without_states(np.ones(e.n)) - 1.0
            v = record.combine((1.0, v), (of_states, record.take(motion, slice(e.n))), value=at.v)
        return q, v, *self._accelerations(record, q, v, at.a, at.lam, moves=moves)

    def _accelerations(
        self,
        record: Record,
        q: Variable,
        v: Variable,
        a: Array,
        lam: Array,
        *,
        moves: bool,
        stiff_time: float = 0.0,
    ) -> tuple[Variable, Variable]:
        """Return (a, lam) of `ConsistencySolver.acceleration`, given their values."""
        e = self.equations

        motion = record.evaluate(self._motion, (q, v, *record.variables(a, lam)), moves=moves)
        forces: list[Term] = [(1.0, x) for x in self._forces(record, motion)]
        if stiff_time:
            rest = record.variables(np.zeros(e.n), lam)
            direction = np.zeros(3 * e.n + e.m + len(e.p))
            direction[: e.n] = stiff_time**2 * a
            change = record.evaluate(
                self._change, (q, v, *rest), direction=[direction], moves=moves
            )
            forces.append((1.0, record.take(change, slice(e.n))))
            forces += self._force_change(record, q, v, stiff_time, moves)
        solution = record.solve(
            self._factorize(record.time, q.point, v.point, (stiff_time**2, 0.0, 1.0), lam),
            e.n + e.m,
            (record.combine(*forces), slice(e.n)),
            (record.take(motion, slice(e.n + 2 * e.m, e.n + 3 * e.m)), slice(e.n, None)),
        )
        return (
            record.combine((-1.0, record.take(solution, slice(e.n))), value=a),
            record.combine((-1.0, record.take(solution, slice(e.n, None))), value=lam),
        )

    def _force_change(
        self, record: Record, q: Variable, v: Variable, delta: float, moves: bool
    ) -> list[Term]:
        """Return the terms of `ConsistencySolver.evaluate_force_change`."""
        e = self.equations
        rest, moving = self._zeros(record)[1:], e.without_states(np.ones(e.n))
        terms: list[Term] = []
        for factor, shift in SECOND_DIFFERENCE:
            moved = record.combine((1.0, q), (shift * delta * moving, v))
            motion = record.evaluate(self._smooth_motion, (moved, v, *rest), moves=moves)
            terms.append((factor * moving, record.take(motion, slice(e.n))))
        return terms

    def _normal_jerk(
        self,
        record: Record,
        q: Variable,
        v: Variable,
        a: Variable,
        delta: float,
        holonomic_only: bool,
    ) -> Variable:
        """Return `ConsistencySolver.evaluate_normal_jerk`."""
        e, none = self.equations, record.variables(np.zeros(self.equations.n))[0]
        if e.m == 0:
            return none

        factor = np.full(e.m, 0.5 / delta)
        if holonomic_only:
            factor[e.nonholonomic_rows] = 0.0
        right, terms = np.zeros(e.n + e.m), []
        for d in (delta, -delta):
            moved = record.combine((1.0, q), (d, v), (0.5 * d**2, a))
            velocity = record.combine((1.0, v), (d, a))
            level = self._level(record, 2, moved, velocity, a, moves=True, shift=d)
            terms.append((np.sign(d) * factor, level))
            values = moved.point, velocity.point, a.point
            time = record.time + np.array([d, 0.0])
            right[e.n :] -= terms[-1][0] * self.solver.constraint_levels(time, *values)[2]
        solve = self._factorize(record.time, q.point, v.point, MASS_COEFFICIENTS)
        rate = record.combine(*terms)
        return self._correct(record, solve, right, q, v, rate, moves=True, start=none)

    def _correct(
        self,
        record: Record,
        solve: Callable[[Array, bool], Array],
        right: Array,
        q: Variable,
        v: Variable,
        rate: Variable,
        moves: bool,
        start: Variable | None = None,
    ) -> Variable:
        """Return velocities x + z, where M z + G^T mu = 0 and G z = -rate; x is v by default.

        `right` is the right-hand side of these equations.
        """
        e, z = self.equations, solve(right, False)
        terms, rates = [], [(1.0, rate)]
        if z.any():
            rest = self._zeros(record)
            direction = np.concatenate([np.zeros(2 * e.n), z, np.zeros(len(e.p))])
            change = record.evaluate(
                self._change, (q, v, *rest[1:]), direction=[direction], moves=moves
            )
            forces = record.combine(*((1.0, x) for x in self._forces(record, change)))
            terms = [(forces, slice(e.n))]
            rates.append((1.0, record.take(change, slice(e.n + 2 * e.m, e.n + 3 * e.m))))
        solution = record.solve(
            solve, e.n + e.m, *terms, (record.combine(*rates), slice(e.n, None))
        )
        x = start or v
        return record.combine(
            (1.0, x), (-1.0, record.take(solution, slice(e.n))), value=x.point + z[: e.n]
        )

    def _level(
        self, record: Record, level: int, *motion: Variable, moves: bool, shift: float = 0.0
    ) -> Variable:
        """Return g, g_dot or g_ddot at (q, v, a); omitted arguments are zero."""
        e, zeros = self.equations, self._zeros(record)
        state = (*motion, *zeros[len(motion) - 1 :])
        total = record.evaluate(self._levels, state, shift=shift, moves=moves)
        first = e.n + level * e.m
        return record.take(total, slice(first, first + e.m))

    def _forces(self, record: Record, motion: Variable) -> tuple[Variable, Variable]:
        """Return F and G^T lam."""
        n, m = self.equations.n, self.equations.m
        return record.take(motion, slice(n)), record.take(motion, slice(n + 3 * m, None))

    def _zeros(self, record: Record) -> tuple[Variable, ...]:
        """Return zero velocities, accelerations and multipliers."""
        n, m = self.equations.n, self.equations.m
        return record.variables(np.zeros(n), np.zeros(n), np.zeros(m))

    def _factorize(
        self,
        time: Array,
        q: Array,
        v: Array,
        coefficients: Coefficients,
        lam: Array | None = None,
    ) -> Callable[[Array, bool], Array]:
        """Return the function that solves the equations of the saddle-point matrix."""
        if all(term.rows is None for term in self.equations.forces):
            lam = None  # Without friction, the matrix does not depend on the multipliers.
        key = coefficients, *(None if x is None else x.tobytes() for x in (time, q, v, lam))
        if key not in self._factors:
            if len(self._factors) >= _MAX_STATES:
                self._factors.clear()
            nonzeros = self.solver.saddle_matrix(time, q, v, None, coefficients, lam)
            self._factors[key] = _TransposableFactors(self.equations.structure, nonzeros).solve
        return self._factors[key]


@cache_on_owner
def _transpose_saddle_pattern(structure: Structure) -> tuple[sp.csc_array, Array]:
    return transpose_pattern(plan_state_sums(structure).saddle_pattern)


class _TransposableFactors:
    """Factors of the saddle-point matrix, and those of its transpose, if they are needed."""

    def __init__(self, structure: Structure, nonzeros: Array) -> None:
        self._structure, self._nonzeros = structure, nonzeros
        self._factors: dict[bool, Any] = {}

    def solve(self, right: Array, transposed: bool) -> Array:
        """Return the solution of the equations or of the transposed ones."""
        if transposed not in self._factors:
            pattern, nonzeros = plan_state_sums(self._structure).saddle_pattern, self._nonzeros
            if transposed:
                pattern, positions = _transpose_saddle_pattern(self._structure)
                nonzeros = np.empty(pattern.nnz)
                nonzeros[positions] = self._nonzeros
            factors = create_factorization(pattern)
            factors.factorize(nonzeros)
            self._factors[transposed] = factors
        return self._factors[transposed].solve(right)


def time_rate(function: Callable[[Array], Array], time: Array, h: float) -> Array:
    """Return the partial derivative of a function of (t, branch) with respect to t.

    `h` is a step of the run [s], which resolves the laws.
    """
    delta = _STEP_FRACTION * h
    ahead, behind = (function(time + np.array([d, 0.0])) for d in (delta, -delta))
    return (ahead - behind) / (2.0 * delta)
