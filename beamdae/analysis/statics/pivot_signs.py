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
from scipy.sparse.linalg import splu

from beamdae.analysis.continuation.critical import Determinant
from beamdae.linear.factorizations import compute_bordered_ordering
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Asymmetry up to which the stiffness is treated as symmetric, relative to its largest entry. It is
# small because a follower load is small compared with the axial stiffness of a thin beam.
_ASYMMETRY_TOLERANCE = 1e-13
# If no entry of the stiffness exceeds this value [J], all are zeros or rounding errors, as without
# loads and springs. The thermal energy of a coordinate is larger (2e-21 J at room temperature).
NEGLIGIBLE_STIFFNESS = 1e-22
# Shifts relative to the largest entry of the stiffness. Above 2e-16, signs of pivots are right for
# all zero eigenvalues that were tried: free beams with h/L = 1e-5 to 3e-2 and 2 to 128 elements in
# any position, prestressed beams, and linkages of up to 60 bodies.
_SHIFT_RATIO = 1e-15
# Steps of equilibration: each halves the logarithm of the ratio of rows. Largest compliance, and
# size of multipliers before.
_EQUILIBRATIONS, _MAX_COMPLIANCE, _FIRST_SIZE = 10, 0.5, 0.5


class SaddlePattern(NamedTuple):
    """Terms of the saddle-point matrix, nonzeros[targets] += shares * x[left] * x[right].

    The numbers x are the non-zeros of the tangent in natural sizes, and a 1 for terms of one
    factor. The first terms are halves of the non-zeros and of their transposed, others are G^T G.

    Attributes
    ----------
    rows, columns
        Rows and columns of the non-zeros of the tangent.
    targets, left, right, shares
        See above.
    is_stiffness
        Mask of the non-zeros of the tangent that are stiffnesses or compliances.
    reduced
        Non-zeros of the tangent that are compliances beside G^T G.
    groups
        Parts and multipliers by number, of each unknown.
    diagonal
        Diagonal entries of the coordinates in the matrix.
    pattern
        Pattern of the matrix in the order of elimination, each multiplier after the coordinates
        that it couples.
    """

    rows: Array
    columns: Array
    targets: Array
    left: Array
    right: Array
    shares: Array
    is_stiffness: Array
    reduced: Array
    groups: Array
    diagonal: Array
    pattern: sp.csc_array

    def largest_stiffness(self, tangent: Array) -> float:
        """Return the largest magnitude of stiffnesses and compliances."""
        return float(np.max(np.abs(tangent[self.is_stiffness]), initial=0.0))


class PivotSigns:
    """Saddle-point matrix of a tangent with the non-zeros `tangent` in natural sizes.

    Attributes
    ----------
    size
        Largest entry of the stiffness, at least `reference`: that at the start, where its terms
        determine rounding errors, since the stiffness may vanish at a critical point.
    is_symmetric
        True if the stiffness is symmetric, so that forces have a potential.
    """

    def __init__(self, plan: SaddlePattern, tangent: Array, reference: float) -> None:
        self._plan, x, count = plan, np.append(tangent, 1.0), plan.pattern.nnz
        self.size = max(plan.largest_stiffness(tangent), reference)
        pairs = np.where(plan.is_stiffness, tangent, 0.0)
        pairs = np.append(pairs, -pairs)
        skew = np.bincount(plan.targets[: len(pairs)], pairs, count)
        asymmetry = np.max(np.abs(skew), initial=0.0)
        self.is_symmetric = bool(asymmetry <= _ASYMMETRY_TOLERANCE * self.size)
        # -C becomes -C / (1 - C).
        x[plan.reduced] /= 1.0 + x[plan.reduced]
        terms = plan.shares * x[plan.left] * x[plan.right]
        self._nonzeros = np.bincount(plan.targets, terms, count)

    def count_negative(self, side: float) -> tuple[int, Determinant]:
        """Return the number of negative pivots, and the determinant.

        The shift is slightly below (`side` 1) or above (-1) zero. The number is -1 if a pivot
        vanishes.
        """
        pattern, nonzeros = self._plan.pattern, self._nonzeros.copy()
        nonzeros[self._plan.diagonal] += side * _SHIFT_RATIO * self.size
        matrix = sp.csc_matrix((nonzeros, pattern.indices, pattern.indptr), pattern.shape)
        options = {"SymmetricMode": True, "Equil": False}
        try:
            factors = splu(matrix, "NATURAL", 0.0, relax=1, panel_size=1, options=options)
        except RuntimeError:
            return -1, Determinant()
        pivots = factors.U.diagonal()
        if not (np.array_equal(factors.perm_r, factors.perm_c) and np.isfinite(pivots).all()):
            return -1, Determinant()
        negative, log_size = int(np.sum(pivots < 0.0)), float(np.sum(np.log(np.abs(pivots))))
        return negative, Determinant((-1) ** negative, log_size)


def scale_by_reference(plan: SaddlePattern, tangent: Array, sizes: Array, rigid: int) -> Array:
    """Return natural sizes (n + m,) for the tangent in the reference configuration, unloaded.

    `tangent` are its non-zeros, `sizes` first sizes of the coordinates, (n,); the first `rigid`
    unknowns have no compliance, that of the others is 1. The final sizes make all parts equally
    stiff: otherwise, rounding errors of large and stiff parts would exceed the stiffness of small
    and soft ones (D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in
    matrices, RAL-TR-2001-034). Parts without stiffness are as stiff as their softest spring or,
    without springs, as what their joints attach them to. By Sylvester's law of inertia, sizes do
    not change the number of negative eigenvalues.
    """
    n, count = len(sizes), len(plan.groups)
    scales = np.append(sizes, np.full(count - n, _FIRST_SIZE))
    values = np.abs(tangent) * scales[plan.rows] * scales[plan.columns]
    values[plan.is_stiffness] *= 0.5
    # Small entries of a block that couples two parts or multipliers may be rounding errors.
    ends = plan.groups[plan.columns] * count + plan.groups[plan.rows]
    blocks, of_entry = np.unique(ends, return_inverse=True)
    columns, rows = np.divmod(blocks, count)
    entries = np.zeros(len(blocks))
    np.maximum.at(entries, of_entry, values)
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
    scales *= factors[plan.groups]
    scales[rigid:] = np.minimum(scales[rigid:], math.sqrt(_MAX_COMPLIANCE))
    return scales


def plan_saddle_point(pattern: sp.csc_array, parts: Array, is_shared: Array) -> SaddlePattern:
    """Return the saddle-point matrix of tangents (n + m, n + m) with a CSC pattern.

    `parts` are the first coordinates of the parts of all coordinates, (n,). Constraints in G^T G,
    (m,), are those that have no stiffness of the same motion beside them.
    """
    rows, size, count = pattern.indices.astype(np.intp), pattern.shape[0], pattern.nnz
    n, columns = len(parts), column_indices(pattern).astype(np.intp)
    is_stiffness = (rows < n) == (columns < n)
    (joints,) = np.nonzero((rows >= n) & (columns < n))
    # Pairs of entries of G in the same row.
    gradients = [joints[rows[joints] == row] for row in n + np.flatnonzero(is_shared)]
    pairs = [np.array(np.meshgrid(x, x)).reshape(2, -1) for x in gradients]
    products = np.concatenate([np.zeros((2, 0), int), *pairs], axis=1)
    i = np.concatenate([rows, columns, columns[products[0]]])
    j = np.concatenate([columns, rows, columns[products[1]]])
    whole = sp.coo_array((np.ones(len(i)), (i, j)), pattern.shape) + sp.eye_array(size)
    position = np.argsort(_elimination_order(sp.csc_array(whole), n, rows[joints], columns[joints]))
    keys, diagonal = position[j] * size + position[i], position[:n] * (size + 1)
    entries = np.unique(np.concatenate([keys, np.arange(size) * (size + 1)]))
    starts = np.searchsorted(entries, np.arange(size + 1) * size)
    numbers, single = np.arange(count), np.full(2 * count, count)
    return SaddlePattern(
        rows=rows,
        columns=columns,
        targets=np.searchsorted(entries, keys),
        left=np.concatenate([numbers, numbers, products[0]]),
        right=np.append(single, products[1]),
        shares=np.append(np.full(2 * count, 0.5), np.ones(products.shape[1])),
        is_stiffness=is_stiffness,
        reduced=np.flatnonzero((rows == columns) & np.append(np.zeros(n, bool), is_shared)[rows]),
        groups=np.append(parts, np.arange(n, size)),
        diagonal=np.searchsorted(entries, diagonal),
        pattern=sp.csc_array((np.ones(len(entries)), entries % size, starts), pattern.shape),
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
