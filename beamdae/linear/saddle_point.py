"""Factorization of saddle-point (KKT) matrices."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.sparse as sp

from beamdae.linear.factorizations import SingularMatrixError, create_factorization
from beamdae.linear.orderings import invert_to_power_of_two

Array = np.ndarray


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
