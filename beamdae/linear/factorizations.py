"""Factorizations of matrices with a fixed sparsity pattern, called from Python."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import get_lapack_funcs

from beamdae.linear.orderings import (
    compute_bordered_ordering,
    factorize_in_order,
    factorize_with_partial_pivoting,
    invert_to_power_of_two,
)

Array = np.ndarray

# Number of unknowns up to which LAPACK is used: it is as fast as SuperLU between 150 and 300
# (measured).
DENSE_LIMIT = 250
# A solution is accurate if its backward error does not exceed this value.
_MAX_BACKWARD_ERROR = 1e-10
# Pivots that require more steps of iterative refinement are rejected.
_MAX_REFINEMENTS = 2


class SingularMatrixError(ArithmeticError):
    """Raised if a matrix to be factorized is singular or not finite."""


class Factorization(Protocol):
    """LU factors of the last matrix, for repeated solution.

    Attributes
    ----------
    factorizations, solves
        Number of calls of `factorize` and of `solve`.
    """

    factorizations: int
    solves: int

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros, or raise `SingularMatrixError`."""

    def solve(self, right: Array) -> Array:
        """Return the solution of matrix @ x = right, (n,) or (n, k)."""


class DenseFactorization:
    """LAPACK factors of a dense matrix, the fastest method for small systems."""

    def __init__(self, pattern: sp.csc_array, dtype: type = float) -> None:
        self.factorizations = 0
        self.solves = 0
        rows, columns = pattern.shape
        self._matrix = np.zeros((rows, columns), dtype, order="F")
        self._getrf, self._getrs = get_lapack_funcs(("getrf", "getrs"), (self._matrix,))
        self._flat = self._matrix.reshape(-1, order="F")
        column = np.repeat(np.arange(columns), np.diff(pattern.indptr))
        self._positions = column * rows + pattern.indices

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros, or raise `SingularMatrixError`."""
        self._flat[:] = 0.0
        self._flat[self._positions] = nonzeros
        self.factorizations += 1
        self._lu, self._pivots, info = self._getrf(self._matrix, overwrite_a=True)
        if info != 0 or not np.isfinite(self._flat).all():
            raise SingularMatrixError("the matrix is singular or not finite")

    def solve(self, right: Array) -> Array:
        """Return the solution of matrix @ x = right, (n,) or (n, k)."""
        self.solves += 1
        return self._getrs(self._lu, self._pivots, right)[0]


class SparseFactorization:
    """SuperLU factors in a bordered ordering; the cost is linear in the number of beam elements.

    Rows of the band are scaled to a largest entry near 1, rows of the border
    (`orderings.compute_bordered_ordering`) to far less. SuperLU therefore chooses pivots from the
    border only if the band has none. Without this scaling, it takes pivots from the dense rows of
    floating frames, which may increase the number of entries of the factors a hundredfold. A test
    solution after each factorization measures the accuracy lost by this choice of pivots, and
    iterative refinement restores it, as with the static pivots of Li & Demmel, Proc. SC98 (1998).
    If refinement does not suffice, SuperLU chooses the column order and the pivots.

    Attributes
    ----------
    refinements
        Number of steps of iterative refinement per solution.
    """

    def __init__(self, pattern: sp.csc_array, dtype: type = float) -> None:
        self.factorizations = 0
        self.solves = 0
        self.refinements = 0
        ordering = compute_bordered_ordering(pattern)
        order, size = ordering.order, len(ordering.order)
        entry_numbers = sp.csc_array(
            (np.arange(pattern.nnz), pattern.indices, pattern.indptr), (size, size)
        )
        entry_numbers = sp.csc_array(entry_numbers[order][:, order])
        entry_numbers.sort_indices()
        self._order, self._source, self._rows = order, entry_numbers.data, entry_numbers.indices
        self._matrix = sp.csc_matrix(
            (np.zeros(pattern.nnz, dtype), entry_numbers.indices, entry_numbers.indptr),
            (size, size),
        )
        self._by_row = np.argsort(self._rows, kind="stable")
        row_counts = np.bincount(self._rows, minlength=size)
        self._row_starts = np.cumsum(row_counts) - row_counts
        has_empty_row = (row_counts == 0).any()
        has_empty_column = (np.diff(entry_numbers.indptr) == 0).any()
        self._is_structurally_singular = bool(has_empty_row or has_empty_column)
        self._band_weights = ordering.row_weights

    @property
    def fill(self) -> float:
        """Number of entries of the factors, relative to the number of entries of the matrix."""
        return self._lu.nnz / self._matrix.nnz

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros, or raise `SingularMatrixError`."""
        self.factorizations += 1
        if not np.isfinite(nonzeros).all():
            raise SingularMatrixError("the matrix is not finite")
        if self._is_structurally_singular:
            raise SingularMatrixError("the matrix is singular")
        matrix = self._matrix
        matrix.data[:] = nonzeros[self._source]
        self._scale = _invert_largest(matrix.data[self._by_row], self._row_starts)
        matrix.data *= self._scale[self._rows]
        self._weights = self._band_weights
        data = matrix.data * self._weights[self._rows]
        weighted = sp.csc_matrix((data, matrix.indices, matrix.indptr), matrix.shape)
        try:
            self._lu = factorize_in_order(weighted)
            is_accurate = self._set_refinements()
        except RuntimeError:
            is_accurate = False
        if is_accurate:
            return
        self._weights, self.refinements = np.ones(len(self._order)), 0
        try:
            self._lu = factorize_with_partial_pivoting(matrix)
        except RuntimeError as problem:
            raise SingularMatrixError("the matrix is singular") from problem

    def solve(self, right: Array) -> Array:
        """Return the solution of matrix @ x = right, (n,) or (n, k)."""
        self.solves += 1
        shape = (-1,) + (1,) * (right.ndim - 1)
        scale, weights = self._scale.reshape(shape), self._weights.reshape(shape)
        right = scale * right[self._order]
        solution = self._lu.solve(weights * right)
        for _ in range(self.refinements):
            solution += self._lu.solve(weights * (right - self._matrix @ solution))
        x = np.empty_like(solution)
        x[self._order] = solution
        return x

    def _set_refinements(self) -> bool:
        """Set the number of refinements; return False if `_MAX_REFINEMENTS` are not enough.

        The measure is the backward error of Oettli & Prager, relative to the terms of each
        equation, for a solution to which all columns contribute equally.
        """
        matrix, magnitudes = self._matrix, abs(self._matrix)
        exact = _invert_largest(matrix.data, matrix.indptr[:-1])
        right = matrix @ exact
        solution = self._lu.solve(self._weights * right)
        for self.refinements in range(_MAX_REFINEMENTS + 1):
            residual = right - matrix @ solution
            terms = magnitudes @ np.abs(solution) + np.abs(right)
            if np.all(np.abs(residual) <= _MAX_BACKWARD_ERROR * terms):
                return True
            solution += self._lu.solve(self._weights * residual)
        return False


def _invert_largest(values: Array, starts: Array) -> Array:
    """Return a power of two close to 1 / (largest magnitude) for each range of `values`.

    The ranges begin at `starts`.
    """
    return invert_to_power_of_two(np.maximum.reduceat(np.abs(values), starts))


def create_factorization(pattern: sp.csc_array, dtype: type = float) -> Factorization:
    """Return a `Factorization` for float or complex matrices with this CSC pattern, without values.

    It is dense up to `DENSE_LIMIT` unknowns.
    """
    is_small = pattern.shape[0] <= DENSE_LIMIT
    return (DenseFactorization if is_small else SparseFactorization)(pattern, dtype)
