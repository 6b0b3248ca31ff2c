"""Operations on constant sparse operators."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
import scipy.sparse as sp


def to_casadi_constant(matrix: sp.sparray) -> ca.DM:
    """Return a scipy sparse matrix as a CasADi constant."""
    csc = sp.csc_array(matrix)
    csc.sort_indices()
    rows, columns = csc.shape
    pattern = ca.Sparsity(rows, columns, csc.indptr.tolist(), csc.indices.tolist())
    return ca.DM(pattern, csc.data)


def column_indices(pattern: sp.csc_array) -> np.ndarray:
    """Return the column of each entry of a CSC matrix; `pattern.indices` are the rows."""
    return np.repeat(np.arange(pattern.shape[1]), np.diff(pattern.indptr))


def build_selection(indices: Sequence[int] | np.ndarray, size: int) -> sp.csr_array:
    """Return the operator that selects the entries `indices` of a vector with `size` entries."""
    parts = (np.ones(len(indices)), np.asarray(indices, int), np.arange(len(indices) + 1))
    return sp.csr_array(parts, shape=(len(indices), size))


def select_rows(operator: sp.csr_array, rows: np.ndarray) -> sp.csr_array:
    """Return operator[rows]; four times as fast as indexing for few rows."""
    starts, counts = operator.indptr[rows], np.diff(operator.indptr)[rows]
    ends = np.cumsum(counts)
    indptr = np.concatenate([np.zeros(1, operator.indptr.dtype), ends])
    entries = np.arange(indptr[-1]) + np.repeat(starts - ends + counts, counts)
    parts = (operator.data[entries], operator.indices[entries], indptr)
    return sp.csr_array(parts, shape=(len(rows), operator.shape[1]))


def multiply_entries(
    left: sp.csr_array, row: np.ndarray, right: sp.csr_array, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return all products left[row[k], i] right[column[k], j] of non-zeros, for all k.

    Returns
    -------
    i, j, k, product
        Indices and values of the products, shape (n_products,).
    """
    left_counts, right_counts = np.diff(left.indptr)[row], np.diff(right.indptr)[column]
    product_counts = left_counts * right_counts
    k = np.repeat(np.arange(len(row)), product_counts)
    number = np.arange(len(k)) - np.repeat(
        np.cumsum(product_counts) - product_counts, product_counts
    )
    left_entry = left.indptr[row[k]] + number // right_counts[k]
    right_entry = right.indptr[column[k]] + number % right_counts[k]
    product = left.data[left_entry] * right.data[right_entry]
    return left.indices[left_entry], right.indices[right_entry], k, product
