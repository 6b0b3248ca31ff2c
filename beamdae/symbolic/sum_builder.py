"""Building sums of kernels: what goes into which copy, and what becomes of what comes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from beamdae.native.lanes import padded
from beamdae.symbolic.kernel_sums import Call, Kernel, SumPlan
from beamdae.symbolic.sparse_sums import products

Array = np.ndarray


@dataclass(frozen=True)
class Gathered:
    """Rows of an operator on a stretch of the vector, as local input of all copies."""

    operator: sp.csr_array
    first: int = 0


@dataclass(frozen=True)
class Copies:
    """A kernel added to a sum: `starts` tells where in `out` each of its outputs begins."""

    kernel: Kernel
    count: int
    padded: int
    starts: tuple[int, ...]


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
    _calls: list[Call] = field(default_factory=list)
    _gathers: list[tuple[Array, Array, Array]] = field(default_factory=list)
    _entries: list[tuple[Array, Array, Array, Array]] = field(default_factory=list)

    def add(self, kernel: Kernel, inputs: Sequence[Gathered], data: slice, count: int) -> Copies:
        """Add `count` copies of a kernel with these local inputs.

        The last of them stand at `data` among the numbers of the model, copy after copy.
        """
        room = padded(count)
        row = 0
        for gathered in inputs:
            operator = sp.coo_array(gathered.operator)
            height = operator.shape[0] // count
            copy, own = np.divmod(operator.coords[0], max(height, 1))
            at = self._local + (row + own) * room + copy
            self._gathers.append((at, operator.coords[1] + gathered.first, operator.data))
            row += height
        numbers = (data.stop - data.start) // count
        own, lane = np.divmod(np.arange(numbers * room), room)
        # Lanes to spare have the numbers of the last copy: they must not be special.
        of = data.start + own + numbers * np.minimum(lane, count - 1)
        self._data.append((self._local + row * room + np.arange(numbers * room), of))
        row += numbers
        assert row == kernel.function.numel_in(1)
        starts = self._out + room * np.cumsum([0, *(s.nnz() for s in kernel.outputs)])
        self._calls.append(Call(kernel, self._local, self._out, room, count))
        self._local += row * room
        self._out = int(starts[-1])
        return Copies(kernel, count, room, tuple(starts[:-1].tolist()))

    def add_column(self, copies: Copies, output: int, operator: sp.csr_array, row: int) -> None:
        """Add operator^T (columns of all copies) to the rows from `row` on; columns are dense."""
        found = sp.coo_array(operator)
        copy, own = np.divmod(found.coords[0], found.shape[0] // copies.count)
        source = copies.starts[output] + own * copies.padded + copy
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
        source = copies.starts[output] + entry * copies.padded + copy
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
        none = [(np.zeros(0, int), np.zeros(0, int), np.zeros(0, int), np.zeros(0))]
        return tuple(np.concatenate(x) for x in zip(*(self._entries or none), strict=True))

    def _plan(self, rows: Array, source: Array, weight: Array) -> SumPlan:
        size = self._out + self.n_shared + 1
        # Shared numbers and the one are counted from the end.
        columns = np.where(source < 0, source + size, source)
        order = np.argsort(rows, kind="stable")
        at, of, weights = self._collected_gathers()
        picked = (weights == 1.0) & (np.bincount(at, minlength=self._local)[at] == 1)
        none = [(np.zeros(0, int), np.zeros(0, int))]
        data_at, data_of = map(np.concatenate, zip(*(self._data or none), strict=True))
        return SumPlan(
            self.n_shared,
            self._local,
            size,
            tuple(self._calls),
            data_at=_index(data_at),
            data_of=_index(data_of),
            at=_index(at[picked]),
            of=_index(of[picked]),
            more_at=_index(at[~picked]),
            more_of=_index(of[~picked]),
            rows=_index(rows[order]),
            columns=_index(columns[order]),
            more_weights=np.ascontiguousarray(weights[~picked]),
            weights=np.ascontiguousarray(weight[order]),
        )

    def _collected_gathers(self) -> tuple[Array, ...]:
        none = [(np.zeros(0, int), np.zeros(0, int), np.zeros(0))]
        return tuple(np.concatenate(x) for x in zip(*(self._gathers or none), strict=True))


def _index(numbers: Array) -> Array:
    return np.ascontiguousarray(numbers, np.int64)
