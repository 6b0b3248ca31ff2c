"""Elimination orders of sparse matrices, row scaling, and the SuperLU call that uses them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import SuperLU, splu

Array = np.ndarray

# Rows with at most this many entries define one unknown by another, such as q' = v.
_MAX_DEFINITION_ENTRIES = 2
# Unknowns with more couplings than this many times the median, such as the floating frame of a beam
# (coupled with all its nodes), fill the factors unless they are eliminated last.
_MAX_RELATIVE_COUPLINGS = 2.0
# Relative size of the rows of the border: they become pivots only where the rows of the band have
# nothing larger.
_BORDER_WEIGHT = 2.0**-60
# Diagonal entries of at least this fraction of the largest one are pivots: this keeps the band
# narrow.
_DIAGONAL_THRESHOLD = 0.1
# Threshold at which the largest entry of a column is the pivot.
_PARTIAL_PIVOTING = 1.0
# Exponent of two below which a row counts as zero; its scale stays finite.
_MIN_EXPONENT = -1000


class Ordering(NamedTuple):
    """Order of elimination, the same for equations and unknowns.

    Attributes
    ----------
    order
        Indices of all unknowns, the first one eliminated first.
    border
        Number of unknowns at the end that are coupled with many others or have no diagonal entry.
    """

    order: Array
    border: int

    @property
    def row_weights(self) -> Array:
        """Sizes to which the rows are scaled, in this order: 1, far less in the border."""
        size = len(self.order)
        return np.where(np.arange(size) < size - self.border, 1.0, _BORDER_WEIGHT)


def compute_bordered_ordering(pattern: sp.csc_array) -> Ordering:
    """Order unknowns as a band with a border: definitions, the band, then whatever would fill it.

    The nodes of a beam, in order along it, form a band. Its floating frame is coupled with all of
    them, and multipliers have no diagonal entry: both form the border, in the order in which they
    are met along the mechanism. Bands and paths are those of Cuthill & McKee, Proc. 24th Nat.
    Conf. ACM (1969) 157, reversed.
    """
    size = pattern.shape[0]
    ones = (np.ones(pattern.nnz), pattern.indices, pattern.indptr)
    rows = sp.csr_array(sp.csc_array(ones, shape=pattern.shape))
    has_diagonal = rows.diagonal() != 0.0
    is_definition = has_diagonal & (np.diff(rows.indptr) <= _MAX_DEFINITION_ENTRIES)
    rest = np.flatnonzero(~is_definition)
    # Pattern after elimination of the definitions.
    eliminated = rows[rest][:, is_definition] @ rows[is_definition][:, rest]
    remainder = rows[rest][:, rest] + eliminated
    symmetric = sp.csr_array(remainder + remainder.T)
    couplings = np.diff(symmetric.indptr)
    in_border = ~has_diagonal[rest]
    if len(rest):
        in_border |= couplings > _MAX_RELATIVE_COUPLINGS * np.median(couplings)
    band, path = np.flatnonzero(~in_border), _compute_path(symmetric)
    parts = (
        np.flatnonzero(is_definition),
        rest[band[_compute_path(symmetric[band][:, band])]],
        rest[path[in_border[path]]],
    )
    assert sum(map(len, parts)) == size
    return Ordering(np.concatenate(parts), len(parts[-1]))


def _compute_path(symmetric: sp.csr_array) -> Array:
    if symmetric.shape[0] == 0:
        return np.zeros(0, int)
    return reverse_cuthill_mckee(sp.csr_matrix(symmetric), symmetric_mode=True)


def invert_to_power_of_two(sizes: Array) -> Array:
    """Return powers of two close to 1 / sizes: scaling by them is exact."""
    _, exponent = np.frexp(sizes)
    return np.ldexp(1.0, -np.maximum(exponent, _MIN_EXPONENT))


def factorize_in_order(matrix: sp.csc_matrix) -> SuperLU:
    """Factorize a matrix in the order it has, with diagonal pivots unless they are small."""
    return _factorize(matrix, "NATURAL", _DIAGONAL_THRESHOLD)


def factorize_with_partial_pivoting(matrix: sp.csc_matrix) -> SuperLU:
    """Factorize a matrix with SuperLU's column order and the largest pivots."""
    return _factorize(matrix, "COLAMD", _PARTIAL_PIVOTING)


def _factorize(matrix: sp.csc_matrix, order: str, threshold: float) -> SuperLU:
    # Supernodes and panels cost ten times what they gain: to SuperLU the dense rows of floating
    # frames are one long chain of elimination.
    return splu(matrix, order, threshold, relax=1, panel_size=1)
