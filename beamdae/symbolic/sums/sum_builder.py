"""Assembly of sums of kernels: where copies gather their inputs and scatter their outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from beamdae.native.lane_kernels import pad_copies
from beamdae.symbolic.sparse_operators import column_indices, pair_entries, row_indices
from beamdae.symbolic.sums.kernel_sums import Entries, Inputs, Kernel, SumPlan

Array = np.ndarray

# Copies per batch: whole vectors of lanes, few enough that the matrices of elements stay in the
# processor caches until they are added.
_MAX_BATCH_COPIES = 72
# Source of the constant 1. Shared number i has the source i - n_shared - 1.
_SOURCE_OF_ONE = -1


@dataclass(frozen=True)
class LocalInput:
    """Local inputs of all copies, as rows of an operator.

    The operator acts on the part of the input vector x that starts at index `first`.
    """

    operator: sp.csr_array
    first: int = 0


@dataclass(frozen=True)
class KernelCopies:
    """Copies of a kernel in a sum; `start` is the position of their first output."""

    kernel: Kernel
    count: int
    start: int

    def sources(self, output: int, entry: Array, copy: Array) -> Array:
        """Return the positions of entries of one output of the given copies."""
        sizes = [pattern.nnz() for pattern in self.kernel.outputs]
        component = sum(sizes[:output]) + entry
        return self.start + _locate_components(self.count, sum(sizes), component, copy)


def _locate_components(count: int, height: int, component: Array, copy: Array) -> Array:
    """Return positions of components of copies, stored batch by batch as (component, lane)."""
    batch = copy // _MAX_BATCH_COPIES
    last_lanes = pad_copies(count % _MAX_BATCH_COPIES)
    lanes = np.where(batch == count // _MAX_BATCH_COPIES, last_lanes, _MAX_BATCH_COPIES)
    first = batch * (_MAX_BATCH_COPIES * height)
    return first + component * lanes + copy % _MAX_BATCH_COPIES


@dataclass
class SumBuilder:
    """Builder of a sum: add kernels first, then add their outputs to columns or matrices.

    Attributes
    ----------
    n_shared
        Number of inputs that all copies share.
    """

    n_shared: int
    _n_local: int = 0
    _n_out: int = 0
    _data: list[tuple[Array, Array]] = field(default_factory=list)
    _batches: list[tuple[Kernel, int, int]] = field(default_factory=list)
    _batch_starts: list[int] = field(default_factory=list)
    _inputs: list[tuple[Array, Array, Array]] = field(default_factory=list)
    _entries: list[tuple[Array, Array, Array, Array, Array, Array]] = field(default_factory=list)

    def add(
        self, kernel: Kernel, inputs: Sequence[LocalInput], data: slice, count: int
    ) -> KernelCopies:
        """Add `count` copies of a kernel.

        Parameters
        ----------
        kernel
            The kernel.
        inputs
            Local inputs of the copies, in the order of the kernel.
        data
            Slice of p with the data of the copies, copy by copy. The data are the last local inputs
            of each copy.
        count
            Number of copies.

        Returns
        -------
        KernelCopies
            Argument of `add_column` and `add_matrix`.
        """
        copies, n_inputs, row = KernelCopies(kernel, count, self._n_out), kernel.n_local, 0
        if kernel.n_out == 0:
            return copies
        kernel = kernel.with_vector_sines
        for local_input in inputs:
            operator = local_input.operator
            height = operator.shape[0] // count
            copy, component = np.divmod(row_indices(operator), max(height, 1))
            target = _locate_components(count, n_inputs, row + component, copy)
            source = operator.indices + local_input.first
            self._inputs.append((self._n_local + target, source, operator.data))
            row += height
        n_data = (data.stop - data.start) // count
        assert row + n_data == n_inputs
        for first in range(0, count, _MAX_BATCH_COPIES):
            batch_copies = min(count - first, _MAX_BATCH_COPIES)
            lanes = pad_copies(batch_copies)
            self._batches.append((kernel, lanes, batch_copies))
            self._batch_starts.append(self._n_out)
            # Padding lanes repeat the data of the last copy, which cannot cause invalid operations.
            copy = first + np.minimum(np.arange(lanes), batch_copies - 1)
            source = data.start + np.arange(n_data)[:, None] + n_data * copy
            target = self._n_local + np.arange(n_inputs * lanes).reshape(n_inputs, lanes)[row:]
            self._data.append((target.ravel(), source.ravel()))
            self._n_local += n_inputs * lanes
            self._n_out += kernel.n_out * lanes
        return copies

    def add_column(
        self,
        copies: KernelCopies,
        output: int,
        operator: sp.csr_array,
        row: int,
        factors: Array | None = None,
    ) -> None:
        """Add operator^T @ (the dense column `output` of all copies), starting at row `row`.

        `factors` multiply the rows; by default, they are 1.
        """
        copy, component = np.divmod(row_indices(operator), operator.shape[0] // copies.count)
        source = copies.sources(output, component, copy)
        target = operator.indices + row
        ones = np.ones(len(target))
        scale = ones if factors is None else factors[operator.indices]
        self._entries.append((target, np.zeros_like(target), source, operator.data, ones, scale))

    def add_matrix(
        self,
        copies: KernelCopies,
        output: int,
        rows: sp.csr_array,
        columns: sp.csr_array,
        offset: tuple[int, int],
        transposed: bool = False,
        factors: Array | None = None,
    ) -> None:
        """Add R_e^T V_e C_e of all copies, or its transpose, with entry (0, 0) at `offset`.

        V_e (r, c) is the matrix `output` of a copy. `rows` (r * count, .) stacks all R_e and
        `columns` (c * count, .) all C_e. `factors` multiply the rows of the result; by default,
        they are 1.
        """
        pattern, count = copies.kernel.outputs[output], copies.count
        r, c = pattern.shape
        pattern_row, pattern_column = (np.array(x, int) for x in pattern.get_triplet())
        copy = np.repeat(np.arange(count), len(pattern_row))
        entry = np.tile(np.arange(len(pattern_row)), count)
        source = copies.sources(output, entry, copy)
        left, right, which = pair_entries(
            rows,
            copy * r + pattern_row[entry],
            columns,
            copy * c + pattern_column[entry],
        )
        i, j = rows.indices[left], columns.indices[right]
        if transposed:
            i, j = j, i
        weights = rows.data[left], columns.data[right]
        scale = np.ones(len(i)) if factors is None else factors[i]
        self._entries.append((i + offset[0], j + offset[1], source[which], *weights, scale))

    def add_diagonal(
        self, size: int, offset: tuple[int, int], shared: int | None, value: float
    ) -> None:
        """Add a diagonal of `value`, multiplied by shared number `shared` unless this is None."""
        index = np.arange(size)
        source = _SOURCE_OF_ONE if shared is None else shared - self.n_shared + _SOURCE_OF_ONE
        sources, values, ones = np.full(size, source), np.full(size, value), np.ones(size)
        rows, columns = index + offset[0], index + offset[1]
        self._entries.append((rows, columns, sources, values, ones, ones))

    def vector(self) -> SumPlan:
        """Return the plan of the sum as a column."""
        rows, _, source, *factors = self._collect_entries()
        return self._plan(rows, source, *factors)

    def matrix(self, shape: tuple[int, int], count: int = 1) -> tuple[sp.csc_array, SumPlan]:
        """Return the pattern of the sum as a matrix of ones, and the plan of its CSC non-zeros.

        If the sum stacks `count` matrices below each other, the pattern is the union of their
        patterns, and the sum has the non-zeros of each matrix in turn.
        """
        stacked_row, j, source, *factors = self._collect_entries()
        which, i = np.divmod(stacked_row, shape[0])
        assert np.all(which < count)
        pattern = sp.csc_array(sp.coo_array((np.ones(len(i)), (i, j)), shape=shape))
        pattern.sort_indices()
        pattern.data[:] = 1.0
        column_start = column_indices(pattern) * shape[0]
        target = np.searchsorted(column_start + pattern.indices, j.astype(np.intp) * shape[0] + i)
        return pattern, self._plan(target + which * pattern.nnz, source, *factors)

    def _collect_entries(self) -> tuple[Array, ...]:
        return _concatenate_columns(self._entries, "lllddd")

    def _plan(self, rows: Array, source: Array, left: Array, right: Array, scale: Array) -> SumPlan:
        """Return the plan; the weight of an entry is the product of `left`, `right` and `scale`."""
        ends = np.array([*self._batch_starts, self._n_out])
        # Shared numbers and the 1 have negative sources and follow the last batch.
        is_shared = source < 0
        batch = np.searchsorted(ends, source, "right") - 1
        batch = np.where(is_shared, len(self._batches), batch)
        column = np.where(is_shared, source + self.n_shared + 1, source - ends[batch])
        is_plain = (left * right == 1.0) & (scale == 1.0)
        entries = Entries(rows, batch, column, left * right * scale, is_plain)
        inputs = Inputs(*_concatenate_columns(self._inputs, "lld"))
        data_target, data_source = _concatenate_columns(self._data, "ll")
        data = data_target, data_source
        return SumPlan.of(self.n_shared, self._batches, data, inputs, entries)


def _concatenate_columns(parts: Sequence[tuple[Array, ...]], kinds: str) -> tuple[Array, ...]:
    """Concatenate the columns of all parts; empty columns have the dtypes `kinds`."""
    empty = tuple(np.zeros(0, kind) for kind in kinds)
    return tuple(np.concatenate(x) for x in zip(empty, *parts, strict=True))
