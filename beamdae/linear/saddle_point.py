"""Solutions of saddle point systems, of a few right sides each."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from beamdae.linear.factorizations import SingularMatrixError, create_factorization

Array = np.ndarray


def factorize_saddle_point(
    block: sp.sparray, reactions: sp.sparray, rows: sp.sparray
) -> Callable[[Array], Array] | None:
    """What solves [[block, reactions], [rows, 0]] x = right; None if that is singular."""
    matrix = block
    if rows.shape[0]:
        matrix = sp.block_array([[block, reactions], [rows, None]])
    own = sp.csc_array(matrix)
    own.sort_indices()
    solver = create_factorization(own)
    try:
        solver.factorize(own.data)
    except SingularMatrixError:
        return None
    return solver.solve
