"""Derivatives of consistent states and of the start of generalized-alpha runs.

At a state, the derivative of a map is a product of derivatives of sums of kernels, of inverse
saddle-point matrices and of sparse matrices. `scipy.sparse.linalg.LinearOperator` applies it
forward along directions, or transposed to the gradient of an objective. A solution x of R(x) = 0
has the derivative -A^-1 dR with A = dR/dx.

Operators act on z = (q, v, a, lam, p, t), where p are the numbers of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial, reduce
from operator import add, matmul
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, aslinearoperator, splu

from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    equations_key,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.closing import closing_matrices
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import (
    MASS_COEFFICIENTS,
    Coefficients,
    PlanFunction,
    plan_balance,
    plan_constraint_levels,
    plan_motion,
    plan_smooth_motion,
)
from beamdae.equations.structure import (
    Structure,
    cache_on_owner,
)
from beamdae.integrators.alpha.family import JERK_INTERVAL, STIFF_TIME, AlphaParameters
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_time
from beamdae.symbolic.sums.sum_derivatives import directional_plan, transposed_plan
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray

# Difference of time for partial derivatives with respect to time, relative to the step.
_STEP_FRACTION = 1e-3
# Motion over which derivatives of forces are differenced, relative to that in a stiff time.
_MOTION_FRACTION = 0.1


@cache_on_owner
def _plan_direction(structure: Structure, plan: PlanFunction, n_inputs: int) -> SumPlan:
    return directional_plan(plan(structure), n_inputs)


@cache_on_owner
def plan_transpose(structure: Structure, plan: PlanFunction, n_inputs: int) -> SumPlan:
    """Return `transposed_plan` of a sum; `plan` is a function of a module."""
    return transposed_plan(plan(structure), n_inputs)


def _inverse(matrix: sp.csc_array) -> LinearOperator:
    solve = splu(matrix).solve
    transposed = partial(solve, trans="T")
    return LinearOperator(matrix.shape, solve, transposed, solve, float, transposed)


def _diagonal(entries: Array) -> LinearOperator:
    return aslinearoperator(sp.dia_array((entries[None], [0]), (len(entries),) * 2))


# Building sparse matrices takes longer than applying them.
@lru_cache
def _split(n: int, m: int, n_p: int) -> dict[str, slice]:
    """Return the parts of z by name."""
    ends = np.cumsum([0, n, n, n, m, n_p, 1]).tolist()
    names = ["q", "v", "a", "lam", "p", "t"]
    return {x: slice(*y) for x, *y in zip(names, ends, ends[1:], strict=False)}


@lru_cache
def _pick(size: int, start: int, stop: int) -> LinearOperator:
    """Return the matrix that selects consecutive entries."""
    return aslinearoperator(sp.eye_array(stop - start, size, k=start, format="csr"))


@lru_cache
def _choose_rows(n: int, m: int, size: int, level: int, with_force: bool) -> LinearOperator:
    force = with_force * (sp.eye_array(n, size) + sp.eye_array(n, size, k=n + 3 * m))
    rows = sp.vstack([force, sp.eye_array(m, size, k=n + level * m)], format="csr")
    return aslinearoperator(rows)


def _take(operator: LinearOperator, size: int) -> LinearOperator:
    """Return the first rows of an operator."""
    return _pick(operator.shape[0], 0, size) @ operator


class _SumDerivative(LinearOperator):
    """Derivative of a sum with respect to (x, p, t) at a time and at inputs x.

    Derivatives with respect to time are differences over +-`delta` [s], and not transposed.
    """

    def __init__(
        self, maps: StartDerivatives, plan: PlanFunction, time: Array, x: Array, size: int, h: float
    ) -> None:
        super().__init__(float, (size, len(x) + len(maps.equations.p) + 1))
        self._maps, self._plan, self._time, self._x = maps, plan, time, x
        self._delta = _STEP_FRACTION * h

    def _evaluator(self, plan: SumPlan, shift: float = 0.0) -> SumEvaluator:
        result = SumEvaluator(plan, self._maps.equations.p)
        set_time(result, self._time[0] + shift, self._time[1])
        return result

    def _matmat(self, changes: Array) -> Array:
        total = self._evaluator(self._maps.plan_along(self._plan, len(self._x)))
        rows = (np.concatenate([self._x, change]) for change in changes[:-1].T)
        result = np.column_stack([total(x, self.shape[0]) for x in rows])
        if changes[-1].any():
            result += np.multiply.outer(self.time_rate, changes[-1])
        return result

    @property
    def time_rate(self) -> Array:
        """Partial derivative with respect to time, (size,)."""
        plan, delta = self._plan(self._maps.equations.structure), self._delta
        before, after = (self._evaluator(plan, x)(self._x, self.shape[0]) for x in (-delta, delta))
        return np.asarray((after - before) / (2.0 * delta))

    def _rmatvec(self, weights: Array) -> Array:
        plan = plan_transpose(self._maps.equations.structure, self._plan, len(self._x))
        inputs, size = np.concatenate([self._x, weights]), self.shape[1] - 1
        return np.append(self._evaluator(plan)(inputs, size), 0.0)


@dataclass(frozen=True, eq=False)
class StartDerivatives:
    """Derivatives of the maps to consistent states.

    Attributes
    ----------
    solver
        Solver for consistent states.
    moving
        Models at neighboring values of the parameter of all directions, if operators of joints
        depend on it; otherwise None.

    Times are arrays (t, branch). `h` is the step [s] after a time that moves; then, all derivatives
    are those along the moving time.
    """

    solver: ConsistencySolver
    moving: Difference | None = None
    _plans: dict[PlanFunction, SumPlan] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, difference: Difference) -> StartDerivatives:
        """Return the derivatives along directions of a parameter."""
        moving = difference if difference.moves_operators else None
        return cls(ConsistencySolver(difference.base), moving)

    @property
    def equations(self) -> EquationsOfMotion:
        """Equations of motion of the solver."""
        return self.solver.equations

    def along(
        self,
        operator: LinearOperator,
        changes: Array,
        numbers: Array,
        shifts: Array | None = None,
    ) -> Array:
        """Return the derivatives (k, j) of a map along directions.

        Parameters
        ----------
        operator
            Derivative of the map.
        changes, numbers
            Derivatives of the first parts of the state (q, v, a, lam), and of the numbers p, one
            direction a row.
        shifts
            Derivatives of the time, (k,) [s].
        """
        z = np.zeros((len(numbers), operator.shape[1]))
        z[:, : changes.shape[1]] = changes
        z[:, self._slices["p"]] = numbers
        if shifts is not None:
            z[:, -1] = shifts
        return np.asarray(operator.matmat(z.T).T)

    def gradient(self, operator: LinearOperator, weights: Array) -> tuple[Array, Array]:
        """Return the gradient of weights . map by (q, v, a, lam), and by the numbers p."""
        z = operator.rmatvec(weights)
        return z[: self._slices["p"].start], z[self._slices["p"]]

    def start_map(self, time: Array, at: State, v: Array, h: float = 0.0) -> LinearOperator:
        """Return the map from requested (q, v) to the consistent state (q, v, a, lam).

        Parameters
        ----------
        time, at
            (t, branch), and the consistent state, whose positions close the joints except for
            rounding.
        v
            Requested velocities.
        h
            See the class.
        """
        e, result, zeros = self.equations, self.completion_map(time, at, h), np.zeros_like(v)
        if e.m:
            here = State(at.q, v, zeros, 0.0 * at.lam)
            velocities = self.solver.solve_saddle(
                time, at.q, v, 0.0, -self.solver.constraint_levels(time, at.q, v)[1]
            )
            levels = self._derivative(plan_constraint_levels, time, here, h)
            change = self._solution(time, here, -self._rows(levels, 1), velocities, h)
            result = result @ (self._identity + self._into("v") @ change)
            matrix, inertia = closing_matrices(self.solver, time, at.q)
            size = matrix.shape[0]
            inverse, head = _inverse(matrix), _pick(size, 0, e.n)
            gaps = _pick(size, 0, e.n + e.m).T @ self._rows(levels, 0)
            change = head @ inverse @ gaps
            # The second step; further ones are smaller than rounding errors.
            change = change + head @ inverse @ head.T @ aslinearoperator(inertia) @ change
            result = result @ (self._identity - self._into("q") @ change)
        return result

    def completion_map(self, time: Array, at: State, h: float = 0.0) -> LinearOperator:
        """Return the map from consistent (q, v) at a fixed time to the state (q, v, a, lam)."""
        e, size = self.equations, self._slices["p"].start
        residual = self._balance(time, at, h, 2)
        inverse = self._saddle(time, at.q, at.v, MASS_COEFFICIENTS, at.lam)
        result = (
            self._without_forces
            - self._into("a", "lam") @ inverse @ residual @ self._without_forces
        )
        if len(e.states):
            # The rates of first-order states follow from the forces.
            rest = State(at.q, at.v, 0.0 * at.a, 0.0 * at.lam)
            force = self._derivative(plan_motion, time, rest, h)
            states = _diagonal(1.0 - e.without_states(np.ones(e.n)))
            result = result @ (self._identity - self._into("v") @ states @ _take(force, e.n))
        return _take(result, size)

    def initial_motion(
        self, member: AlphaParameters, is_cured: bool, time: Array, at: State, h: float
    ) -> LinearOperator:
        """Return the map of `AlphaStart.initial_motion` for steps `h` [s].

        It maps the state (q, v, a, lam) to (q, v, q'', algorithmic acceleration).
        """
        n, parts = self.equations.n, [self._part(x) for x in ("q", "v", "a", "a")]
        if is_cured:
            jerk = position_jerk = self.jerk_map(time, at, h, False)
            if self.equations.nonholonomic_rows.size:
                position_jerk = self.jerk_map(time, at, h)
            acceleration = self._reduced_acceleration(time, at, h)
            parts[1] = parts[1] + (h * h * member.defect) * position_jerk
            parts[2:] = acceleration, acceleration + (member.shift * h) * jerk
        columns = (_pick(4 * n, k * n, (k + 1) * n).T for k in range(4))
        return reduce(add, map(matmul, columns, parts))

    @property
    def _slices(self) -> dict[str, slice]:
        e = self.equations
        return _split(e.n, e.m, len(e.p))

    @property
    def _identity(self) -> LinearOperator:
        return _pick(self._slices["t"].stop, 0, self._slices["t"].stop)

    @property
    def _without_forces(self) -> LinearOperator:
        """Projection to (q, v, p, t)."""
        keep = np.ones(self._slices["t"].stop)
        keep[self._slices["a"].start : self._slices["lam"].stop] = 0.0
        return _diagonal(keep)

    @property
    def _head(self) -> LinearOperator:
        """The coordinates of a solution (n + m,)."""
        return _pick(self.equations.n + self.equations.m, 0, self.equations.n)

    def _part(self, name: str) -> LinearOperator:
        part = self._slices[name]
        return _pick(self._slices["t"].stop, part.start, part.stop)

    def _into(self, first: str, last: str | None = None) -> LinearOperator:
        """Return the matrix that places a part, or consecutive ones, in z."""
        slices = self._slices
        return _pick(slices["t"].stop, slices[first].start, slices[last or first].stop).T

    def _derivative(self, plan: PlanFunction, time: Array, at: State, h: float) -> LinearOperator:
        """Return the derivative of a sum of `StateEvaluator` at a state."""
        e, x = self.equations, np.concatenate(at)
        size = (2 if plan is plan_balance else 1) * e.n + 3 * e.m
        return self.differentiate(plan, time, x, size, h)

    def differentiate(
        self, plan: PlanFunction, time: Array, x: Array, size: int, h: float
    ) -> _SumDerivative:
        """Return the derivative of a sum (size,) at its inputs `x` and a time, see the class.

        `h` is the step of the run.
        """
        return _SumDerivative(self, plan, time, x, size, h)

    def plan_along(self, plan: PlanFunction, n_inputs: int) -> SumPlan:
        """Return `directional_plan` of a sum; `plan` is a function of a module."""
        structure, moving = self.equations.structure, self.moving
        if moving is None:
            return _plan_direction(structure, plan, n_inputs)
        if plan not in self._plans:
            changes = (
                moving.along(lambda e: plan(e.structure).gather_weights),
                moving.along(lambda e: plan(e.structure).weights),
            )
            self._plans[plan] = directional_plan(plan(structure), n_inputs, changes)
        return self._plans[plan]

    def _rows(
        self, operator: LinearOperator, level: int, *, with_force: bool = False
    ) -> LinearOperator:
        """Return F + G^T lam, or zeros, and a level of the constraints."""
        e = self.equations
        return _choose_rows(e.n, e.m, operator.shape[0], level, with_force) @ operator

    def _balance(self, time: Array, at: State, h: float, level: int) -> LinearOperator:
        """Return the derivative of F + G^T lam and of a level of the constraints."""
        return self._rows(self._derivative(plan_balance, time, at, h), level, with_force=True)

    def _solution(
        self,
        time: Array,
        at: State,
        right: LinearOperator,
        solution: tuple[Array, Array],
        h: float,
    ) -> LinearOperator:
        """Return the derivative of the x of [[M, G^T], [G, 0]] (x, mu) = right, given (x, mu)."""
        if any(x.any() for x in solution):
            # M x and G^T mu are odd functions of (x, mu), other forces are even ones.
            for sign in (-1.0, 1.0):
                there = State(at.q, at.v, sign * solution[0], sign * solution[1])
                balance = self._balance(time, there, h, 2) @ self._without_forces
                right = right - 0.5 * sign * balance
        return self._head @ self._saddle(time, at.q, at.v, MASS_COEFFICIENTS) @ right

    def jerk_map(
        self, time: Array, at: State, h: float, holonomic_only: bool = True
    ) -> LinearOperator:
        """Return the map from (q, v, a) to `ConsistencySolver.evaluate_normal_jerk`."""
        e, (q, v, a, lam) = self.equations, at
        if e.m == 0:
            return 0.0 * self._part("q")
        delta = JERK_INTERVAL * h
        factor = np.full(e.m, 0.5 / delta)
        if holonomic_only:
            factor[e.nonholonomic_rows] = 0.0
        value, rights = np.zeros(e.m), []
        for d, sign in ((-delta, 1.0), (delta, -1.0)):
            there = State(q + d * v + 0.5 * d**2 * a, v + d * a, a, 0.0 * lam)
            now = time + np.array([d, 0.0])
            value += sign * factor * self.solver.constraint_levels(now, *there[:3])[2]
            v_part, a_part = self._part("v"), self._part("a")
            motion = self._into("q") @ (d * v_part + 0.5 * d**2 * a_part)
            moved = self._identity + motion + self._into("v") @ (d * a_part)
            levels = self._derivative(plan_constraint_levels, now, there, h)
            rights.append(sign * self._rows(levels @ moved, 2))
        weights = _diagonal(np.append(np.zeros(e.n), factor))
        solution = self.solver.solve_saddle(time, q, v, 0.0, value)
        return self._solution(time, at, weights @ (rights[0] + rights[1]), solution, h)

    def _reduced_acceleration(self, time: Array, at: State, h: float) -> LinearOperator:
        """Return the derivative of `ConsistencySolver.acceleration` with a stiff time."""
        e, stiff_time = self.equations, STIFF_TIME * h
        q, v = at.q, at.v
        a, lam = self.solver.acceleration(time, q, v, stiff_time)
        there = State(q, v, a, lam)
        residual = self._balance(time, there, h, 2)
        zeros, moving = np.zeros(e.n), e.without_states(np.ones(e.n))
        # The derivative of K T^2 a is the rate of that of the forces along T^2 a.
        force = 0.0 * _take(residual, e.n)
        for share in (-_MOTION_FRACTION, _MOTION_FRACTION):
            near = State(q + share * stiff_time**2 * a, v, zeros, lam)
            total = self._derivative(plan_balance, time, near, h) @ self._without_forces
            force = force + 0.5 / share * _take(total, e.n)
        for factor, shift in ((1.0, stiff_time), (-2.0, 0.0), (1.0, -stiff_time)):
            near = State(q + shift * moving * v, v, zeros, 0.0 * lam)
            total = self._derivative(plan_smooth_motion, time, near, h)
            drift = self._into("q") @ _diagonal(shift * moving) @ self._part("v")
            moved = self._identity + drift
            force = force + factor * _diagonal(moving) @ _take(total, e.n) @ moved
        residual = residual + _pick(e.n + e.m, 0, e.n).T @ force
        inverse = self._saddle(time, q, v, (stiff_time**2, 0.0, 1.0), lam)
        return -self._head @ inverse @ residual @ self._without_forces

    def _saddle(
        self,
        time: Array,
        q: Array,
        v: Array,
        coefficients: Coefficients,
        lam: Array | None = None,
    ) -> LinearOperator:
        """Return the inverse of the saddle-point matrix."""
        pattern = self.solver.sums.saddle_pattern
        nonzeros = self.solver.saddle_matrix(time, q, v, None, coefficients, lam)
        matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
        return _inverse(matrix)


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
        groups.setdefault(k if x.moves_operators else equations_key(x.base), []).append(k)
    return [
        Directions(
            StartDerivatives.of(differences[members[0]]),
            np.array(members),
            np.array([differences[k].along(lambda e: e.p) for k in members]),
        )
        for members in groups.values()
    ]
