"""Factorization of saddle-point (KKT) matrices."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from beamdae.linear.orderings import invert_to_power_of_two
from beamdae.linear.factorizations import SingularMatrixError, create_factorization

Array = np.ndarray


def factorize_saddle_point(
    block: sp.sparray, reactions: sp.sparray, rows: sp.sparray, compliance: Array | None = None
) -> Callable[[Array], Array] | None:
    """Return a solver for [[block, reactions], [rows, -C]] x = b, or None.

    Parameters
    ----------
    block
        Sparse matrix (n, n), real or complex.
    reactions, rows
        Sparse matrices (n, m) and (m, n); m may be zero.
    compliance
        Diagonal of C, (m,). Defaults to zero.

    Returns
    -------
    Callable or None
        Function from b to x, (n + m,) or (n + m, k). None if the matrix is singular or not finite.
    """
    matrix = block
    if rows.shape[0]:
        is_rigid = compliance is None or not np.any(compliance)
        corner = None if is_rigid else -sp.diags_array(compliance)
        matrix = sp.block_array([[block, reactions], [rows, corner]])
    saddle_point = sp.csc_array(matrix)
    saddle_point.sort_indices()
    # Pivots of rows that are not scaled would come from stiff parts, not from constraints.
    scale = invert_to_power_of_two(abs(saddle_point).max(axis=1).toarray().ravel())
    saddle_point.data *= scale[saddle_point.indices]
    solver = create_factorization(saddle_point, dtype=saddle_point.dtype.type)
    try:
        solver.factorize(saddle_point.data)
    except SingularMatrixError:
        return None

    return lambda right: solver.solve((right.T * scale).T)
