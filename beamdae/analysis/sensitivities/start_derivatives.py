"""Derivatives of consistent states, impacts and the start of generalized-alpha runs.

The solver for consistent states is called with recorded arrays, see `recorded_maps`; the
derivatives of its functions are applied forward or transposed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.continuation.engine import RefinedFactors
from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    equations_key,
    moves_operators,
)
from beamdae.analysis.sensitivities.recorded_maps import (
    DifferentiableSum,
    Record,
    value_of,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.starts.closing import CLOSING_COEFFICIENTS
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import (
    MASS_COEFFICIENTS,
    Coefficients,
    PlanFunction,
    plan_balance,
)
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    cache_on_owner,
    comparison_key,
)
from beamdae.integrators.alpha.family import JERK_INTERVAL, AlphaStart
from beamdae.symbolic.sums.directional_sums import directional_plan
from beamdae.symbolic.sums.kernel_sums import SumPlan

Array = np.ndarray

# Larger errors of a solution of the static equations show that the equilibrium is not unique. Those
# of stiff beams reach 1e-7.
_MAX_EQUILIBRIUM_ERROR = 1e-6
_EQUILIBRATION_STEPS = 8  # each takes the square root of the ratios of the largest entries
# Difference of time for partial derivatives with respect to time, relative to the step.
STEP_FRACTION = 1e-3
# Stiffnesses of contacts are proportional to the square root of the penetration, whose slope has no
# bound. Up to this penetration [m], starting values are differentiated with constant stiffnesses:
# a slope at a penetration of 1e-15 m, due to rounding, would dominate the derivatives of the run.
# From this penetration on, the effect of the slopes was less than 1e-3 of a derivative.
MIN_STIFF_PENETRATION = 1e-6
# Stored factors of states, which several maps need.
_MAX_STATES = 8


@cache_on_owner
def _plan_change(structure: Structure) -> SumPlan:
    """Return the plan of the derivative of `plan_balance` along a change of the state."""
    return directional_plan(plan_balance(structure), 3 * structure.n + structure.m)


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
        inaccurate or the matrix singular.
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
        scaled = sp.csc_array(sp.diags_array(scales) @ matrix @ sp.diags_array(scales))
        self.is_unique = False
        try:
            factors = splu(scaled)
        except RuntimeError:
            return
        self._factors = RefinedFactors(scaled, factors, scales)
        expected = np.ones(len(scales))
        error = factors.solve(scaled @ expected) - expected
        self.is_unique = bool(np.max(np.abs(error)) <= _MAX_EQUILIBRIUM_ERROR)

    def solve(self, right: Array, transposed: bool) -> Array:
        """Return the solution of the equations or of the transposed ones, with one refinement."""
        return self._factors.solve(right, "T" if transposed else "N")


def has_unique_equilibrium(equations: EquationsOfMotion, time: Array) -> bool:
    """Return True if derivatives of the equilibrium at the start follow from static equations."""
    at = ConsistencySolver(equations).state(time, equations.q0, np.zeros(equations.n))
    return StaticFactors(equations, time, at).is_unique


@dataclass(frozen=True)
class RecordingSolver(ConsistencySolver):
    """Solver for consistent states whose functions record their operations.

    Its functions are those of `ConsistencySolver`, called with recorded arrays. The solution x of
    an equation R(x) = 0 is recorded as x - A^-1 R(x) with a constant x and A = dR/dx, which has the
    same derivative.

    Attributes
    ----------
    derivatives, record
        Sums and factors, and the record.
    at
        Consistent state near which states are recorded; None if it is not known.
    """

    derivatives: StartDerivatives
    record: Record
    at: State | None

    def evaluate(self, plan: PlanFunction, time: Array, state: Sequence[Any], size: int) -> Any:
        """See `StateEvaluator`."""
        e = self.equations
        zeros = (np.zeros(k) for k in (e.n, e.n, e.n, e.m))
        state = [z if x is None else x for x, z in zip(state, zeros, strict=True)]
        return self.record.evaluate(self.derivatives.sum(plan, size), time, state)

    def _split_levels(self, motion: Any) -> Any:
        n, m = self.equations.n, self.equations.m
        return [motion[n + k * m : n + (k + 1) * m] for k in range(3)]

    def stiffness_force(self, time: Array, q: Any, v: Any, lam: Any, x: Array) -> Any:
        """See `StateEvaluator`."""
        change = np.concatenate([x, np.zeros(2 * self.equations.n + self.equations.m)])
        return self._change(time, q, v, lam, change)[: self.equations.n]

    def _change(self, time: Array, q: Any, v: Any, lam: Array, change: Array) -> Any:
        """Return the derivative of (F, g, g_dot, g_ddot, G^T lam) along a change of the state."""
        e = self.equations
        state = (q, v, np.zeros(e.n), lam, change, np.zeros(len(e.p)))
        return self.record.evaluate(self.derivatives.change, time, state)

    def close_positions(self, time: Array, q: Any, requested: Any = None) -> Any:
        """Return the positions that close the joints, near those of a consistent state."""
        e = self.equations
        if e.m == 0:
            return q
        at_rest = np.zeros(e.n)
        solve = self.derivatives.factorize(time, q.value, at_rest, CLOSING_COEFFICIENTS)
        right = np.zeros(e.n), self.position_gaps(time, q)
        change = self.record.solve(solve, right, np.zeros(e.n + e.m))[: e.n]
        return q - e.without_states(np.ones(e.n)) * change

    def solve_saddle(
        self,
        time: Array,
        q: Any,
        v: Any,
        force: Any,
        rates: Any,
        coefficients: Coefficients = MASS_COEFFICIENTS,
        lam: Array | None = None,
    ) -> tuple[Any, Any]:
        """See `StateEvaluator`."""
        e = self.equations
        at = q.value, value_of(v)
        solve = self.derivatives.factorize(time, *at, coefficients, lam)
        right = [
            np.zeros(k) if isinstance(x, float) else x for k, x in ((e.n, force), (e.m, rates))
        ]
        if lam is not None:  # The correction of a solution.
            solution = self.record.solve(solve, right, np.zeros(e.n + e.m))
            return solution[: e.n], solution[e.n :]
        x = solve(np.concatenate([value_of(y) for y in right]), False)
        if x.any():
            assert coefficients == MASS_COEFFICIENTS
            at_rest = np.zeros(2 * e.n)
            change = self._change(time, q, v, np.zeros(e.m), np.concatenate([at_rest, x]))
            levels = self._split_levels(change)
            right = [right[0] - change[: e.n] - change[e.n + 3 * e.m :], right[1] - levels[2]]
        solution = self.record.solve(solve, right, x)
        return solution[: e.n], solution[e.n :]

    def acceleration(self, time: Array, q: Any, v: Any, stiff_time: float = 0.0) -> tuple[Any, Any]:
        """See `ConsistencySolver`."""
        if stiff_time == 0.0 and self.at is not None:
            _, _, a, lam = self.at
        else:
            a, lam = self.derivatives.solver.acceleration(time, q.value, v.value, stiff_time)
        force, rates = self.unbalance(time, q, v, a, lam, stiff_time)
        coefficients = (stiff_time**2, 0.0, 1.0)
        da, dlam = self.solve_saddle(time, q, v, -force, -rates, coefficients, lam)
        return a + da, lam + dlam


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
    _sums: dict[PlanFunction, DifferentiableSum] = field(
        default_factory=dict, init=False, repr=False
    )
    _factors: dict[Any, Callable[[Array, bool], Array]] = field(
        default_factory=dict, init=False, repr=False
    )

    @classmethod
    def of(cls, difference: Difference) -> StartDerivatives:
        """Return the derivatives along directions of a parameter."""
        moving = difference if moves_operators(difference) else None
        return cls(ConsistencySolver(difference.base), moving)

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the solver."""
        return self.solver.equations

    def sum(self, plan: PlanFunction, size: int) -> DifferentiableSum:
        """Return a sum of `StateEvaluator`."""
        if plan not in self._sums:
            e = self.equations
            self._sums[plan] = DifferentiableSum(e, plan, 3 * e.n + e.m, size, self.moving)
        return self._sums[plan]

    @cached_property
    def change(self) -> DifferentiableSum:
        """Derivative of (F, g, g_dot, g_ddot, G^T lam) along a change of the state."""
        e = self.equations
        n_inputs, size = 2 * (3 * e.n + e.m) + len(e.p), 2 * e.n + 3 * e.m
        return DifferentiableSum(
            e, _plan_change, n_inputs, size, self.moving, MIN_STIFF_PENETRATION
        )

    def start_map(self, time: Array, at: State, v: Array, h: float = 0.0) -> Record:
        """Return the map from requested (q, v) to the consistent state (q, v, a, lam).

        Parameters
        ----------
        time, at
            (t, branch), and the consistent state, whose positions close the joints except for
            rounding.
        v
            Requested velocities.
        h
            Step after it [s] if the time moves, and all derivatives are those along the moving
            time.
        """
        record, solver = self._record(h, at)
        record.inputs = q, v = record.variables(at.q, v)
        q = solver.close_positions(time, q)
        record.outputs = solver.complete(time, q, solver.project_velocities(time, q, v))
        return record

    def completion_map(self, time: Array, at: State) -> Record:
        """Return the map from consistent (q, v) at a fixed time to the state (q, v, a, lam)."""
        record, solver = self._record(0.0, at)
        record.inputs = q, v = record.variables(at.q, at.v)
        record.outputs = solver.complete(time, q, v)
        return record

    def initial_motion(self, start: AlphaStart, time: Array, at: State, h: float) -> Record:
        """Return the map of `AlphaStart.initial_motion` for steps `h` [s].

        It maps the state (q, v, a, lam) to (q, v, q'', algorithmic acceleration).
        """
        record, solver = self._record(h)
        record.inputs = state = record.variables(*at)
        motion = replace(start, solver=solver).initial_motion(time, State(*state), h)
        record.outputs = motion.q, motion.v, motion.ddq, motion.a
        return record

    def jerk_map(self, time: Array, at: State, h: float) -> Record:
        """Return the map from (q, v, a) to the normal jerk that corrects steps `h` [s]."""
        record, solver = self._record(h)
        record.inputs = q, v, a = record.variables(*at[:3])
        interval = JERK_INTERVAL * h
        jerk = solver.evaluate_normal_jerk(time, State(q, v, a, at.lam), interval, True)
        record.outputs = (jerk,)
        return record

    def correct_equilibrium(self, time: Array, at: State, dq: Array, dp: Array) -> Array:
        """Return the derivative of equilibrium positions, given an approximation dq.

        It solves [[K, G^T + dF/dlam], [G, 0]] (dq, dlam) = -(dF/dp dp + d(G^T lam)/dp dp, dg/dp dp)
        with K = d(F + G^T lam)/dq. If the equilibrium is not unique, dq is returned.
        """
        factors = StaticFactors(self.equations, time, at)
        if not factors.is_unique:
            return dq
        # The residual along (dq, dp) corrects dq.
        record = self._equilibrium_map(time, at, factors)
        return record.along([dq[None]], dp[None])[0][0]

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
        n, (record, solver) = self.equations.n, self._record(0.0)
        record.inputs = (q,) = record.variables(at.q)
        force, levels = solver.balance(time, q, None, None, at.lam)
        right = -force, -levels[0]
        change = record.solve(factors.solve, right, np.zeros(n + self.equations.m))
        record.outputs = q + change[:n], at.lam + change[n:]
        return record

    def _record(self, h: float, at: State | None = None) -> tuple[Record, RecordingSolver]:
        """Return a record and its solver; `h` is the step of a moving time [s]."""
        record = Record(len(self.equations.p), STEP_FRACTION * h)
        return record, RecordingSolver(self.equations, self, record, at)

    def factorize(
        self,
        time: Array,
        q: Array,
        v: Array,
        coefficients: Coefficients,
        lam: Array | None = None,
    ) -> Callable[[Array, bool], Array]:
        """Return the function that solves the equations of the saddle-point matrix."""
        if not self.solver.has_friction:
            lam = None  # The matrix does not depend on the multipliers.
        states = (None if x is None else x.tobytes() for x in (time, q, v, lam))
        key = coefficients, *states
        if key not in self._factors:
            if len(self._factors) >= _MAX_STATES:
                self._factors.clear()
            pattern = self.solver.sums.saddle_pattern
            nonzeros = self.solver.saddle_matrix(time, q, v, None, coefficients, lam)
            matrix = (nonzeros, pattern.indices, pattern.indptr)
            factors = splu(sp.csc_array(matrix, shape=pattern.shape))
            self._factors[key] = lambda b, transposed: factors.solve(b, "T" if transposed else "N")
        return self._factors[key]


class Directions(NamedTuple):
    """Directions of parameters that the same equations serve.

    Forces may be missing in a model because they vanish at the value of a parameter, such as drag
    with a coefficient of zero, and a parameter may move the operators of joints. Along these
    parameters, other sums are differentiated than along the others. At the value of the parameter,
    all of them are equal: the steps of all directions have the matrices of the run.

    Attributes
    ----------
    maps
        Derivatives of the maps to consistent states of these equations.
    members
        Indices of the parameters, (k,).
    numbers
        Derivatives of the numbers p along them, (k, n_p).
    """

    maps: StartDerivatives
    members: Array
    numbers: Array


def group_directions(differences: Sequence[Difference]) -> list[Directions]:
    """Group parameters by equations that serve them; one that moves operators is a group."""
    groups: dict[Any, list[int]] = {}
    for k, x in enumerate(differences):
        groups.setdefault(k if moves_operators(x) else equations_key(x.base), []).append(k)
    result: list[Directions] = []
    # Equations with further forces, which vanish, serve the parameters of those without, too.
    for members in sorted(groups.values(), key=lambda x: -len(differences[x[0]].base.p)):
        maps = StartDerivatives.of(differences[members[0]])
        numbers = np.array([differences[k].derivative(lambda e: e.p) for k in members])
        for i, other in enumerate(result):
            targets = _locate_numbers(maps, other.maps)
            if targets is not None:
                rows = np.zeros((len(members), other.numbers.shape[1]))
                rows[:, targets[0]] = numbers[:, targets[1]]
                members = [*other.members, *members]
                result[i] = Directions(
                    other.maps, np.array(members), np.vstack([other.numbers, rows])
                )
                break
        else:
            result.append(Directions(maps, np.array(members), numbers))
    return result


def _locate_numbers(maps: StartDerivatives, other: StartDerivatives) -> list[Array] | None:
    """Return the positions in p of the terms of `maps`, in other equations and in its own.

    Return None if the other equations do not contain all terms with the same numbers.
    """
    if maps.moving is not None or other.moving is not None:
        return None

    def locate(e: EquationsOfMotion) -> dict[Any, Array]:
        counts, positions = Counter[Any](), dict[Any, Array]()
        terms: tuple[ForceTerm | ConstraintTerm, ...] = (*e.forces, *e.joints)
        for term in terms:
            values = (x for name, x in vars(term).items() if name != "data")
            key = *map(comparison_key, values), (e.p[term.data] + 0.0).tobytes()  # not -0.0
            positions[key, counts[key]] = np.arange(term.data.start, term.data.stop)
            counts[key] += 1
        return positions

    here, there = locate(maps.equations), locate(other.equations)
    if not here.keys() <= there.keys():
        return None
    return [np.concatenate([np.zeros(0, int), *(x[key] for key in here)]) for x in (there, here)]
