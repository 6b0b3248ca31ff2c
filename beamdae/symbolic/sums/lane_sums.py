"""Sums of kernels for several inputs at once, one per vector lane.

The matrices of successive steps of a known run do not depend on each other. With one step per lane,
kernels with few copies fill all lanes, and their outputs are added by vectors.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from beamdae.linear.lane_operations import LANES, add_entry, aligned_zeros, set_entry
from beamdae.native.loop_functions import call_kernel
from beamdae.symbolic.sums.kernel_sums import (
    ADD_END,
    WEIGHTED_END,
    Batch,
    InterpretedKernel,
    SumPlan,
)

Array = np.ndarray

# Columns of `LaneSum.copies`: index of the kernel, first entry of its inputs in `local`, and the
# ends of its entries in `set_targets` and `add_targets`.
_KERNEL = 0
_START = 1
_SET_END = 2
_ADD_END = 3


@dataclass(slots=True)
class LaneSum:
    """Arrays and buffers of a sum with lanes; argument of `evaluate_lanes`.

    Arrays of lanes hold the first entry of all lanes, then the second one; indices are those of
    entries.

    Attributes
    ----------
    shared
        As in `Sum`, without the time.
    times
        Times, one per lane [s].
    x
        Inputs, with lanes.
    local
        Inputs of the copies, one copy after the other, with lanes.
    out
        Outputs of the current copy, with lanes; after the last copy, `shared` and a 1.
    kernels
        As in `Sum`.
    copies
        One row per copy, with the columns `_KERNEL` to `_ADD_END`. Further entries read `shared`.
    input_targets, input_sources, input_weights
        local[input_targets] = input_weights x[input_sources].
    more_targets, more_sources, more_weights
        Terms that are added to inputs.
    time_targets
        Inputs that are the time.
    set_targets, set_sources, set_weights
        result[set_targets] = set_weights out[set_sources].
    add_targets, add_sources, add_weights
        Outputs that are added to results after they have been set.
    code_owners
        As in `Sum`.
    """

    shared: Array
    times: Array
    x: Array
    local: Array
    out: Array
    kernels: Any
    copies: Array
    input_targets: Array
    input_sources: Array
    input_weights: Array
    more_targets: Array
    more_sources: Array
    more_weights: Array
    time_targets: Array
    set_targets: Array
    set_sources: Array
    set_weights: Array
    add_targets: Array
    add_sources: Array
    add_weights: Array
    code_owners: tuple[Any, ...]


def has_lane_code(plan: SumPlan) -> bool:
    """Return True if machine code of all kernels with lanes is available."""
    return all(batch.kernel.with_local_time.native is not None for batch in plan.batches)


def create_lane_sum(plan: SumPlan, n_inputs: int, native: bool, p: Array) -> LaneSum:
    """Return the sum of a plan with lanes, and new buffers.

    Parameters
    ----------
    plan
        The sum. Every entry of its result must have a term.
    n_inputs
        Number of inputs x.
    native, p
        See `SumPlan.sum`.
    """
    layout = dict(plan.cache_layout(_lay_out_lanes))
    weights = np.concatenate([np.ones(len(plan.pick_targets)), plan.gather_weights])
    input_weights, more_weights = (weights[layout.pop(x)] for x in ("input_terms", "more_terms"))
    weights = np.concatenate([np.ones(len(plan.add_targets)), plan.weights])
    set_weights, add_weights = (weights[layout.pop(x)] for x in ("set_terms", "add_terms"))
    kernels_of_batches = [batch.kernel.with_local_time for batch in plan.batches]
    data_targets, data_terms = layout.pop("data_targets"), layout.pop("data_terms")
    n_local, n_out = (int(x) for x in layout.pop("sizes"))
    copies = layout["copies"]
    kernels: Any
    code_owners: tuple[Any, ...] = ()
    if native:
        code_owners = tuple(kernel.native for kernel in kernels_of_batches)
        kernels = np.array([kernel.address for kernel in code_owners], np.int64)
    else:
        kernels = [
            InterpretedKernel(Batch(kernels_of_batches[k], LANES * start, LANES, LANES))
            for k, start in copies[:, [_KERNEL, _START]].tolist()
        ]
        copies = copies.copy()
        copies[:, _KERNEL] = np.arange(len(copies))
        layout["copies"] = copies
    local = aligned_zeros(LANES * n_local)
    local.reshape(-1, LANES)[data_targets] = p[plan.data_sources[data_terms], None]
    return LaneSum(
        shared=np.zeros(plan.n_shared),
        times=np.zeros(LANES),
        x=aligned_zeros(LANES * n_inputs),
        local=local,
        out=aligned_zeros(LANES * n_out),
        kernels=kernels,
        input_weights=input_weights,
        more_weights=more_weights,
        set_weights=set_weights,
        add_weights=add_weights,
        code_owners=code_owners,
        **layout,
    )


def empty_lane_sum() -> LaneSum:
    """Return the sum without copies, in place of one that is not used."""
    numbers, indices = np.zeros(0), np.zeros(0, np.int64)
    arrays: dict[str, Any] = {
        x.name: indices if x.name.endswith(("targets", "sources")) else numbers
        for x in fields(LaneSum)
    }
    return LaneSum(
        **{**arrays, "kernels": indices, "copies": np.zeros((0, 4), np.int64), "code_owners": ()}
    )


def _lay_out_lanes(plan: SumPlan) -> dict[str, Array]:
    """Return the arrays of a `LaneSum` and, as `*_terms`, the indices of terms of the plan."""
    starts = np.array([b.start for b in plan.batches], np.intp)
    lanes, n_copies = (np.array([b[k] for b in plan.batches], np.intp) for k in (2, 3))
    kernels = [b.kernel.with_local_time for b in plan.batches]
    heights = np.array([kernel.n_local for kernel in kernels], np.intp)
    is_timed = heights > np.array([b.kernel.n_local for b in plan.batches], np.intp)
    batch_of_copy = np.repeat(np.arange(len(starts)), n_copies)
    first_copy = np.cumsum(n_copies) - n_copies
    copy_starts = np.cumsum(heights[batch_of_copy]) - heights[batch_of_copy]

    def locate(batch: Array, positions: Array) -> tuple[Array, Array, Array]:
        """Return the copies and rows of positions in batches, and a mask without padding."""
        row, lane = np.divmod(positions, lanes[batch])
        return first_copy[batch] + lane, row, lane < n_copies[batch]

    def locate_inputs(targets: Array) -> tuple[Array, Array]:
        """Return the entries of local inputs, and the indices of those that are not padding."""
        targets = targets.astype(np.intp)
        batch = np.searchsorted(starts, targets, "right") - 1
        copy, row, is_copy = locate(batch, targets - starts[batch])
        terms = np.flatnonzero(is_copy)
        return copy_starts[copy[terms]] + row[terms], terms

    inputs, terms = locate_inputs(np.concatenate([plan.pick_targets, plan.gather_targets]))
    sources = np.concatenate([plan.pick_sources, plan.gather_sources])[terms]
    is_first = _mark_first(inputs)
    data_targets, data_terms = locate_inputs(plan.data_targets)
    rows, outputs, copies = [], [], []
    for column, targets, columns in (
        (ADD_END, plan.add_targets, plan.add_sources),
        (WEIGHTED_END, plan.weighted_targets, plan.weighted_sources),
    ):
        batch = np.searchsorted(plan.batch_table[:, column], np.arange(len(targets)), "right")
        copy, row = np.full(len(targets), len(batch_of_copy)), columns.astype(np.intp)
        of_copy = batch < len(starts)
        copy[of_copy], row[of_copy], _ = locate(batch[of_copy], row[of_copy])
        rows.append(targets.astype(np.intp))
        outputs.append(row)
        copies.append(copy)
    # By copies; within a copy, plain terms precede weighted ones.
    copy = np.concatenate(copies)
    order = np.argsort(copy, kind="stable")
    target, output, copy = np.concatenate(rows)[order], np.concatenate(outputs)[order], copy[order]
    is_set = _mark_first(target)
    ends = [
        np.searchsorted(copy[mask], np.arange(len(batch_of_copy)), "right")
        for mask in (is_set, ~is_set)
    ]
    table = np.column_stack([batch_of_copy, copy_starts, *ends])
    n_local = int(heights[batch_of_copy].sum())
    n_out = max([plan.n_shared + 1, *(kernel.n_out for kernel in kernels)])
    return {
        "copies": np.ascontiguousarray(table, np.int64),
        "input_targets": inputs[is_first],
        "input_sources": sources[is_first].astype(np.intp),
        "input_terms": terms[is_first],
        "more_targets": inputs[~is_first],
        "more_sources": sources[~is_first].astype(np.intp),
        "more_terms": terms[~is_first],
        "time_targets": (copy_starts + heights[batch_of_copy] - 1)[is_timed[batch_of_copy]],
        "set_targets": target[is_set],
        "set_sources": output[is_set],
        "set_terms": order[is_set],
        "add_targets": target[~is_set],
        "add_sources": output[~is_set],
        "add_terms": order[~is_set],
        "data_targets": data_targets,
        "data_terms": data_terms,
        "sizes": np.array([n_local, n_out]),
    }


def _mark_first(targets: Array) -> Array:
    """Return a mask of the entries whose value does not occur earlier."""
    result = np.zeros(len(targets), bool)
    result[np.unique(targets, return_index=True)[1]] = True
    return result


def evaluate_lanes(total: LaneSum, result: Array) -> None:
    """Write the sums at the inputs `total.x` into the first entries of `result`, with lanes."""
    x, local, out, copies = total.x, total.local, total.out, total.copies
    targets, sources = total.input_targets, total.input_sources
    for k in range(targets.size):
        set_entry(local, targets[k], x, sources[k], total.input_weights[k])
    targets, sources = total.more_targets, total.more_sources
    for k in range(targets.size):
        add_entry(local, targets[k], x, sources[k], total.more_weights[k])
    for k in range(total.time_targets.size):
        set_entry(local, total.time_targets[k], total.times, 0, 1.0)
    set_begin, add_begin = 0, 0
    for k in range(copies.shape[0]):
        set_end, add_end = copies[k, _SET_END], copies[k, _ADD_END]
        start = LANES * copies[k, _START]
        call_kernel(total.kernels, copies[k, _KERNEL], total.shared, local, start, out, LANES)
        _move_outputs(total, result, set_begin, set_end, add_begin, add_end)
        set_begin, add_begin = set_end, add_end
    n_shared = total.shared.size
    for k in range(n_shared):
        for lane in range(LANES):
            out[LANES * k + lane] = total.shared[k]
    for lane in range(LANES):
        out[LANES * n_shared + lane] = 1.0
    set_end, add_end = total.set_targets.size, total.add_targets.size
    _move_outputs(total, result, set_begin, set_end, add_begin, add_end)


def _move_outputs(
    total: LaneSum, result: Array, set_begin: int, set_end: int, add_begin: int, add_end: int
) -> None:
    """Set and add the outputs of the current copy."""
    out, weights = total.out, total.set_weights
    targets, sources = total.set_targets, total.set_sources
    for k in range(set_begin, set_end):
        set_entry(result, targets[k], out, sources[k], weights[k])
    targets, sources, weights = total.add_targets, total.add_sources, total.add_weights
    for k in range(add_begin, add_end):
        add_entry(result, targets[k], out, sources[k], weights[k])
