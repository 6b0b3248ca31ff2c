"""Statements whose kernels differ in numbers alone: they get one kernel, with the numbers as data.

Joints of one kind differ in where their points lie. Each with a kernel of its own, a chain of many
bodies takes as many functions to build and to call; with one, they are copies in one map, as the
elements of beams are. What is made of formulas has one from the start (`formulas`); this is for
what users state.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.symbolic.formulas import MOST_KINDS
from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
    QuantityKernel,
)

Array = np.ndarray
AnyKernel = ForceKernel | ConstraintKernel | QuantityKernel
Statement = ForceStatement | ConstraintStatement


class Alike(NamedTuple):
    """Statements that share a kernel.

    Attributes
    ----------
    kernel
        The kernel.
    members
        Which of the statements.
    data
        The data of their copies, a column each, one statement after the other.
    """

    kernel: Any
    members: list[int]
    data: Array


def by_kernel(statements: Sequence[Statement]) -> list[Alike]:
    """The statements by kernel, those of one kind with the same."""
    kinds: dict[Hashable, list[int]] = {}
    for k, statement in enumerate(statements):
        kernel = statement.kernel
        kinds.setdefault(_recipe(kernel) or id(kernel), []).append(k)
    return [_alike(kind, members, statements) for kind, members in kinds.items()]


def _alike(kind: Any, members: list[int], statements: Sequence[Statement]) -> Alike:
    own = [statements[k] for k in members]
    data = np.concatenate([statement.data for statement in own], axis=1)
    if not isinstance(kind, _Recipe):
        return Alike(own[0].kernel, members, data)
    numbers = [np.repeat(_numbers(x.kernel)[:, None], x.data.shape[1], axis=1) for x in own]
    return Alike(_general(kind), members, np.concatenate([data, np.concatenate(numbers, axis=1)]))


def recognized(kernel: QuantityKernel) -> tuple[Any, Array]:
    """The kernel of its kind, and the numbers that are its further data."""
    recipe = _recipe(kernel)
    return (kernel, np.zeros(0)) if recipe is None else (_general(recipe), _numbers(kernel))


class _Recipe(NamedTuple):
    """How a kernel is evaluated, but for the numbers in it.

    Attributes
    ----------
    type, size, n_data, n_multipliers
        Of the kernel and its symbols.
    shapes
        Of its outputs.
    steps
        Operations, their operands and their results.
    """

    type: type[AnyKernel]
    size: int
    n_data: int
    n_multipliers: int
    shapes: tuple[tuple[int, int], ...]
    steps: tuple[tuple[int, tuple[int, ...], tuple[int, ...]], ...]


def _function(kernel: AnyKernel) -> ca.Function:
    return ca.Function("kernel", kernel.inputs, [ca.densify(x) for x in kernel.outputs])


def _recipe(kernel: AnyKernel) -> _Recipe | None:
    """The recipe of a kernel; None of those of elements, which are shared as they are."""
    if kernel.reused:
        return None
    f, x = _function(kernel), kernel.local
    steps = tuple(
        (f.instruction_id(k), tuple(f.instruction_input(k)), tuple(f.instruction_output(k)))
        for k in range(f.n_instructions())
    )
    if any(operation == ca.OP_CALL for operation, _, _ in steps):
        return None
    shapes = tuple(output.shape for output in kernel.outputs)
    return _Recipe(type(kernel), x.size, x.n_data, x.n_multipliers, shapes, steps)


def _numbers(kernel: AnyKernel) -> Array:
    """The numbers in a kernel, in the order of its steps."""
    f = _function(kernel)
    steps = range(f.n_instructions())
    return np.array(
        [f.instruction_constant(k) for k in steps if f.instruction_id(k) == ca.OP_CONST], float
    )


@lru_cache(maxsize=MOST_KINDS)
def _general(recipe: _Recipe) -> AnyKernel:
    """The kernel of a kind with its numbers as further data, the same one every time.

    Models that differ in numbers alone so have the same kernels, and what is derived from them.
    """
    count = sum(operation == ca.OP_CONST for operation, _, _ in recipe.steps)
    local = Local(recipe.size, recipe.n_data + count, recipe.n_multipliers)
    blank = [SX.zeros(shape) for shape in recipe.shapes]
    inputs = recipe.type.stated(local, blank).inputs
    numbers = iter(range(recipe.n_data, recipe.n_data + count))
    found: dict[int, SX] = {}
    for operation, operands, results in recipe.steps:
        if operation == ca.OP_OUTPUT:
            blank[results[0]][results[1]] = found[operands[0]]
        elif operation == ca.OP_INPUT:
            found[results[0]] = inputs[operands[0]][operands[1]]
        elif operation == ca.OP_CONST:
            found[results[0]] = local.data[next(numbers)]
        elif len(operands) == 1:
            found[results[0]] = SX.unary(operation, found[operands[0]])
        else:
            found[results[0]] = SX.binary(operation, *(found[k] for k in operands))
    return recipe.type.stated(local, blank)
