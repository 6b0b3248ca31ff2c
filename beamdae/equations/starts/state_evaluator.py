"""Constraints, forces and matrices of the equations of motion, evaluated at single states.

CasADi's virtual machine evaluates these quantities, because a run needs them only a few times; see
`SumEvaluator`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.sums import (
    GRADIENT,
    InputLayout,
    add_joint_matrices,
    add_saddle_point,
    assemble_motion,
    create_matrix_sum,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.linear.factorizations import (
    Factorization,
    SingularMatrixError,
    create_factorization,
)
from beamdae.symbolic.force_kernel import DAMPING, MASS, STIFFNESS, Tangents
from beamdae.symbolic.local_symbols import C_A
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray
# Coefficients (c0, c1, c2) of stiffness, damping and mass.
Coefficients = tuple[float, float, float]
PlanFunction = Callable[[Structure], SumPlan]
MASS_COEFFICIENTS = (0.0, 0.0, 1.0)
_UNIT_COEFFICIENTS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), MASS_COEFFICIENTS)


@dataclass(frozen=True)
class StateSums:
    """Plans of the matrices of `StateEvaluator`, with inputs (q, v, a, lam), and their patterns.

    `block` is that of the forces, (n, n), with the indices of its non-zeros in the saddle-point
    matrix.
    """

    gradients: SumPlan
    gradient_pattern: sp.csc_array
    saddle: SumPlan
    saddle_pattern: sp.csc_array
    block: sp.csc_array


def _layout(structure: Structure) -> InputLayout:
    n = structure.n
    return InputLayout(q=0, v=n, a=2 * n, lam=3 * n)


@cache_on_owner
def plan_state_sums(structure: Structure) -> StateSums:
    """Return the plans of the matrices that `StateEvaluator` needs, and their patterns."""
    n, m, layout = structure.n, structure.m, _layout(structure)
    jacobian = create_matrix_sum()
    for joint, copies in add_joint_matrices(jacobian, structure, layout, (), False):
        jacobian.add_matrix(copies, GRADIENT, joint.rows, joint.operator, (0, 0))
    gradient_pattern, gradients = jacobian.matrix((m, n))
    total = create_matrix_sum()
    # As in the tangents of states, so that all use the same kernels: deriving a kernel takes longer
    # than all evaluations at single states.
    sums: Tangents = ((STIFFNESS,), (DAMPING,), (MASS,))
    add_saddle_point(total, structure, layout, sums, with_reaction_stiffness=False)
    # First-order states have no inertia; a unit diagonal separates them from the accelerations.
    for row in structure.states:
        total.add_diagonal(1, (row, row), C_A, 1.0)
    pattern, saddle = total.matrix((n + m, n + m))
    entries = np.arange(pattern.nnz), pattern.indices, pattern.indptr
    block = sp.csc_array(entries, shape=pattern.shape)[:n, :n]
    return StateSums(gradients, gradient_pattern, saddle, pattern, block)


@cache_on_owner
def plan_motion(structure: Structure) -> SumPlan:
    """Return the plan of (F, g, g_dot, g_ddot)."""
    return assemble_motion(structure, _layout(structure)).vector()


@cache_on_owner
def plan_smooth_motion(structure: Structure) -> SumPlan:
    """Return `plan_motion` with the `smooth_forces` only."""
    smooth = structure.smooth_forces
    if len(smooth) == len(structure.forces):
        return plan_motion(structure)
    return assemble_motion(structure, _layout(structure), smooth).vector()


@cache_on_owner
def plan_constraint_levels(structure: Structure) -> SumPlan:
    """Return `plan_motion` without forces, which take longer than joints do."""
    return assemble_motion(structure, _layout(structure), forces=()).vector()


@cache_on_owner
def plan_balance(structure: Structure) -> SumPlan:
    """Return the plan of (F, g, g_dot, g_ddot, G^T lam)."""
    return assemble_motion(structure, _layout(structure), with_reactions=True).vector()


@cache_on_owner
def plan_gradients(structure: Structure) -> SumPlan:
    """Return the plan of the non-zeros of G."""
    return plan_state_sums(structure).gradients


@dataclass(frozen=True)
class StateEvaluator:
    """Evaluates constraints, forces and matrices at single states.

    Times are arrays (t, branch) with t [s]. Instances hold buffers: do not share an instance
    between threads.
    """

    equations: EquationsOfMotion
    _sums: dict[PlanFunction, SumEvaluator] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )
    # Arguments of `solve_saddle` for which the solver has factors.
    _factorized: dict[str, Array] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def sums(self) -> StateSums:
        """Plans of the sums, and patterns; equations with the same `structure` share them."""
        return plan_state_sums(self.equations.structure)

    @cached_property
    def _saddle(self) -> SumEvaluator:
        return SumEvaluator(self.sums.saddle, self.equations.p)

    @cached_property
    def _solver(self) -> Factorization:
        return create_factorization(self.sums.saddle_pattern)

    def evaluate(
        self, plan: PlanFunction, time: Array, state: Sequence[Array | None], size: int
    ) -> Array:
        """Return a sum (size,) at the inputs (q, v, a, lam), of which None are zero.

        `plan` is a function of a module that returns the plan of the sum of a structure.
        """
        n, m = self.equations.n, self.equations.m
        zeros = (np.zeros(k) for k in (n, n, n, m))
        parts = (y if y is not None else z for y, z in zip(state, zeros, strict=True))
        if plan not in self._sums:
            self._sums[plan] = SumEvaluator(plan(self.equations.structure), self.equations.p)
        evaluator = self._sums[plan]
        set_time(evaluator, *time)
        return evaluator(np.concatenate(list(parts)), size)

    def rest_state(self, q: Array) -> State:
        """Return the state at rest at positions `q`, with zero accelerations and multipliers."""
        zeros = np.zeros(self.equations.n)
        return State(q, zeros, zeros, np.zeros(self.equations.m))

    def constraint_levels(
        self, time: Array, q: Array, v: Array | None = None, a: Array | None = None
    ) -> Array:
        """Return g (0 if nonholonomic), g_dot and g_ddot, (3, m); omitted arguments are zero."""
        # A restart needs the forces at this state, too.
        plan = plan_motion if a is None and v is not None else plan_constraint_levels
        return self._split_levels(self._evaluate_motion(plan, time, q, v, a))

    def _split_levels(self, motion: Array) -> Array:
        n, m = self.equations.n, self.equations.m
        return motion[n : n + 3 * m].reshape(3, m)

    def position_gaps(self, time: Array, q: Array) -> Array:
        """Return g, the gap of each constraint, (m,); 0 if the constraint is nonholonomic."""
        return self.constraint_levels(time, q)[0]

    def force(
        self,
        time: Array,
        q: Array,
        v: Array,
        a: Array | None = None,
        lam: Array | None = None,
    ) -> Array:
        """Return F, (n,); omitted arguments are zero."""
        return self._evaluate_motion(plan_motion, time, q, v, a, lam)[: self.equations.n]

    def balance(
        self, time: Array, q: Array, v: Array | None, a: Array | None, lam: Array
    ) -> tuple[Array, Array]:
        """Return F + G^T lam, (n,), and `constraint_levels`; omitted arguments are zero."""
        n, m = self.equations.n, self.equations.m
        motion = self.evaluate(plan_balance, time, (q, v, a, lam), 2 * n + 3 * m)
        return motion[:n] + motion[n + 3 * m :], self._split_levels(motion)

    def evaluate_force_change(self, time: Array, q: Array, v: Array, delta: float) -> Array:
        """Return F(q + delta v) - 2 F(q) + F(q - delta v) at constant velocities v, (n,).

        Forces with kinks over the motion are left out, because contacts may close along it, and so
        are the rates of first-order states.
        """
        e, change = self.equations, np.zeros(self.equations.n)
        moving = e.without_states(np.ones(e.n))
        for factor, shift in ((1.0, 1.0), (-2.0, 0.0), (1.0, -1.0)):
            moved = q + shift * delta * moving * v
            change = change + factor * moving * self.smooth_force(time, moved, v)
        return change

    def smooth_force(self, time: Array, q: Array, v: Array) -> Array:
        """Return F without forces that have kinks over the motion, (n,), at a = 0."""
        return self._evaluate_motion(plan_smooth_motion, time, q, v)[: self.equations.n]

    def _evaluate_motion(
        self,
        plan: PlanFunction,
        time: Array,
        q: Array,
        v: Array | None = None,
        a: Array | None = None,
        lam: Array | None = None,
    ) -> Array:
        """Return F and the three levels of constraints, (n + 3 m,)."""
        return self.evaluate(plan, time, (q, v, a, lam), self.equations.n + 3 * self.equations.m)

    def gradients(self, time: Array, q: Array) -> Array:
        """Return the non-zeros of G on `sums.gradient_pattern`, (nnz,)."""
        size = self.sums.gradient_pattern.nnz
        return self.evaluate(plan_gradients, time, (q, None, None, None), size)

    def constraint_matrix(self, time: Array, q: Array) -> sp.csc_array:
        """Return G = dg/dq, sparse (m, n), with rows of A for nonholonomic constraints."""
        pattern, nonzeros = self.sums.gradient_pattern, self.gradients(time, q)
        return sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)

    def saddle_matrix(
        self,
        time: Array,
        q: Array,
        v: Array,
        a: Array | None,
        coefficients: Coefficients,
        lam: Array | None = None,
    ) -> Array:
        """Return the non-zeros of [[c0 K + c1 C + c2 M, G^T + dF/dlam], [G, 0]].

        K, C and M are dF/dq, dF/dv and dF/da, where M has a unit diagonal for first-order states;
        the pattern is `sums.saddle_pattern`.
        """
        zeros = np.zeros(self.equations.n + self.equations.m)
        rest = (zeros[: self.equations.n] if a is None else a, zeros[self.equations.n :])
        x = np.concatenate([q, v, rest[0], rest[1] if lam is None else lam])
        set_matrix_factors(self._saddle, *coefficients, c_l=1.0, c_h=1.0, c_r=1.0)
        set_time(self._saddle, *time)
        return self._saddle(x, self.sums.saddle_pattern.nnz)

    def force_matrix(self, time: Array, *arguments: Any) -> sp.csc_array:
        """Return c0 K + c1 C + c2 M, sparse (n, n); the arguments are those of `saddle_matrix`."""
        # In a tenth of the time of `sp.csc_array`, which checks the indices again.
        matrix = copy(self.sums.block)
        matrix.data = self.saddle_matrix(time, *arguments)[matrix.data]
        return matrix

    def linearize_forces(
        self, time: Array, state: State
    ) -> tuple[sp.csc_array, sp.csc_array, sp.csc_array]:
        """Return stiffness dF/dq, damping dF/dv and mass dF/da at lam = 0, each sparse (n, n).

        First-order states are constant: their rows and columns are zero, except for a unit mass.
        """
        q, v, a, _ = state
        stiffness, damping, mass = (self.force_matrix(time, q, v, a, c) for c in _UNIT_COEFFICIENTS)
        if len(self.equations.states):
            keep = sp.diags_array(self.equations.without_states(np.ones(self.equations.n)))
            stiffness, damping = (sp.csc_array(keep @ x @ keep) for x in (stiffness, damping))
        return stiffness, damping, mass

    def mass_matrix(self, time: Array, q: Array) -> sp.csc_array:
        """Return the mass matrix dF/da at rest at positions `q`, sparse (n, n)."""
        return self.force_matrix(time, *self.rest_state(q)[:3], MASS_COEFFICIENTS)

    def solve_saddle(
        self,
        time: Array,
        q: Array,
        v: Array | None,
        force: Array | float,
        rates: Array | float,
        coefficients: Coefficients = MASS_COEFFICIENTS,
        lam: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return x, (n,), and mu, (m,), with W x + (G^T + dF/dlam) mu = `force` and G x = `rates`.

        W = c0 K + c1 C + c2 M, with the mass matrix alone by default; see `saddle_matrix`.
        """
        e, n, m = self.equations, self.equations.n, self.equations.m
        right = np.concatenate([np.zeros(n) + force, np.zeros(m) + rates])
        v = np.zeros(n) if v is None else v
        lam = np.zeros(m) if lam is None or not e.has_friction else lam
        arguments = np.concatenate([time, q, v, coefficients, lam])
        # The solver keeps the factors of the last call.
        if not np.array_equal(arguments, self._factorized.pop("arguments", np.zeros(0))):
            pattern = self.sums.saddle_pattern
            forces = self.force(time, q, v, lam=lam)
            nonzeros = self.saddle_matrix(time, q, v, None, coefficients, lam)
            if not np.all(np.isfinite(forces)):
                name = e.q_names[int(np.flatnonzero(~np.isfinite(forces))[0])]
                raise BeamdaeError(
                    f"{name}: the force on this coordinate is not finite at t = {time[0]:g} s; "
                    "check the laws and the start values."
                )
            if not np.isfinite(nonzeros).all():
                entry = int(np.flatnonzero(~np.isfinite(nonzeros))[0])
                row = int(pattern.indices[entry])
                raise BeamdaeError(
                    f"{(*e.q_names, *e.lam_names)[row]}: a derivative of the forces or "
                    f"constraints is not finite at t = {time[0]:g} s; if an expression takes the "
                    "square root of zero, add a small positive number under the root."
                )
            try:
                self._solver.factorize(nonzeros)
            except SingularMatrixError:
                matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), pattern.shape)
                unresisted = la.svd(np.nan_to_num(matrix.toarray()))[2][-1, : e.n]
                raise BeamdaeError(
                    f"{e.q_names[int(np.argmax(np.abs(unresisted)))]}: this coordinate has no "
                    f"inertia at t = {time[0]:g} s; add mass or a joint."
                ) from None
        self._factorized["arguments"] = arguments
        solution = self._solver.solve(right)
        return solution[:n], solution[n:]
