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

from beamdae.native.lanes import LaneKernel, lane_kernel
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


class Call(NamedTuple):
    """Copies of a kernel in a sum, and where their numbers begin in `local` and `out`."""

    kernel: Kernel
    local: int
    out: int
    padded: int
    copies: int


@dataclass(frozen=True)
class SumPlan:
    """A sum without buffers and numbers, see `Sum`; what it has of constants is shared by all.

    The numbers of a model go to local[data_at] = p[data_of].
    """

    n_shared: int
    n_local: int
    n_out: int
    calls: tuple[Call, ...]
    data_at: Array
    data_of: Array
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

    def sum(self, native: bool, p: Array) -> Sum:
        """The sum with buffers, with kernels in machine code or by the virtual machine.

        `p` are the numbers of the model.
        """
        local = np.zeros(self.n_local)
        local[self.data_at] = p[self.data_of]
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
            local,
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
        self._compiled = Compiled(kernel.copies(count))
        shape = (function.numel_in(1), padded)
        self._local, self._in = slice(local, local + shape[0] * padded), shape
        entries = function.numel_out(0)
        self._out, self._entries = slice(out, out + entries * padded), (entries, padded)
        self._count = count

    def __call__(self, shared: Array, local: Array, out: Array) -> None:
        own = local[self._local].reshape(self._in)[:, : self._count]
        (found,) = self._compiled(shared, own.T.ravel())
        out[self._out].reshape(self._entries)[:, : self._count] = found.reshape(self._count, -1).T


def evaluate(total: Sum, x: Array, result: Array) -> None:
    """The sum at x, into `result`; `total.shared` has to be set before."""
    pick(total.local, total.at, x, total.of)
    gather(total.local, total.more_at, total.more_weights, x, total.more_of)
    call_kernels(total.kernels, total.shared, total.local, total.out)
    n_shared = total.shared.size
    combine(total.out[-1 - n_shared : -1], (1.0,), (total.shared,))
    scatter(result, total.rows, total.weights, total.out, total.columns)
