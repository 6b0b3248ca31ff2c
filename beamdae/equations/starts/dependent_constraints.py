"""Detection, description and rejection of dependent (redundant) constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rank import RANK_TOLERANCE
from beamdae.equations.starts.rigid_motions import describe_largest_motion, join_some_names
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Rejection of dependent constraints, by singular values of gradients of length one.
_ZERO_GRADIENT_LENGTH = 1e-13  # of scaled gradients; shorter gradients are rounding errors
_SINGULAR_VALUE_TOLERANCE = 1e-10
_INVOLVED_SHARE = 1e-6  # constraints with smaller coefficients do not belong to a combination
_MAX_SVD_CONSTRAINTS = 100  # the cost of an SVD is cubic; above, inverse iteration is tried first
_MIN_INDEPENDENT_SQUARE = 1e-8  # smallest squared singular value that needs no SVD
_INVERSE_ITERATIONS = 3
_MAX_EXPLAINED_CONSTRAINTS = 300  # the cost of describing the blocked motions is cubic

# Search for minimal dependent sets, by a QR factorization.
_MIN_SHARE = 1e-7  # relative to the largest coefficient; smaller ones are rounding errors
_SIDE_STEP = 1e-2  # distance of the nearby test position, relative to the mechanism
_MAX_SIDE_ITERATIONS = 20
_AGREEMENT_TOLERANCE = 1e-10  # gap of constraints that agree, relative to its scale
_NULL_SPACE_TOLERANCE = 1e-9  # relative singular value
_OUTSIDE_NULL_SPACE_TOLERANCE = 1e-10  # relative singular value
_LEAST_SQUARES_TOLERANCE = 1e-8  # relative singular value
_MIN_ALLOWED_MOTION = 1e-9  # relative length of the part of a motion other constraints allow
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
    e, pattern = evaluator.equations, evaluator.sums.gradient_pattern
    names, t = e.lam_names, float(time[0])
    count, size = pattern.shape
    if count == 0:
        return
    columns = column_indices(pattern)
    gradients = evaluator.gradients(time, q) * e.position_scales[columns]
    lengths = np.sqrt(np.bincount(pattern.indices, gradients**2, count))
    if np.any(lengths <= _ZERO_GRADIENT_LENGTH):
        name = names[int(np.argmin(lengths))]
        raise BeamdaeError(
            f"{name}: this constraint has a zero gradient at t = {t:g} s; change the "
            "start values, or remove the constraint if it depends on no coordinate."
        )
    scaled_gradients = gradients / lengths[pattern.indices]
    if count > _MAX_SVD_CONSTRAINTS and _are_clearly_independent(
        sp.csr_array(
            sp.csc_array((scaled_gradients, pattern.indices, pattern.indptr), shape=(count, size))
        )
    ):
        return
    matrix = np.zeros((count, size))
    matrix[pattern.indices, columns] = scaled_gradients
    left_vectors, singular, _ = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.sum(singular > _SINGULAR_VALUE_TOLERANCE))
    if rank == count:
        return
    if count > size:
        left_vectors = np.linalg.svd(matrix)[0]
    involved = np.max(np.abs(left_vectors[:, rank:]), axis=1) > _INVOLVED_SHARE
    dependent = ", ".join(name for name, is_in in zip(names, involved, strict=True) if is_in)
    explanation = ""
    if count <= _MAX_EXPLAINED_CONSTRAINTS:
        constraint_rank = analyze_constraint_rank(evaluator, time, q)
        sets = find_dependent_sets(evaluator, time, q, np.zeros(e.n), constraint_rank)
        explanation = describe_dependent_sets(sets)
    raise BeamdaeError(
        f"{dependent}: these constraints depend on each other at t = {t:g} s; remove "
        f"{count - rank} of them or, at a singular position, change the start "
        f"values{(f': {explanation}' if explanation else '')}."
    )


def _are_clearly_independent(rows: sp.csr_array) -> bool:
    """Return True if inverse iteration finds the lowest eigenvalue of rows @ rows.T above 1e-8."""
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
    scales = evaluator.equations.position_scales
    matrix = evaluator.constraint_matrix(time, q).toarray() * scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return ConstraintRank(matrix, lengths, select_independent_rows(matrix))


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
    nearby = _gradients_nearby(evaluator, time, q, constraint_rank)
    levels = evaluator.constraint_levels(time, q, v)[:2]
    lengths = np.where(constraint_rank.lengths > 0.0, constraint_rank.lengths, 1.0)
    sets = []
    for row, coefficients in zip(rows.dependent, rows.coefficients, strict=True):
        weights = np.zeros(e.m)
        weights[rows.independent], weights[row] = -coefficients, 1.0
        members = np.flatnonzero(np.abs(weights) > _MIN_SHARE * np.max(np.abs(weights)))
        names = tuple(e.lam_names[k] for k in members)
        differences = np.abs(levels @ (weights / lengths)) * np.median(lengths[members])
        tolerance = _AGREEMENT_TOLERANCE * np.median(e.constraint_scales[members])
        gap, rate = (float(x) if x > tolerance else 0.0 for x in differences)
        # At the nearby position, the row may depend on further independent rows.
        rank_nearby = len(select_independent_rows(nearby[[*rows.independent, row]]).independent)
        sets.append(
            DependentSet(
                names,
                tuple(dict.fromkeys(_part_name(name) for name in names)),
                _describe_blocked_motion(e, q, constraint_rank.matrix, members, weights),
                (gap, rate),
                rank_nearby <= len(rows.independent),
            )
        )
    return tuple(sets)


def _gradients_nearby(
    evaluator: StateEvaluator, time: Array, q: Array, constraint_rank: ConstraintRank
) -> Array:
    """Return the scaled G at a nearby position that the constraints allow, or else at `q`."""
    e = evaluator.equations
    (nonzero_columns,) = np.nonzero(np.any(constraint_rank.matrix, axis=0))
    free = la.null_space(constraint_rank.matrix[:, nonzero_columns], rcond=_NULL_SPACE_TOLERANCE)
    if not free.shape[1]:
        return constraint_rank.matrix
    direction = np.zeros(e.n)
    direction[nonzero_columns] = free @ np.cos(np.arange(free.shape[1]) ** 2.0)
    nearby = q + _SIDE_STEP * e.position_scales * direction / np.max(np.abs(direction))
    for _ in range(_MAX_SIDE_ITERATIONS):
        g = evaluator.position_gaps(time, nearby)
        if np.max(np.abs(g) / e.constraint_scales) <= _AGREEMENT_TOLERANCE:
            return analyze_constraint_rank(evaluator, time, nearby).matrix
        gradients = evaluator.constraint_matrix(time, nearby).toarray() * e.position_scales
        change = la.lstsq(gradients[:, nonzero_columns], g, cond=_LEAST_SQUARES_TOLERANCE)[0]
        nearby[nonzero_columns] -= (e.position_scales[nonzero_columns]) * change
    return constraint_rank.matrix


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
        la.null_space(outside, rcond=_OUTSIDE_NULL_SPACE_TOLERANCE)
        if len(outside)
        else np.eye(len(nonzero_columns))
    )
    motion = np.zeros(matrix.shape[1])
    motion[nonzero_columns] = free @ (free.T @ along[nonzero_columns])
    too_small = np.linalg.norm(motion) < _MIN_ALLOWED_MOTION * np.linalg.norm(along)
    if too_small or not np.any(along):
        motion = along
    return f"the {describe_largest_motion(equations, q, motion * equations.position_scales)}"
