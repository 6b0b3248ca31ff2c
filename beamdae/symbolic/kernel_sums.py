"""Sums of kernels over many copies: gathered from one vector, evaluated, scattered into another.

    out = kernels(shared, gathered x, data),    result = S (out, shared, 1)

with constant sparse operators. Residuals and iteration matrices of all forms are such sums. They
are evaluated in stretches of copies whose numbers stay in the caches. Arrays are laid out for
machine code with a copy a lane: component by component, copies of a stretch side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.lanes import LaneKernel, lane_kernel
from beamdae.native.object_code import is_on
from beamdae.native.vectors import add, add_weighted, call_kernel, combine, fill, gather, pick
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
    turned
        The same in other coordinates, see `turns`.
    """

    function: ca.Function
    outputs: tuple[ca.Sparsity, ...]
    turned: dict[Any, Kernel] = field(default_factory=dict, repr=False, compare=False)
    _copies: dict[int, ca.Function] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )

    def copies(self, count: int) -> ca.Function:
        """The function of many copies side by side: making it costs as much as using it."""
        if count not in self._copies:
            function = self.function
            many = function.map("copies", "serial", count, [0], []) if count > 1 else function
            self._copies[count] = many
        return self._copies[count]

    @property
    def native(self) -> LaneKernel | None:
        """In machine code, if that is wanted and can be had."""
        return self._compiled if is_on() else None

    @cached_property
    def _compiled(self) -> LaneKernel | None:
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
        What goes into the kernels, (component, copy) of one stretch after the other, and what comes
        out of them, (component, copy) of the stretch under way; in the end `shared` and a one.
    kernels
        Of the stretches: addresses of machine code, or Python functions of (shared, local, out).
    stretches
        Where they begin in `local`, their lanes, and where they end in `at`, `more_at`, `rows` and
        `more_rows`, a row each; what is behind the last one in the latter two takes `shared` and
        the one.
    at, of
        local[at] = x[of], for what is just picked.
    more_at, more_of, gathered
        local[more_at] += gathered x[more_of], for what is not.
    rows, columns
        result[rows] += out[columns], for what is just added up.
    more_rows, more_columns, weights
        result[more_rows] += weights out[more_columns], for what is not.
    alive
        What the addresses of `kernels` belong to.
    """

    shared: Array
    local: Array
    out: Array
    kernels: Any
    stretches: Array
    at: Array
    of: Array
    more_at: Array
    more_of: Array
    gathered: Array
    rows: Array
    columns: Array
    more_rows: Array
    more_columns: Array
    weights: Array
    alive: tuple[Any, ...]


class Stretch(NamedTuple):
    """Copies of a kernel that are evaluated at once, and where their numbers begin in `local`."""

    kernel: Kernel
    local: int
    lanes: int
    copies: int


@dataclass(frozen=True)
class SumPlan:
    """A sum without buffers and numbers, see `Sum`; what it has of constants is shared by all.

    The numbers of a model go to local[data_at] = p[data_of].
    """

    n_shared: int
    n_local: int
    n_out: int
    data_at: Array
    data_of: Array
    calls: tuple[Stretch, ...]
    stretches: Array
    at: Array
    of: Array
    more_at: Array
    more_of: Array
    gathered: Array
    rows: Array
    columns: Array
    more_rows: Array
    more_columns: Array
    weights: Array

    @property
    def is_native(self) -> bool:
        """Whether all kernels can be had in machine code."""
        return all(call.kernel.native is not None for call in self.calls)

    def sum(self, native: bool, p: Array) -> Sum:
        """The sum with buffers, with kernels in machine code or by the virtual machine.

        `p` are the numbers of the model.
        """
        local = np.zeros(self.n_local)
        local[self.data_at] = p[self.data_of]
        kernels: Any
        alive: tuple[Any, ...] = ()
        if native:
            alive = tuple(call.kernel.native for call in self.calls)
            kernels = np.array([kernel.address for kernel in alive], np.int64)
        else:
            kernels = [_Evaluated(call) for call in self.calls]
        return Sum(
            np.zeros(self.n_shared),
            local,
            np.zeros(self.n_out),
            kernels,
            self.stretches,
            self.at,
            self.of,
            self.more_at,
            self.more_of,
            self.gathered,
            self.rows,
            self.columns,
            self.more_rows,
            self.more_columns,
            self.weights,
            alive,
        )


class _Evaluated:
    """A kernel for the copies of a stretch, by CasADi's virtual machine."""

    def __init__(self, call: Stretch) -> None:
        kernel, local, lanes, count = call
        function = kernel.function
        self._compiled = Compiled(kernel.copies(count))
        shape = (function.numel_in(1), lanes)
        self._local, self._in = slice(local, local + shape[0] * lanes), shape
        entries = function.numel_out(0)
        self._out, self._entries = slice(entries * lanes), (entries, lanes)
        self._count = count

    def __call__(self, shared: Array, local: Array, out: Array) -> None:
        own = local[self._local].reshape(self._in)[:, : self._count]
        (found,) = self._compiled(shared, own.T.ravel())
        out[self._out].reshape(self._entries)[:, : self._count] = found.reshape(self._count, -1).T


def evaluate(total: Sum, x: Array, result: Array) -> None:
    """The sum at x, into `result`; `total.shared` has to be set before."""
    local, out, stretches, n_shared = total.local, total.out, total.stretches, total.shared.size
    fill(result, 0.0)
    picked, gathered, added, weighted = 0, 0, 0, 0
    for k in range(stretches.shape[0]):
        pick(local, total.at, x, total.of, picked, stretches[k, 2])
        gather(local, total.more_at, total.gathered, x, total.more_of, gathered, stretches[k, 3])
        start, lanes = stretches[k, 0], stretches[k, 1]
        call_kernel(total.kernels, k, total.shared, local, start, out, lanes)
        add(result, total.rows, out, total.columns, added, stretches[k, 4])
        more = total.more_rows, total.weights
        add_weighted(result, *more, out, total.more_columns, weighted, stretches[k, 5])
        picked, gathered = stretches[k, 2], stretches[k, 3]
        added, weighted = stretches[k, 4], stretches[k, 5]
    combine(out[:n_shared], (1.0,), (total.shared,))
    out[n_shared] = 1.0
    add(result, total.rows, out, total.columns, added, total.rows.size)
    more = total.more_rows, total.weights
    add_weighted(result, *more, out, total.more_columns, weighted, total.more_rows.size)
