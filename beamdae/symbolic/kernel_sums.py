"""Sums of kernels over many copies: gathered from one vector, evaluated, scattered into another.

    out = kernels(shared, gathered x, data),    result = S (out, shared, 1)

with constant sparse operators. Residuals and iteration matrices of all forms are such sums. Arrays
are laid out for machine code with a copy a lane: component by component, copies side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.native.lanes import LaneKernel, lane_kernel, padded
from beamdae.native.vectors import call_kernels, combine, gather, pick, scatter
from beamdae.symbolic.compiled import Compiled

Array = np.ndarray
SX = ca.SX


@dataclass(frozen=True)
class Kernel:
    """What one copy gives: columns and matrices from numbers it shares with the others and its own.

    Attributes
    ----------
    function
        (shared, local) -> the entries of all `outputs`, one after the other.
    outputs
        Patterns of the columns and matrices it gives.
    """

    function: ca.Function
    outputs: tuple[ca.Sparsity, ...]

    @cached_property
    def native(self) -> LaneKernel | None:
        """In machine code, if that can be had."""
        return lane_kernel(self.function)

    @classmethod
    def of(cls, name: str, shared: SX, local: SX, outputs: Sequence[SX]) -> Kernel:
        """A kernel of these expressions."""
        entries = ca.vertcat(*(ca.vec(x.nz[:]) for x in outputs))
        (entries,) = ca.cse([ca.densify(entries)])
        return cls(ca.Function(name, [shared, local], [entries]), tuple(map(SX.sparsity, outputs)))


@dataclass(slots=True)
class Sum:
    """Numbers and buffers of a sum, as `evaluate` takes them.

    Attributes
    ----------
    shared
        What all copies share, (time, branch, coefficients); to be set before an evaluation.
    local, out
        What goes into the kernels and what comes out of them: (component, copy) of each; `out`
        ends with `shared` and a one.
    kernels
        Kernels in machine code, (address, start in local, start in out, copies) a row; or Python
        functions of (shared, local, out).
    at, of
        local[at] = x[of], for what is just picked.
    more_at, more_of, more_weights
        local[more_at] += more_weights x[more_of], for what is not.
    rows, columns, weights
        result[rows] += weights out[columns].
    alive
        What the addresses of `kernels` belong to.
    """

    shared: Array
    local: Array
    out: Array
    kernels: Any
    at: Array
    of: Array
    more_at: Array
    more_of: Array
    more_weights: Array
    rows: Array
    columns: Array
    weights: Array
    alive: tuple[Any, ...]


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
    _data: list[tuple[int, Array]] = field(default_factory=list)
    _calls: list[Call] = field(default_factory=list)
    _gathers: list[tuple[Array, Array, Array]] = field(default_factory=list)
    _entries: list[tuple[Array, Array, Array, Array]] = field(default_factory=list)

    def add(self, kernel: Kernel, inputs: Sequence[Gathered], data: Array, count: int) -> Copies:
        """Add `count` copies of a kernel with these local inputs, the last of them `data`."""
        room = padded(count)
        row = 0
        for gathered in inputs:
            operator = sp.coo_array(gathered.operator)
            height = operator.shape[0] // count
            copy, own = np.divmod(operator.coords[0], max(height, 1))
            at = self._local + (row + own) * room + copy
            self._gathers.append((at, operator.coords[1] + gathered.first, operator.data))
            row += height
        self._data.append((self._local + row * room, _spread(data, room)))
        row += data.shape[0]
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
        i, j, which, weight = _products(
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
        local = np.zeros(self._local)
        for start, values in self._data:
            local[start : start + values.size] = values
        return SumPlan(
            self.n_shared,
            size,
            local,
            tuple(self._calls),
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


class Call(NamedTuple):
    """Copies of a kernel in a sum, and where their numbers begin in `local` and `out`."""

    kernel: Kernel
    local: int
    out: int
    padded: int
    copies: int


@dataclass(frozen=True)
class SumPlan:
    """A sum without buffers, see `Sum`; what it has of constants is shared by all of them."""

    n_shared: int
    n_out: int
    local: Array
    calls: tuple[Call, ...]
    at: Array
    of: Array
    more_at: Array
    more_of: Array
    rows: Array
    columns: Array
    more_weights: Array
    weights: Array

    @property
    def is_native(self) -> bool:
        """Whether all kernels can be had in machine code."""
        return all(call.kernel.native is not None for call in self.calls)

    def sum(self, native: bool) -> Sum:
        """The sum with buffers, with kernels in machine code or by the virtual machine."""
        out = np.zeros(self.n_out)
        out[-1] = 1.0
        kernels: Any = [_Evaluated(call) for call in self.calls]
        alive: tuple[Any, ...] = ()
        if native:
            alive = tuple(call.kernel.native for call in self.calls)
            rows = [(k.address, *call[1:4]) for k, call in zip(alive, self.calls, strict=True)]
            kernels = np.array(rows, np.int64).reshape(-1, 4)
        return Sum(
            np.zeros(self.n_shared),
            self.local.copy(),
            out,
            kernels,
            self.at,
            self.of,
            self.more_at,
            self.more_of,
            self.more_weights,
            self.rows,
            self.columns,
            self.weights,
            alive,
        )


class _Evaluated:
    """A kernel for all copies, by CasADi's virtual machine."""

    def __init__(self, call: Call) -> None:
        kernel, local, out, padded, count = call
        function = kernel.function
        many = function.map("copies", "serial", count, [0], []) if count > 1 else function
        self._compiled = Compiled(many)
        shape = (function.numel_in(1), padded)
        self._local, self._in = slice(local, local + shape[0] * padded), shape
        entries = function.numel_out(0)
        self._out, self._entries = slice(out, out + entries * padded), (entries, padded)
        self._count = count

    def __call__(self, shared: Array, local: Array, out: Array) -> None:
        own = local[self._local].reshape(self._in)[:, : self._count]
        (found,) = self._compiled(shared, own.T.ravel())
        out[self._out].reshape(self._entries)[:, : self._count] = found.reshape(self._count, -1).T


def _index(numbers: Array) -> Array:
    return np.ascontiguousarray(numbers, np.int64)


def _spread(data: Array, padded: int) -> Array:
    """Columns of data, and the last one again and again: lanes to spare must not be special."""
    if data.size == 0:
        return np.zeros(0)
    more = np.repeat(data[:, -1:], padded - data.shape[1], axis=1)
    return np.concatenate([data, more], axis=1).ravel()


def _products(
    left: sp.csr_array, row: Array, right: sp.csr_array, column: Array
) -> tuple[Array, Array, Array, Array]:
    """(i, j, which, weight) of every product left[row, i] right[column, j]."""
    of_left, of_right = np.diff(left.indptr)[row], np.diff(right.indptr)[column]
    pairs = of_left * of_right
    which = np.repeat(np.arange(len(row)), pairs)
    within = np.arange(len(which)) - np.repeat(np.cumsum(pairs) - pairs, pairs)
    a = left.indptr[row[which]] + within // of_right[which]
    b = right.indptr[column[which]] + within % of_right[which]
    return left.indices[a], right.indices[b], which, left.data[a] * right.data[b]


def evaluate(total: Sum, x: Array, result: Array) -> None:
    """The sum at x, into `result`; `total.shared` has to be set before."""
    pick(total.local, total.at, x, total.of)
    gather(total.local, total.more_at, total.more_weights, x, total.more_of)
    call_kernels(total.kernels, total.shared, total.local, total.out)
    n_shared = total.shared.size
    combine(total.out[-1 - n_shared : -1], (1.0,), (total.shared,))
    scatter(result, total.rows, total.weights, total.out, total.columns)
