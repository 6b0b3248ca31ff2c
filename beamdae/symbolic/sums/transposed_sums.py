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
from beamdae.symbolic.sums.kernel_sums import (
    START,
    Entries,
    Inputs,
    Kernel,
    SumPlan,
    join,
    select,
)
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
    kernels = [_transposed_kernel(b.kernel) for b in plan.batches]
    inputs, entries, (local_sizes, out_sizes) = plan.inputs, plan.entries, plan.sizes
    # The weights of the outputs of a batch follow its local inputs.
    shifts = np.cumsum(out_sizes) - out_sizes
    starts = plan.batch_table[:, START]
    weight_starts = starts + shifts + local_sizes
    data_targets, data_sources = (x.astype(np.intp) for x in (plan.data_targets, plan.data_sources))
    batch, data_batch = map(plan.batch_of, (inputs.targets, data_targets))
    all_inputs = join(
        inputs._replace(targets=inputs.targets + shifts[batch]),
        Inputs(
            entries.sources + weight_starts[entries.batches],
            entries.rows + n_inputs,
            entries.weights,
        ),
    )
    # Lanes beyond the copies also have data, but no weights, and their outputs are not defined.
    positions = data_targets - starts[data_batch]
    lanes, copies = np.array([b[-2:] for b in plan.batches], np.intp).reshape(-1, 2).T
    is_copy = positions % lanes[data_batch] < copies[data_batch]
    ones = np.ones(len(data_targets))
    of_data = Entries(data_sources + n_inputs, data_batch, positions, ones, ones == 1.0)
    is_picked = np.arange(len(batch)) < len(plan.pick_targets)
    of_inputs = Entries(
        inputs.sources, batch, inputs.targets - starts[batch], inputs.weights, is_picked
    )
    # Entries beyond the last batch add shared numbers, which are constant.
    entries = join(of_inputs, select(of_data, is_copy))
    return plan.with_kernels(kernels, data_targets + shifts[data_batch], all_inputs, entries)


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
