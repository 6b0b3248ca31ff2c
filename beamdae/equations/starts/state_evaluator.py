"""Constraints, forces and matrices of the equations of motion, evaluated at single states.

CasADi's virtual machine evaluates these quantities, because a run needs them only a few times; see
`SumEvaluator`.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Self

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
from beamdae.equations.structure import Structure, share_plans
from beamdae.errors import BeamdaeError
from beamdae.linear.factorizations import (
    Factorization,
    SingularMatrixError,
    create_factorization,
)
from beamdae.symbolic.force_kernel import DAMPING, MASS, STIFFNESS, Tangents
from beamdae.symbolic.local_symbols import C_A
from beamdae.symbolic.sparse_operators import column_indices
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

Array = np.ndarray
# Coefficients (c0, c1, c2) of stiffness, damping and mass.
Coefficients = tuple[float, float, float]
MASS_COEFFICIENTS = (0.0, 0.0, 1.0)
_UNIT_COEFFICIENTS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), MASS_COEFFICIENTS)
# Factors and shifts of the values in a second difference.
SECOND_DIFFERENCE = ((1.0, 1.0), (-2.0, 0.0), (1.0, -1.0))


@dataclass(frozen=True)
class ForceBlock:
    """Block c0 K + c1 C + c2 M of the saddle-point matrix; see `StateEvaluator.saddle_matrix`.

    Attributes
    ----------
    pattern
        CSC pattern, (n, n).
    entries
        Indices of the block's entries among the non-zeros of the saddle-point matrix.
    columns
        Column of each entry; `pattern.indices` has the rows.
    mirrored
        Index of the entry mirrored about the diagonal; -1 if it is not in the pattern.
    """

    pattern: sp.csc_array
    entries: Array
    columns: Array
    mirrored: Array

    def transposed(self, values: Array) -> Array:
        """Return the entries of the transposed block on `pattern`; zero if not in the pattern.

        `values` are the entries of the block.
        """
        return np.append(values, 0.0)[self.mirrored]

    def matrix(self, nonzeros: Array) -> sp.csc_array:
        """Return the block as a matrix, given the non-zeros of the saddle-point matrix."""
        # In a tenth of the time of `sp.csc_array`, which checks the indices again.
        matrix = copy(self.pattern)
        matrix.data = nonzeros[self.entries]
        return matrix


@dataclass(frozen=True)
class StateSums:
    """Plans of the sums in `StateEvaluator`, with inputs (q, v, a, lam), and matrix patterns.

    The sum `smooth_motion` is `motion` without forces that have kinks over the motion, such as
    contacts.
    """

    motion: SumPlan
    smooth_motion: SumPlan
    gradients: SumPlan
    gradient_pattern: sp.csc_array
    saddle: SumPlan
    saddle_pattern: sp.csc_array
    block: ForceBlock


@share_plans
def plan_state_sums(structure: Structure) -> StateSums:
    """Return the plans of the sums that `StateEvaluator` needs, and the matrix patterns."""
    n, m = structure.n, structure.m
    layout = InputLayout(q=0, v=n, a=2 * n, lam=3 * n)
    jacobian = create_matrix_sum()
    for joint, copies in add_joint_matrices(jacobian, structure, layout, (), False):
        jacobian.add_matrix(copies, GRADIENT, joint.rows, joint.operator, (0, 0))
    gradient_pattern, gradients = jacobian.matrix((m, n))
    total = create_matrix_sum()
    # As in the Jacobians of Radau, so that both use the same kernels: deriving a kernel takes
    # longer than all evaluations at single states.
    sums: Tangents = ((STIFFNESS,), (DAMPING,), (MASS,))
    add_saddle_point(total, structure, layout, sums, with_reaction_stiffness=False)
    # First-order states have no inertia; a unit diagonal separates them from the accelerations.
    for row in structure.states:
        total.add_diagonal(1, (row, row), C_A, 1.0)
    pattern, saddle = total.matrix((n + m, n + m))
    motion = assemble_motion(structure, layout).vector()
    smooth = [term for term in structure.forces if not term.kernel.has_kinks_over_motion]
    is_smooth = len(smooth) == len(structure.forces)
    smooth_motion = motion if is_smooth else assemble_motion(structure, layout, smooth).vector()
    return StateSums(
        motion,
        smooth_motion,
        gradients,
        gradient_pattern,
        saddle,
        pattern,
        _locate_force_block(pattern, n),
    )


@share_plans
def plan_constraint_levels(structure: Structure) -> SumPlan:
    """Return the plan of `StateSums.motion` without forces, which take longer than joints do."""
    n = structure.n
    layout = InputLayout(q=0, v=n, a=2 * n, lam=3 * n)
    return assemble_motion(structure, layout, forces=()).vector()


def _locate_force_block(pattern: sp.csc_array, n: int) -> ForceBlock:
    column = column_indices(pattern)
    (entries,) = np.nonzero((pattern.indices < n) & (column < n))
    rows, columns = pattern.indices[entries].astype(np.intp), column[entries]
    starts = np.searchsorted(columns, np.arange(n + 1))
    block = sp.csc_array((np.ones(len(entries)), rows, starts), shape=(n, n))
    # The keys ascend because the entries are sorted by column and row.
    key, mirror_key = columns * n + rows, rows * n + columns
    mirrored = np.minimum(np.searchsorted(key, mirror_key), len(key) - 1)
    return ForceBlock(block, entries, columns, np.where(key[mirrored] == mirror_key, mirrored, -1))


class Recent:
    """Result of a function at its last argument: a restart asks for the same state repeatedly."""

    def __init__(self) -> None:
        self._argument: Array | None = None
        self._result = np.zeros(0)

    def get(self, argument: Array, compute: Callable[[], Array]) -> Array:
        """Return a copy of the result of `compute`, called only if `argument` has changed."""
        if self._argument is None or not np.array_equal(argument, self._argument):
            # An exception leaves no result.
            self._argument = None
            self._result = compute()
            self._argument = argument
        return self._result.copy()


@dataclass(frozen=True)
class StateEvaluator:
    """Evaluates constraints, forces and matrices at single states.

    Times are arrays (t, branch) with t [s]. Instances hold buffers: do not share an instance
    between threads.
    """

    equations: EquationsOfMotion

    def __copy__(self) -> Self:
        """Return an instance with its own buffers."""
        return type(self)(self.equations)

    @property
    def sums(self) -> StateSums:
        """Plans of the sums, and patterns; equations with the same `structure` share them."""
        return plan_state_sums(self.equations.structure)

    @cached_property
    def _motion(self) -> SumEvaluator:
        return SumEvaluator.borrow(self.sums.motion, self.equations.p, self)

    @cached_property
    def _smooth_motion(self) -> SumEvaluator:
        return SumEvaluator.borrow(self.sums.smooth_motion, self.equations.p, self)

    @cached_property
    def _levels(self) -> SumEvaluator:
        plan = plan_constraint_levels(self.equations.structure)
        return SumEvaluator.borrow(plan, self.equations.p, self)

    @cached_property
    def _recent_motion(self) -> Recent:
        return Recent()

    @cached_property
    def _recent_gaps(self) -> Recent:
        return Recent()

    @cached_property
    def _gradients(self) -> SumEvaluator:
        return SumEvaluator.borrow(self.sums.gradients, self.equations.p, self)

    @cached_property
    def _saddle(self) -> SumEvaluator:
        return SumEvaluator.borrow(self.sums.saddle, self.equations.p, self)

    @cached_property
    def _solver(self) -> Factorization:
        return create_factorization(self.sums.saddle_pattern)

    @cached_property
    def _recent_factors(self) -> Recent:
        return Recent()

    def rest_state(self, q: Array) -> State:
        """Return the state at rest at positions `q`, with zero accelerations and multipliers."""
        zeros = np.zeros(self.equations.n)
        return State(q, zeros, zeros, np.zeros(self.equations.m))

    def constraint_levels(
        self, time: Array, q: Array, v: Array | None = None, a: Array | None = None
    ) -> Array:
        """Return g (0 if nonholonomic), g_dot and g_ddot, (3, m); omitted arguments are zero."""
        n, m = self.equations.n, self.equations.m
        if a is None and v is not None:
            # A restart needs the forces at this state, too.
            return self._evaluate_motion(time, q, v, a)[n:].reshape(3, m)
        return self._evaluate(self._levels, time, (q, v, a), n + 3 * m)[n:].reshape(3, m)

    def position_gaps(self, time: Array, q: Array) -> Array:
        """Return g, the gap of each constraint, (m,); 0 if the constraint is nonholonomic."""
        # The steps of a consistent start ask for the same gaps repeatedly.
        return self._recent_gaps.get(
            np.concatenate([time, q]), lambda: self.constraint_levels(time, q)[0]
        )

    def force(
        self,
        time: Array,
        q: Array,
        v: Array,
        a: Array | None = None,
        lam: Array | None = None,
    ) -> Array:
        """Return F, (n,); omitted arguments are zero."""
        return self._evaluate_motion(time, q, v, a, lam)[: self.equations.n]

    def evaluate_force_change(self, time: Array, q: Array, v: Array, delta: float) -> Array:
        """Return F(q + delta v) - 2 F(q) + F(q - delta v) at constant velocities v, (n,).

        Forces with kinks over the motion are left out, because contacts may close along it, and so
        are the rates of first-order states.
        """
        e, total = self.equations, self._smooth_motion
        step, change = delta * e.without_states(v), np.zeros(e.n + 3 * e.m)
        for factor, shift in SECOND_DIFFERENCE:
            motion = (q + shift * step, v, None)
            change += factor * self._evaluate(total, time, motion, len(change))
        return e.without_states(change[: e.n])

    def _evaluate_motion(
        self,
        time: Array,
        q: Array,
        v: Array | None,
        a: Array | None,
        lam: Array | None = None,
    ) -> Array:
        """Return F and the three levels of constraints, (n + 3 m,)."""

        def compute() -> Array:
            size = self.equations.n + 3 * self.equations.m
            return self._evaluate(self._motion, time, (q, v, a), size, lam)

        if a is not None or lam is not None or v is None:
            return compute()
        return self._recent_motion.get(np.concatenate([time, q, v]), compute)

    def gradients(self, time: Array, q: Array) -> Array:
        """Return the non-zeros of G on `sums.gradient_pattern`, (nnz,)."""
        size = self.sums.gradient_pattern.nnz
        return self._evaluate(self._gradients, time, (q, None, None), size)

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
        set_matrix_factors(self._saddle, *coefficients, c_l=1.0, c_h=1.0, c_r=1.0)
        return self._evaluate(self._saddle, time, (q, v, a), self.sums.saddle_pattern.nnz, lam)

    def linearize_forces(
        self, time: Array, state: State
    ) -> tuple[sp.csc_array, sp.csc_array, sp.csc_array]:
        """Return stiffness dF/dq, damping dF/dv and mass dF/da at lam = 0, each sparse (n, n).

        First-order states are constant: their rows and columns are zero, except for a unit mass.
        """
        stiffness, damping, mass = self.linearize_with_states(time, state)
        if len(self.equations.states):
            moving = np.ones(self.equations.n)
            moving[self.equations.states] = 0.0
            keep = sp.diags_array(moving)
            stiffness, damping = (sp.csc_array(keep @ x @ keep) for x in (stiffness, damping))
        return stiffness, damping, mass

    def linearize_with_states(
        self, time: Array, state: State
    ) -> tuple[sp.csc_array, sp.csc_array, sp.csc_array]:
        """Return the matrices of `linearize_forces` with the equations of first-order states."""
        q, v, a, _ = state
        stiffness, damping, mass = (
            self.sums.block.matrix(self.saddle_matrix(time, q, v, a, c)) for c in _UNIT_COEFFICIENTS
        )
        return stiffness, damping, mass

    def mass_matrix(self, time: Array, q: Array) -> sp.csc_array:
        """Return the mass matrix dF/da at rest at positions `q`, sparse (n, n)."""
        nonzeros = self.saddle_matrix(time, *self.rest_state(q)[:3], MASS_COEFFICIENTS)
        return self.sums.block.matrix(nonzeros)

    def solve_saddle(
        self,
        time: Array,
        q: Array,
        v: Array | None,
        force: Array | float,
        rates: Array | float,
        coefficients: Coefficients = MASS_COEFFICIENTS,
    ) -> tuple[Array, Array]:
        """Return x, (n,), and mu, (m,), with W x + G^T mu = `force` and G x = `rates`.

        W = c0 K + c1 C + c2 M, with the mass matrix alone by default; see `saddle_matrix`.
        """
        n, m = self.equations.n, self.equations.m
        right = np.concatenate([np.zeros(n) + force, np.zeros(m) + rates])
        solver, _ = self._factorize(time, q, np.zeros(n) if v is None else v, coefficients)
        solution = solver.solve(right)
        return solution[:n], solution[n:]

    def _factorize(
        self, time: Array, q: Array, v: Array, coefficients: Coefficients
    ) -> tuple[Factorization, Array]:
        """Factorize the saddle-point matrix; return the solver and F.

        The solver keeps the factors of the last call if all arguments are the same.
        """
        force = self._recent_factors.get(
            np.concatenate([time, q, v, coefficients]),
            lambda: self._renew_factors(time, q, v, coefficients),
        )
        return self._solver, force

    def _renew_factors(self, time: Array, q: Array, v: Array, coefficients: Coefficients) -> Array:
        """Factorize the saddle-point matrix; return F."""
        e, solver, pattern = self.equations, self._solver, self.sums.saddle_pattern
        force = self.force(time, q, v)
        nonzeros = self.saddle_matrix(time, q, v, None, coefficients)
        if not np.all(np.isfinite(force)):
            name = e.q_names[int(np.flatnonzero(~np.isfinite(force))[0])]
            raise BeamdaeError(
                f"{name}: the force on this coordinate is not finite at t = {time[0]:g} s; check "
                "the laws and the start values."
            )
        if not np.isfinite(nonzeros).all():
            entry = int(np.flatnonzero(~np.isfinite(nonzeros))[0])
            row = int(pattern.indices[entry])
            raise BeamdaeError(
                f"{(*e.q_names, *e.lam_names)[row]}: a derivative of the forces or constraints "
                f"is not finite at t = {time[0]:g} s; if an expression takes the square root of "
                "zero, add a small positive number under the root."
            )
        try:
            solver.factorize(nonzeros)
        except SingularMatrixError:
            matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), pattern.shape)
            unresisted = la.svd(np.nan_to_num(matrix.toarray()))[2][-1, : e.n]
            raise BeamdaeError(
                f"{e.q_names[int(np.argmax(np.abs(unresisted)))]}: this coordinate has no inertia "
                f"at t = {time[0]:g} s; add mass or a joint."
            ) from None
        return force

    def _evaluate(
        self,
        total: SumEvaluator,
        time: Array,
        state: tuple[Array | None, ...],
        size: int,
        lam: Array | None = None,
    ) -> Array:
        n, m = self.equations.n, self.equations.m
        inputs = [np.zeros(n) if x is None else x for x in state]
        inputs.append(np.zeros(m) if lam is None else lam)
        set_time(total, *time)
        return total(np.concatenate(inputs), size)
