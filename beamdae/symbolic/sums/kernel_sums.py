"""Sums of kernels over many copies: gather inputs, evaluate kernels, scatter outputs.

    out = kernels(shared, gathered x, data),    result = S (out, shared, 1)

Gathering and S are constant sparse operators. The residuals and iteration matrices of all
formulations are such sums. Each sum is evaluated in batches of copies whose numbers stay in the
processor caches. Arrays are laid out for machine code with one copy per vector lane: component by
component, with the copies of a batch side by side.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, cast

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.core.library import load_core
from beamdae.core.tables import Loop, Workspace
from beamdae.linear.elimination import aligned_zeros
from beamdae.native.instructions import remove_repetitions
from beamdae.native.lane_code import LANE_WIDTH
from beamdae.native.lane_kernels import (
    KERNEL_SIGNATURE,
    LaneKernel,
    Rewrite,
    build_lane_kernel,
    rewrite,
)
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.compiled import Compiled, RowFunction, keep_latest
from beamdae.symbolic.local_symbols import C_Q, SHARED_BRANCH, SHARED_T
from beamdae.symbolic.sums.kernel_code import BatchRows, PointSum, expand_sines, find_tiles
from beamdae.symbolic.table_lookups import has_lookups, remove_zero_lookups

Array = np.ndarray
SX = ca.SX

# Columns of `Sum.batches`: start of the inputs of a batch in `local`, its number of lanes, and the
# ends of its entries in `pick_targets`, `gather_targets`, `add_targets`, `weighted_targets`,
# `pick_tiles`.
START = 0
LANES = 1
PICK_END = 2
ADD_END = 4
WEIGHTED_END = 5

# Straight-line code of larger kernels takes seconds to compile; that of elements with up to four
# nodes is faster than loops.
_MAX_STRAIGHT_INSTRUCTIONS = 6500
# Rewriting larger kernels for the virtual machine takes longer than loading their machine code.
_MIN_INSTRUCTIONS_OF_CACHED_CODE = 4000


@dataclass(frozen=True)
class Kernel:
    """Function that returns columns and matrices of one copy from shared and local numbers.

    Attributes
    ----------
    source
        CasADi function of (shared, local) that returns the concatenated non-zeros of all `outputs`.
    outputs
        Patterns of the columns and matrices that `source` returns.
    linear_from
        Index of the first of the last local inputs in which all outputs are linear, such as
        tangents and weights, so that outputs are zero if these inputs are; None if there are none.
    rewrites
        Functions that return a faster function of the same values, applied to `source` in order.
        They take longer than reading machine code from the cache, which is found without them.
    points
        Points whose sum is the kernel, for machine code of large kernels; None for others.
    """

    source: ca.Function
    outputs: tuple[ca.Sparsity, ...]
    linear_from: int | None = None
    rewrites: tuple[Rewrite, ...] = ()
    points: PointSum | None = None
    _derived_kernels: dict[Any, Kernel] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    _mapped_functions: dict[int, ca.Function] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )

    @cached_property
    def function(self) -> ca.Function:
        """The function after all rewrites, for CasADi's virtual machine and for derivatives."""
        return rewrite(self.source, self.rewrites)

    @property
    def n_local(self) -> int:
        """Number of local inputs of a copy."""
        return self.source.numel_in(1)

    @property
    def n_out(self) -> int:
        """Number of non-zeros of all outputs of a copy."""
        return self.source.numel_out(0)

    def map_copies(self, count: int) -> ca.Function:
        """Return the function of `count` copies; cached, as mapping costs as much as a call."""
        mapped = self._mapped_functions.get(count)
        if mapped is None:
            function = self.function
            mapped = function.map("copies", "serial", count, [0], []) if count > 1 else function
            keep_latest(self._mapped_functions, count, mapped)
        return mapped

    def derive(self, key: Any, build: Callable[[], Kernel]) -> Kernel:
        """Return the kernel that `build` derives from this one, cached by `key`."""
        if key not in self._derived_kernels:
            self._derived_kernels[key] = build()
        return self._derived_kernels[key]

    @cached_property
    def with_vector_sines(self) -> Kernel:
        """The same kernel, with sines and cosines as polynomials if it has several."""
        return replace(self, rewrites=(*self.rewrites, expand_sines))

    @cached_property
    def rows(self) -> RowFunction:
        """The function, evaluated for many copies at a time."""
        return RowFunction(self.function)

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
        return self._cached_lane_kernel or self._build(True)

    @cached_property
    def _cached_lane_kernel(self) -> LaneKernel | None:
        # Looked up once, because serializing the function takes milliseconds.
        return self._build(False)

    def _build(self, compiles: bool) -> LaneKernel | None:
        if self.loops is None:
            return build_lane_kernel(self.source, compiles, self.rewrites)
        return self.loops.compile(self.source, self.outputs, compiles)

    @property
    def loops(self) -> PointSum | None:
        """Points whose sum replaces straight-line code; None for small and for other kernels."""
        is_long = self.source.n_instructions() > _MAX_STRAIGHT_INSTRUCTIONS
        return self.points if is_long else None

    @classmethod
    def of(
        cls,
        name: str,
        shared: SX,
        local: SX,
        outputs: Sequence[SX],
        points: PointSum | None = None,
    ) -> Kernel:
        """Return the kernel of `outputs`, expressions in `shared` and `local`."""
        entries = ca.densify(ca.vertcat(*(ca.vec(x.nz[:]) for x in outputs)))
        source = ca.Function(name, [shared, local], [entries])
        rewrites: tuple[Rewrite, ...] = (remove_repetitions,)
        if has_lookups(source):
            rewrites = (*rewrites, remove_zero_lookups)
        return cls(source, tuple(map(SX.sparsity, outputs)), rewrites=rewrites, points=points)


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
        Addresses of C functions, one per batch; see `LaneKernel`.
    batches
        One row per batch, with the columns from `START`, in this order. Entries of `add_targets`
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
    pick_tiles
        Entries that the core moves by vectors, see `kernel_code`, in place of the same entries of
        `pick_targets`.
    code_owners
        Objects with the functions at the addresses of `kernels`.
    """

    shared: Array
    local: Array
    out: Array
    kernels: Array
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
    pick_tiles: Array
    code_owners: tuple[Any, ...]


class SharedInputs(Protocol):
    """A `Sum`, or another object with its `shared` inputs."""

    @property
    def shared(self) -> Array:
        """See `Sum.shared`."""


class Batch(NamedTuple):
    """Copies of a kernel that are evaluated together; their inputs begin at `start` in `local`."""

    kernel: Kernel
    start: int
    lanes: int
    copies: int


class Inputs(NamedTuple):
    """Inputs local[targets] = weights x[sources] of all batches, summed over repeated targets."""

    targets: Array
    sources: Array
    weights: Array


class Entries(NamedTuple):
    """Entries result[rows] += weights out[sources] of the outputs of batches.

    Attributes
    ----------
    rows
        Rows of the result.
    batches
        Batch of each entry; the number of batches for entries of `shared` and the 1.
    sources
        Positions in the outputs of the batch.
    weights
        Weights.
    is_plain
        True for weights that are 1 in all models of a structure.
    """

    rows: Array
    batches: Array
    sources: Array
    weights: Array
    is_plain: Array


def join(*parts: Any) -> Any:
    """Join `Inputs` or `Entries`."""
    return type(parts[0])(*map(np.concatenate, zip(*parts, strict=True)))


def select(part: Any, which: Array) -> Any:
    """Return some of `Inputs` or `Entries`, by mask or indices."""
    return type(part)(*(column[which] for column in part))


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
    # Of `SumEvaluator`: buffers for the next evaluator.
    idle_buffers: list[Any] = field(default_factory=list, init=False, compare=False, repr=False)

    @classmethod
    def of(
        cls,
        n_shared: int,
        batches: Sequence[tuple[Kernel, int, int]],
        data: tuple[Array, Array],
        inputs: Inputs,
        entries: Entries,
    ) -> SumPlan:
        """Return the plan of a sum; inputs and entries are sorted by batch and grouped as in `Sum`.

        Parameters
        ----------
        n_shared
            Number of inputs that all copies share.
        batches
            Kernel, number of lanes and number of copies of each batch.
        data
            Targets and sources of the data of the model.
        inputs, entries
            Inputs of the copies, and entries of the result.
        """
        n_batches = len(batches)
        in_sizes, out_sizes = (
            np.array([getattr(kernel, size) * lanes for kernel, lanes, _ in batches], np.intp)
            for size in ("n_local", "n_out")
        )
        starts = np.cumsum(in_sizes) - in_sizes
        by_batch = np.lexsort((entries.rows, entries.batches))
        plain, weighted = _partition(by_batch, entries.is_plain)
        target = inputs.targets
        is_single = np.bincount(target, minlength=1)[target] == 1
        by_target = np.argsort(target, kind="stable")
        picks, gathers = _partition(by_target, (inputs.weights == 1.0) & is_single)
        input_batch = np.searchsorted(starts, target, "right") - 1
        sorted_batches = (
            *(input_batch[order] for order in (picks, gathers)),
            *(entries.batches[order] for order in (plain, weighted)),
        )
        table = [starts, [lanes for _, lanes, _ in batches]]
        table += [np.searchsorted(x, np.arange(n_batches), "right") for x in sorted_batches]
        kernels = zip(batches, starts.tolist(), strict=True)
        return cls(
            n_shared=n_shared,
            n_local=int(in_sizes.sum()),
            n_out=int(max([n_shared + 1, *out_sizes])),
            data_targets=_to_unsigned(data[0]),
            data_sources=_to_unsigned(data[1]),
            batches=tuple(Batch(kernel, start, *sizes) for (kernel, *sizes), start in kernels),
            batch_table=np.ascontiguousarray(np.array(table, np.int64).reshape(6, -1).T),
            pick_targets=_to_unsigned(target[picks]),
            pick_sources=_to_unsigned(inputs.sources[picks]),
            gather_targets=_to_unsigned(target[gathers]),
            gather_sources=_to_unsigned(inputs.sources[gathers]),
            gather_weights=inputs.weights[gathers],
            add_targets=_to_unsigned(entries.rows[plain]),
            add_sources=_to_unsigned(entries.sources[plain]),
            weighted_targets=_to_unsigned(entries.rows[weighted]),
            weighted_sources=_to_unsigned(entries.sources[weighted]),
            weights=entries.weights[weighted],
        )

    def with_kernels(
        self, kernels: Sequence[Kernel], data_targets: Array, inputs: Inputs, entries: Entries
    ) -> SumPlan:
        """Return the plan of other kernels of the same copies."""
        batches = [(x, b.lanes, b.copies) for x, b in zip(kernels, self.batches, strict=True)]
        data = data_targets, self.data_sources
        return SumPlan.of(self.n_shared, batches, data, inputs, entries)

    @property
    def sizes(self) -> tuple[Array, Array]:
        """Numbers of local inputs and of outputs of each batch."""
        sizes = [(b.kernel.n_local * b.lanes, b.kernel.n_out * b.lanes) for b in self.batches]
        n_local, n_out = np.array(sizes, np.intp).reshape(-1, 2).T
        return n_local, n_out

    def batch_of(self, targets: Array) -> Array:
        """Return the batch of positions in `Sum.local`."""
        return np.searchsorted(self.batch_table[:, START], targets, "right") - 1

    @property
    def inputs(self) -> Inputs:
        """Inputs of the copies: those that are picked, then those that are gathered."""
        targets, sources = (
            np.concatenate(x).astype(np.intp)
            for x in (
                (self.pick_targets, self.gather_targets),
                (self.pick_sources, self.gather_sources),
            )
        )
        ones = np.ones(len(self.pick_targets))
        return Inputs(targets, sources, np.concatenate([ones, self.gather_weights]))

    @property
    def entries(self) -> Entries:
        """Entries of the outputs of batches, without `shared` and the 1: plain ones come first."""
        ends = self.batch_table[:, [ADD_END, WEIGHTED_END]].T
        columns = (
            (self.add_targets, self.add_sources, np.ones(len(self.add_targets))),
            (self.weighted_targets, self.weighted_sources, self.weights),
        )
        parts = []
        for is_plain, end, (rows, sources, weights) in zip(
            (True, False), ends, columns, strict=True
        ):
            count = int(end[-1]) if len(end) else 0
            batches = np.searchsorted(end, np.arange(count), "right")
            row, source = (x[:count].astype(np.intp) for x in (rows, sources))
            parts.append(Entries(row, batches, source, weights[:count], np.full(count, is_plain)))
        return cast("Entries", join(*parts))

    def load_native(self, compiles: bool) -> bool:
        """Return True if there is machine code of all kernels, in the cache or compiled."""
        return all(batch.kernel.load_native(compiles) is not None for batch in self.batches)

    def sum(self, native: bool, p: Array) -> Sum:
        """Return the sum with new buffers and the data of a model.

        Parameters
        ----------
        native
            True to run kernels as machine code where possible, False to run them in CasADi's
            virtual machine, except for large ones.
        p
            Numbers of the model; `data_sources` selects the data of the copies.
        """
        owners = (x.kernel.native if native else _find_code(x) for x in self.batches)
        pairs = zip(owners, self.batches, strict=True)
        code_owners: tuple[Any, ...] = tuple(owner or InterpretedKernel(x) for owner, x in pairs)
        addresses = [kernel.address for kernel in code_owners]
        return self.allocate(addresses, p, load_core() is not None, code_owners)

    def allocate(
        self, kernels: Sequence[int], p: Array, tiled: bool, code_owners: tuple[Any, ...] = ()
    ) -> Sum:
        """Return the sum as `sum`, with the addresses of the functions of its batches."""
        total = Sum(
            shared=np.zeros(self.n_shared),
            local=aligned_zeros(self.n_local),
            out=aligned_zeros(self.n_out),
            kernels=np.array(kernels, np.int64),
            gather_targets=self.gather_targets,
            gather_sources=self.gather_sources,
            gather_weights=self.gather_weights,
            add_targets=self.add_targets,
            add_sources=self.add_sources,
            weighted_targets=self.weighted_targets,
            weighted_sources=self.weighted_sources,
            weights=self.weights,
            code_owners=code_owners,
            **(self._tiled_entries if tiled else self._untiled_entries),
        )
        self.set_data(total, p)
        return total

    def set_data(self, total: Sum, p: Array) -> None:
        """Set the data of a model in a sum of this plan."""
        # Indexing with empty arrays takes as long as with a few numbers.
        if len(self.data_sources):
            total.local[self.data_targets] = p[self.data_sources]

    @cached_property
    def _tiled_entries(self) -> dict[str, Array]:
        """Fields of `Sum` that depend on tiles."""
        inputs = [BatchRows(x.kernel.n_local, x.lanes, x.copies) for x in self.batches]
        targets, sources = (x.astype(np.intp) for x in (self.pick_targets, self.pick_sources))
        tiles = find_tiles(inputs, targets, sources)
        batches = np.column_stack([self.batch_table, tiles.ends])
        batches[:, PICK_END] -= np.append(0, np.cumsum(tiles.covered))[batches[:, PICK_END]]
        return {
            "batches": np.ascontiguousarray(batches, np.int64),
            "pick_targets": self.pick_targets[~tiles.covered],
            "pick_sources": self.pick_sources[~tiles.covered],
            "pick_tiles": tiles.table,
        }

    @cached_property
    def _untiled_entries(self) -> dict[str, Array]:
        """Fields of `Sum` without tiles."""
        return {
            "batches": np.column_stack([self.batch_table, np.zeros(len(self.batches), int)]),
            "pick_targets": self.pick_targets,
            "pick_sources": self.pick_sources,
            "pick_tiles": np.zeros((0, 2 + LANE_WIDTH), np.uint32),
        }

    @cached_property
    def operators(self) -> tuple[sp.csr_array, sp.csr_array]:
        """Matrices that gather x in `local`, and add the outputs of all batches to the result.

        Batches are in order, (component, copy) within each of them. Shared numbers are not added.
        """
        inputs, entries, (_, sizes) = self.inputs, self.entries, self.sizes
        columns = (np.cumsum(sizes) - sizes)[entries.batches] + entries.sources
        return (
            _matrix(inputs.weights, inputs.targets, inputs.sources, height=self.n_local),
            _matrix(entries.weights, entries.rows, columns, width=int(sizes.sum())),
        )


def _matrix(
    values: Array, rows: Array, columns: Array, height: int | None = None, width: int | None = None
) -> sp.csr_array:
    """Return the sum of entries, as large as necessary by default."""
    height = int(rows.max(initial=-1)) + 1 if height is None else height
    width = int(columns.max(initial=-1)) + 1 if width is None else width
    return sp.csr_array((values, (rows, columns)), shape=(height, width))


def _partition(order: Array, condition: Array) -> tuple[Array, Array]:
    """Split indices by a condition: those that satisfy it and the rest, in the given order."""
    return order[condition[order]], order[~condition[order]]


def _to_unsigned(numbers: Array) -> Array:
    # Compiled loops check signed indices for wrap-around from the end.
    return numbers.astype(np.uint32)


def _find_code(batch: Batch) -> LaneKernel | None:
    """Return the machine code of a large kernel: if it is a loop, always, else from the cache.

    Loops add numbers in another order, so that results would depend on the state of the cache.
    """
    kernel = batch.kernel
    if kernel.source.n_instructions() <= _MIN_INSTRUCTIONS_OF_CACHED_CODE:
        return None
    return kernel.load_native(compiles=kernel.loops is not None)


class InterpretedKernel:
    """Kernel of a batch, evaluated for all copies by CasADi's virtual machine.

    Attributes
    ----------
    address, n_local, n_out
        As of `LaneKernel`.
    """

    def __init__(self, batch: Batch) -> None:
        kernel, lanes = batch.kernel, batch.lanes
        self.n_local, self.n_out = kernel.n_local, kernel.n_out
        shapes = (kernel.source.numel_in(0),), (self.n_local, lanes), (self.n_out, lanes)
        self._evaluate = evaluate = _create_evaluator(batch)
        views: dict[tuple[int, int, int], list[Array]] = {}

        def call(shared: int, local: int, out: int, lanes: int) -> None:
            addresses = shared, local, out
            if addresses not in views:
                arrays = [_view_of(*x) for x in zip(addresses, shapes, strict=True)]
                keep_latest(views, addresses, arrays)
            try:
                evaluate(*views[addresses])
            except BaseException:
                # The caller is C: ctypes prints the exception, and the numbers end the step.
                views[addresses][2][:] = np.nan
                raise

        self._callback = KERNEL_SIGNATURE(call)
        self.address = ctypes.cast(self._callback, ctypes.c_void_p).value

    def __call__(self, shared: Array, local: Array, out: Array) -> None:
        """Write the outputs of all copies to `out`, from the inputs in `local`."""
        self._evaluate(shared, local, out)


def _create_evaluator(batch: Batch) -> Callable[[Array, Array, Array], None]:
    """Return a function of (shared, local, out) that evaluates a kernel for all its copies."""
    kernel, count, linear_from = batch.kernel, batch.copies, batch.kernel.linear_from
    compiled = Compiled(kernel.map_copies(count))
    # Views of the buffers. Further copies would take as long as a small kernel.
    shared_buffer, copies = compiled.inputs
    inputs = copies.reshape(count, kernel.n_local).T
    outputs = compiled.outputs[0].reshape(count, kernel.n_out).T

    def evaluate(shared: Array, local: Array, out: Array) -> None:
        if linear_from is not None and not local[linear_from:, :count].any():
            # A parameter changes few kernels of the start of a run.
            out[:] = 0.0
            return
        shared_buffer[:] = shared
        inputs[:] = local[:, :count]
        compiled()
        out[:, :count] = outputs

    return evaluate


def _view_of(address: int | None, shape: tuple[int, ...]) -> Array:
    """Return a view of numbers at an address."""
    size = int(np.prod(shape))
    if not size or address is None:
        return np.zeros(shape)
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address)).reshape(shape)


def set_time(total: SharedInputs, t: float, branch: float) -> None:
    """Set the time at which laws are evaluated, and the time that selects the pieces of laws."""
    total.shared[SHARED_T] = t
    total.shared[SHARED_BRANCH] = branch


def set_matrix_factors(
    total: SharedInputs, c_q: float, c_v: float, c_a: float, c_l: float, c_h: float, c_r: float
) -> None:
    """Set the factors of the parts of a matrix, see `local_symbols.MatrixFactors`."""
    total.shared[C_Q:] = c_q, c_v, c_a, c_l, c_h, c_r


def evaluate_sum(total: Sum, x: Array, result: Array) -> None:
    """Write the sum at x into `result`, with the time and factors in `total.shared`."""
    if load_core() is not None:
        Loop("run_evaluation", Workspace("Evaluation", total=total, x=x, result=result))()
    else:
        evaluate_plainly(total, x, result)


def evaluate_plainly(total: Sum, x: Array, result: Array) -> None:
    """Write the sum at x into `result` without the core."""
    local, out, n_shared = total.local, total.out, len(total.shared)
    local[total.pick_targets] = x[total.pick_sources]
    local[total.gather_targets] = 0.0
    np.add.at(local, total.gather_targets, total.gather_weights * x[total.gather_sources])
    result[:] = 0.0
    add_begin = weighted_begin = 0

    def add(add_end: int, weighted_end: int) -> None:
        at = slice(add_begin, add_end)
        np.add.at(result, total.add_targets[at], out[total.add_sources[at]])
        at = slice(weighted_begin, weighted_end)
        values = total.weights[at] * out[total.weighted_sources[at]]
        np.add.at(result, total.weighted_targets[at], values)

    for kernel, row in zip(total.code_owners, total.batches.tolist(), strict=True):
        start, lanes, _, _, add_end, weighted_end, *_ = row
        inputs = local[start : start + kernel.n_local * lanes].reshape(kernel.n_local, lanes)
        kernel(total.shared, inputs, out[: kernel.n_out * lanes].reshape(kernel.n_out, lanes))
        add(add_end, weighted_end)
        add_begin, weighted_begin = add_end, weighted_end
    out[:n_shared], out[n_shared] = total.shared, 1.0
    add(len(total.add_targets), len(total.weighted_targets))
