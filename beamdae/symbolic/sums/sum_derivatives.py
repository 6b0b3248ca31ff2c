"""Derivatives of sums of kernels with respect to their inputs and their data.

For a sum r = S k(shared, L x, p), the derivative along (dx, dp) is the sum

    dr = S (dk/dlocal (L dx) + dk/dp dp)

over the same copies. Its kernels are Jacobian-vector products of the kernels k, so that no residual
is differenced. Shared numbers, such as time and matrix factors, are constant.

With weights y of the rows of r, the gradient of y . r is the sum

    (dx, dp) = (L^T, I) [dk/dlocal, dk/dp]^T S^T y

over the same copies: gathering and scattering change places. It is the transpose of the
directional derivative.
"""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np

from beamdae.linear.elimination import aligned_zeros
from beamdae.native.instructions import expand_powers
from beamdae.symbolic.sums.kernel_code import expand_sines
from beamdae.symbolic.sums.kernel_sums import (
    START,
    Entries,
    Inputs,
    Kernel,
    SumPlan,
    join,
    select,
)
from beamdae.symbolic.table_lookups import directional_derivative, has_lookups, weighted_derivative

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
    inputs, entries = plan.inputs, plan.entries
    gather_changes, changes = np.zeros(len(inputs.weights)), np.zeros(len(entries.weights))
    if weight_changes is not None:
        of_gathers, of_entries = weight_changes
        gather_changes[len(plan.pick_targets) :] = of_gathers
        # Weights of shared numbers follow.
        changes[~entries.is_plain] = of_entries[: np.count_nonzero(~entries.is_plain)]
    moving, changed = np.flatnonzero(gather_changes), np.flatnonzero(changes)
    valued = {id(plan.batches[k].kernel) for k in set(entries.batches[changed].tolist())}
    kernels = [_directional_kernel(b.kernel, id(b.kernel) in valued) for b in plan.batches]

    # Each batch has twice as many local inputs: those of the original batch, then their tangents.
    def locate(targets: Array) -> tuple[Array, Array]:
        """Return the new positions of values and tangents of local inputs."""
        batch = plan.batch_of(targets)
        values = targets + plan.batch_table[batch, START]
        return values, values + plan.sizes[0][batch]

    values, tangents = locate(inputs.targets)
    data_values, data_tangents = locate(plan.data_targets.astype(np.intp))
    data_sources = plan.data_sources.astype(np.intp) + 2 * n_inputs
    of_weights = select(inputs, moving)._replace(
        targets=tangents[moving], weights=gather_changes[moving]
    )
    all_inputs = join(
        inputs._replace(targets=values),
        inputs._replace(targets=tangents, sources=inputs.sources + n_inputs),
        of_weights,
        Inputs(data_tangents, data_sources, np.ones(len(data_sources))),
    )
    # Values follow the derivatives in the outputs of a batch.
    of_values = select(entries, changed)
    of_values = of_values._replace(
        sources=of_values.sources + plan.sizes[1][of_values.batches], weights=changes[changed]
    )
    # Entries beyond the last batch add shared numbers, which are constant.
    return plan.with_kernels(kernels, data_values, all_inputs, join(entries, of_values))


def motion_plan(plan: SumPlan, n_inputs: int) -> SumPlan:
    """Return a `directional_plan` that does not gather dp, for `evaluate_with_data`.

    `n_inputs` is the size of x. Many more numbers belong to the data of copies than to their
    motion; those of a direction are the same in all steps, see `direction_inputs`.
    """
    inputs = select(plan.inputs, plan.inputs.sources < 2 * n_inputs)
    kernels = [batch.kernel for batch in plan.batches]
    return plan.with_kernels(kernels, plan.data_targets, inputs, plan.entries)


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
