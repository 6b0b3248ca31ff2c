"""Operations on constant sparse operators."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
import scipy.sparse as sp

_EMPTY = sp.csr_array((0, 0))
_MAX_INDEX = np.iinfo(np.int32).max


def assemble_csr(
    data: np.ndarray, indices: np.ndarray, indptr: np.ndarray, shape: tuple[int, int]
) -> sp.csr_array:
    """Return a sparse matrix of valid arrays, as `sp.csr_array`, in a fifth of its time.

    The arrays are not checked; indices become 32-bit integers if they fit.
    """
    kind = np.int32 if max(*shape, len(data)) <= _MAX_INDEX else np.int64
    matrix = copy(_EMPTY)
    matrix._shape = shape
    matrix.data = data
    matrix.indices = indices.astype(kind, copy=False)
    matrix.indptr = indptr.astype(kind, copy=False)
    return matrix


def _count(starts: np.ndarray) -> np.ndarray:
    """Return the number of entries of each row or column, from the index pointers."""
    # In 32 bits, np.repeat rejects counts of 64 bits, which index pointers may have.
    return np.diff(starts).astype(np.intp)


def _expand(starts: np.ndarray) -> np.ndarray:
    """Return the number of the row or column of each entry, from the index pointers."""
    return np.repeat(np.arange(len(starts) - 1), _count(starts))


def column_indices(pattern: sp.csc_array) -> np.ndarray:
    """Return the column of each entry of a CSC matrix; `pattern.indices` are the rows."""
    return _expand(pattern.indptr)


def row_indices(operator: sp.csr_array) -> np.ndarray:
    """Return the row of each entry of a CSR matrix; `operator.indices` are the columns."""
    return _expand(operator.indptr)


def build_selection(indices: Sequence[int] | np.ndarray, size: int) -> sp.csr_array:
    """Return the operator that selects the entries `indices` of a vector with `size` entries."""
    count = len(indices)
    rows = np.asarray(indices, int)
    return assemble_csr(np.ones(count), rows, np.arange(count + 1), (count, size))


def stack_rows(operators: Sequence[sp.csr_array]) -> sp.csr_array:
    """Return the operators one below the other, as `sp.vstack`, in a quarter of its time."""
    data = np.concatenate([x.data for x in operators])
    indices = np.concatenate([x.indices for x in operators])
    counts = np.concatenate([x.indptr[1:] - x.indptr[:-1] for x in operators])
    shape = (len(counts), operators[0].shape[1])
    return assemble_csr(data, indices, np.append(0, np.cumsum(counts)), shape)


def select_rows(operator: sp.csr_array, rows: np.ndarray) -> sp.csr_array:
    """Return operator[rows]; four times as fast as indexing for few rows."""
    starts, counts = operator.indptr[rows], _count(operator.indptr)[rows]
    ends = np.cumsum(counts)
    indptr = np.concatenate([np.zeros(1, operator.indptr.dtype), ends])
    entries = np.arange(indptr[-1]) + np.repeat(starts - ends + counts, counts)
    parts = (operator.data[entries], operator.indices[entries], indptr)
    return sp.csr_array(parts, shape=(len(rows), operator.shape[1]))


def pair_entries(
    left: sp.csr_array, row: np.ndarray, right: sp.csr_array, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return all pairs of non-zeros in rows row[k] of `left` and columns column[k] of `right`.

    Returns
    -------
    left_entry, right_entry, k
        Numbers of the non-zeros of `left` and `right`, and k, shape (n_pairs,).
    """
    left_counts, right_counts = _count(left.indptr)[row], _count(right.indptr)[column]
    pair_counts = left_counts * right_counts
    k = np.repeat(np.arange(len(row)), pair_counts)
    number = np.arange(len(k)) - np.repeat(np.cumsum(pair_counts) - pair_counts, pair_counts)
    left_entry = left.indptr[row[k]] + number // right_counts[k]
    right_entry = right.indptr[column[k]] + number % right_counts[k]
    return left_entry, right_entry, k
