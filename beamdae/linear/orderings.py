"""In what order to eliminate the unknowns of a sparse matrix, from its pattern alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee

Array = np.ndarray

# Rows of at most so many entries say what one unknown is by another, such as q' = v.
_DEFINITION = 2
# Unknowns coupled with more than so many times as many as half of them are, such as the floating
# frame of a beam with all of its nodes, fill the factors if they do not come last.
_MANY = 2.0


class Elimination(NamedTuple):
    """An order of elimination: equations and unknowns alike.

    Attributes
    ----------
    order
        All of them, from the first to the last.
    border
        How many at its end are coupled with many others, or have no diagonal entry of their own.
    """

    order: Array
    border: int


def bordered(pattern: sp.csc_array) -> Elimination:
    """A band with a border: definitions first, then a band, then what would fill it.

    The nodes of a beam, in order along it, make a band; its floating frame is coupled with all of
    them; multipliers have no entry on the diagonal. Both make the border, in the order in which
    they are met along the mechanism. Bands and the paths along the mechanism are those of Cuthill
    & McKee, Proc. 24th Nat. Conf. ACM (1969) 157, reversed.
    """
    size = pattern.shape[0]
    ones = (np.ones(pattern.nnz), pattern.indices, pattern.indptr)
    rows = sp.csr_array(sp.csc_array(ones, shape=pattern.shape))
    diagonal = rows.diagonal() != 0.0
    defined = diagonal & (np.diff(rows.indptr) <= _DEFINITION)
    rest = np.flatnonzero(~defined)
    # As it is once the definitions are eliminated: what is defined stands for what defines it.
    left = rows[rest][:, rest] + rows[rest][:, defined] @ rows[defined][:, rest]
    coupled = sp.csr_array(left + left.T)
    couplings = np.diff(coupled.indptr)
    last = ~diagonal[rest]
    if len(rest):
        last |= couplings > _MANY * np.median(couplings)
    band, along = np.flatnonzero(~last), _path(coupled)
    order = (
        np.flatnonzero(defined),
        rest[band[_path(coupled[band][:, band])]],
        rest[along[last[along]]],
    )
    assert sum(map(len, order)) == size
    return Elimination(np.concatenate(order), len(order[-1]))


def _path(symmetric: sp.csr_array) -> Array:
    if symmetric.shape[0] == 0:
        return np.zeros(0, int)
    return reverse_cuthill_mckee(sp.csr_matrix(symmetric), symmetric_mode=True)
