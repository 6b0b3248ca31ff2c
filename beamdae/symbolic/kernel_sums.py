"""Sums of kernels over many copies: gather inputs, evaluate kernels, scatter outputs.

    out = kernels(shared, gathered x, data),    result = S (out, shared, 1)

Gathering and S are constant sparse operators. The residuals and iteration matrices of all
formulations are such sums. Each sum is evaluated in batches of copies whose numbers stay in the
processor caches. Arrays are laid out for machine code with one copy per vector lane: component by
component, with the copies of a batch side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.lane_kernels import LaneKernel, build_lane_kernel
from beamdae.native.loop_functions import (
    add,
    add_weighted,
    call_kernel,
    combine,
    fill,
    gather,
    pick,
)
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.compiled import Compiled, keep_latest
from beamdae.symbolic.local_symbols import C_A, C_H, C_L, C_Q, C_R, C_V, SHARED_BRANCH, SHARED_T

Array = np.ndarray
SX = ca.SX

# Columns of `Sum.batches`: start of the inputs of a batch in `local`, its number of lanes, and the
# ends of its entries in `pick_targets`, `gather_targets`, `add_targets` and `weighted_targets`.
_START = 0
_LANES = 1
_PICK_END = 2
_GATHER_END = 3
_ADD_END = 4
_WEIGHTED_END = 5


@dataclass(frozen=True)
class Kernel:
    """Function that returns columns and matrices of one copy from shared and local numbers.

    Attributes
    ----------
    function
        CasADi function of (shared, local) that returns the concatenated non-zeros of all `outputs`.
    outputs
        Patterns of the columns and matrices that `function` returns.
    rotated_kernels
        Cache of `rotations.rotate_kernel`.
    """

    function: ca.Function
    outputs: tuple[ca.Sparsity, ...]
    rotated_kernels: dict[Any, Kernel] = field(default_factory=dict, repr=False, compare=False)
    _mapped_functions: dict[int, ca.Function] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )

    @property
    def n_local(self) -> int:
        """Number of local inputs of a copy."""
        return self.function.numel_in(1)

    @property
    def n_out(self) -> int:
        """Number of non-zeros of all outputs of a copy."""
        return self.function.numel_out(0)

    def map_copies(self, count: int) -> ca.Function:
        """Return the function of `count` copies; cached, as mapping costs as much as a call."""
        mapped = self._mapped_functions.get(count)
        if mapped is None:
            function = self.function
            mapped = function.map("copies", "serial", count, [0], []) if count > 1 else function
            keep_latest(self._mapped_functions, count, mapped)
        return mapped

    @property
    def native(self) -> LaneKernel | None:
        """Machine code of the kernel; None if machine code is switched off or cannot be built."""
        return self.load_native()

    def load_native(self, compiles: bool = True) -> LaneKernel | None:
        """Return the machine code as `native`, but only from the cache if `compiles` is False."""
        if not is_native_enabled():
            return None
        is_known = "_lane_kernel" in vars(self)
        return self._lane_kernel if compiles or is_known else self._cached_lane_kernel

    @cached_property
    def _lane_kernel(self) -> LaneKernel | None:
        return self._cached_lane_kernel or build_lane_kernel(self.function)

    @cached_property
    def _cached_lane_kernel(self) -> LaneKernel | None:
        # Looked up once, because serializing the function takes milliseconds.
        return build_lane_kernel(self.function, compiles=False)

    @classmethod
    def of(cls, name: str, shared: SX, local: SX, outputs: Sequence[SX]) -> Kernel:
        """Return the kernel of `outputs`, expressions in `shared` and `local`."""
        entries = ca.vertcat(*(ca.vec(x.nz[:]) for x in outputs))
        (entries,) = ca.cse([ca.densify(entries)])
        return cls(ca.Function(name, [shared, local], [entries]), tuple(map(SX.sparsity, outputs)))


@dataclass(slots=True)
class Sum:
    """Arrays and buffers of a sum; argument of `evaluate_sum`.

    Attributes
    ----------
    shared
        Inputs common to all copies: (t, branch), followed by the `MatrixFactors` in sums of
        matrices. Set before an evaluation, see `set_time` and `set_matrix_factors`.
    local
        Inputs of the copies, batch by batch; (component, copy) within each batch.
    out
        Outputs of the current batch, (component, copy); after the last batch, `shared` and a 1.
    kernels
        One per batch: addresses of machine code, or Python functions of (shared, local, out).
    batches
        One row per batch, with the columns `_START` to `_WEIGHTED_END`. Entries of `add_targets`
        and `weighted_targets` beyond the last batch read `shared` and the 1.
    pick_targets, pick_sources
        local[pick_targets] = x[pick_sources].
    gather_targets, gather_sources, gather_weights
        local[gather_targets] = gather_weights x[gather_sources], summed over repeated targets, for
        inputs that are weighted or have several terms.
    add_targets, add_sources
        result[add_targets] += out[add_sources].
    weighted_targets, weighted_sources, weights
        result[weighted_targets] += weights out[weighted_sources], for weights other than 1.
    code_owners
        Objects that keep the machine code at the addresses of `kernels` in memory.
    """

    shared: Array
    local: Array
    out: Array
    kernels: Any
    batches: Array
    pick_targets: Array
    pick_sources: Array
    gather_targets: Array
    gather_sources: Array
    gather_weights: Array
    add_targets: Array
    add_sources: Array
    weighted_targets: Array
    weighted_sources: Array
    weights: Array
    code_owners: tuple[Any, ...]


class Batch(NamedTuple):
    """Copies of a kernel that are evaluated together; their inputs begin at `start` in `local`."""

    kernel: Kernel
    start: int
    lanes: int
    copies: int


@dataclass(frozen=True)
class SumPlan:
    """A sum without buffers and model data; all its `Sum`s share the constant arrays.

    The data p of a model are copied by local[data_targets] = p[data_sources].
    """

    n_shared: int
    n_local: int
    n_out: int
    data_targets: Array
    data_sources: Array
    batches: tuple[Batch, ...]
    batch_table: Array
    pick_targets: Array
    pick_sources: Array
    gather_targets: Array
    gather_sources: Array
    gather_weights: Array
    add_targets: Array
    add_sources: Array
    weighted_targets: Array
    weighted_sources: Array
    weights: Array

    @property
    def is_native(self) -> bool:
        """True if machine code of all kernels is available."""
        return self.load_native()

    def load_native(self, compiles: bool = True) -> bool:
        """Return `is_native`, using only machine code in the cache if `compiles` is False."""
        return all(batch.kernel.load_native(compiles) is not None for batch in self.batches)

    def sum(self, native: bool, p: Array) -> Sum:
        """Return the sum with new buffers and the data of a model.

        Parameters
        ----------
        native
            True to run kernels as machine code, False to run them in CasADi's virtual machine.
        p
            Numbers of the model; `data_sources` selects the data of the copies.
        """
        local = np.zeros(self.n_local)
        local[self.data_targets] = p[self.data_sources]
        kernels: Any
        code_owners: tuple[Any, ...] = ()
        if native:
            code_owners = tuple(batch.kernel.native for batch in self.batches)
            kernels = np.array([kernel.address for kernel in code_owners], np.int64)
        else:
            kernels = [_InterpretedKernel(batch) for batch in self.batches]
        return Sum(
            shared=np.zeros(self.n_shared),
            local=local,
            out=np.zeros(self.n_out),
            kernels=kernels,
            batches=self.batch_table,
            pick_targets=self.pick_targets,
            pick_sources=self.pick_sources,
            gather_targets=self.gather_targets,
            gather_sources=self.gather_sources,
            gather_weights=self.gather_weights,
            add_targets=self.add_targets,
            add_sources=self.add_sources,
            weighted_targets=self.weighted_targets,
            weighted_sources=self.weighted_sources,
            weights=self.weights,
            code_owners=code_owners,
        )


class _InterpretedKernel:
    """Kernel of a batch, evaluated for all copies by CasADi's virtual machine."""

    def __init__(self, batch: Batch) -> None:
        kernel, start, lanes, self._count = batch
        n_inputs, n_outputs = kernel.n_local, kernel.n_out
        self._compiled = Compiled(kernel.map_copies(self._count))
        self._input_shape, self._output_shape = (n_inputs, lanes), (n_outputs, lanes)
        self._input_range = slice(start, start + n_inputs * lanes)
        self._output_range = slice(n_outputs * lanes)

    def __call__(self, shared: Array, local: Array, out: Array) -> None:
        count = self._count
        inputs = local[self._input_range].reshape(self._input_shape)[:, :count]
        (values,) = self._compiled(shared, inputs.T.ravel())
        outputs = out[self._output_range].reshape(self._output_shape)
        outputs[:, :count] = values.reshape(count, -1).T


def set_time(total: Sum, t: float, branch: float) -> None:
    """Set the time at which laws are evaluated, and the time that selects the pieces of laws."""
    total.shared[SHARED_T] = t
    total.shared[SHARED_BRANCH] = branch


def set_matrix_factors(
    total: Sum, c_q: float, c_v: float, c_a: float, c_l: float, c_h: float, c_r: float
) -> None:
    """Set the factors of the parts of a matrix, see `local_symbols.MatrixFactors`."""
    total.shared[C_Q] = c_q
    total.shared[C_V] = c_v
    total.shared[C_A] = c_a
    total.shared[C_L] = c_l
    total.shared[C_H] = c_h
    total.shared[C_R] = c_r


def evaluate_sum(total: Sum, x: Array, result: Array) -> None:
    """Write the sum at x into `result`, with the time and factors in `total.shared`."""
    local, out, batches, n_shared = total.local, total.out, total.batches, total.shared.size
    fill(result, 0.0)
    pick_begin, gather_begin, add_begin, weighted_begin = 0, 0, 0, 0
    for k in range(batches.shape[0]):
        start, lanes = batches[k, _START], batches[k, _LANES]
        pick_end, gather_end = batches[k, _PICK_END], batches[k, _GATHER_END]
        add_end, weighted_end = batches[k, _ADD_END], batches[k, _WEIGHTED_END]
        pick(local, total.pick_targets, x, total.pick_sources, pick_begin, pick_end)
        targets, weights, sources = total.gather_targets, total.gather_weights, total.gather_sources
        gather(local, targets, weights, x, sources, gather_begin, gather_end)
        call_kernel(total.kernels, k, total.shared, local, start, out, lanes)
        add(result, total.add_targets, out, total.add_sources, add_begin, add_end)
        targets, weights, sources = total.weighted_targets, total.weights, total.weighted_sources
        add_weighted(result, targets, weights, out, sources, weighted_begin, weighted_end)
        pick_begin, gather_begin = pick_end, gather_end
        add_begin, weighted_begin = add_end, weighted_end
    combine(out[:n_shared], (1.0,), (total.shared,))
    out[n_shared] = 1.0
    add(result, total.add_targets, out, total.add_sources, add_begin, total.add_targets.size)
    targets, weights, sources = total.weighted_targets, total.weights, total.weighted_sources
    add_weighted(result, targets, weights, out, sources, weighted_begin, targets.size)
