"""Rank of the constraint Jacobian G during a run: smallest singular values and closed loops."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import term_data
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.equations.structure import ConstraintTerm, Structure, cache_on_owner
from beamdae.symbolic.sparse_operators import column_indices, multiply_entries

Array = np.ndarray

RANK_TOLERANCE = 1e-9  # smaller singular values of rows of length one are treated as zero
_MAX_ENTRIES = 2_000_000  # of the matrices evaluated together
MIN_RELATIVE_SHARE = 0.1  # relative to the largest; joints with smaller shares are not named
_GROUND = ""


@dataclass(frozen=True)
class ConstraintJacobian:
    """G = dg/dq with columns scaled by `position_scales` and rows of length one.

    Attributes
    ----------
    equations
        Equations of motion with the constraints.
    pattern
        CSC pattern of G.
    scatter
        For each joint, the operator from the gradients of its copies to the non-zeros of G.
    rank
        Rank of G at regular positions; less than m if constraints are redundant. Equal to m unless
        set by `with_rank_at`.
    """

    equations: EquationsOfMotion
    pattern: sp.csc_array
    scatter: tuple[sp.csr_array, ...]
    rank: int

    def with_rank_at(self, time: Array, q: Array) -> ConstraintJacobian:
        """Return a copy with `rank` set to the rank of G at `time` = (t, branch) and `q`."""
        singular = np.linalg.svd(self.at(time[None], q[None])[0], compute_uv=False)
        return replace(self, rank=int(np.sum(singular > RANK_TOLERANCE)))

    def at(self, times: Array, q: Array) -> Array:
        """Return the nonempty columns of the scaled G, (rows, m, columns), at rows of times and q.

        The rows of `times` are (t, branch).
        """
        return self.scaled(times, q)[0]

    @property
    def columns(self) -> Array:
        """Indices of the nonempty columns."""
        return np.flatnonzero(np.diff(self.pattern.indptr))

    def scaled(self, times: Array, q: Array) -> tuple[Array, Array]:
        """Return `at`, and the lengths (rows, m) by which the rows of G were divided."""
        pattern, columns = self.pattern, self.columns
        count = np.diff(pattern.indptr)[columns]
        column = np.repeat(np.arange(len(columns)), count)
        values = self._nonzeros(times, q)
        values *= np.repeat(self.equations.position_scales[columns], count)
        matrix = np.zeros((len(q), self.equations.m, len(columns)))
        matrix[:, pattern.indices, column] = values
        length = np.linalg.norm(matrix, axis=2)
        return matrix / np.where(length > 0.0, length, 1.0)[..., None], length

    def smallest_singular_values(self, times: Array, q: Array) -> Array:
        """Return the smallest singular value of the scaled G at rows of (t, branch) and q, (rows,).

        Singular values that are zero at all positions, due to redundant constraints, are skipped.
        """
        m = self.equations.m
        rows_at_once = max(1, _MAX_ENTRIES // (m * max(self.pattern.nnz, 1)))
        blocks = []
        for first in range(0, len(q), rows_at_once):
            block = slice(first, first + rows_at_once)
            matrices = self.at(times[block], q[block])
            squares = np.linalg.eigvalsh(matrices @ np.swapaxes(matrices, 1, 2))
            blocks.append(np.sqrt(np.maximum(squares[:, m - self.rank], 0.0)))
        return np.concatenate(blocks)

    def singular_joints(self, time: Array, q: Array) -> list[str]:
        """Return the names of the joints that become dependent where G loses rank, at or near `q`.

        These are the joints with the largest entries in the left singular vector of the smallest
        singular value that is not zero due to redundant constraints.
        """
        left_vectors, _, _ = np.linalg.svd(self.at(time[None], q[None])[0])
        share = np.abs(left_vectors[:, self.rank - 1])
        names = [name.rpartition(".")[0] or name for name in self.equations.lam_names]
        involved = share > MIN_RELATIVE_SHARE * share.max()
        return list(
            dict.fromkeys(name for name, is_in in zip(names, involved, strict=True) if is_in)
        )

    def _nonzeros(self, times: Array, q: Array) -> Array:
        """Return the unscaled non-zeros of G at rows of (t, branch) and q, one row per position."""
        total = np.zeros((len(q), self.pattern.nnz))
        for joint, scatter in zip(self.equations.joints, self.scatter, strict=True):
            count, size = joint.count, joint.kernel.local.size
            local = np.asarray(joint.operator @ q.T).T.reshape(len(q) * count, size)
            data = np.tile(term_data(self.equations, joint).T, (len(q), 1))
            gradients = joint.kernel.gradients(np.repeat(times, count, axis=0), local, data)
            total += gradients.reshape(len(q), -1) @ scatter
        return total


def build_constraint_jacobian(e: EquationsOfMotion) -> ConstraintJacobian:
    """Return the constraint Jacobian with `rank` m, as for independent constraints."""
    return ConstraintJacobian(
        e, plan_state_sums(e.structure).gradient_pattern, _scatter_operators(e.structure), e.m
    )


@cache_on_owner
def _scatter_operators(structure: Structure) -> tuple[sp.csr_array, ...]:
    pattern = plan_state_sums(structure).gradient_pattern
    positions = column_indices(pattern) * structure.m + pattern.indices
    return tuple(_scatter_operator(joint, structure.m, positions) for joint in structure.joints)


def _scatter_operator(joint: ConstraintTerm, m: int, positions: Array) -> sp.csr_array:
    """Return the operator from the gradients of all copies to the entries of G.

    `positions` has column * m + row of each entry.
    """
    pattern = joint.kernel.gradient_pattern
    row, column = (np.array(x, int) for x in pattern.get_triplet())
    copy = np.repeat(np.arange(joint.count), len(row))
    i, j, source, weight = multiply_entries(
        joint.rows,
        copy * pattern.size1() + np.tile(row, joint.count),
        joint.operator,
        copy * pattern.size2() + np.tile(column, joint.count),
    )
    target = np.searchsorted(positions, j.astype(np.intp) * m + i)
    return sp.csr_array((weight, (source, target)), shape=(len(copy), len(positions)))


def has_closed_loops(e: EquationsOfMotion) -> bool:
    """Return True if joints or drivers form a loop; without loops, the rank of G is constant."""
    owner = [name.rpartition(".")[0] for name in e.q_names]
    group = {body: body for body in (*owner, _GROUND)}

    def root(body: str) -> str:
        while group[body] != body:
            body = group[body]
        return body

    for joint in e.joints:
        tied = {owner[column] for column in joint.operator.indices}
        first, *others = [root(body) for body in (tied if len(tied) > 1 else {*tied, _GROUND})]
        if not others or first in others or len(set(others)) < len(others):
            return True
        for other in others:
            group[other] = first
    return False


def scaled_null_space(rows: sp.csc_array, scales: Array) -> Array:
    """Return a basis (n, k) of the null space of `rows`, orthonormal if divided by `scales`."""
    if not rows.shape[0]:
        return np.diag(scales)
    matrix = rows.toarray() * scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix /= np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return scales[:, None] * la.null_space(matrix, rcond=RANK_TOLERANCE)
