"""What a consistent start asks of the equations of motion, as sums of kernels.

These are evaluated a few times a run: by CasADi's virtual machine, for which nothing is compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import (
    InputLayout,
    add_joint_matrices,
    add_tangents,
    assemble_motion,
    create_matrix_sum,
)
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.kernel_sums import Sum, SumPlan, evaluate_sum
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray


@dataclass(frozen=True)
class ForceBlock:
    """The block of F in the saddle matrix: stiffness, damping and mass.

    Attributes
    ----------
    pattern
        CSC pattern, (n, n).
    entries
        Which of the non-zeros of the saddle matrix they are.
    columns
        Of the entries; their rows are the indices of the pattern.
    mirrored
        Of each entry which one is on the other side of the diagonal, -1 if there is none.
    """

    pattern: sp.csc_array
    entries: Array
    columns: Array
    mirrored: Array

    def transposed(self, values: Array) -> Array:
        """Of each entry the one on the other side of the diagonal, zero where there is none."""
        return np.append(values, 0.0)[self.mirrored]

    def matrix(self, nonzeros: Array) -> sp.csc_array:
        """The block as a matrix; `nonzeros` are those of the saddle matrix."""
        own = (nonzeros[self.entries], self.pattern.indices, self.pattern.indptr)
        return sp.csc_array(own, shape=self.pattern.shape)


@dataclass(frozen=True)
class StateSums:
    """Sums over (q, v, a, lam) and patterns, see `StateEvaluator`."""

    motion: SumPlan
    gradients: SumPlan
    gradient_pattern: sp.csc_array
    saddle: SumPlan
    saddle_pattern: sp.csc_array
    block: ForceBlock


@cache_on_owner
def plan_state_sums(structure: Structure) -> StateSums:
    """The sums of the start, built once."""
    n, m = structure.n, structure.m
    at = InputLayout(q=0, v=n, a=2 * n, lam=3 * n)
    jacobian = create_matrix_sum()
    for joint, copies in add_joint_matrices(jacobian, structure, at, (), False):
        jacobian.add_matrix(copies, 0, joint.rows, joint.operator, (0, 0))
    gradient_pattern, gradients = jacobian.matrix((m, n))
    total = create_matrix_sum()
    for term, copies in add_tangents(total, structure, at, ((0, 1, 2),)):
        total.add_matrix(copies, 0, term.operator, term.operator, (0, 0))
        if term.rows is not None:
            total.add_matrix(copies, 1, term.operator, term.rows, (0, n))
    for joint, copies in add_joint_matrices(total, structure, at, (), False):
        total.add_matrix(copies, 0, joint.rows, joint.operator, (n, 0))
        total.add_matrix(copies, 0, joint.rows, joint.operator, (0, n), transposed=True)
    pattern, saddle = total.matrix((n + m, n + m))
    motion = assemble_motion(structure, at).vector()
    return StateSums(
        motion, gradients, gradient_pattern, saddle, pattern, _locate_force_block(pattern, n)
    )


def _locate_force_block(pattern: sp.csc_array, n: int) -> ForceBlock:
    column = column_indices(pattern)
    (entries,) = np.nonzero((pattern.indices < n) & (column < n))
    rows, columns = pattern.indices[entries].astype(np.int64), column[entries]
    starts = np.searchsorted(columns, np.arange(n + 1))
    own = sp.csc_array((np.ones(len(entries)), rows, starts), shape=(n, n))
    # Ascending, as CSC entries are.
    place, across = columns * n + rows, rows * n + columns
    mirrored = np.minimum(np.searchsorted(place, across), len(place) - 1)
    return ForceBlock(own, entries, columns, np.where(place[mirrored] == across, mirrored, -1))


@dataclass(frozen=True)
class StateEvaluator:
    """Constraints, forces and matrices at one state after the other; not for several threads."""

    equations: EquationsOfMotion

    @property
    def sums(self) -> StateSums:
        """What they are built from."""
        return plan_state_sums(self.equations.structure)

    @cached_property
    def _motion(self) -> Sum:
        return self.sums.motion.sum(False, self.equations.p)

    @cached_property
    def _gradients(self) -> Sum:
        return self.sums.gradients.sum(False, self.equations.p)

    @cached_property
    def _saddle(self) -> Sum:
        return self.sums.saddle.sum(False, self.equations.p)

    def constraint_levels(
        self, time: Array, q: Array, v: Array | None = None, a: Array | None = None
    ) -> Array:
        """g, g_dot and g_ddot, (3, m)."""
        n, m = self.equations.n, self.equations.m
        return self._evaluated(self._motion, time, (q, v, a), n + 3 * m)[n:].reshape(3, m)

    def force(
        self,
        time: Array,
        q: Array,
        v: Array,
        a: Array | None = None,
        lam: Array | None = None,
    ) -> Array:
        """F."""
        n, m = self.equations.n, self.equations.m
        return self._evaluated(self._motion, time, (q, v, a), n + 3 * m, lam)[:n]

    def gradients(self, time: Array, q: Array) -> Array:
        """Non-zeros of G on its pattern."""
        size = self.sums.gradient_pattern.nnz
        return self._evaluated(self._gradients, time, (q, None, None), size)

    def saddle(
        self,
        time: Array,
        q: Array,
        v: Array,
        a: Array | None,
        c: Sequence[float],
        lam: Array | None = None,
    ) -> Array:
        """Non-zeros of [[c0 K + c1 C + c2 M, G^T + dF/dlam], [G, 0]] on its pattern."""
        self._saddle.shared[2:] = *c, 1.0, 1.0, 1.0
        return self._evaluated(self._saddle, time, (q, v, a), self.sums.saddle_pattern.nnz, lam)

    def _evaluated(
        self,
        total: Sum,
        time: Array,
        state: tuple[Array | None, ...],
        size: int,
        lam: Array | None = None,
    ) -> Array:
        n, m = self.equations.n, self.equations.m
        given = [np.zeros(n) if x is None else x for x in state]
        given.append(np.zeros(m) if lam is None else lam)
        total.shared[:2] = time
        result = np.zeros(size)
        evaluate_sum(total, np.concatenate(given), result)
        return result
