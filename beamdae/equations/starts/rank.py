"""Rank of the constraint Jacobian G, at single positions and along runs; closed loops."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.symbolic.sparse_operators import column_indices, row_indices

Array = np.ndarray

RANK_TOLERANCE = 1e-9  # smaller singular values of rows of length one are treated as zero
_MAX_ENTRIES = 2_000_000  # of the matrices evaluated together
MIN_RELATIVE_SHARE = 0.1  # relative to the largest; joints with smaller shares are not named


def normalize_rows(matrix: Array) -> tuple[Array, Array]:
    """Return a matrix (..., m, n) with rows of length one, or zero, and the lengths (..., m)."""
    lengths = np.linalg.norm(matrix, axis=-1)
    return matrix / np.where(lengths > 0.0, lengths, 1.0)[..., None], lengths


def _scaled_gradients(evaluator: StateEvaluator, times: Array, q: Array) -> Array:
    """Return G with columns scaled by `position_scales` at rows of (t, branch) and q, (k, m, n)."""
    e, pattern = evaluator.equations, evaluator.sums.gradient_pattern
    columns, matrices = column_indices(pattern), np.zeros((len(q), e.m, e.n))
    values = np.array([evaluator.gradients(*row) for row in zip(times, q, strict=True)])
    matrices[:, pattern.indices, columns] = values * e.position_scales[columns]
    return matrices


@dataclass(frozen=True)
class RowSelection:
    """Independent rows of a matrix, and the other rows as combinations of them.

    Attributes
    ----------
    independent, dependent
        Row indices, ascending.
    coefficients
        Weights of the independent rows in each dependent row, (dependent, independent).
    """

    independent: Array
    dependent: Array
    coefficients: Array


def select_independent_rows(matrix: Array) -> RowSelection:
    """Select independent rows of a matrix (m, n) by pivoted QR factorization of its transpose.

    Rows should have equal lengths, because the rank tolerance is relative to the longest.
    """
    m = len(matrix)
    if m == 0:
        none = np.zeros(0, int)
        return RowSelection(none, none, np.zeros((0, 0)))
    triangle, order = la.qr(matrix.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int(np.sum(diagonal > RANK_TOLERANCE * max(float(diagonal[0]), 1e-300)))
    if rank == m:
        return RowSelection(np.arange(m), np.zeros(0, int), np.zeros((0, m)))
    independent, dependent = order[:rank], order[rank:]
    coefficients = la.solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:]).T
    columns, rows = np.argsort(independent), np.argsort(dependent)
    return RowSelection(independent[columns], dependent[rows], coefficients[rows][:, columns])


@dataclass(frozen=True)
class ConstraintRank:
    """Scaled constraint Jacobian G = dg/dq at one position, with its independent rows.

    Attributes
    ----------
    matrix
        G with columns scaled by `position_scales` and rows of length one, (m, n); rows of zeros
        remain zero.
    lengths
        Lengths of the rows of G with scaled columns, before the rows are normalized, (m,).
    rows
        Selection of independent rows.
    """

    matrix: Array
    lengths: Array
    rows: RowSelection

    @property
    def rank(self) -> int:
        """Number of linearly independent constraints."""
        return len(self.rows.independent)


def analyze_constraint_rank(evaluator: StateEvaluator, time: Array, q: Array) -> ConstraintRank:
    """Return the scaled G at positions `q`, (n,), and a selection of independent rows."""
    matrix, lengths = normalize_rows(_scaled_gradients(evaluator, time[None], q[None])[0])
    return ConstraintRank(matrix, lengths, select_independent_rows(matrix))


@dataclass(frozen=True)
class ConstraintJacobian:
    """G = dg/dq with columns scaled by `position_scales` and rows of length one.

    Attributes
    ----------
    evaluator
        Evaluator of the equations of motion with the constraints.
    rank
        Rank of G at regular positions; less than m if constraints are redundant. Equal to m unless
        set by `with_rank_at`.
    """

    evaluator: StateEvaluator
    rank: int

    def with_rank_at(self, time: Array, q: Array) -> ConstraintJacobian:
        """Return a copy with `rank` set to the rank of G at `time` = (t, branch) and `q`."""
        return replace(self, rank=analyze_constraint_rank(self.evaluator, time, q).rank)

    def at(self, times: Array, q: Array) -> Array:
        """Return the nonempty columns of the scaled G, (rows, m, columns), at rows of times and q.

        The rows of `times` are (t, branch).
        """
        return self.scaled(times, q)[0]

    @property
    def columns(self) -> Array:
        """Indices of the nonempty columns."""
        return np.flatnonzero(np.diff(self.evaluator.sums.gradient_pattern.indptr))

    def scaled(self, times: Array, q: Array) -> tuple[Array, Array]:
        """Return `at`, and the lengths (rows, m) by which the rows of G were divided."""
        return normalize_rows(_scaled_gradients(self.evaluator, times, q)[:, :, self.columns])

    def smallest_singular_values(self, times: Array, q: Array) -> Array:
        """Return the smallest singular value of the scaled G at rows of (t, branch) and q, (rows,).

        Singular values that are zero at all positions, due to redundant constraints, are skipped.
        """
        m = self.evaluator.equations.m
        rows_at_once = max(1, _MAX_ENTRIES // max(m * len(self.columns), 1))
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
        involved = np.flatnonzero(share > MIN_RELATIVE_SHARE * share.max())
        names = [self.evaluator.equations.lam_names[k] for k in involved]
        return list(dict.fromkeys(name.rpartition(".")[0] or name for name in names))


def build_constraint_jacobian(e: EquationsOfMotion) -> ConstraintJacobian:
    """Return the constraint Jacobian with `rank` m, as for independent constraints."""
    return ConstraintJacobian(StateEvaluator(e), e.m)


def list_tied_parts(e: EquationsOfMotion) -> list[Array]:
    """Return the indices of the parts with coordinates that each joint constrains."""
    ties = []
    for joint in e.joints:
        copies = row_indices(joint.operator) // (joint.operator.shape[0] // joint.count)
        owners = e.part_indices[joint.operator.indices]
        ties += [np.unique(owners[copies == copy]) for copy in range(joint.count)]
    return ties


def has_closed_loops(e: EquationsOfMotion) -> bool:
    """Return True if joints or drivers form a loop; without loops, the rank of G is constant."""
    # Parts, then the ground, then joints; those of one part tie it to the ground.
    ground = len(e.parts)
    ties = [x if len(x) > 1 else np.append(x, ground) for x in list_tied_parts(e)]
    joints = ground + 1 + np.repeat(np.arange(len(ties)), [len(x) for x in ties])
    pairs = np.concatenate(ties) if ties else np.zeros(0, int), joints
    size = ground + 1 + len(ties)
    graph = sp.coo_array((np.ones(len(joints)), pairs), shape=(size, size))
    return len(joints) > size - connected_components(graph, directed=False)[0]


def scaled_null_space(rows: sp.csc_array, scales: Array) -> Array:
    """Return a basis (n, k) of the null space of `rows`, orthonormal if divided by `scales`."""
    if not rows.shape[0]:
        return np.diag(scales)
    matrix, _ = normalize_rows(rows.toarray() * scales)
    return scales[:, None] * la.null_space(matrix, rcond=RANK_TOLERANCE)
