"""Elimination of sparse symmetric matrices in a fixed order, with diagonal pivots.

The order depends on the pattern only, so that no search for pivots is needed, and the matrix has as
many negative eigenvalues as negative pivots (Sylvester's law of inertia). `eliminate` is a plain
loop over arrays that numba can compile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.linear.pivots import compute_fill, flatten_columns

Array = np.ndarray


class FixedOrder(NamedTuple):
    """Order of elimination and pattern of the factors; a position is an index in the order.

    Attributes
    ----------
    order
        Indices of the unknowns, and of their equations, by position.
    starts, positions, sources
        Columns of the matrix, by position: their starts, the positions of their rows, and the
        indices of their CSC non-zeros.
    upper_starts, upper_rows, lower_starts, lower_rows
        Columns of the factors above and below the diagonal: their starts, and the positions of
        their rows, ascending.
    """

    order: Array
    starts: Array
    positions: Array
    sources: Array
    upper_starts: Array
    upper_rows: Array
    lower_starts: Array
    lower_rows: Array

    @classmethod
    def of(cls, pattern: sp.csc_array, order: Array) -> FixedOrder:
        """Return the elimination of matrices with this CSC pattern, which includes the diagonal."""
        position = np.empty(len(order), int)
        position[order] = np.arange(len(order))
        numbers = (np.arange(pattern.nnz), position[pattern.indices], pattern.indptr)
        permuted = sp.csc_array(numbers, shape=pattern.shape)[:, order]
        upper, lower = compute_fill(permuted.indptr.tolist(), permuted.indices.tolist())
        arrays = (order, permuted.indptr, permuted.indices, permuted.data)
        flat = (*flatten_columns(upper), *flatten_columns(lower))
        return cls(*(np.asarray(x).astype(np.uint32) for x in (*arrays, *flat)))


@dataclass(slots=True)
class FixedOrderFactors:
    """Factors of the last matrix.

    Attributes
    ----------
    plan
        Order and pattern.
    lower, pivots
        Entries of the unit factor below the diagonal, and the pivots.
    first
        First entry of each column of `lower` that has not been used yet.
    x
        Work array by position.
    smallest_pivot
        Smallest magnitude of a pivot.
    """

    plan: FixedOrder
    lower: Array
    pivots: Array
    first: Array
    x: Array
    smallest_pivot: float = 0.0

    @classmethod
    def of(cls, plan: FixedOrder) -> FixedOrderFactors:
        """Return the arrays of the factors, filled with zeros."""
        pivots, x = np.zeros((2, len(plan.order)))
        return cls(plan, np.zeros(len(plan.lower_rows)), pivots, plan.lower_starts.copy(), x)


def eliminate(run: FixedOrderFactors, nonzeros: Array) -> int:
    """Factorize the symmetric matrix with these CSC non-zeros, of which those below count.

    Return the number of negative pivots, or -1 if a pivot or its reciprocal is not finite.
    """
    plan, lower, pivots, first, x = run.plan, run.lower, run.pivots, run.first, run.x
    starts, positions, sources = plan.starts, plan.positions, plan.sources
    upper_starts, upper_rows = plan.upper_starts, plan.upper_rows
    lower_starts, lower_rows = plan.lower_starts, plan.lower_rows
    count, run.smallest_pivot = 0, np.inf
    for j in range(len(x)):
        x[j] = 0.0
    for j in range(len(x)):
        for e in range(starts[j], starts[j + 1]):
            x[positions[e]] = nonzeros[sources[e]]
        for p in range(upper_starts[j], upper_starts[j + 1]):
            k = upper_rows[p]
            x[k] = 0.0
            # The rows of each column ascend, so that its first unused entry is in row j.
            factor = lower[first[k]] * pivots[k]
            for q in range(first[k], lower_starts[k + 1]):
                x[lower_rows[q]] -= lower[q] * factor
            first[k] += 1
        pivot = x[j]
        if pivot == 0.0 or not (np.isfinite(pivot) and np.isfinite(1.0 / pivot)):
            return -1
        pivots[j], first[j], x[j] = pivot, lower_starts[j], 0.0
        count += pivot < 0.0
        run.smallest_pivot = min(run.smallest_pivot, abs(pivot))
        for q in range(lower_starts[j], lower_starts[j + 1]):
            row = lower_rows[q]
            lower[q] = x[row] / pivot
            x[row] = 0.0
    return count


def eliminate_by_scipy(run: FixedOrderFactors, nonzeros: Array) -> int:
    """Perform `eliminate` by SuperLU; only `pivots` and `smallest_pivot` are set."""
    plan, run.smallest_pivot = run.plan, 0.0
    size = len(plan.order)
    data = (nonzeros[plan.sources], plan.positions.astype(np.int32), plan.starts.astype(np.int32))
    lower = sp.tril(sp.csc_array(data, shape=(size, size)))
    matrix = sp.csc_matrix(lower + sp.tril(lower, -1).T)
    matrix.sort_indices()
    options = {"SymmetricMode": True}
    try:
        factors = splu(matrix, "NATURAL", 0.0, relax=1, panel_size=1, options=options)
    except RuntimeError:
        return -1
    if not np.array_equal(factors.perm_r, np.arange(size)):
        return -1
    run.pivots[:] = factors.U.diagonal()
    run.smallest_pivot = float(np.min(np.abs(run.pivots), initial=np.inf))
    return int(np.sum(run.pivots < 0.0))
