"""Factorization of saddle-point (KKT) matrices, for a few right-hand sides each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from beamdae.linear.factorizations import SingularMatrixError, create_factorization

Array = np.ndarray


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
