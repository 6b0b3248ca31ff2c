"""Rank of the constraints: detection, description and rejection of dependent constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import describe_largest_motion, join_some_names
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError
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
        Rank of G at regular positions; less than m if constraints are redundant.
    """

    evaluator: StateEvaluator
    rank: int

    @property
    def columns(self) -> Array:
        """Indices of the nonempty columns."""
        return np.flatnonzero(np.diff(self.evaluator.sums.gradient_pattern.indptr))

    def scaled(self, times: Array, q: Array) -> tuple[Array, Array]:
        """Return the nonempty columns of the scaled G, (rows, m, columns), at rows of times and q.

        The rows of `times` are (t, branch). The lengths (rows, m) by which the rows of G were
        divided follow.
        """
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
            matrices, _ = self.scaled(times[block], q[block])
            squares = np.linalg.eigvalsh(matrices @ np.swapaxes(matrices, 1, 2))
            blocks.append(np.sqrt(np.maximum(squares[:, m - self.rank], 0.0)))
        return np.concatenate(blocks)

    def singular_joints(self, time: Array, q: Array) -> list[str]:
        """Return the names of the joints that become dependent where G loses rank, at or near `q`.

        These are the joints with the largest entries in the left singular vector of the smallest
        singular value that is not zero due to redundant constraints.
        """
        left_vectors, _, _ = np.linalg.svd(self.scaled(time[None], q[None])[0][0])
        share = np.abs(left_vectors[:, self.rank - 1])
        involved = np.flatnonzero(share > MIN_RELATIVE_SHARE * share.max())
        names = [self.evaluator.equations.lam_names[k] for k in involved]
        return list(dict.fromkeys(name.rpartition(".")[0] or name for name in names))


def build_constraint_jacobian(
    e: EquationsOfMotion, regular: tuple[Array, Array] | None = None
) -> ConstraintJacobian:
    """Return the constraint Jacobian with the rank m, or that at a `regular` (t, branch) and q."""
    evaluator = StateEvaluator(e)
    if regular is None:
        return ConstraintJacobian(evaluator, e.m)
    return ConstraintJacobian(evaluator, analyze_constraint_rank(evaluator, *regular).rank)


def list_tied_parts(e: EquationsOfMotion) -> list[Array]:
    """Return the indices of the parts that each joint ties, and len(e.parts) for the ground.

    Joints that constrain the coordinates of a single part tie it to the ground.
    """
    ground, ties = len(e.parts), []
    for joint in e.joints:
        copies = row_indices(joint.operator) // (joint.operator.shape[0] // joint.count)
        owners = e.part_indices[joint.operator.indices]
        tied = (np.unique(owners[copies == copy]) for copy in range(joint.count))
        ties += [x if len(x) > 1 else np.append(x, ground) for x in tied]
    return ties


def group_tied(count: int, ties: Sequence[Array]) -> Array:
    """Return the number of the group of each of `count` parts, then of each tie.

    A group contains the parts that ties connect.
    """
    size, lengths = count + len(ties), [len(x) for x in ties]
    pairs = (
        np.concatenate([np.zeros(0, int), *ties]),
        count + np.repeat(np.arange(len(ties)), lengths),
    )
    graph = sp.coo_array((np.ones(sum(lengths)), pairs), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1])


def has_closed_loops(e: EquationsOfMotion) -> bool:
    """Return True if joints or drivers form a loop; without loops, the rank of G is constant."""
    ties = list_tied_parts(e)
    groups = group_tied(len(e.parts) + 1, ties)
    return sum(map(len, ties)) >= len(groups) - groups.max()


def scaled_null_space(rows: sp.csc_array, scales: Array) -> Array:
    """Return a basis (n, k) of the null space of `rows`, orthonormal if divided by `scales`."""
    if not rows.shape[0]:
        return np.diag(scales)
    matrix, _ = normalize_rows(rows.toarray() * scales)
    return scales[:, None] * la.null_space(matrix, rcond=RANK_TOLERANCE)


_ZERO_GRADIENT_LENGTH = 1e-13  # of scaled gradients; shorter gradients are rounding errors
_MAX_DENSE_CONSTRAINTS = 100  # dense costs are cubic; above, inverse iteration is tried first
_MIN_INDEPENDENT_SQUARE = 1e-8  # smallest squared singular value of independent constraints
_INVERSE_ITERATIONS = 3
_MAX_EXPLAINED_CONSTRAINTS = 300  # the cost of describing the blocked motions is cubic

_MIN_SHARE = 1e-7  # relative to the largest coefficient; smaller ones are rounding errors
_CURVATURE_TOLERANCE = 1e-7  # of scaled constraints along a motion of size one
_AGREEMENT_TOLERANCE = 1e-10  # gap of constraints that agree, relative to its scale
_MAX_DESCRIBED_SETS = 8


def require_independent_constraints(evaluator: StateEvaluator, time: Array, q: Array) -> None:
    """Reject constraints that depend on each other or have a zero gradient at positions `q`.

    Raises
    ------
    BeamdaeError
        If such constraints exist. The message names one constraint with a zero gradient, or all
        dependent constraints. Unless there are more than 300 constraints, it also describes the
        motions that dependent constraints block more than once.
    """
    e, t = evaluator.equations, float(time[0])
    if e.m == 0 or (e.m > _MAX_DENSE_CONSTRAINTS and _are_clearly_independent(evaluator, time, q)):
        return
    constraint_rank = analyze_constraint_rank(evaluator, time, q)
    lengths, rows = constraint_rank.lengths, constraint_rank.rows
    if np.any(lengths <= _ZERO_GRADIENT_LENGTH):
        raise BeamdaeError(
            f"{e.lam_names[int(np.argmin(lengths))]}: this constraint has a zero gradient at "
            f"t = {t:g} s; change the start values, or remove the constraint if it depends on no "
            "coordinate."
        )
    count = len(rows.dependent)
    if not count:
        return
    weights = np.abs(rows.coefficients)
    is_in = np.isin(np.arange(e.m), rows.dependent)
    is_in[rows.independent] = np.any(
        weights > _MIN_SHARE * np.max(weights, axis=1)[:, None], axis=0
    )
    dependent = ", ".join(e.lam_names[k] for k in np.flatnonzero(is_in))
    explanation = ""
    if e.m <= _MAX_EXPLAINED_CONSTRAINTS:
        sets = find_dependent_sets(evaluator, time, q, np.zeros(e.n), constraint_rank)
        explanation = f": {describe_dependent_sets(sets)}"
    raise BeamdaeError(
        f"{dependent}: these constraints depend on each other at t = {t:g} s; remove {count} of "
        f"them or, at a singular position, change the start values{explanation}."
    )


def _are_clearly_independent(evaluator: StateEvaluator, time: Array, q: Array) -> bool:
    """Return True if inverse iteration finds the lowest eigenvalue of G G^T above 1e-8.

    The rows of G have length one.
    """
    rows = evaluator.constraint_matrix(time, q) @ sp.diags_array(
        evaluator.equations.position_scales
    )
    lengths = sp.linalg.norm(rows, axis=1)
    rows = sp.diags_array(1.0 / np.maximum(lengths, _ZERO_GRADIENT_LENGTH)) @ rows
    try:
        factors = splu(sp.csc_array(rows @ rows.T), "MMD_AT_PLUS_A", 0.0)
    except RuntimeError:
        return False
    x = np.cos(np.arange(rows.shape[0]) ** 2.0)
    for _ in range(_INVERSE_ITERATIONS):
        x = factors.solve(x / np.linalg.norm(x))
    return bool(np.linalg.norm(x) < 1.0 / _MIN_INDEPENDENT_SQUARE)


@dataclass(frozen=True)
class DependentSet:
    """Minimal set of dependent constraints: if one is removed, the rest are independent.

    Attributes
    ----------
    constraints
        Names "part.constraint" of the constraints.
    parts
        Names of the parts to which the constraints belong.
    blocks
        Phrase for the motion that these parts all block, or that a single part blocks more than
        once.
    contradiction
        Differences of the prescribed values [m or rad] and of their rates [m/s or rad/s]; zero if
        the constraints agree.
    everywhere
        True if the constraints are also dependent nearby; False at a singular position.
    """

    constraints: tuple[str, ...]
    parts: tuple[str, ...]
    blocks: str
    contradiction: tuple[float, float]
    everywhere: bool = True

    def __str__(self) -> str:
        return _describe_sets([self])


def describe_dependent_sets(sets: Sequence[DependentSet]) -> str:
    """Return one phrase per group of dependent parts, joined by "; "; "" if `sets` is empty.

    After eight phrases, the others are only counted.
    """
    by_parts: dict[tuple[str, ...], list[DependentSet]] = {}
    for one in sets:
        by_parts.setdefault(one.parts, []).append(one)
    phrases = [_describe_sets(group) for group in by_parts.values()]
    omitted = len(phrases) - _MAX_DESCRIBED_SETS
    more = [f"and {omitted} more"] if omitted > 0 else []
    return "; ".join([*phrases[:_MAX_DESCRIBED_SETS], *more])


def _describe_sets(sets: Sequence[DependentSet]) -> str:
    """Return a phrase that describes sets of the same parts."""
    first = sets[0]
    blocks = join_some_names(list(dict.fromkeys(one.blocks for one in sets)))
    parts = join_some_names(first.parts)
    both = "both" if len(first.parts) == 2 else "all"
    sentence = f"{parts} {both} block {blocks}"
    if len(first.parts) == 1:
        sentence = f"{parts} blocks {blocks} more than once"
    if not first.everywhere:
        return f"{sentence} in this singular position; start from a nearby position"
    gap, rate = (max(one.contradiction[k] for one in sets) for k in (0, 1))
    if max(gap, rate) > 0.0:
        return (
            f"{sentence}, but the prescribed values contradict each other by {gap:.3g} "
            f"(m or rad) and the rates by {rate:.3g} (m/s or rad/s)"
        )
    return sentence


def find_dependent_sets(
    evaluator: StateEvaluator, time: Array, q: Array, v: Array, constraint_rank: ConstraintRank
) -> tuple[DependentSet, ...]:
    """Return one minimal dependent set per redundant constraint, in order of the constraints.

    Parameters
    ----------
    evaluator
        Evaluator of the equations of motion.
    time
        (t, branch).
    q, v
        Positions and velocities, (n,) each, at which the constraints are compared.
    constraint_rank
        Rank of the constraints at `q`.
    """
    e, rows = evaluator.equations, constraint_rank.rows
    if not len(rows.dependent):
        return ()
    lengths = np.where(constraint_rank.lengths > 0.0, constraint_rank.lengths, 1.0)
    # Second derivatives along a straight free motion. Along curves on which the independent
    # constraints stay closed, those that follow from them everywhere stay closed, too: the same
    # combination of second derivatives vanishes.
    matrix = constraint_rank.matrix
    (nonzero_columns,) = np.nonzero(np.any(matrix, axis=0))
    free = la.null_space(matrix[:, nonzero_columns], rcond=RANK_TOLERANCE)
    direction = np.zeros(e.n)
    direction[nonzero_columns] = free @ np.cos(np.arange(free.shape[1]) ** 2.0)
    direction /= np.max(np.abs(direction), initial=1e-300)
    ahead, behind, at_rest = (
        evaluator.constraint_levels(time, q, k * e.position_scales * direction)[2]
        for k in (1.0, -1.0, 0.0)
    )
    accelerations = (0.5 * (ahead + behind) - at_rest) / lengths
    levels = evaluator.constraint_levels(time, q, v)[:2]
    sets = []
    for row, coefficients in zip(rows.dependent, rows.coefficients, strict=True):
        weights = np.zeros(e.m)
        weights[rows.independent], weights[row] = -coefficients, 1.0
        members = np.flatnonzero(np.abs(weights) > _MIN_SHARE * np.max(np.abs(weights)))
        names = tuple(e.lam_names[k] for k in members)
        differences = np.abs(levels @ (weights / lengths)) * np.median(lengths[members])
        tolerance = _AGREEMENT_TOLERANCE * np.median(e.constraint_scales[members])
        gap, rate = (float(x) if x > tolerance else 0.0 for x in differences)
        terms = weights * accelerations
        limit = _CURVATURE_TOLERANCE * max(1.0, float(np.max(np.abs(terms))))
        sets.append(
            DependentSet(
                names,
                tuple(dict.fromkeys(_part_name(name) for name in names)),
                _describe_blocked_motion(e, q, matrix, members, weights),
                (gap, rate),
                bool(abs(terms.sum()) <= limit),
            )
        )
    return tuple(sets)


def _part_name(constraint: str) -> str:
    return constraint.rpartition(".")[0] or constraint


def _describe_blocked_motion(
    equations: EquationsOfMotion, q: Array, matrix: Array, members: Array, weights: Array
) -> str:
    """Describe the motion that the parts of a set all block.

    If sum w_i G_i = 0, the sum over the rows of one part is minus the sum over the other parts, so
    that this part and the others block the same combination of coordinates. The motion is the
    projection of this combination onto the motions that all constraints outside the set allow.
    """
    names = equations.lam_names
    last = _part_name(names[members[-1]])
    rows = [k for k in members if _part_name(names[k]) == last]
    has_others = len(rows) < len(members)
    along = weights[rows] @ matrix[rows] if has_others else matrix[rows[-1]]
    # Unconstrained coordinates do not take part in the motion.
    (nonzero_columns,) = np.nonzero(np.any(matrix, axis=0))
    outside = np.delete(matrix, members, axis=0)[:, nonzero_columns]
    free = (
        la.null_space(outside, rcond=RANK_TOLERANCE)
        if len(outside)
        else np.eye(len(nonzero_columns))
    )
    motion = np.zeros(matrix.shape[1])
    motion[nonzero_columns] = free @ (free.T @ along[nonzero_columns])
    too_small = np.linalg.norm(motion) < RANK_TOLERANCE * np.linalg.norm(along)
    if too_small or not np.any(along):
        motion = along
    return f"the {describe_largest_motion(equations, q, motion * equations.position_scales)}"
