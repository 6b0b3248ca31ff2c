"""Building sums of kernels: what goes into which copy, and what becomes of what comes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from beamdae.native.lanes import padded
from beamdae.symbolic.kernel_sums import Kernel, Stretch, SumPlan
from beamdae.symbolic.sparse_operators import products

Array = np.ndarray

# Copies of a stretch, whole vectors: so the matrices of elements stay in the caches until they are
# added up.
_AT_ONCE = 72


@dataclass(frozen=True)
class Gathered:
    """Rows of an operator on a stretch of the vector, as local input of all copies."""

    operator: sp.csr_array
    first: int = 0


@dataclass(frozen=True)
class Copies:
    """A kernel added to a sum, and where its numbers begin among those of all kernels."""

    kernel: Kernel
    count: int
    start: int

    def sources(self, output: int, entry: Array, copy: Array) -> Array:
        """Where entries of one of its outputs are."""
        sizes = [pattern.nnz() for pattern in self.kernel.outputs]
        return self.start + _places(self.count, sum(sizes), sum(sizes[:output]) + entry, copy)


def _places(count: int, height: int, component: Array, copy: Array) -> Array:
    """Where a component of a copy stands: stretch by stretch, (component, copy) of each."""
    stretch = copy // _AT_ONCE
    lanes = np.where(stretch == count // _AT_ONCE, padded(count % _AT_ONCE), _AT_ONCE)
    return stretch * (_AT_ONCE * height) + component * lanes + copy % _AT_ONCE


@dataclass
class SumBuilder:
    """Builds a sum: first kernels are added, then what becomes of their outputs.

    Attributes
    ----------
    n_shared
        How many numbers all copies share.
    """

    n_shared: int
    _local: int = 0
    _out: int = 0
    _data: list[tuple[Array, Array]] = field(default_factory=list)
    _calls: list[Stretch] = field(default_factory=list)
    _sources: list[int] = field(default_factory=list)
    _gathers: list[tuple[Array, Array, Array]] = field(default_factory=list)
    _entries: list[tuple[Array, Array, Array, Array]] = field(default_factory=list)

    def add(self, kernel: Kernel, inputs: Sequence[Gathered], data: slice, count: int) -> Copies:
        """Add `count` copies of a kernel with these local inputs.

        Behind them stands what is at `data` among the numbers of the model, copy after copy.
        """
        copies, numbers, row = Copies(kernel, count, self._out), kernel.function.numel_in(1), 0
        if kernel.function.numel_out(0) == 0:
            return copies
        for gathered in inputs:
            operator = sp.coo_array(gathered.operator)
            height = operator.shape[0] // count
            copy, own = np.divmod(operator.coords[0], max(height, 1))
            at = self._local + _places(count, numbers, row + own, copy)
            self._gathers.append((at, operator.coords[1] + gathered.first, operator.data))
            row += height
        n_data = (data.stop - data.start) // count
        assert row + n_data == numbers
        for first in range(0, count, _AT_ONCE):
            found = min(count - first, _AT_ONCE)
            lanes = padded(found)
            self._calls.append(Stretch(kernel, self._local, lanes, found))
            self._sources.append(self._out)
            # Lanes to spare have the numbers of the last copy: they must not be special.
            copy = first + np.minimum(np.arange(lanes), found - 1)
            of = data.start + np.arange(n_data)[:, None] + n_data * copy
            at = self._local + np.arange(numbers * lanes).reshape(numbers, lanes)[row:]
            self._data.append((at.ravel(), of.ravel()))
            self._local += numbers * lanes
            self._out += kernel.function.numel_out(0) * lanes
        return copies

    def add_column(self, copies: Copies, output: int, operator: sp.csr_array, row: int) -> None:
        """Add operator^T (columns of all copies) to the rows from `row` on; columns are dense."""
        found = sp.coo_array(operator)
        copy, own = np.divmod(found.coords[0], found.shape[0] // copies.count)
        source = copies.sources(output, own, copy)
        at = found.coords[1] + row
        self._entries.append((at, np.zeros_like(at), source, found.data))

    def add_matrix(
        self,
        copies: Copies,
        output: int,
        rows: sp.csr_array,
        columns: sp.csr_array,
        place: tuple[int, int],
        transposed: bool = False,
    ) -> None:
        """Add R_e^T V_e C_e of all copies at a place, or the transposed of that.

        `rows` is (r * count, .) and `columns` (c * count, .), V_e is (r, c).
        """
        pattern, count = copies.kernel.outputs[output], copies.count
        r, c = pattern.shape
        own_row, own_column = (np.array(x, int) for x in pattern.get_triplet())
        copy = np.repeat(np.arange(count), len(own_row))
        entry = np.tile(np.arange(len(own_row)), count)
        source = copies.sources(output, entry, copy)
        left, right = sp.csr_array(rows), sp.csr_array(columns)
        i, j, which, weight = products(
            left, copy * r + own_row[entry], right, copy * c + own_column[entry]
        )
        if transposed:
            i, j = j, i
        self._entries.append((i + place[0], j + place[1], source[which], weight))

    def add_diagonal(
        self, size: int, place: tuple[int, int], shared: int | None, value: float
    ) -> None:
        """Add a diagonal of `value`, times a shared number if one is named, at a place."""
        index = np.arange(size)
        source = np.full(size, -1 if shared is None else shared - self.n_shared - 1)
        self._entries.append((index + place[0], index + place[1], source, np.full(size, value)))

    def vector(self) -> SumPlan:
        """The sum as a column."""
        rows, _, source, weight = self._collected()
        return self._plan(rows, source, weight)

    def matrix(self, shape: tuple[int, int], count: int = 1) -> tuple[sp.csc_array, SumPlan]:
        """The pattern of the sum as a matrix, with ones, and the sum as its CSC non-zeros.

        Of `count` matrices below each other it is what they have in common, and the sum has the
        non-zeros of one after the other.
        """
        below, j, source, weight = self._collected()
        which, i = np.divmod(below, shape[0])
        assert np.all(which < count)
        pattern = sp.csc_array(sp.coo_array((np.ones(len(i)), (i, j)), shape=shape))
        pattern.sort_indices()
        pattern.data[:] = 1.0
        position = np.repeat(np.arange(shape[1]), np.diff(pattern.indptr)) * shape[0]
        target = np.searchsorted(position + pattern.indices, j.astype(np.int64) * shape[0] + i)
        return pattern, self._plan(target + which * pattern.nnz, source, weight)

    def _collected(self) -> tuple[Array, ...]:
        return _joined(self._entries, "llld")

    def _plan(self, rows: Array, source: Array, weight: Array) -> SumPlan:
        starts = np.array([*self._sources, self._out])
        # Shared numbers and the one are counted from the end, and come last.
        behind = source < 0
        stretch = np.where(behind, len(self._calls), np.searchsorted(starts, source, "right") - 1)
        columns = np.where(behind, source + self.n_shared + 1, source - starts[stretch])
        order = np.lexsort((rows, stretch))
        plain, weighted = _split(order, weight == 1.0)
        at, of, weights = _joined(self._gathers, "lld")
        alone = (weights == 1.0) & (np.bincount(at, minlength=self._local)[at] == 1)
        picked, gathered = _split(np.argsort(at, kind="stable"), alone)
        firsts = np.array([call.local for call in self._calls], int)
        calls = np.arange(len(firsts))
        stretches = [firsts, [call.lanes for call in self._calls]]
        of_local = np.searchsorted(firsts, at, "right") - 1
        ended = ((of_local, picked), (of_local, gathered), (stretch, plain), (stretch, weighted))
        stretches += [np.searchsorted(by[entries], calls, "right") for by, entries in ended]
        data_at, data_of = _joined(self._data, "ll")
        return SumPlan(
            self.n_shared,
            self._local,
            max([self.n_shared + 1, *np.diff(starts)]),
            _index(data_at),
            _index(data_of),
            tuple(self._calls),
            np.ascontiguousarray(np.array(stretches, np.int64).reshape(6, -1).T),
            at=_index(at[picked]),
            of=_index(of[picked]),
            more_at=_index(at[gathered]),
            more_of=_index(of[gathered]),
            gathered=weights[gathered],
            rows=_index(rows[plain]),
            columns=_index(columns[plain]),
            more_rows=_index(rows[weighted]),
            more_columns=_index(columns[weighted]),
            weights=weight[weighted],
        )


def _joined(parts: Sequence[tuple[Array, ...]], kinds: str) -> tuple[Array, ...]:
    """One after the other, of arrays of these kinds, which may be none."""
    none = tuple(np.zeros(0, kind) for kind in kinds)
    return tuple(np.concatenate(x) for x in zip(none, *parts, strict=True))


def _split(order: Array, chosen: Array) -> tuple[Array, Array]:
    """What is chosen and what is not, in this order."""
    return order[chosen[order]], order[~chosen[order]]


def _index(numbers: Array) -> Array:
    # Unsigned: compiled loops then need not ask whether an index counts from the end.
    return numbers.astype(np.uint32)
