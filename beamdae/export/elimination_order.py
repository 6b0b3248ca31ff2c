"""Elimination of step matrices with diagonal pivots, for all positions of a mechanism."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from beamdae.linear.elimination import N_EXTRA_ENTRIES, EliminationPlan, empty_plan
from beamdae.linear.factorizations import has_many_couplings, order_along_band
from beamdae.linear.pivots import FixedOrder

Array = np.ndarray


def plan_elimination(
    pattern: sp.csc_array, n: int, first: int = 0, last: int = 0
) -> EliminationPlan:
    """Return the elimination of a matrix of n coordinates, followed by multipliers.

    The next `first` unknowns after the coordinates are eliminated before them, and the last `last`
    unknowns after all others.

    Coordinates are eliminated first: their block, dominated by inertia, has suitable diagonal
    pivots in all positions. The remaining block of the multipliers is then definite if the
    constraints are independent. Pivots chosen for one position would fail in others.
    """
    size = pattern.shape[0]
    ones = sp.csc_array((np.ones(pattern.nnz), pattern.indices, pattern.indptr), pattern.shape)
    symmetric = sp.csr_array(ones + ones.T)
    in_border = has_many_couplings(np.diff(symmetric.indptr)[:n])
    path = order_along_band(symmetric)
    is_coordinate = path < n
    band = np.flatnonzero(~in_border)
    wide = path[is_coordinate]
    is_first, is_last = ~is_coordinate & (path < n + first), path >= size - last
    order = np.concatenate(
        [
            path[is_first],
            band[order_along_band(symmetric[band][:, band])],
            wide[in_border[wide]],
            path[~is_coordinate & ~is_first & ~is_last],
            path[is_last],
        ]
    ).astype(int)
    # Only entries on the diagonal of the multipliers may be missing; a zero is their source.
    count = pattern.nnz + 1
    numbers = sp.csc_array((np.arange(1, count), pattern.indices, pattern.indptr), pattern.shape)
    whole = sp.csc_array(numbers + count * sp.eye_array(size, dtype=int, format="csc"))
    whole.sort_indices()
    plan, pivots = FixedOrder.of(whole, order), order.astype(np.uint32)
    fields = plan._asdict() | {
        "scale": np.ones(size),
        "matrix_starts": pattern.indptr.astype(np.uint32),
        "matrix_rows": pattern.indices.astype(np.uint32),
        "n_entries": pattern.nnz + N_EXTRA_ENTRIES,
        "rows": pivots,
        "columns": pivots,
        "sources": ((whole.data - 1) % count)[plan.sources].astype(np.uint32),
    }
    return empty_plan()._replace(**fields)
