"""Which pivots a matrix is eliminated with, and what its factors hold.

All of this is done once for many matrices of one pattern: `elimination` then works with new numbers
alone. Scaling and pivots are found with one set of numbers; which entries the factors have follows
from the pattern, so that it holds for every other set, and for every run that has the same pivots.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.linear.elimination import Plan
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.linear.fill import fill
from beamdae.linear.orderings import bordered

Array = np.ndarray

# Rows of the border are pivots where those of the band have nothing this times as large.
_BORDER = 2.0**-60
# Pivots of the band are diagonal from this share of the largest on: they keep the band narrow.
_DIAGONAL = 0.1
_LEAST_EXPONENT = -1000
# What follows from patterns and pivots is kept for so many of them, of matrices of this size.
_MOST_KEPT = 32
_LARGEST_KEPT = 3000


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
    told = _Told(
        pattern.indptr.astype(np.int64).tobytes(), pattern.indices.astype(np.int64).tobytes()
    )
    scale = _row_scale(pattern, nonzeros)
    try:
        for rows, columns in _pivots(told, nonzeros, scale):
            yield _plan(told, rows, columns, scale)
    except RuntimeError as problem:
        raise SingularMatrixError("the matrix is singular") from problem


class _Told(NamedTuple):
    """A CSC pattern as what tells it from others."""

    starts: bytes
    indices: bytes

    @property
    def size(self) -> int:
        return len(self.starts) // 8 - 1

    def matrix(self, values: Array) -> sp.csc_array:
        starts, indices = (np.frombuffer(x, np.int64) for x in self)
        return sp.csc_array((values, indices, starts), shape=(self.size,) * 2)

    def numbered(self) -> sp.csc_array:
        """The matrix whose entries are where they stand."""
        return self.matrix(np.arange(len(self.indices) // 8))


class _Ordered(NamedTuple):
    """A matrix with rows and columns in another order, and in which sizes its rows are.

    Attributes
    ----------
    order
        Of rows and columns.
    starts, indices, sources
        CSC pattern, and which of the non-zeros its entries are.
    weights
        Of the rows.
    """

    order: Array
    starts: Array
    indices: Array
    sources: Array
    weights: Array


def _ordered(told: _Told) -> _Ordered:
    """The order of `orderings.bordered`, those of the border far smaller than the others."""
    numbered = told.numbered()
    order, border = bordered(numbered)
    found = sp.csc_array(numbered[order][:, order])
    found.sort_indices()
    weights = np.where(np.arange(len(order)) < len(order) - border, 1.0, _BORDER)
    return _Ordered(order, found.indptr, found.indices, found.data, weights)


_kept_ordered = lru_cache(maxsize=_MOST_KEPT)(_ordered)


def _pivots(told: _Told, nonzeros: Array, scale: Array) -> Iterator[tuple[Array, Array]]:
    """Rows and columns in orders of elimination, the first one the best if it is accurate.

    Rows are scaled to size 1, those of the border to far less: so partial pivoting stays within the
    band where there is a pivot, and goes on within the border. The other order is SuperLU's, which
    takes the largest pivots.
    """
    small = told.size <= _LARGEST_KEPT
    yield _superlu(
        (_kept_ordered if small else _ordered)(told), nonzeros, scale, "NATURAL", _DIAGONAL
    )
    every = told.numbered()
    plain = _Ordered(
        np.arange(told.size), every.indptr, every.indices, every.data, np.ones(told.size)
    )
    yield _superlu(plain, nonzeros, scale, "COLAMD", 1.0)


def _superlu(
    at: _Ordered, nonzeros: Array, scale: Array, method: str, threshold: float
) -> tuple[Array, Array]:
    """Rows and columns as SuperLU orders them, after they have been brought into an order.

    Diagonal pivots count as large enough from this share of the largest on.
    """
    weights = scale[at.order] * at.weights
    values = nonzeros[at.sources] * weights[at.indices]
    ordered = sp.csc_matrix((values, at.indices, at.starts), shape=(len(weights),) * 2)
    found = splu(ordered, method, threshold, relax=1, panel_size=1)
    return at.order[np.argsort(found.perm_r)], at.order[np.argsort(found.perm_c)]


def _row_scale(pattern: sp.csc_array, nonzeros: Array) -> Array:
    """Powers of two near to one over the largest size in each row."""
    largest = np.zeros(pattern.shape[0])
    np.maximum.at(largest, pattern.indices, np.abs(nonzeros))
    _, exponent = np.frexp(largest)
    return np.ldexp(1.0, -np.maximum(exponent, _LEAST_EXPONENT))


def _plan(told: _Told, rows: Array, columns: Array, scale: Array) -> Plan:
    small = told.size <= _LARGEST_KEPT
    symbolic = (_kept_plan if small else _symbolic_plan)(told, rows.tobytes(), columns.tobytes())
    return symbolic._replace(scale=scale[rows])


def _symbolic_plan(told: _Told, rows_told: bytes, columns_told: bytes) -> Plan:
    """A plan but for the scale of its rows."""
    rows, columns = (np.frombuffer(x, np.int64) for x in (rows_told, columns_told))
    position = np.empty(len(rows), int)
    position[rows] = np.arange(len(rows))
    numbered = told.numbered()
    permuted = sp.csc_array(
        (numbered.data, position[numbered.indices], numbered.indptr), shape=numbered.shape
    )[:, columns]
    upper, lower = fill(permuted.indptr.tolist(), permuted.indices.tolist())
    return Plan(
        _unsigned(rows),
        _unsigned(columns),
        np.ones(0),
        _unsigned(permuted.indptr),
        _unsigned(permuted.indices),
        _unsigned(permuted.data),
        *_flat(upper),
        *_flat(lower),
    )


_kept_plan = lru_cache(maxsize=_MOST_KEPT)(_symbolic_plan)


def _flat(columns: list[list[int]]) -> tuple[Array, Array]:
    """Starts of the columns, and their rows one after the other."""
    starts = np.cumsum([0, *map(len, columns)])
    return _unsigned(starts), _unsigned(np.fromiter(chain.from_iterable(columns), int, starts[-1]))


def _unsigned(numbers: Array) -> Array:
    return numbers.astype(np.uint32)
