"""Factorizations of a matrix with a fixed sparsity pattern."""

from __future__ import annotations

import contextlib
import threading
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import get_lapack_funcs
from scipy.sparse.linalg import splu
from threadpoolctl import threadpool_limits

Array = np.ndarray

# LAPACK and SuperLU cross between 150 and 300 unknowns (validation/performance, --linear).
DENSE_LIMIT = 250


class _OneThread(contextlib.ContextDecorator):
    """BLAS on one thread while anybody is inside.

    Matrices of this size gain nothing from threads, and lose a factor of ten where cores are busy.
    Runs in several threads overlap: the last one to leave restores what the first one found.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._inside = 0
        self._limits: threadpool_limits | None = None

    def __enter__(self) -> None:
        with self._lock:
            if self._inside == 0:
                self._limits = threadpool_limits(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(self, *problem: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0 and self._limits is not None:
                self._limits.restore_original_limits()


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
    """SuperLU factors: cost grows linearly with the number of elements."""

    def __init__(self, pattern: sp.csc_array, dtype: type = float) -> None:
        self.factorizations = 0
        self.solves = 0
        self._matrix = sp.csc_matrix(pattern, dtype=dtype, copy=True)

    def factorize(self, nonzeros: Array) -> None:
        """Factorize the matrix with these CSC non-zeros; raises `SingularMatrixError`."""
        self._matrix.data[:] = nonzeros
        self.factorizations += 1
        if not np.isfinite(nonzeros).all():
            raise SingularMatrixError("the matrix is not finite")
        try:
            # The dense rows of floating frames make SuperLU see one long elimination chain:
            # supernodes and panels cost ten times what they gain, and pivots off the diagonal
            # that are only a little larger fill the factors a hundredfold.
            self._lu = splu(self._matrix, relax=1, panel_size=1, diag_pivot_thresh=0.01)
        except RuntimeError as problem:
            raise SingularMatrixError("the matrix is singular") from problem

    def solve(self, right: Array) -> Array:
        """Solution of matrix @ x = right."""
        self.solves += 1
        return self._lu.solve(right)


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
