"""What can move at the start of a mechanism: free motions and loose parts."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.redundant_constraints import ConstraintRank
from beamdae.equations.starts.rigid_motions import compute_rigid_motions, describe_free_motion
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Singular values of the scaled joints, and shares of a motion, that are none.
_NONE = 1e-9


def describe_free_motions(
    e: EquationsOfMotion, q: Array, joints: ConstraintRank
) -> tuple[str, ...]:
    """Motions of the bodies that no joint and no driver holds, in words; beams are stiff in them.

    As many as are independent of each other, each of as few bodies as can be.
    """
    motions = compute_rigid_motions(e, q)
    space = la.null_space(joints.matrix @ motions, rcond=_NONE)
    count = space.shape[1]
    if not count:
        return ()
    _, _, order = la.qr(space.T, mode="economic", pivoting=True)
    apart = space @ la.inv(space[order[:count]])
    apart[np.abs(apart) < _NONE * np.max(np.abs(apart))] = 0.0
    return tuple(
        describe_free_motion(e, q, motions @ apart[:, k] * e.position_scales)
        for k in np.argsort(order[:count])
    )


def count_rigid_mobility(e: EquationsOfMotion, q: Array, joints: ConstraintRank) -> int:
    """Degrees of freedom that are left to the bodies if beams are rigid."""
    motions = compute_rigid_motions(e, q)
    matrix = joints.matrix @ motions
    rank = int(np.sum(la.svdvals(matrix) > _NONE)) if matrix.size else 0
    return motions.shape[1] - rank


def find_loose_groups(e: EquationsOfMotion) -> tuple[tuple[str, ...], ...]:
    """Groups of parts that joints and forces tie to each other, but no joint to the ground."""
    owner = np.zeros(e.n, int)
    for k, part in enumerate(e.parts):
        owner[part.rows] = k
    grounded, ties = set(), []
    for joint in e.joints:
        entries = sp.coo_array(joint.operator)
        copies = entries.coords[0] // (joint.operator.shape[0] // joint.count)
        for copy in range(joint.count):
            tied = np.unique(owner[entries.coords[1][copies == copy]])
            ties += [(tied[0], other) for other in tied]
            if len(tied) == 1:
                grounded.add(int(tied[0]))
    block = plan_state_sums(e.structure).block
    ties += list(
        zip(owner[block.pattern.indices], owner[column_indices(block.pattern)], strict=True)
    )
    pairs = np.array(ties, int).reshape(-1, 2).T
    graph = sp.coo_array((np.ones(pairs.shape[1]), pairs), shape=(len(e.parts), len(e.parts)))
    count, group = connected_components(graph.tocsr(), directed=False)
    held = {group[k] for k in grounded}
    names = np.array([part.name for part in e.parts], object)
    return tuple(tuple(names[group == k]) for k in range(count) if k not in held)
