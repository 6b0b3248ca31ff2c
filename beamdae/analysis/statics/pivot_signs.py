"""Signs of the pivots of static equations, by symmetric elimination.

The saddle-point matrix of the tangent, with the stiffness K, the constraint matrix G and the
compliances C of constraints, is

    [[K + G^T G, G^T], [G, -C / (1 - C)]]

in units of natural sizes in which the largest entry of each row is 1, and C at most 1/2. G^T G is a
share of the stiffness of joints and springs, but not of beams, whose K is regular and whose
constraints keep -C. It keeps leading pivots nonzero if bodies would be free without their joints
and springs, so that the matrix can be eliminated in an order that depends on the pattern only:
along the mechanism, each multiplier after the coordinates that it couples.

By Sylvester's law of inertia, the number of negative pivots is m plus the number of negative
eigenvalues of K + G^T C^-1 G in the motions that the joints allow, in any units. Because rounding
errors decide the sign of a pivot of a motion without stiffness, pivots are counted for K - s I with
shifts s on both sides of zero; the difference is the number of such motions.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.core.tables import Workspace
from beamdae.linear.factorizations import compute_bordered_ordering
from beamdae.linear.pivots import FixedOrder
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Asymmetry up to which the stiffness is treated as symmetric, relative to its largest entry. It is
# small because a follower load is small compared with the axial stiffness of a thin beam.
ASYMMETRY_TOLERANCE = 1e-13
# If no entry of the stiffness exceeds this value [J], all are zeros or rounding errors, as without
# loads and springs. The thermal energy of a coordinate is larger (2e-21 J at room temperature).
NEGLIGIBLE_STIFFNESS = 1e-22
# Steps of equilibration: each halves the logarithm of the ratio of rows. Largest compliance, and
# size of multipliers before.
_EQUILIBRATIONS, _MAX_COMPLIANCE, _FIRST_SIZE = 10, 0.5, 0.5


class SaddlePattern(NamedTuple):
    """Terms of the saddle-point matrix, nonzeros[targets] += weights * x[left] * x[right].

    The numbers x are the non-zeros of the tangent, and a 1 for terms of one factor. The first terms
    are the halves of both entries of each pair in the stiffness and the compliance, the next ones
    are G, the last ones G^T G. Of the symmetric matrix, the triangle below the diagonal in the
    order of elimination is assembled.

    Attributes
    ----------
    rows, columns
        Rows and columns of the non-zeros of the tangent.
    targets, left, right, shares
        See above; `weights` are shares in natural sizes.
    reduced
        Non-zeros of the tangent that are compliances beside G^T G.
    diagonal
        Diagonal entries of the coordinates in the matrix.
    groups, block_rows, block_columns
        Parts and multipliers by number, of each unknown, and of the rows and columns of the blocks
        that couple them.
    counted, blocks
        Non-zeros of the tangent in blocks of coordinates or rows of multipliers, and the block of
        each, followed by that of its transposed.
    plan
        Elimination in order, each multiplier after the coordinates that it couples.
    """

    rows: Array
    columns: Array
    targets: Array
    left: Array
    right: Array
    shares: Array
    reduced: Array
    diagonal: Array
    groups: Array
    block_rows: Array
    block_columns: Array
    counted: Array
    blocks: Array
    plan: FixedOrder


def allocate_saddle_point(plan: SaddlePattern, positions: Array) -> Workspace:
    """Return a `SaddlePoint` of the core, without natural sizes.

    The non-zeros of the tangent, and a 1, are at `positions` in the argument of `count_signs`.
    """
    order, positions = plan.plan, positions.astype(np.uint32)
    pairs = np.count_nonzero(plan.shares < 1.0) // 2
    factors = Workspace(
        "FixedOrderFactors",
        plan=order,
        lower=np.zeros(len(order.lower_rows)),
        pivots=np.zeros(len(order.lower_starts) - 1),
        first=order.lower_starts.copy(),
        x=np.zeros(len(order.lower_starts) - 1),
    )
    return Workspace(
        "SaddlePoint",
        pattern=plan,
        factors=factors,
        left=positions[plan.left],
        right=positions[plan.right],
        weights=plan.shares.copy(),
        values=np.zeros(len(plan.left)),
        skew=np.zeros(pairs),
        nonzeros=np.zeros(len(order.sources)),
        ones=np.ones(2 * pairs),
    )


def scale_by_reference(run: Workspace, tangent: Array, sizes: Array, rigid: int) -> Array:
    """Return natural sizes (n + m,) for the tangent in the reference configuration, unloaded.

    Sets the weights and `reference` of a `SaddlePoint`. `tangent` are its non-zeros, `sizes` first
    sizes of the coordinates, (n,); the first `rigid` unknowns have no compliance, that of the
    others is 1. The final sizes make all parts equally stiff: otherwise, rounding errors of large
    and stiff parts would exceed the stiffness of small and soft ones (D. Ruiz, A scaling algorithm
    to equilibrate both rows and columns norms in matrices, RAL-TR-2001-034). Parts without
    stiffness are as stiff as their softest spring or, without springs, as what their joints attach
    them to. By Sylvester's law of inertia, sizes do not change the number of negative eigenvalues.
    """
    n, pattern, count = len(sizes), run.pattern, len(run.factors.pivots)
    rows, columns = pattern.block_rows, pattern.block_columns
    scales = np.append(sizes, np.full(count - n, _FIRST_SIZE))
    is_joint = (pattern.rows < n) != (pattern.columns < n)
    values = np.abs(np.where(is_joint, 1.0, 0.5) * _weigh(pattern, scales)[:-1] * tangent)
    # Small entries of a block may be rounding errors.
    entries = np.zeros(len(rows))
    np.maximum.at(entries, pattern.blocks, np.tile(values[pattern.counted], 2))
    softest, factors = np.full(count, np.inf), np.ones(count)
    is_stiffness = (rows < n) & (entries > NEGLIGIBLE_STIFFNESS)
    is_spring = (rows >= rigid) & (entries > 0.0)
    np.minimum.at(softest, columns[is_spring], entries[is_spring])
    is_softest = np.isinf(softest[columns]) | (entries == softest[columns])
    is_used = np.where(np.isin(columns, columns[is_stiffness]), is_stiffness, is_softest)
    entries[(columns < n) & ~is_used] = 0.0
    for _ in range(_EQUILIBRATIONS):
        largest = np.zeros(count)
        np.maximum.at(largest, columns, entries * factors[rows] * factors[columns])
        factors /= np.sqrt(np.where(largest > 0.0, largest, 1.0))
    scales *= factors[pattern.groups]
    scales[rigid:] = np.minimum(scales[rigid:], math.sqrt(_MAX_COMPLIANCE))
    weights = _weigh(pattern, scales)
    run.weights[:] = pattern.shares * weights[pattern.left] * weights[pattern.right]
    run.reference = float(np.max(np.abs(weights[:-1] * tangent)[~is_joint], initial=0.0))
    return scales


def _weigh(pattern: SaddlePattern, scales: Array) -> Array:
    """Return the weights of the non-zeros of the tangent, and a 1, for sizes of the unknowns."""
    weights = np.append(scales[pattern.rows] * scales[pattern.columns], 1.0)
    # -C becomes -C / (1 - C).
    weights[pattern.reduced] /= 1.0 - weights[pattern.reduced]
    return weights


def plan_saddle_point(pattern: sp.csc_array, parts: Array, is_shared: Array) -> SaddlePattern:
    """Return the saddle-point matrix of tangents (n + m, n + m) with a CSC pattern.

    `parts` are the first coordinates of the parts of all coordinates, (n,). Constraints in G^T G,
    (m,), are those that have no stiffness of the same motion beside them.
    """
    rows, size, one = pattern.indices.astype(np.intp), pattern.shape[0], pattern.nnz
    n = len(parts)
    is_shared = np.append(np.zeros(n, bool), is_shared)
    columns = column_indices(pattern).astype(np.intp)
    keys = columns * size + rows

    def find(row: Array, column: Array) -> Array:
        """Return the indices of entries of the tangent, `one` for those outside the pattern."""
        wanted = column * size + row
        found = np.searchsorted(keys, wanted)
        return np.where(np.append(keys, -1)[found] == wanted, found, one)

    is_stiffness = (rows < n) == (columns < n)
    low, high = np.sort([rows[is_stiffness], columns[is_stiffness]], axis=0)
    first, last = np.divmod(np.unique(low * size + high), max(size, 1))
    halves = np.append(find(first, last), find(last, first))
    (joints,) = np.nonzero((rows >= n) & (columns < n))
    # Pairs of entries of G in the same row.
    gradients = [joints[rows[joints] == row] for row in np.flatnonzero(is_shared)]
    pairs = [x[np.stack(np.triu_indices(len(x)))] for x in gradients]
    products = np.concatenate([np.zeros((2, 0), int), *pairs], axis=1)
    i = np.concatenate([first, first, columns[joints], columns[products[0]]])
    j = np.concatenate([last, last, rows[joints], columns[products[1]]])
    keys_of_terms, diagonal = (i * size + j, j * size + i), np.arange(size) * (size + 1)
    entries = np.unique(np.concatenate([*keys_of_terms, diagonal]))
    indptr = np.searchsorted(entries, np.arange(size + 1) * size).astype(np.int32)
    numbers = (np.ones(len(entries)), (entries % size).astype(np.int32), indptr)
    pattern = sp.csc_array(numbers, shape=(size, size))
    order = _elimination_order(pattern, n, rows[joints], columns[joints])
    position, groups = np.argsort(order), np.append(parts, np.arange(n, size))
    # Entries count in both directions.
    counted = np.flatnonzero(is_stiffness | (rows >= n))
    ends = groups[rows[counted]], groups[columns[counted]]
    blocks, of_entry = np.unique(
        np.append(ends[1] * size + ends[0], ends[0] * size + ends[1]), return_inverse=True
    )
    # Each pair is assembled below the diagonal.
    targets = np.searchsorted(entries, np.where(position[i] < position[j], *keys_of_terms))
    single = len(halves) + len(joints)
    left = np.concatenate([halves, joints, products[0]])
    return SaddlePattern(
        rows=rows,
        columns=columns,
        targets=targets.astype(np.uint32),
        left=left,
        right=np.append(np.full(single, one), products[1]),
        shares=np.where(left == one, 0.0, np.where(np.arange(len(left)) < len(halves), 0.5, 1.0)),
        reduced=np.flatnonzero((rows == columns) & is_shared[rows]),
        diagonal=np.searchsorted(entries, diagonal[:n]).astype(np.uint32),
        groups=groups,
        block_rows=blocks % size,
        block_columns=blocks // size,
        counted=counted,
        blocks=of_entry,
        plan=FixedOrder.of(pattern, order),
    )


def _elimination_order(
    pattern: sp.csc_array, n: int, joint_rows: Array, joint_columns: Array
) -> Array:
    """Return an order with little fill, each multiplier after the coordinates that it couples."""
    position, last = np.zeros((2, pattern.shape[0]))
    position[compute_bordered_ordering(sp.csc_array(pattern[:n, :n])).order] = np.arange(n)
    np.maximum.at(last, joint_rows, position[joint_columns])
    position[n:] = last[n:] + 0.5
    return np.argsort(position, kind="stable")
