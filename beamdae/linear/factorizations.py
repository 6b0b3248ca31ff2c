"""Sparse factorizations, their orderings, and factors of saddle-point matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.linalg import get_lapack_funcs
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import SuperLU, splu

Array = np.ndarray

# Rows with at most this many entries define one unknown by another, such as q' = v.
_MAX_DEFINITION_ENTRIES = 2
# Unknowns with more couplings than this many times the usual number, such as the floating frame of
# a beam (coupled with all its nodes), fill the factors unless they are eliminated last.
_MAX_RELATIVE_COUPLINGS = 2.0
# Share of the unknowns with at most as many couplings as is usual: multipliers have few.
_USUAL_SHARE = 0.75
# Relative size of the rows of the border, so small that they provide pivots only if the band has
# none.
_BORDER_WEIGHT = 2.0**-60
# Diagonal entries of at least this fraction of the largest entry of their column become pivots,
# which keeps the band narrow.
_DIAGONAL_THRESHOLD = 0.1
# Threshold at which the largest entry of a column is the pivot.
_PARTIAL_PIVOTING = 1.0
# Smaller exponents of two of the sizes are replaced by this value, so that scales stay finite.
_MIN_EXPONENT = -1000


class Ordering(NamedTuple):
    """Elimination order, the same for equations and unknowns, and the kinds of unknowns.

    Attributes
    ----------
    order
        Indices of all unknowns, in the order of elimination.
    is_definition
        Mask of the equations that define one unknown by another, such as q' = v.
    in_border
        Mask of the unknowns at the end of the order, which are coupled with many others or have no
        diagonal entry.
    """

    order: Array
    is_definition: Array
    in_border: Array

    @property
    def row_weights(self) -> Array:
        """Weights of the ordered rows: far below 1 in the border, 1 elsewhere."""
        return np.where(self.in_border[self.order], _BORDER_WEIGHT, 1.0)


def compute_bordered_ordering(pattern: sp.csc_array) -> Ordering:
    """Order unknowns for elimination: definitions such as q' = v, then a band, then a border.

    The nodes of a beam, in order along the beam, form a band. The floating frame of the beam is
    coupled with all nodes, and multipliers have no diagonal entry: frames and multipliers form the
    border, in their order along the mechanism, because they would fill the band. Band and border
    are ordered by the reverse Cuthill-McKee algorithm, Proc. 24th Nat. Conf. ACM (1969) 157.
    """
    ones = (np.ones(pattern.nnz), pattern.indices, pattern.indptr)
    rows = sp.csr_array(sp.csc_array(ones, shape=pattern.shape))
    has_diagonal = rows.diagonal() != 0.0
    is_definition = has_diagonal & (np.diff(rows.indptr) <= _MAX_DEFINITION_ENTRIES)
    rest = np.flatnonzero(~is_definition)
    # The other unknowns after the elimination of the definitions.
    remainder = rows[rest][:, rest] + rows[rest][:, is_definition] @ rows[is_definition][:, rest]
    symmetric = sp.csr_array(remainder + remainder.T)
    is_last = ~has_diagonal[rest] | has_many_couplings(np.diff(symmetric.indptr))
    band, path = np.flatnonzero(~is_last), order_along_band(symmetric)
    parts = (
        np.flatnonzero(is_definition),
        rest[band[order_along_band(symmetric[band][:, band])]],
        rest[path[is_last[path]]],
    )
    in_border = np.zeros(len(is_definition), bool)
    in_border[rest] = is_last
    return Ordering(np.concatenate(parts), is_definition, in_border)


def has_many_couplings(couplings: Array) -> Array:
    """Return the mask of unknowns with more couplings than is usual, given their numbers."""
    if not len(couplings):
        return np.zeros(0, bool)
    return couplings > _MAX_RELATIVE_COUPLINGS * np.quantile(couplings, _USUAL_SHARE)


def order_along_band(symmetric: sp.csr_array) -> Array:
    """Return the unknowns of a symmetric pattern in the reverse Cuthill-McKee order."""
    if symmetric.shape[0] == 0:
        return np.zeros(0, int)
    return np.asarray(reverse_cuthill_mckee(sp.csr_matrix(symmetric), symmetric_mode=True), int)


def invert_to_power_of_two(sizes: Array) -> Array:
    """Return powers of two close to 1 / `sizes`, at most 2^1000; 1 for zeros.

    Scaling by powers of two causes no rounding errors.
    """
    _, exponent = np.frexp(sizes)
    return np.ldexp(1.0, -np.maximum(exponent, _MIN_EXPONENT))


def factorize_in_order(matrix: sp.csc_matrix) -> SuperLU:
    """Factorize a matrix in the order of its columns, with diagonal pivots where large enough."""
    return _factorize(matrix, "NATURAL", _DIAGONAL_THRESHOLD)


def factorize_with_partial_pivoting(matrix: sp.csc_matrix) -> SuperLU:
    """Factorize a matrix with SuperLU's column order and partial pivoting."""
    return _factorize(matrix, "COLAMD", _PARTIAL_PIVOTING)


def _factorize(matrix: sp.csc_matrix, order: str, threshold: float) -> SuperLU:
    # No supernodes or panels, which cost ten times what they save: SuperLU treats the dense rows of
    # floating frames as one long chain in the elimination tree.
    return splu(matrix, order, threshold, relax=1, panel_size=1)


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
    (`compute_bordered_ordering`) to far less. SuperLU therefore chooses pivots from the
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


class SaddlePencil:
    """Square matrix A0 + s A1 + s^2 A2 ... of blocks, which is factorized at several shifts s.

    Parameters
    ----------
    size
        Number of rows.
    blocks
        (power of s, first row, first column, sparse matrix), real or complex.

    Attributes
    ----------
    matrices
        Coefficients A0, A1 ..., sparse (size, size) with equal patterns.
    """

    def __init__(self, size: int, blocks: Sequence[tuple[int, int, int, sp.sparray]]) -> None:
        pieces = [(power, i, j, x.tocoo()) for power, i, j, x in blocks]
        powers = np.repeat([power for power, *_ in pieces], [x.nnz for *_, x in pieces])
        data = np.concatenate([x.data for *_, x in pieces])
        rows = np.concatenate([x.row + i for _, i, _, x in pieces])
        columns = np.concatenate([x.col + j for *_, j, x in pieces])
        self.matrices = [
            sp.coo_array((data * (powers == k), (rows, columns)), (size, size)).tocsc()
            for k in range(max(power for power, *_ in pieces) + 1)
        ]
        first = self.matrices[0]
        self._rows, self._size = first.indices, size
        self._factorization = create_factorization(first, dtype=first.dtype.type)

    def factorize(self, s: float = 0.0) -> Callable[[Array], Array] | None:
        """Return a solver of matrix @ x = b, (n,) or (n, k), until the next call.

        None if the matrix is singular or not finite.
        """
        data = sum(s**k * x.data for k, x in enumerate(self.matrices))
        # Pivots of rows that are not scaled would come from stiff parts, not from constraints.
        sizes = np.zeros(self._size)
        np.maximum.at(sizes, self._rows, np.abs(data))
        scale = invert_to_power_of_two(sizes)
        try:
            self._factorization.factorize(data * scale[self._rows])
        except SingularMatrixError:
            return None
        return lambda right: self._factorization.solve((right.T * scale).T)


def factorize_saddle_point(
    block: sp.sparray, reactions: sp.sparray, rows: sp.sparray
) -> Callable[[Array], Array] | None:
    """Return a solver for [[block, reactions], [rows, 0]] x = b, or None.

    Parameters
    ----------
    block
        Sparse matrix (n, n), real or complex.
    reactions, rows
        Sparse matrices (n, m) and (m, n); m may be zero.

    Returns
    -------
    Callable or None
        Function from b, (n + m,), to x, (n + m,). None if the matrix is singular or not finite.
    """
    # Rows of beams without resultants are not scaled: their stiff parts are better pivots.
    matrix = block
    if rows.shape[0]:
        matrix = sp.block_array([[block, reactions], [rows, None]])
    saddle_point = sp.csc_array(matrix)
    saddle_point.sort_indices()
    solver = create_factorization(saddle_point, dtype=saddle_point.dtype.type)
    try:
        solver.factorize(saddle_point.data)
    except SingularMatrixError:
        return None
    return solver.solve
