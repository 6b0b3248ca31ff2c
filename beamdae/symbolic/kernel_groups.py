"""Groups of statements whose kernels differ only in numbers.

Joints of one type differ in the positions of their points. If each joint had a separate kernel, a
chain of many bodies would need as many functions to build and to call. With the numbers as data,
these joints share one kernel, whose copies are evaluated together like the elements of a beam.
Kernels made only of `Formula`s already take their numbers as data; they are shared unchanged.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.symbolic.formula import cache_kernels
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    QuantityKernel,
)
from beamdae.symbolic.table_lookups import LOOKUPS, has_lookups, look_up

Array = np.ndarray
AnyKernel = ForceKernel | ConstraintKernel | QuantityKernel
Statement = ForceStatement | ConstraintStatement


class KernelGroup(NamedTuple):
    """Statements that share a kernel.

    Attributes
    ----------
    kernel
        Kernel that the statements share.
    members
        Indices of the statements that share the kernel.
    data
        Data of the copies of all members, one column per copy, in the order of `members`. If
        `kernel` takes numbers of the original kernels as data, these are the last rows.
    """

    kernel: Any
    members: list[int]
    data: Array


def group_by_kernel(statements: Sequence[Statement]) -> list[KernelGroup]:
    """Group statements whose kernels are equal, except for the numbers in them."""
    groups: dict[Hashable, list[int]] = {}
    for k, statement in enumerate(statements):
        kernel = statement.kernel
        groups.setdefault(_describe_kernel(kernel) or id(kernel), []).append(k)
    return [_form_group(key, members, statements) for key, members in groups.items()]


def _form_group(key: Any, members: list[int], statements: Sequence[Statement]) -> KernelGroup:
    group = [statements[k] for k in members]
    data = np.concatenate([statement.data for statement in group], axis=1)
    if not isinstance(key, _KernelRecipe):
        return KernelGroup(group[0].kernel, members, data)
    numbers = [
        np.repeat(_extract_constants(x.kernel)[:, None], x.data.shape[1], axis=1) for x in group
    ]
    all_data = np.concatenate([data, np.concatenate(numbers, axis=1)])
    return KernelGroup(_rebuild_kernel(key), members, all_data)


def generalize_quantity(kernel: QuantityKernel) -> tuple[Any, Array]:
    """Return the kernel with the numbers in it as additional data, and these numbers.

    A kernel that calls functions other than lookups is returned unchanged, with no numbers.
    """
    recipe = _describe_kernel(kernel)
    if recipe is None:
        return kernel, np.zeros(0)
    return _rebuild_kernel(recipe), _extract_constants(kernel)


class _KernelRecipe(NamedTuple):
    """Instructions of a kernel without the numbers in it.

    Attributes
    ----------
    type, size, n_data, n_multipliers
        Type of the kernel, and sizes of its symbols.
    shapes
        Shapes of the outputs.
    steps
        (operation or name of a lookup, operands, results) of each instruction.
    """

    type: type[AnyKernel]
    size: int
    n_data: int
    n_multipliers: int
    shapes: tuple[tuple[int, int], ...]
    steps: tuple[tuple[int | str, tuple[int, ...], tuple[int, ...]], ...]


def _to_function(kernel: AnyKernel) -> ca.Function:
    return ca.Function("kernel", kernel.inputs, [ca.densify(x) for x in kernel.outputs])


def _describe_kernel(kernel: AnyKernel) -> _KernelRecipe | None:
    """Return the recipe of a kernel; None if the kernel is shared or calls other functions."""
    if kernel.reused:
        return None
    f, x = _to_function(kernel), kernel.local
    calls = f.instructions_sx() if has_lookups(f) else SX()

    def describe_operation(k: int) -> int | str:
        code = f.instruction_id(k)
        is_call = code == ca.OP_CALL
        return str(calls.nz[k].which_function().name()) if is_call else code

    steps = tuple(
        (describe_operation(k), tuple(f.instruction_input(k)), tuple(f.instruction_output(k)))
        for k in range(f.n_instructions())
    )
    if any(isinstance(operation, str) and operation not in LOOKUPS for operation, _, _ in steps):
        return None
    shapes = tuple(output.shape for output in kernel.outputs)
    return _KernelRecipe(type(kernel), x.size, x.n_data, x.n_multipliers, shapes, steps)


def _extract_constants(kernel: AnyKernel) -> Array:
    """Return the numbers in a kernel, in the order of its instructions."""
    f = _to_function(kernel)
    steps = range(f.n_instructions())
    return np.array(
        [f.instruction_constant(k) for k in steps if f.instruction_id(k) == ca.OP_CONST], float
    )


@cache_kernels
def _rebuild_kernel(recipe: _KernelRecipe) -> AnyKernel:
    """Return the kernel of a recipe, with its numbers as additional data.

    Equal recipes return the same object, so that models which differ only in numbers share the
    kernel and everything derived from it.
    """
    count = sum(operation == ca.OP_CONST for operation, _, _ in recipe.steps)
    local = Local(recipe.size, recipe.n_data + count, recipe.n_multipliers)
    outputs = [SX.zeros(shape) for shape in recipe.shapes]
    inputs = recipe.type.from_outputs(local, outputs).inputs
    data_index = iter(range(recipe.n_data, recipe.n_data + count))
    values: dict[int, SX] = {}
    for operation, operands, results in recipe.steps:
        if operation == ca.OP_OUTPUT:
            outputs[results[0]][results[1]] = values[operands[0]]
        elif operation == ca.OP_INPUT:
            values[results[0]] = inputs[operands[0]][operands[1]]
        elif operation == ca.OP_CONST:
            values[results[0]] = local.data[next(data_index)]
        elif isinstance(operation, str):
            column = ca.vertcat(*(values[k] for k in operands[1:]))
            found = look_up(operation, values[operands[0]], column, len(results))
            values.update(zip(results, ca.vertsplit(found), strict=True))
        elif len(operands) == 1:
            values[results[0]] = SX.unary(operation, values[operands[0]])
        else:
            values[results[0]] = SX.binary(operation, *(values[k] for k in operands))
    return recipe.type.from_outputs(local, outputs)
