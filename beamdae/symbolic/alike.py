"""Statements whose kernels differ in numbers alone: they get one kernel, with the numbers as data.

Joints of one kind differ in where their points lie. Each with a kernel of its own, a chain of many
bodies takes as many functions to build and to call; with one, they are copies in one map, as the
elements of beams are.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.symbolic.statements import (
    SX,
    ConstraintKernel,
    ConstraintStatement,
    ForceKernel,
    ForceStatement,
    Local,
)

Array = np.ndarray


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


def by_kernel(statements: Sequence[ForceStatement | ConstraintStatement]) -> list[Alike]:
    """The statements by kernel, those of one kind with the same."""
    recipes: dict[int, _Recipe] = {}
    kinds: dict[Hashable, list[int]] = {}
    for k, statement in enumerate(statements):
        kernel = statement.kernel
        recipe = recipes.setdefault(id(kernel), _Recipe(kernel))
        kinds.setdefault(recipe.kind, []).append(k)
    return [
        _alike(
            members,
            [recipes[id(statements[k].kernel)] for k in members],
            [statements[k].data for k in members],
        )
        for members in kinds.values()
    ]


def _alike(members: list[int], recipes: list[_Recipe], data: list[Array]) -> Alike:
    """With the kernel of the first, the numbers in which they differ made data."""
    first = recipes[0]
    if all(recipe is first for recipe in recipes):
        return Alike(first.kernel, members, np.concatenate(data, axis=1))
    numbers = np.array([recipe.numbers for recipe in recipes])
    differ = np.flatnonzero((numbers != numbers[0]).any(axis=0))
    own = np.repeat(numbers[:, differ], [x.shape[1] for x in data], axis=0).T
    return Alike(
        first.with_data(differ), members, np.concatenate([np.concatenate(data, axis=1), own])
    )


@dataclass(frozen=True)
class _Recipe:
    """How a kernel is evaluated, step by step."""

    kernel: ForceKernel | ConstraintKernel

    @cached_property
    def _function(self) -> ca.Function:
        kernel = self.kernel
        return ca.Function("kernel", kernel.inputs, [ca.densify(x) for x in kernel.outputs])

    @cached_property
    def _steps(self) -> list[tuple[int, tuple[int, ...], tuple[int, ...]]]:
        """Operation, its operands and its results."""
        f = self._function
        return [
            (f.instruction_id(k), tuple(f.instruction_input(k)), tuple(f.instruction_output(k)))
            for k in range(f.n_instructions())
        ]

    @cached_property
    def kind(self) -> Hashable:
        """What kernels have in common that differ in numbers alone."""
        kernel = self.kernel
        # Those of elements are shared as they are, and much longer than those of joints.
        if kernel.reused or any(op == ca.OP_CALL for op, _, _ in self._steps):
            return id(kernel)
        x = kernel.local
        return (type(kernel), x.size, x.n_data, x.n_multipliers, tuple(self._steps))

    @cached_property
    def numbers(self) -> Array:
        """The numbers in it, in the order of the steps."""
        f = self._function
        constants = (k for k, (op, _, _) in enumerate(self._steps) if op == ca.OP_CONST)
        return np.array([f.instruction_constant(k) for k in constants])

    def with_data(self, which: Array) -> ForceKernel | ConstraintKernel:
        """The kernel with these of its numbers as further data."""
        x = self.kernel.local
        local = Local(x.size, x.n_data + len(which), x.n_multipliers)
        numbers = [SX(number) for number in self.numbers]
        for place, k in enumerate(which, start=x.n_data):
            numbers[k] = local.data[place]
        return self.kernel.restated(local, self._followed(local, iter(numbers)))

    def _followed(self, local: Local, numbers: Iterator[SX]) -> list[SX]:
        """What the steps lead to, in other symbols and with other numbers."""
        inputs = self.kernel.restated(local, self.kernel.outputs).inputs
        outputs = [SX.zeros(x.shape) for x in self.kernel.outputs]
        found: dict[int, SX] = {}
        for op, operands, results in self._steps:
            if op == ca.OP_OUTPUT:
                outputs[results[0]][results[1]] = found[operands[0]]
            elif op == ca.OP_INPUT:
                found[results[0]] = inputs[operands[0]][operands[1]]
            elif op == ca.OP_CONST:
                found[results[0]] = next(numbers)
            elif len(operands) == 1:
                found[results[0]] = SX.unary(op, found[operands[0]])
            else:
                found[results[0]] = SX.binary(op, *(found[k] for k in operands))
        return outputs
