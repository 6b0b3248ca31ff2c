"""Groups of statements whose kernels differ only in numbers.

Joints of one type differ in the positions of their points. If each joint had a separate kernel, a
chain of many bodies would need as many functions to build and to call. With the numbers as data,
these joints share one kernel, whose copies are evaluated together like the elements of a beam.
Kernels made only of `Formula`s already take their numbers as data; they are shared unchanged.
"""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.instructions import (
    Instruction,
    evaluate_instructions,
    read_instructions,
    repeat_instructions,
    repeat_operation,
)
from beamdae.read_only import read_only
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
from beamdae.symbolic.table_lookups import LOOKUPS, look_up

Array = np.ndarray
AnyKernel = ForceKernel | ConstraintKernel | QuantityKernel
Statement = ForceStatement | ConstraintStatement
_SEPARATED = "_separated_numbers"  # attribute of kernels with the result of `_separate_numbers`


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
        of_kernel = _describe_kernel(statement.kernel) or id(statement.kernel)
        groups.setdefault(of_kernel, []).append(k)
    formed = []
    for key, members in groups.items():
        group = [statements[k] for k in members]
        kernel: Any = group[0].kernel
        data = np.concatenate([x.data for x in group], axis=1)
        if isinstance(key, _KernelRecipe):
            numbers = [
                np.repeat(_extract_constants(x.kernel)[:, None], x.data.shape[1], axis=1)
                for x in group
            ]
            kernel = _rebuild_kernel(key)
            data = np.concatenate([data, np.concatenate(numbers, axis=1)])
        formed.append(KernelGroup(kernel, members, data))
    return formed


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
        Instructions, whose calls are names of lookups.
    """

    type: type[AnyKernel]
    size: int
    n_data: int
    n_multipliers: int
    shapes: tuple[tuple[int, int], ...]
    steps: tuple[Instruction, ...]


def _describe_kernel(kernel: AnyKernel) -> _KernelRecipe | None:
    """Return the recipe of a kernel; None if the kernel is shared or calls other functions."""
    return None if kernel.reused else _separate_numbers(kernel)[0]


def _extract_constants(kernel: AnyKernel) -> Array:
    """Return the numbers in a kernel, in the order of its instructions."""
    return _separate_numbers(kernel)[1]


def _separate_numbers(kernel: AnyKernel) -> tuple[_KernelRecipe | None, Array]:
    """Return the recipe of a kernel, None if it calls other functions, and the numbers in it."""
    # Stored in the kernel, because the kernels of formulas are grouped for warnings, too.
    cache = vars(kernel)
    if _SEPARATED not in cache:
        function = ca.Function("kernel", kernel.inputs, [ca.densify(x) for x in kernel.outputs])
        steps, constants = _separate_tables(function)
        numbers = np.array(constants, float)
        cache[_SEPARATED] = _form_recipe(kernel, steps), read_only(numbers)
    separated: tuple[_KernelRecipe | None, Array] = cache[_SEPARATED]
    return separated


def _form_recipe(kernel: AnyKernel, steps: tuple[Instruction, ...]) -> _KernelRecipe | None:
    local = kernel.local
    if any(isinstance(operation, str) and operation not in LOOKUPS for operation, _, _ in steps):
        return None
    shapes = tuple(output.shape for output in kernel.outputs)
    return _KernelRecipe(type(kernel), local.size, local.n_data, local.n_multipliers, shapes, steps)


def _separate_tables(function: ca.Function) -> tuple[tuple[Instruction, ...], list[float]]:
    """Return instructions with names of calls, and the constants in the order of OP_CONST.

    CasADi stores equal constants of an expression once. Machine code of lookups needs the numbers
    of a table in successive rows, so each different column of constants is stored as a whole.
    """
    columns: dict[tuple[float, ...], list[int]] = {}
    known: dict[int, float] = {}  # constants by slot; each value has its own slot
    slots = itertools.count()
    steps: list[Instruction] = []

    def read(code: int, operands: tuple[Any, ...]) -> int:
        slot = next(slots)
        if code == ca.OP_CONST:
            (known[slot],), operands = operands, ()
        steps.append((code, operands, (slot,)))
        return slot

    def operate(operation: Any, operands: list[int], count: int) -> list[int]:
        name = operation if isinstance(operation, int) else operation.name()
        if name in LOOKUPS and all(slot in known for slot in operands[1:]):
            numbers = tuple(known[slot] for slot in operands[1:])
            if numbers not in columns:
                columns[numbers] = [read(ca.OP_CONST, (x,)) for x in numbers]
            operands = [operands[0], *columns[numbers]]
        results = list(itertools.islice(slots, count))
        steps.append((name, tuple(operands), tuple(results)))
        return results

    def write(output: int, entry: int, slot: int) -> None:
        steps.append((ca.OP_OUTPUT, (slot,), (output, entry)))

    evaluate_instructions(read_instructions(function), read, operate, write)
    return tuple(steps), list(known.values())


@cache_kernels
def _rebuild_kernel(recipe: _KernelRecipe) -> AnyKernel:
    """Return the kernel of a recipe, with its numbers as additional data.

    Equal recipes return the same object, so that models which differ only in numbers share the
    kernel and everything derived from it.
    """
    count = sum(operation == ca.OP_CONST for operation, _, _ in recipe.steps)
    local = Local(recipe.size, recipe.n_data + count, recipe.n_multipliers)
    outputs: list[Any] = [SX.zeros(shape) for shape in recipe.shapes]
    inputs = recipe.type(local, *outputs).inputs
    constants = iter(ca.vertsplit(local.data[recipe.n_data :]))

    def operate(operation: Any, operands: list[SX], count: int) -> Sequence[SX]:
        if operation in LOOKUPS:
            return ca.vertsplit(look_up(operation, operands[0], ca.vertcat(*operands[1:]), count))
        return repeat_operation(operation, operands, count)

    repeat_instructions(recipe.steps, inputs, outputs, lambda: next(constants), operate)
    return recipe.type(local, *outputs)
