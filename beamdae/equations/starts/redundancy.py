"""Constraints that depend on each other: minimal sets, by name, and the motion they all block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg as la

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import described, listed

if TYPE_CHECKING:
    from beamdae.equations.starts.consistent_start import Starter

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
        return _together([self])


def sentences(found: Sequence[DependentSet]) -> str:
    """What parts depend on each other, a phrase for each group of them; "" of none."""
    by_parts: dict[tuple[str, ...], list[DependentSet]] = {}
    for one in found:
        by_parts.setdefault(one.parts, []).append(one)
    said = [_together(sets) for sets in by_parts.values()]
    more = [f"and {len(said) - _MOST_TOLD} more"] if len(said) > _MOST_TOLD else []
    return "; ".join([*said[:_MOST_TOLD], *more])


def _together(sets: Sequence[DependentSet]) -> str:
    """A sentence on sets of the same parts."""
    first = sets[0]
    blocks = listed(list(dict.fromkeys(one.blocks for one in sets)))
    who = listed(first.parts)
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
class Independent:
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


def independent_rows(matrix: Array) -> Independent:
    """Independent rows of (m, n), by a QR factorization with column pivoting of the transpose.

    Rows count as they are: scale them first.
    """
    m = len(matrix)
    if m == 0:
        none = np.zeros(0, int)
        return Independent(none, none, np.zeros((0, 0)))
    triangle, order = la.qr(matrix.T, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int(np.sum(diagonal > _DEPENDENT * max(float(diagonal[0]), 1e-300)))
    kept, dropped = order[:rank], order[rank:]
    shares = la.solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:]).T
    to_kept, to_dropped = np.argsort(kept), np.argsort(dropped)
    return Independent(kept[to_kept], dropped[to_dropped], shares[to_dropped][:, to_kept])


@dataclass(frozen=True)
class ScaledJoints:
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
    split: Independent

    @property
    def rank(self) -> int:
        """How many constraints are independent."""
        return len(self.split.kept)


def scaled_joints(starter: Starter, time: Array, q: Array) -> ScaledJoints:
    """G at `q`, in natural sizes."""
    e = starter.equations
    matrix = starter.constraint_matrix(time, q).toarray() * e.position_scales
    lengths = np.linalg.norm(matrix, axis=1)
    matrix = matrix / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    return ScaledJoints(matrix, lengths, independent_rows(matrix))


def dependent_sets(
    starter: Starter, time: Array, q: Array, v: Array, joints: ScaledJoints
) -> tuple[DependentSet, ...]:
    """A minimal set for each constraint that can be spared, in the order they are stated."""
    e, split = starter.equations, joints.split
    if not len(split.dropped):
        return ()
    beside = _beside(starter, time, q, joints)
    levels = starter.levels(time, q, v)[:2]
    return tuple(
        _dependent_set(e, q, joints, levels, row, shares, beside)
        for row, shares in zip(split.dropped, split.shares, strict=True)
    )


def _dependent_set(
    e: EquationsOfMotion,
    q: Array,
    joints: ScaledJoints,
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
        tuple(dict.fromkeys(_part(name) for name in named)),
        _blocked(e, q, joints.matrix, chosen, weights),
        (gap, rate),
        _follows(beside, joints.split.kept, row),
    )


def _follows(matrix: Array, kept: Array, row: int) -> bool:
    """Whether a row is a sum of those kept, of more of them perhaps than where they were chosen."""
    found = independent_rows(matrix[[*kept, row]])
    return len(found.kept) <= len(kept)


def _beside(starter: Starter, time: Array, q: Array, joints: ScaledJoints) -> Array:
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
        g = starter.levels(time, beside)[0]
        if np.max(np.abs(g)) <= _AGREE * max(1.0, e.length):
            return scaled_joints(starter, time, beside).matrix
        own = starter.constraint_matrix(time, beside).toarray() * e.position_scales
        beside[held] -= (e.position_scales[held]) * la.lstsq(own[:, held], g, cond=1e-8)[0]
    return joints.matrix


def _part(name: str) -> str:
    return name.rpartition(".")[0] or name


def _blocked(
    equations: EquationsOfMotion, q: Array, matrix: Array, chosen: Array, weights: Array
) -> str:
    """The motion that the last part of a set blocks, and the others as well.

    With sum w_i G_i = 0 what the rows of one part come to, sum over its own of w_i G_i, is also
    what the others come to: both hold it at zero. The motion is the least one along it that all
    constraints outside the set allow.
    """
    names = equations.lam_names
    last = _part(names[chosen[-1]])
    own = [k for k in chosen if _part(names[k]) == last]
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
    return f"the {described(equations, q, motion * equations.position_scales)}"
