"""Which pivots a matrix is eliminated with, and what its factors hold.

All of this is done once for many matrices of one pattern: `elimination` then works with new numbers
alone. Scaling and pivots are found with one set of numbers; which entries the factors have follows
from the pattern, so that it holds for every other set.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.linear.fill import fill
from beamdae.native.elimination import Plan
from beamdae.symbolic.factorizations import SingularMatrixError
from beamdae.symbolic.orderings import bordered

Array = np.ndarray

# Rows of the border are pivots where those of the band have nothing this times as large.
_BORDER = 2.0**-60
# Pivots of the band are diagonal from this share of the largest on: they keep the band narrow.
_DIAGONAL = 0.1
_LEAST_EXPONENT = -1000


def plans(pattern: sp.csc_array, nonzeros: Array) -> Iterator[Plan]:
    """Pivots that may serve matrices like this one, the best first.

    Parameters
    ----------
    pattern
        Of a square matrix; its numbers do not matter.
    nonzeros
        CSC non-zeros, real or complex.

    Raises
    ------
    SingularMatrixError
        If the matrix has none.
    """
    size = pattern.shape[0]
    if not np.isfinite(nonzeros).all():
        raise SingularMatrixError("the matrix is not finite")
    occupied = np.bincount(pattern.indices, minlength=size)
    if (occupied == 0).any() or (np.diff(pattern.indptr) == 0).any():
        raise SingularMatrixError("the matrix is singular")
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    scale = _row_scale(matrix)
    try:
        for rows, columns in _pivots(matrix, scale):
            yield _plan(pattern, rows, columns, scale)
    except RuntimeError as problem:
        raise SingularMatrixError("the matrix is singular") from problem


def _pivots(matrix: sp.csc_array, scale: Array) -> Iterator[tuple[Array, Array]]:
    """Rows and columns in orders of elimination, the first one the best if it is accurate.

    Rows are scaled to size 1, those of the border (`orderings.bordered`) to far less: so partial
    pivoting stays within the band where there is a pivot, and goes on within the border. The other
    order is SuperLU's, which takes the largest pivots.
    """
    size = matrix.shape[0]
    order, border = bordered(matrix)
    weights = np.where(np.arange(size) < size - border, 1.0, _BORDER)
    yield _superlu(matrix, scale[order] * weights, order, "NATURAL", _DIAGONAL)
    yield _superlu(matrix, scale, np.arange(size), "COLAMD", 1.0)


def _superlu(
    matrix: sp.csc_array, scale: Array, order: Array, method: str, threshold: float
) -> tuple[Array, Array]:
    """Rows and columns as SuperLU orders them, rows and columns being in `order` already.

    Diagonal pivots count as large enough from this share of the largest on.
    """
    ordered = sp.csc_matrix(matrix[order][:, order])
    ordered.data *= scale[ordered.indices]
    found = splu(ordered, method, threshold, relax=1, panel_size=1)
    return order[np.argsort(found.perm_r)], order[np.argsort(found.perm_c)]


def _row_scale(matrix: sp.csc_array) -> Array:
    """Powers of two near to one over the largest size in each row."""
    largest = np.zeros(matrix.shape[0])
    np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
    _, exponent = np.frexp(largest)
    return np.ldexp(1.0, -np.maximum(exponent, _LEAST_EXPONENT))


def _plan(pattern: sp.csc_array, rows: Array, columns: Array, scale: Array) -> Plan:
    size = len(rows)
    position = np.empty(size, int)
    position[rows] = np.arange(size)
    permuted = sp.csc_array(
        (np.arange(pattern.nnz), position[pattern.indices], pattern.indptr), shape=pattern.shape
    )[:, columns]
    upper, lower = fill(permuted.indptr.tolist(), permuted.indices.tolist())
    return Plan(
        _unsigned(rows),
        _unsigned(columns),
        scale[rows],
        _unsigned(permuted.indptr),
        _unsigned(permuted.indices),
        _unsigned(permuted.data),
        *_flat(upper),
        *_flat(lower),
    )


def _flat(columns: list[list[int]]) -> tuple[Array, Array]:
    """Starts of the columns, and their rows one after the other."""
    starts = np.cumsum([0, *map(len, columns)])
    return _unsigned(starts), _unsigned(np.fromiter(chain.from_iterable(columns), int, starts[-1]))


def _unsigned(numbers: Array) -> Array:
    return numbers.astype(np.uint32)
