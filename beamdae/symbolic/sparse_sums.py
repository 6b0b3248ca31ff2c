"""Sums of local blocks: constant sparse operators from local values to global ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import scipy.sparse as sp


def constant(matrix: sp.sparray) -> ca.DM:
    """A scipy sparse matrix as a CasADi constant."""
    csc = sp.csc_array(matrix)
    csc.sort_indices()
    return ca.DM(sparsity(csc), csc.data)


def sparsity(csc: sp.csc_array) -> ca.Sparsity:
    """The pattern of a scipy CSC matrix as a CasADi pattern."""
    rows, columns = csc.shape
    return ca.Sparsity(rows, columns, csc.indptr.tolist(), csc.indices.tolist())


def picked(operator: sp.csr_array, rows: np.ndarray) -> sp.csr_array:
    """Rows of an operator: what its index does, in a quarter of the time where they are few."""
    starts, counts = operator.indptr[rows], np.diff(operator.indptr)[rows]
    ends = np.cumsum(counts)
    indptr = np.concatenate([np.zeros(1, operator.indptr.dtype), ends])
    entries = np.arange(indptr[-1]) + np.repeat(starts - ends + counts, counts)
    parts = (operator.data[entries], operator.indices[entries], indptr)
    return sp.csr_array(parts, shape=(len(rows), operator.shape[1]))


def gather(operator: sp.csr_array, x: ca.MX, count: int) -> ca.MX:
    """Local coordinates of `count` copies, one column each."""
    return ca.reshape(constant(operator) @ x, operator.shape[0] // count, count)


def scatter(operator: sp.csr_array, local: ca.MX) -> ca.MX:
    """Sum of local vectors (one column a copy) in global coordinates."""
    return constant(sp.csr_array(operator.T)) @ ca.vec(local)


@dataclass(frozen=True)
class Block:
    """Local matrices R_e^T V_e C_e of `count` copies, placed at (row, column) of a larger matrix.

    `values` is (r, c * count), copies side by side, and sparse: what it has no entries for is zero
    for all coordinates; `rows` is (r * count, .), `columns` is (c * count, .). The transposed one
    is placed at (column, row).
    """

    values: ca.MX
    rows: sp.csr_array
    columns: sp.csr_array
    count: int
    is_transposed: bool = False

    def scaled(self, factor: ca.MX | float) -> Block:
        """The block times a factor."""
        return replace(self, values=factor * self.values)

    @property
    def transposed(self) -> Block:
        """The transposed block."""
        return replace(self, is_transposed=not self.is_transposed)


@dataclass
class SparseSum:
    """Sum of blocks with one fixed CSC pattern: non-zeros = constant operator @ local values."""

    shape: tuple[int, int]
    _values: list[ca.MX] = field(default_factory=list)
    _entries: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = field(
        default_factory=list
    )
    _size: int = 0

    @classmethod
    def of(cls, shape: tuple[int, int], blocks: Iterable[Block]) -> SparseSum:
        """The sum of blocks at its upper left corner."""
        total = cls(shape)
        for block in blocks:
            total.add(block)
        return total

    def add(self, block: Block, row: int = 0, column: int = 0) -> None:
        """Add a block whose global rows and columns start at (row, column)."""
        i, j, source, weight = _expand(block)
        self._entries.append((i + row, j + column, source + self._size, weight))
        self._values.append(ca.vec(block.values.nz[:]))
        self._size += block.values.nnz()

    def assemble(self) -> tuple[sp.csc_array, ca.MX]:
        """The pattern (data all one) and the expression of its non-zeros in CSC order."""
        if not self._entries:
            return sp.csc_array(self.shape), ca.MX.zeros(0)
        i, j, source, weight = (np.concatenate(x) for x in zip(*self._entries, strict=True))
        pattern = sp.csc_array(sp.coo_array((np.ones(len(i)), (i, j)), shape=self.shape))
        pattern.sort_indices()
        position = np.repeat(np.arange(self.shape[1]), np.diff(pattern.indptr)) * self.shape[0]
        keys = position + pattern.indices
        target = np.searchsorted(keys, j.astype(np.int64) * self.shape[0] + i)
        operator = sp.csc_array(
            sp.coo_array((weight, (target, source)), shape=(len(keys), self._size))
        )
        pattern.data[:] = 1.0
        return pattern, ca.densify(constant(operator) @ ca.vertcat(*self._values))

    def matrix(self) -> ca.MX:
        """The sum as a sparse CasADi matrix."""
        pattern, nonzeros = self.assemble()
        return ca.MX(sparsity(pattern), nonzeros)


def _expand(block: Block) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(row, column, index into the entries of values, weight) of every product R_ai V_ab C_bj."""
    r, c = block.rows.shape[0] // block.count, block.columns.shape[0] // block.count
    row, column = (np.array(x, int) for x in block.values.sparsity().get_triplet())
    row += column // c * r
    i, j, source, weight = products(
        sp.csr_array(block.rows), row, sp.csr_array(block.columns), column
    )
    if block.is_transposed:
        i, j = j, i
    return i, j, source, weight


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
