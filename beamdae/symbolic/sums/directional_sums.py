"""Directional derivatives of sums of kernels with respect to their inputs and their data.

For a sum r = S k(shared, L x, p), the derivative along (dx, dp) is the sum

    dr = S (dk/dlocal (L dx) + dk/dp dp)

over the same copies. Its kernels are Jacobian-vector products of the kernels k, so that no residual
is differenced. Shared numbers, such as time and matrix factors, are constant.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np

from beamdae.linear.lanes import aligned_zeros
from beamdae.native.instructions import expand_powers
from beamdae.symbolic.functions.table_lookups import directional_derivative, has_lookups
from beamdae.symbolic.sums.kernel_sums import (
    ADD_END,
    GATHER_END,
    PICK_END,
    START,
    WEIGHTED_END,
    Batch,
    Kernel,
    SumPlan,
)
from beamdae.symbolic.sums.vector_sines import expand_sines

Array = np.ndarray
SX = ca.SX


def directional_plan(
    plan: SumPlan,
    n_inputs: int,
    weight_changes: tuple[Array, Array] | None = None,
) -> SumPlan:
    """Return the plan of the directional derivative of a sum.

    Parameters
    ----------
    plan
        The sum, with inputs x of size `n_inputs`.
    n_inputs
        Size of x.
    weight_changes
        Derivatives of `gather_weights` and of `weights` of the plan, if L and S depend on the
        parameter of the direction: dr also contains S dk/dlocal dL x + dS k. None if they do not.

    Returns
    -------
    SumPlan
        Sum with the inputs (x, dx, dp), where p are the numbers of the model. `SumPlan.sum` of the
        result takes p, as the original sum does.
    """
    table = plan.batch_table.copy()
    n_add, n_weighted = table[-1, [ADD_END, WEIGHTED_END]] if len(table) else (0, 0)
    gather_changes, changes = np.zeros(len(plan.gather_weights)), np.zeros(n_weighted)
    if weight_changes is not None:
        gather_changes, changes = weight_changes[0], weight_changes[1][:n_weighted]
    (changed,) = np.nonzero(changes)
    entry_batch = np.searchsorted(table[:, WEIGHTED_END], np.arange(n_weighted), "right")
    with_value = np.isin(np.arange(len(plan.batches)), entry_batch[changed])
    valued = {id(b.kernel) for b, x in zip(plan.batches, with_value, strict=True) if x}
    kernels = {
        id(b.kernel): _directional_kernel(b.kernel, id(b.kernel) in valued) for b in plan.batches
    }
    # Each batch has twice as many local inputs: those of the original batch, then their tangents.
    batches = tuple(
        Batch(kernels[id(b.kernel)], 2 * b.start, b.lanes, b.copies) for b in plan.batches
    )
    starts = np.array([b.start for b in plan.batches], int)
    sizes = np.array([b.kernel.n_local * b.lanes for b in plan.batches], int)

    def locate(targets: Array) -> tuple[Array, Array, Array]:
        """Return the batch of local inputs, and the new positions of values and tangents."""
        targets = targets.astype(np.intp)
        batch = np.searchsorted(starts, targets, "right") - 1
        value = targets + starts[batch]
        return batch, value, value + sizes[batch]

    pick_batch, pick_value, pick_tangent = locate(plan.pick_targets)
    data_batch, data_value, data_tangent = locate(plan.data_targets)
    gather_batch, gather_value, gather_tangent = locate(plan.gather_targets)
    pick_source, gather_source = (
        x.astype(np.intp) for x in (plan.pick_sources, plan.gather_sources)
    )
    pick_order, pick_ends = group_by_batch(len(starts), pick_batch, pick_batch, data_batch)
    (moving,) = np.nonzero(gather_changes)
    gather_order, gather_ends = group_by_batch(
        len(starts), gather_batch, gather_batch, gather_batch[moving]
    )
    # Values follow the derivatives in the outputs of a batch.
    value_start = np.array([b.kernel.n_out * b.lanes for b in plan.batches], int)
    weighted_order, weighted_ends = group_by_batch(len(starts), entry_batch, entry_batch[changed])
    weighted_sources = plan.weighted_sources[:n_weighted].astype(np.intp)
    weighted_sources = np.concatenate(
        [
            weighted_sources,
            weighted_sources[changed] + value_start[entry_batch[changed]],
        ]
    )
    weighted_targets, weights = (
        np.concatenate([x[:n_weighted], y[changed]])
        for x, y in (
            (plan.weighted_targets, plan.weighted_targets[:n_weighted]),
            (plan.weights, changes),
        )
    )
    pick_targets = np.concatenate([pick_value, pick_tangent, data_tangent])
    pick_sources = np.concatenate(
        [pick_source, pick_source + n_inputs, plan.data_sources.astype(np.intp) + 2 * n_inputs]
    )
    gather_targets = np.concatenate([gather_value, gather_tangent, gather_tangent[moving]])
    gather_sources = np.concatenate(
        [gather_source, gather_source + n_inputs, gather_source[moving]]
    )
    gather_weights = np.concatenate(
        [plan.gather_weights, plan.gather_weights, gather_changes[moving]]
    )
    table[:, START] *= 2
    table[:, PICK_END], table[:, GATHER_END] = pick_ends, gather_ends
    table[:, WEIGHTED_END] = weighted_ends
    # Entries beyond the last batch add shared numbers, which are constant.
    return replace(
        plan,
        n_local=2 * plan.n_local,
        n_out=max([plan.n_out, *(b.kernel.n_out * b.lanes for b in batches)]),
        data_targets=data_value.astype(np.uint32),
        batches=batches,
        batch_table=table,
        pick_targets=pick_targets[pick_order].astype(np.uint32),
        pick_sources=pick_sources[pick_order].astype(np.uint32),
        gather_targets=gather_targets[gather_order].astype(np.uint32),
        gather_sources=gather_sources[gather_order].astype(np.uint32),
        gather_weights=gather_weights[gather_order],
        add_targets=plan.add_targets[:n_add],
        add_sources=plan.add_sources[:n_add],
        weighted_targets=weighted_targets[weighted_order].astype(np.uint32),
        weighted_sources=weighted_sources[weighted_order].astype(np.uint32),
        weights=weights[weighted_order],
    )


def motion_plan(plan: SumPlan, n_inputs: int) -> SumPlan:
    """Return a `directional_plan` that does not gather dp, for `evaluate_with_data`.

    `n_inputs` is the size of x. Many more numbers belong to the data of copies than to their
    motion; those of a direction are the same in all steps, see `direction_inputs`.
    """
    table, is_motion = plan.batch_table.copy(), plan.pick_sources < 2 * n_inputs
    table[:, PICK_END] = np.concatenate([[0], np.cumsum(is_motion)])[table[:, PICK_END]]
    return replace(
        plan,
        batch_table=table,
        pick_targets=plan.pick_targets[is_motion],
        pick_sources=plan.pick_sources[is_motion],
    )


def direction_inputs(plan: SumPlan, n_inputs: int, p: Array, numbers: Array) -> Array:
    """Return the array `local` of each direction for `evaluate_with_data`, (k, n_local).

    Parameters
    ----------
    plan, n_inputs
        Result of `directional_plan`, and the size of x.
    p, numbers
        Numbers of the model, and their derivatives dp, one direction a row.
    """
    local = aligned_zeros(len(numbers) * plan.n_local).reshape(len(numbers), plan.n_local)
    local[:, plan.data_targets] = p[plan.data_sources]
    is_data = plan.pick_sources >= 2 * n_inputs
    sources = plan.pick_sources[is_data].astype(np.intp) - 2 * n_inputs
    local[:, plan.pick_targets[is_data]] = numbers[:, sources]
    return local


class StackedSum:
    """Directional derivative for several directions together, in CasADi's virtual machine.

    Parameters
    ----------
    plan
        Result of `directional_plan`.
    p
        Numbers of the model.
    """

    def __init__(self, plan: SumPlan, p: Array) -> None:
        self._plan, self._data = plan, p[plan.data_sources]
        self._shared = np.zeros(plan.n_shared)

    def __call__(self, time: Array, x: Array, size: int) -> Array:
        """Return the derivatives (..., size) at (t, branch) for inputs (..., n)."""
        self._shared[: len(time)] = time
        plan, rows = self._plan, x.reshape(-1, x.shape[-1])
        count = len(rows)
        gather, scatter = plan.operators
        local = gather @ rows.T[: gather.shape[1]]
        local[plan.data_targets] = self._data[:, None]
        out, first = np.zeros((scatter.shape[1], count)), 0
        for kernel, start, lanes, copies in plan.batches:
            shapes = [(height, lanes, count) for height in (kernel.n_local, kernel.n_out)]
            inputs = local[start : start + kernel.n_local * lanes].reshape(shapes[0])[:, :copies]
            outputs = out[first : first + kernel.n_out * lanes].reshape(shapes[1])[:, :copies]
            first += kernel.n_out * lanes
            changing = np.ones((copies, count), bool)
            if kernel.linear_from is not None:
                # A direction changes few kernels.
                changing = inputs[kernel.linear_from :].any(axis=0)
            if changing.any():
                outputs[:, changing] = kernel.rows(self._shared, inputs[:, changing].T).T
        result = np.zeros((count, size))
        result[:, : scatter.shape[0]] = (scatter @ out).T
        return result.reshape(*x.shape[:-1], size)


def group_by_batch(count: int, *batches: Array) -> tuple[Array, Array]:
    """Return the order that sorts entries by batch, and the end of each batch in this order."""
    batch = np.concatenate(batches)
    order = np.argsort(batch, kind="stable")
    return order, np.searchsorted(batch[order], np.arange(count), "right")


def _directional_kernel(kernel: Kernel, with_value: bool) -> Kernel:
    """Return the kernel of (shared, (local, tangent)) for the derivative along the tangent.

    If `with_value`, the outputs of `kernel` follow.
    """
    key = "directional", with_value
    return kernel.derive(key, partial(_build_directional_kernel, kernel, with_value))


def _build_directional_kernel(kernel: Kernel, with_value: bool) -> Kernel:
    function = kernel.function
    shared = SX.sym("shared", function.numel_in(0))
    local, tangent = SX.sym("local", kernel.n_local), SX.sym("tangent", kernel.n_local)
    value = expand_powers(function, shared, local)
    differentiate = directional_derivative if has_lookups(function) else ca.jtimes
    derivative = ca.densify(differentiate(value, local, tangent))
    results = ca.vertcat(derivative, value) if with_value else derivative
    (results,) = ca.cse([results])
    directional = ca.Function(
        f"{function.name()}_directional", [shared, ca.vertcat(local, tangent)], [results]
    )
    directional = expand_sines(directional, is_derivative=True)
    if with_value:
        return Kernel(directional, kernel.outputs * 2)
    return Kernel(directional, kernel.outputs, linear_from=kernel.n_local)
