"""Constant sparse operators, and what sums of local blocks on them are made of."""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp


def constant(matrix: sp.sparray) -> ca.DM:
    """A scipy sparse matrix as a CasADi constant."""
    csc = sp.csc_array(matrix)
    csc.sort_indices()
    rows, columns = csc.shape
    pattern = ca.Sparsity(rows, columns, csc.indptr.tolist(), csc.indices.tolist())
    return ca.DM(pattern, csc.data)


def column_of(pattern: sp.csc_array) -> np.ndarray:
    """Column of each of the entries of a CSC matrix, whose rows are its `indices`."""
    return np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.indptr))


def picked(operator: sp.csr_array, rows: np.ndarray) -> sp.csr_array:
    """Rows of an operator: what its index does, in a quarter of the time where they are few."""
    starts, counts = operator.indptr[rows], np.diff(operator.indptr)[rows]
    ends = np.cumsum(counts)
    indptr = np.concatenate([np.zeros(1, operator.indptr.dtype), ends])
    entries = np.arange(indptr[-1]) + np.repeat(starts - ends + counts, counts)
    parts = (operator.data[entries], operator.indices[entries], indptr)
    return sp.csr_array(parts, shape=(len(rows), operator.shape[1]))


def products(
    left: sp.csr_array, row: np.ndarray, right: sp.csr_array, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(i, j, which, weight) of every product left[row, i] right[column, j] of these pairs."""
    of_left, of_right = np.diff(left.indptr)[row], np.diff(right.indptr)[column]
    pairs = of_left * of_right
    which = np.repeat(np.arange(len(row)), pairs)
    within = np.arange(len(which)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    a = left.indptr[row[which]] + within // of_right[which]
    b = right.indptr[column[which]] + within % of_right[which]
    return left.indices[a], right.indices[b], which, left.data[a] * right.data[b]
