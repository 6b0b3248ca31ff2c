"""Constraints that depend on each other: minimal sets, by name, and the motion they all block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import describe_largest_motion, join_names
from beamdae.errors import BeamdaeError
from beamdae.symbolic.sparse_operators import column_indices

if TYPE_CHECKING:
    from beamdae.equations.starts.consistent_start import ConsistencySolver

Array = np.ndarray

# Rows are of length one in the natural sizes of coordinates: what is left of one that depends on
# others, and the least share a constraint has in such a set.
_DEPENDENT, _SHARE = 1e-9, 1e-7
# A set that depends only here is independent after moving on by this much of the mechanism.
_ASIDE, _ITERATIONS = 1e-2, 20
# Names of a sentence.
_MOST_TOLD = 8
# Of the mechanism: what constraints may differ by that agree.
_AGREE = 1e-10


@dataclass(frozen=True)
class DependentSet:
    """A minimal set of constraints that depend on each other: without any one of them none do.

    Attributes
    ----------
    constraints
        Their names, "part.constraint".
    parts
        The parts that state them.
    blocks
        The motion that the last of these parts blocks and the others as well, in words.
    contradiction
        How far what they hold differs [m or rad], and how fast; zero where they agree.
    everywhere
        Whether they depend on each other in other positions too; if not this is a singular one.
    """

    constraints: tuple[str, ...]
    parts: tuple[str, ...]
    blocks: str
    contradiction: tuple[float, float]
    everywhere: bool = True

    def __str__(self) -> str:
        """A sentence."""
        return _describe_sets([self])


def describe_dependent_sets(found: Sequence[DependentSet]) -> str:
    """What parts depend on each other, a phrase for each group of them; "" of none."""
    by_parts: dict[tuple[str, ...], list[DependentSet]] = {}
    for one in found:
        by_parts.setdefault(one.parts, []).append(one)
    said = [_describe_sets(sets) for sets in by_parts.values()]
    more = [f"and {len(said) - _MOST_TOLD} more"] if len(said) > _MOST_TOLD else []
    return "; ".join([*said[:_MOST_TOLD], *more])


def _describe_sets(sets: Sequence[DependentSet]) -> str:
    """A sentence on sets of the same parts."""
    first = sets[0]
    blocks = join_names(list(dict.fromkeys(one.blocks for one in sets)))
    who = join_names(first.parts)
    both = "both" if len(first.parts) == 2 else "all"
    told = f"{who} {both} block {blocks}"
    if len(first.parts) == 1:
        told = f"{who} holds {blocks} more than once"
    if not first.everywhere:
        return f"{told} in this position, a singular one; start beside it"
    gap, rate = (max(one.contradiction[k] for one in sets) for k in (0, 1))
    if max(gap, rate) > 0.0:
        return f"{told}, and contradict each other by {gap:.3g} (m or rad), {rate:.3g} per s"
    return told


@dataclass(frozen=True)
class RowSelection:
    """A choice of independent rows of a matrix, and what the others are made of.

    Attributes
    ----------
    kept, dropped
        Row numbers, ascending.
    shares
        (dropped, kept): each dropped row as a sum of those kept.
    """

    kept: Array
    dropped: Array
    shares: Array


def select_independent_rows(matrix: Array) -> RowSelection:
    """Independent rows of (m, n), by a QR factorization with column pivoting of the transpose.

    Rows count as they are: scale them first.
    """
    m = len(matrix)
    if m == 0:
        none = np.zeros(0, int)
        return RowSelection(none, none, np.zeros((0, 0)))
    triangle, order = la.qr(matrix.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int(np.sum(diagonal > _DEPENDENT * max(float(diagonal[0]), 1e-300)))
    kept, dropped = order[:rank], order[rank:]
    shares = la.solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:]).T
    to_kept, to_dropped = np.argsort(kept), np.argsort(dropped)
    return RowSelection(kept[to_kept], dropped[to_dropped], shares[to_dropped][:, to_kept])


@dataclass(frozen=True)
class ConstraintRank:
    """G of a mechanism at one position, and whether its rank is the same beside it.

    Attributes
    ----------
    matrix
        G in the natural sizes of coordinates, rows of length one.
    lengths
        Of the rows before.
    split
        Independent rows.
    """

    matrix: Array
    lengths: Array
    split: RowSelection

    @property
    def rank(self) -> int:
        """How many constraints are independent."""
        return len(self.split.kept)


def analyze_constraint_rank(starter: ConsistencySolver, time: Array, q: Array) -> ConstraintRank:
    """G at `q`, in natural sizes."""
    e = starter.equations
    matrix = starter.constraint_matrix(time, q).toarray() * e.position_scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return ConstraintRank(matrix, lengths, select_independent_rows(matrix))


def find_dependent_sets(
    starter: ConsistencySolver, time: Array, q: Array, v: Array, joints: ConstraintRank
) -> tuple[DependentSet, ...]:
    """A minimal set for each constraint that can be spared, in the order they are stated."""
    e, split = starter.equations, joints.split
    if not len(split.dropped):
        return ()
    beside = _gradients_nearby(starter, time, q, joints)
    levels = starter.constraint_levels(time, q, v)[:2]
    return tuple(
        _dependent_set(e, q, joints, levels, row, shares, beside)
        for row, shares in zip(split.dropped, split.shares, strict=True)
    )


def _dependent_set(
    e: EquationsOfMotion,
    q: Array,
    joints: ConstraintRank,
    levels: Array,
    row: int,
    shares: Array,
    beside: Array,
) -> DependentSet:
    weights = np.zeros(e.m)
    weights[joints.split.kept], weights[row] = -shares, 1.0
    chosen = np.flatnonzero(np.abs(weights) > _SHARE * np.max(np.abs(weights)))
    named = tuple(e.lam_names[k] for k in chosen)
    lengths = np.where(joints.lengths > 0.0, joints.lengths, 1.0)
    off = np.abs(levels @ (weights / lengths)) * np.median(lengths[chosen])
    gap, rate = (float(x) if x > _AGREE * max(1.0, e.length) else 0.0 for x in off)
    return DependentSet(
        named,
        tuple(dict.fromkeys(_part_name(name) for name in named)),
        _describe_blocked_motion(e, q, joints.matrix, chosen, weights),
        (gap, rate),
        _depends_on(beside, joints.split.kept, row),
    )


def _depends_on(matrix: Array, kept: Array, row: int) -> bool:
    """Whether a row is a sum of those kept, of more of them perhaps than where they were chosen."""
    found = select_independent_rows(matrix[[*kept, row]])
    return len(found.kept) <= len(kept)


def _gradients_nearby(
    starter: ConsistencySolver, time: Array, q: Array, joints: ConstraintRank
) -> Array:
    """The scaled G beside a position, along motions its constraints allow, if there are any."""
    e = starter.equations
    (held,) = np.nonzero(np.any(joints.matrix, axis=0))
    free = la.null_space(joints.matrix[:, held], rcond=1e-9)
    if not free.shape[1]:
        return joints.matrix
    way = np.zeros(e.n)
    way[held] = free @ np.cos(np.arange(free.shape[1]) ** 2.0)
    beside = q + _ASIDE * e.position_scales * way / np.max(np.abs(way))
    for _ in range(_ITERATIONS):
        g = starter.constraint_levels(time, beside)[0]
        if np.max(np.abs(g)) <= _AGREE * max(1.0, e.length):
            return analyze_constraint_rank(starter, time, beside).matrix
        own = starter.constraint_matrix(time, beside).toarray() * e.position_scales
        beside[held] -= (e.position_scales[held]) * la.lstsq(own[:, held], g, cond=1e-8)[0]
    return joints.matrix


def _part_name(name: str) -> str:
    return name.rpartition(".")[0] or name


def _describe_blocked_motion(
    equations: EquationsOfMotion, q: Array, matrix: Array, chosen: Array, weights: Array
) -> str:
    """The motion that the last part of a set blocks, and the others as well.

    With sum w_i G_i = 0 what the rows of one part come to, sum over its own of w_i G_i, is also
    what the others come to: both hold it at zero. The motion is the least one along it that all
    constraints outside the set allow.
    """
    names = equations.lam_names
    last = _part_name(names[chosen[-1]])
    own = [k for k in chosen if _part_name(names[k]) == last]
    others = len(own) < len(chosen)
    along = weights[own] @ matrix[own] if others else matrix[own[-1]]
    # Coordinates that no constraint holds have no part in it.
    (held,) = np.nonzero(np.any(matrix, axis=0))
    outside = np.delete(matrix, chosen, axis=0)[:, held]
    free = la.null_space(outside, rcond=1e-10) if len(outside) else np.eye(len(held))
    motion = np.zeros(matrix.shape[1])
    motion[held] = free @ (free.T @ along[held])
    if np.linalg.norm(motion) < 1e-9 * np.linalg.norm(along) or not np.any(along):
        motion = along
    return f"the {describe_largest_motion(equations, q, motion * equations.position_scales)}"


# A gradient this small, in the scales of the coordinates, is what rounding leaves of zero.
_ZERO_GRADIENT = 1e-13
# Constraints depend on each other from this singular value of their scaled gradients on.
_DEPENDENT_SINGULAR_VALUE = 1e-10
# So many gradients are looked at by a singular value decomposition, which takes their number cubed;
# of more of them those alone whose squared singular values may be smaller than this.
_MAX_SVD_CONSTRAINTS = 100
_CLEARLY_INDEPENDENT = 1e-8
_INVERSE_ITERATIONS = 3


def require_independent(
    pattern: sp.csc_array,
    gradients: Array,
    names: tuple[str, ...],
    t: float,
    what_they_block: Callable[[], str],
) -> None:
    """Refuse constraints that hold nothing or depend on each other at time `t` [s].

    `gradients` are the non-zeros on `pattern` of those of the constraints `names`, a row each, in
    the scales of the coordinates. `what_they_block` is called where they depend on each other.

    Raises
    ------
    BeamdaeError
        Naming them.
    """
    count, size = pattern.shape
    if count == 0:
        return
    lengths = np.sqrt(np.bincount(pattern.indices, gradients**2, count))
    if np.any(lengths <= _ZERO_GRADIENT):
        name = names[int(np.argmin(lengths))]
        raise BeamdaeError(
            f"{name}: this constraint holds nothing at t = {t:g}, its gradient is zero; "
            "it cannot be met from the start given, or is none."
        )
    scaled = gradients / lengths[pattern.indices]
    if count > _MAX_SVD_CONSTRAINTS and _are_clearly_independent(
        sp.csr_array(sp.csc_array((scaled, pattern.indices, pattern.indptr), shape=(count, size)))
    ):
        return
    matrix = np.zeros((count, size))
    matrix[pattern.indices, column_indices(pattern)] = scaled
    left, singular, _ = la.svd(matrix, full_matrices=False)
    rank = int(np.sum(singular > _DEPENDENT_SINGULAR_VALUE))
    if rank == count:
        return
    if count > size:
        left = la.svd(matrix)[0]
    involved = np.max(np.abs(left[:, rank:]), axis=1) > 1e-6
    listed = ", ".join(name for name, is_in in zip(names, involved, strict=True) if is_in)
    blocked = what_they_block()
    raise BeamdaeError(
        f"{listed}: these constraints depend on each other at t = {t:g}, "
        f"remove {count - rank} of them{f': {blocked}' if blocked else ''}."
    )


def _are_clearly_independent(rows: sp.csr_array) -> bool:
    """Whether the smallest eigenvalue of rows @ rows.T, by inverse iteration, is far from zero."""
    try:
        factors = splu(sp.csc_array(rows @ rows.T), "MMD_AT_PLUS_A", 0.0)
    except RuntimeError:
        return False
    x = np.cos(np.arange(rows.shape[0]) ** 2.0)
    for _ in range(_INVERSE_ITERATIONS):
        x = factors.solve(x / np.linalg.norm(x))
    return bool(np.linalg.norm(x) < 1.0 / _CLEARLY_INDEPENDENT)
