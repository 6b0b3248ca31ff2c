"""Elimination of sparse symmetric matrices in a fixed order, with diagonal pivots.

The order depends on the pattern only, so that no search for pivots is needed, and the matrix has as
many negative eigenvalues as negative pivots (Sylvester's law of inertia). The core
eliminates: `linear.c`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.linear.pivots import compute_fill, flatten_columns

Array = np.ndarray


class FixedOrder(NamedTuple):
    """Pattern of the matrix and of its factors; a position is an index in the order of elimination.

    Attributes
    ----------
    starts, positions, sources
        Columns of the matrix, by position: their starts, the positions of their rows, and the
        indices of their CSC non-zeros.
    upper_starts, upper_rows, lower_starts, lower_rows
        Columns of the factors above and below the diagonal: their starts, and the positions of
        their rows, ascending.
    """

    starts: Array
    positions: Array
    sources: Array
    upper_starts: Array
    upper_rows: Array
    lower_starts: Array
    lower_rows: Array

    @classmethod
    def of(cls, pattern: sp.csc_array, order: Array) -> FixedOrder:
        """Return the elimination of matrices with this CSC pattern, which includes the diagonal."""
        position = np.empty(len(order), int)
        position[order] = np.arange(len(order))
        numbers = (np.arange(pattern.nnz), position[pattern.indices], pattern.indptr)
        permuted = sp.csc_array(numbers, shape=pattern.shape)[:, order]
        upper, lower = compute_fill(permuted.indptr.tolist(), permuted.indices.tolist())
        arrays = (permuted.indptr, permuted.indices, permuted.data)
        flat = (*flatten_columns(upper), *flatten_columns(lower))
        return cls(*(np.asarray(x).astype(np.uint32) for x in (*arrays, *flat)))
