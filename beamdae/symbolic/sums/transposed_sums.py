"""Transposed derivatives of sums of kernels with respect to their inputs and their data.

For a sum r = S k(shared, L x, p) and weights y of its rows, the gradient of y . r is the sum

    (dx, dp) = (L^T, I) [dk/dlocal, dk/dp]^T S^T y

over the same copies: gathering and scattering change places. It is the transpose of the derivative
in `directional_sums`. Shared numbers, such as time and matrix factors, are constant.
"""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np

from beamdae.native.instructions import expand_powers
from beamdae.symbolic.functions.table_lookups import has_lookups, weighted_derivative
from beamdae.symbolic.sums.directional_sums import group_by_batch
from beamdae.symbolic.sums.kernel_sums import ADD_END, LANES, WEIGHTED_END, Batch, Kernel, SumPlan
from beamdae.symbolic.sums.vector_sines import expand_sines

Array = np.ndarray
SX = ca.SX


def transposed_plan(plan: SumPlan, n_inputs: int) -> SumPlan:
    """Return the plan of the gradient of y . r with respect to the inputs and the numbers.

    Parameters
    ----------
    plan
        The sum r, with inputs x of size `n_inputs`.
    n_inputs
        Size of x.

    Returns
    -------
    SumPlan
        Sum with the inputs (x, y) and the result (dx, dp), where p are the numbers of the model.
        `SumPlan.sum` of the result takes p, as the original sum does.
    """
    kernels = {id(b.kernel): _transposed_kernel(b.kernel) for b in plan.batches}
    starts = np.array([b.start for b in plan.batches], int)
    local_sizes = np.array([b.kernel.n_local * b.lanes for b in plan.batches], int)
    out_sizes = np.array([b.kernel.n_out * b.lanes for b in plan.batches], int)
    # The weights of the outputs of a batch follow its local inputs.
    shifts = np.cumsum(out_sizes) - out_sizes
    weight_starts = starts + shifts + local_sizes
    batches = tuple(
        Batch(kernels[id(b.kernel)], int(b.start + shift), b.lanes, b.copies)
        for b, shift in zip(plan.batches, shifts, strict=True)
    )
    count = len(batches)

    def locate(targets: Array) -> tuple[Array, Array, Array]:
        """Return the batch of local inputs, their new positions, and those among its outputs."""
        targets = targets.astype(np.intp)
        batch = np.searchsorted(starts, targets, "right") - 1
        return batch, targets + shifts[batch], targets - starts[batch]

    pick_batch, pick_value, pick_output = locate(plan.pick_targets)
    gather_batch, gather_value, gather_output = locate(plan.gather_targets)
    data_batch, data_value, data_output = locate(plan.data_targets)
    pick_source, gather_source, data_source = (
        x.astype(np.intp) for x in (plan.pick_sources, plan.gather_sources, plan.data_sources)
    )
    # Rows of y per output. Entries beyond the last batch add shared numbers, which are constant.
    n_add, n_weighted = plan.batch_table[-1, [ADD_END, WEIGHTED_END]] if count else (0, 0)
    row = np.concatenate([plan.add_targets[:n_add], plan.weighted_targets[:n_weighted]])
    output = np.concatenate([plan.add_sources[:n_add], plan.weighted_sources[:n_weighted]])
    weight = np.concatenate([np.ones(n_add), plan.weights[:n_weighted]])
    row_batch = np.concatenate(
        [
            np.searchsorted(plan.batch_table[:, column], np.arange(size), "right")
            for column, size in ((ADD_END, n_add), (WEIGHTED_END, n_weighted))
        ]
    )
    row, target = row.astype(np.intp) + n_inputs, output + weight_starts[row_batch]
    is_plain = (weight == 1.0) & (np.bincount(target, minlength=1)[target] == 1)
    rest = ~is_plain

    picks = (
        np.concatenate([pick_batch, row_batch[is_plain]]),
        np.concatenate([pick_value, target[is_plain]]),
        np.concatenate([pick_source, row[is_plain]]),
    )
    gathers = (
        np.concatenate([gather_batch, row_batch[rest]]),
        np.concatenate([gather_value, target[rest]]),
        np.concatenate([gather_source, row[rest]]),
        np.concatenate([plan.gather_weights, weight[rest]]),
    )
    # Lanes beyond the copies also have data, but no weights, and their outputs are not defined.
    lanes = np.array([b.lanes for b in plan.batches], int)[data_batch]
    is_copy = data_output % lanes < np.array([b.copies for b in plan.batches], int)[data_batch]
    adds = (
        np.concatenate([pick_batch, data_batch[is_copy]]),
        np.concatenate([pick_source, data_source[is_copy] + n_inputs]),
        np.concatenate([pick_output, data_output[is_copy]]),
    )
    weighted = (gather_batch, gather_source, gather_output, plan.gather_weights)
    ends, sorted_columns = [], []
    for batch, *columns in (picks, gathers, adds, weighted):
        order, end = group_by_batch(count, batch)
        ends.append(end)
        sorted_columns.append([column[order] for column in columns])
    (pick_at, pick_of), (gather_at, gather_of, gather_by), (add_at, add_of), by_weight = (
        sorted_columns
    )
    table = np.stack([starts + shifts, plan.batch_table[:, LANES], *ends], axis=1)
    return SumPlan(
        n_shared=plan.n_shared,
        n_local=int(plan.n_local + out_sizes.sum()),
        n_out=int(max([plan.n_shared + 1, *local_sizes])),
        data_targets=_to_unsigned(data_value),
        data_sources=plan.data_sources,
        batches=batches,
        batch_table=np.ascontiguousarray(table, np.int64),
        pick_targets=_to_unsigned(pick_at),
        pick_sources=_to_unsigned(pick_of),
        gather_targets=_to_unsigned(gather_at),
        gather_sources=_to_unsigned(gather_of),
        gather_weights=gather_by,
        add_targets=_to_unsigned(add_at),
        add_sources=_to_unsigned(add_of),
        weighted_targets=_to_unsigned(by_weight[0]),
        weighted_sources=_to_unsigned(by_weight[1]),
        weights=by_weight[2],
    )


def _to_unsigned(numbers: Array) -> Array:
    # Compiled loops check signed indices for wrap-around from the end.
    return np.ascontiguousarray(numbers, np.uint32)


def _transposed_kernel(kernel: Kernel) -> Kernel:
    """Return the kernel of (shared, (local, weights)) for the gradient of weights . outputs."""
    return kernel.derive("transposed", partial(_build_transposed_kernel, kernel))


def _build_transposed_kernel(kernel: Kernel) -> Kernel:
    function = kernel.function
    shared = SX.sym("shared", function.numel_in(0))
    local, weights = SX.sym("local", kernel.n_local), SX.sym("weights", kernel.n_out)
    value = expand_powers(function, shared, local)
    if has_lookups(function):
        gradient = weighted_derivative(value, local, weights)
    else:
        gradient = ca.jtimes(value, local, weights, True)
    (gradient,) = ca.cse([ca.densify(gradient)])
    transposed = ca.Function(
        f"{function.name()}_transposed", [shared, ca.vertcat(local, weights)], [gradient]
    )
    transposed = expand_sines(transposed, is_derivative=True)
    columns = (ca.Sparsity.dense(kernel.n_local, 1),)
    return Kernel(transposed, columns, linear_from=kernel.n_local)
