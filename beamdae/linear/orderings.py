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
    """Elimination order, the same for equations and unknowns.

    Attributes
    ----------
    order
        Indices of all unknowns, in the order of elimination.
    border
        Number of unknowns at the end of the order that are coupled with many others or have no
        diagonal entry.
    """

    order: Array
    border: int

    @property
    def row_weights(self) -> Array:
        """Weights of the ordered rows: far below 1 in the border, 1 elsewhere."""
        size = len(self.order)
        return np.where(np.arange(size) < size - self.border, 1.0, _BORDER_WEIGHT)


class UnknownKinds(NamedTuple):
    """Masks of unknowns (and of their equations) by their part in the elimination.

    Attributes
    ----------
    is_definition
        Equations that define one unknown by another, such as q' = v.
    in_border
        Unknowns that are coupled with many others or have no diagonal entry.
    """

    is_definition: Array
    in_border: Array


def classify_unknowns(pattern: sp.csc_array) -> UnknownKinds:
    """Return the kinds of the unknowns of a matrix with this pattern."""
    rows = _pattern_rows(pattern)
    is_definition = _find_definitions(rows)
    rest, symmetric = _eliminate_definitions(rows, is_definition)
    in_border = np.zeros(len(is_definition), bool)
    in_border[rest] = _find_border(rows, rest, symmetric)
    return UnknownKinds(is_definition, in_border)


def compute_bordered_ordering(pattern: sp.csc_array) -> Ordering:
    """Order unknowns for elimination: definitions such as q' = v, then a band, then a border.

    The nodes of a beam, in order along the beam, form a band. The floating frame of the beam is
    coupled with all nodes, and multipliers have no diagonal entry: frames and multipliers form the
    border, in their order along the mechanism, because they would fill the band. Band and border
    are ordered by the reverse Cuthill-McKee algorithm, Proc. 24th Nat. Conf. ACM (1969) 157.
    """
    rows = _pattern_rows(pattern)
    is_definition = _find_definitions(rows)
    rest, symmetric = _eliminate_definitions(rows, is_definition)
    in_border = _find_border(rows, rest, symmetric)
    band, path = np.flatnonzero(~in_border), order_along_band(symmetric)
    parts = (
        np.flatnonzero(is_definition),
        rest[band[order_along_band(symmetric[band][:, band])]],
        rest[path[in_border[path]]],
    )
    assert sum(map(len, parts)) == pattern.shape[0]
    return Ordering(np.concatenate(parts), len(parts[-1]))


def _pattern_rows(pattern: sp.csc_array) -> sp.csr_array:
    ones = (np.ones(pattern.nnz), pattern.indices, pattern.indptr)
    return sp.csr_array(sp.csc_array(ones, shape=pattern.shape))


def _find_definitions(rows: sp.csr_array) -> Array:
    return (rows.diagonal() != 0.0) & (np.diff(rows.indptr) <= _MAX_DEFINITION_ENTRIES)


def _eliminate_definitions(rows: sp.csr_array, is_definition: Array) -> tuple[Array, sp.csr_array]:
    """Return the other unknowns, and their symmetric pattern after eliminating the definitions."""
    rest = np.flatnonzero(~is_definition)
    eliminated = rows[rest][:, is_definition] @ rows[is_definition][:, rest]
    remainder = rows[rest][:, rest] + eliminated
    return rest, sp.csr_array(remainder + remainder.T)


def _find_border(rows: sp.csr_array, rest: Array, symmetric: sp.csr_array) -> Array:
    couplings = np.diff(symmetric.indptr)
    in_border = rows.diagonal()[rest] == 0.0
    return in_border | has_many_couplings(couplings)


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
