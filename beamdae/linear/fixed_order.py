"""Elimination of sparse matrices in a fixed order, with diagonal pivots.

The order depends on the pattern only, so that no search for pivots is needed, and a symmetric
matrix has as many negative eigenvalues as negative pivots (Sylvester's law of inertia). Solutions
may be inaccurate: the caller refines and checks them. `eliminate` and `substitute` are plain loops
over arrays that numba can compile.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.linear.elimination import eliminate_columns, substitute_triangles
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
    upper, lower, inverse
        Entries of the factors above and below the diagonal, and the reciprocals of the pivots.
    x
        Work array by position.
    smallest_pivot
        Smallest magnitude of a pivot.
    """

    plan: FixedOrder
    upper: Array
    lower: Array
    inverse: Array
    x: Array
    smallest_pivot: float = 0.0

    @classmethod
    def of(cls, plan: FixedOrder) -> FixedOrderFactors:
        """Return the arrays of the factors, filled with zeros."""
        size = len(plan.order)
        upper, lower = np.zeros(len(plan.upper_rows)), np.zeros(len(plan.lower_rows))
        return cls(plan, upper, lower, np.zeros(size), np.zeros(size))


def eliminate(factors: FixedOrderFactors, nonzeros: Array) -> int:
    """Factorize the matrix with these CSC non-zeros.

    Return the number of negative pivots, or -1 if a pivot or its reciprocal is not finite.
    """
    if not eliminate_columns(factors.plan, factors, nonzeros):
        return -1
    count, largest = 0, 0.0
    for inverse in factors.inverse:
        if inverse < 0.0:
            count += 1
        largest = max(largest, abs(inverse))
    factors.smallest_pivot = 1.0 / largest if largest > 0.0 else np.inf
    return count


def substitute(factors: FixedOrderFactors, right: Array) -> None:
    """Replace `right` by the solution, without refinement."""
    plan, order, x = factors.plan, factors.plan.order, factors.x
    for k in range(len(x)):
        x[k] = right[order[k]]
    substitute_triangles(
        plan.lower_starts,
        plan.lower_rows,
        factors.lower,
        plan.upper_starts,
        plan.upper_rows,
        factors.upper,
        factors.inverse,
        x,
    )
    for k in range(len(x)):
        right[order[k]] = x[k]


def count_negative_pivots_by_scipy(plan: FixedOrder, nonzeros: Array) -> tuple[int, float]:
    """Return the result of `eliminate` for a symmetric matrix, by SuperLU, and `smallest_pivot`."""
    size = len(plan.order)
    data = (nonzeros[plan.sources], plan.positions.astype(np.int32), plan.starts.astype(np.int32))
    matrix = sp.csc_matrix(sp.csc_array(data, shape=(size, size)))
    matrix.sort_indices()
    options = {"SymmetricMode": True}
    try:
        factors = splu(matrix, "NATURAL", 0.0, relax=1, panel_size=1, options=options)
    except RuntimeError:
        return -1, 0.0
    if not np.array_equal(factors.perm_r, np.arange(size)):
        return -1, 0.0
    pivots = factors.U.diagonal()
    return int(np.sum(pivots < 0.0)), float(np.min(np.abs(pivots), initial=np.inf))
