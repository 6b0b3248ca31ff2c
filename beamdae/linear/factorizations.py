"""Factorizations of a matrix with a fixed sparsity pattern."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import get_lapack_funcs
from scipy.sparse.linalg import SuperLU, splu
from threadpoolctl import ThreadpoolController

from beamdae.linear.orderings import bordered

Array = np.ndarray

# LAPACK and SuperLU cross between 150 and 300 unknowns (validation/performance, --linear).
DENSE_LIMIT = 250

# Rows of the border are pivots where those of the band have nothing this times as large.
_BORDER = 2.0**-60
# Diagonal pivots are taken from this share of the largest on: they keep the band narrow.
_DIAGONAL = 0.1
# Backward error of what counts as solved.
_ACCURATE = 1e-10
_MOST_REFINEMENTS = 2
_LEAST_EXPONENT = -1000


class _OneThread(contextlib.ContextDecorator):
    """BLAS on one thread while anybody is inside.

    Matrices of this size gain nothing from threads, and lose a factor of ten where cores are busy.
    Runs in several threads overlap: the last one to leave restores what the first one found.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._limits: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._limits is None:
                _in_a_thread_of_its_own(self._limit)
            self._inside += 1

    def __exit__(self, *problem: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                _in_a_thread_of_its_own(self._restore)

    def _limit(self) -> None:
        self._limits = ThreadpoolController().limit(limits=1, user_api="blas")

    def _restore(self) -> None:
        self._limits.restore_original_limits()
        self._limits = None


def _in_a_thread_of_its_own(do: Callable[[], None]) -> None:
    """Call what changes BLAS: its thread ends, and no interrupt comes in between.

    Threadpoolctl takes changes from one thread only, from the first that makes one until it ends.
    """
    with ThreadPoolExecutor(1) as threads:
        threads.submit(do).result()


single_threaded = _OneThread()


class SingularMatrixError(ArithmeticError):
    """The matrix to be factorized is singular or not finite."""


class Factorization(Protocol):
    """LU factors of the last matrix given, for repeated solution."""

    factorizations: int
    solves: int

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros; raises `SingularMatrixError`."""

    def solve(self, right: Array) -> Array:
        """Solution of matrix @ x = right."""


class DenseFactorization:
    """LAPACK factors of the dense matrix: fastest for small systems."""

    def __init__(self, pattern: sp.csc_array, dtype: type = float) -> None:
        self.factorizations = 0
        self.solves = 0
        rows, columns = pattern.shape
        self._matrix = np.zeros((rows, columns), dtype, order="F")
        self._getrf, self._getrs = get_lapack_funcs(("getrf", "getrs"), (self._matrix,))
        self._flat = self._matrix.reshape(-1, order="F")
        column = np.repeat(np.arange(columns), np.diff(pattern.indptr))
        self._where = column * rows + pattern.indices

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros; raises `SingularMatrixError`."""
        self._flat[:] = 0.0
        self._flat[self._where] = nonzeros
        self.factorizations += 1
        self._lu, self._pivots, info = self._getrf(self._matrix, overwrite_a=True)
        if info != 0 or not np.isfinite(self._flat).all():
            raise SingularMatrixError("the matrix is singular or not finite")

    def solve(self, right: Array) -> Array:
        """Solution of matrix @ x = right."""
        self.solves += 1
        return self._getrs(self._lu, self._pivots, right)[0]


class SparseFactorization:
    """SuperLU factors in an order of our own: cost grows linearly with the number of elements.

    Rows are scaled to size 1, those of the border (`orderings.bordered`) to far less: so partial
    pivoting stays within the band where there is a pivot, and goes on within the border. Left to
    itself it takes pivots from the dense rows of floating frames, and they fill the factors up to
    a hundredfold. What such pivots lack in accuracy is measured by a solution after each
    factorization and made up for by iterative refinement, as with the static pivots of Li & Demmel,
    Proc. SC98 (1998); where that is not enough, SuperLU orders columns and pivots as it likes.

    Attributes
    ----------
    refinements
        Steps of iterative refinement of each solution.
    """

    def __init__(self, pattern: sp.csc_array, dtype: type = float) -> None:
        self.factorizations = 0
        self.solves = 0
        self.refinements = 0
        order, border = bordered(pattern)
        size = len(order)
        number = sp.csc_array(
            (np.arange(pattern.nnz), pattern.indices, pattern.indptr), (size,) * 2
        )
        number = sp.csc_array(number[order][:, order])
        number.sort_indices()
        self._order, self._source, self._rows = order, number.data, number.indices
        self._matrix = sp.csc_matrix(
            (np.zeros(pattern.nnz, dtype), number.indices, number.indptr), (size,) * 2
        )
        self._by_row = np.argsort(self._rows, kind="stable")
        counts = np.bincount(self._rows, minlength=size)
        self._first_of_row = np.cumsum(counts) - counts
        self._has_gaps = bool((counts == 0).any() or (np.diff(number.indptr) == 0).any())
        self._restricted = np.where(np.arange(size) < size - border, 1.0, _BORDER)

    @property
    def fill(self) -> float:
        """Entries of the factors over those of the matrix."""
        return self._lu.nnz / self._matrix.nnz

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros; raises `SingularMatrixError`."""
        self.factorizations += 1
        if not np.isfinite(nonzeros).all():
            raise SingularMatrixError("the matrix is not finite")
        if self._has_gaps:
            raise SingularMatrixError("the matrix is singular")
        matrix = self._matrix
        matrix.data[:] = nonzeros[self._source]
        self._scale = _one_over(matrix.data[self._by_row], self._first_of_row)
        matrix.data *= self._scale[self._rows]
        try:
            self._weights = self._restricted
            restricted = sp.csc_matrix(
                (matrix.data * self._weights[self._rows], matrix.indices, matrix.indptr),
                matrix.shape,
            )
            self._lu = _superlu(restricted, "NATURAL", _DIAGONAL)
            if not self._is_accurate():
                self._weights, self.refinements = np.ones(len(self._order)), 0
                self._lu = _superlu(matrix, "COLAMD", 1.0)
        except RuntimeError as problem:
            raise SingularMatrixError("the matrix is singular") from problem

    def solve(self, right: Array) -> Array:
        """Solution of matrix @ x = right."""
        self.solves += 1
        right = self._scale * right[self._order]
        found = self._lu.solve(self._weights * right)
        for _ in range(self.refinements):
            found += self._lu.solve(self._weights * (right - self._matrix @ found))
        x = np.empty_like(found)
        x[self._order] = found
        return x

    def _is_accurate(self) -> bool:
        """Set how often solutions have to be refined; whether that is seldom enough.

        Measured by the backward error of Oettli & Prager, of an equation relative to its terms, for
        a solution to which all columns contribute alike.
        """
        matrix, sizes = self._matrix, abs(self._matrix)
        exact = _one_over(matrix.data, matrix.indptr[:-1])
        right = matrix @ exact
        found = self._lu.solve(self._weights * right)
        for self.refinements in range(_MOST_REFINEMENTS + 1):
            left = right - matrix @ found
            if np.all(np.abs(left) <= _ACCURATE * (sizes @ np.abs(found) + np.abs(right))):
                return True
            found += self._lu.solve(self._weights * left)
        return False


def _one_over(values: Array, starts: Array) -> Array:
    """Powers of two near to one over the largest size in each of the stretches from `starts` on."""
    _, exponent = np.frexp(np.maximum.reduceat(np.abs(values), starts))
    return np.ldexp(1.0, -np.maximum(exponent, _LEAST_EXPONENT))


def _superlu(matrix: sp.csc_matrix, order: str, threshold: float) -> SuperLU:
    """Factors; diagonal pivots count as large enough from this share of the largest on.

    Supernodes and panels cost ten times what they gain: to SuperLU the dense rows of floating
    frames are one long chain of elimination.
    """
    return splu(matrix, order, threshold, relax=1, panel_size=1)


def factorization(
    pattern: sp.csc_array, method: str = "auto", dtype: type = float
) -> Factorization:
    """Factorization by `method`: "dense", "sparse", or "auto" by the measured crossover.

    `dtype` is float or complex.
    """
    if method == "auto":
        method = "dense" if pattern.shape[0] <= DENSE_LIMIT else "sparse"
    kind = DenseFactorization if method == "dense" else SparseFactorization
    return kind(pattern, dtype)
