"""Recorded functions of a state, whose derivatives are applied forward or transposed.

A function is called with recorded arrays in place of arrays. The record lists its operations:
linear combinations, sums of kernels, and solutions of linear systems. The derivative along
directions follows from the operations in their order, and the gradient of a weighted sum of the
results in the reverse order; Griewank & Walther, Evaluating Derivatives, SIAM 2008.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.sensitivities.neighbors import Difference, directional_plan_along
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.state_evaluator import PlanFunction
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.sums.directional_sums import StackedSum, directional_plan
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator
from beamdae.symbolic.sums.transposed_sums import transposed_plan

Array = np.ndarray


def plan_along(
    equations: EquationsOfMotion,
    moving: Difference | None,
    plan: PlanFunction,
    n_inputs: int,
    min_base: float = 0.0,
) -> SumPlan:
    """Return `directional_plan` of a sum; `plan` is a function of a module.

    `moving` are the models at neighboring values of the parameter of all directions, if operators
    of joints depend on it.
    """
    if moving is not None:
        return directional_plan_along(moving, lambda e: plan(e.structure), n_inputs, min_base)
    return _plan_direction(equations.structure, plan, n_inputs, min_base)


@cache_on_owner
def _plan_direction(
    structure: Structure, plan: PlanFunction, n_inputs: int, min_base: float
) -> SumPlan:
    return directional_plan(plan(structure), n_inputs, min_base=min_base)


@cache_on_owner
def plan_transpose(
    structure: Structure, plan: PlanFunction, n_inputs: int, min_base: float = 0.0
) -> SumPlan:
    """Return `transposed_plan` of a sum; `plan` is a function of a module."""
    return transposed_plan(plan(structure), n_inputs, min_base)


@dataclass(eq=False)
class DifferentiableSum:
    """Sum of kernels with its directional derivative and gradient.

    Attributes
    ----------
    equations
        Equations that the sum belongs to.
    plan, n_inputs, size, min_base
        Function of a module that returns the plan of the sum, the sizes of its input and result,
        and the limit of `expand_powers`.
    moving
        Models at neighboring values of the parameter of all directions, if operators of joints
        depend on it; otherwise None.
    """

    equations: EquationsOfMotion
    plan: PlanFunction
    n_inputs: int
    size: int
    moving: Difference | None
    min_base: float = 0.0

    @cached_property
    def along(self) -> StackedSum:
        """Directional derivatives, with the inputs (x, dx, dp)."""
        plan = plan_along(self.equations, self.moving, self.plan, self.n_inputs, self.min_base)
        return StackedSum(plan, self.equations.p)

    @cached_property
    def _transposed(self) -> SumEvaluator:
        e = self.equations
        plan = plan_transpose(e.structure, self.plan, self.n_inputs, self.min_base)
        return SumEvaluator(plan, e.p)

    @cached_property
    def _value(self) -> SumEvaluator:
        plan = self.plan(self.equations.structure)
        return SumEvaluator(plan, self.equations.p)

    def value(self, time: Array, x: Array) -> Array:
        """Return the sum at (t, branch)."""
        set_time(self._value, *time)
        return self._value(x, self.size)

    def gradient(self, time: Array, x: Array, weights: Array) -> tuple[Array, Array]:
        """Return the derivatives of weights . sum by x and by p."""
        n_p = len(self.equations.p)
        set_time(self._transposed, *time)
        result = self._transposed(np.concatenate([x, weights]), self.n_inputs + n_p)
        return result[: self.n_inputs], result[self.n_inputs :]


class RecordedArray:
    """Array whose derivatives a record knows; it supports +, -, *, slices and copies.

    Parameters
    ----------
    record, index, size
        The record, the index of the array in it, and its size.
    value
        Its value, or the function that returns the value, called if an operation needs it.
    """

    __array_ufunc__ = None  # Arrays leave operations with recorded arrays to the latter.

    def __init__(
        self, record: Record, index: int, size: int, value: Array | Callable[[], Array]
    ) -> None:
        self._record, self.index, self.size, self._value = record, index, size, value

    @property
    def value(self) -> Array:
        """Value of the array."""
        if callable(self._value):
            self._value = self._value()
        return self._value

    def any(self) -> bool:
        """Return True, because derivatives of zeros are not zero."""
        return True

    def copy(self) -> RecordedArray:
        """Return the array, which never changes."""
        return self

    def __getitem__(self, part: slice | Array) -> RecordedArray:
        return self._record.take(self, part)

    def __add__(self, other: Any) -> RecordedArray:
        if isinstance(other, RecordedArray):
            return self._record.combine((1.0, self), (1.0, other))
        return self._record.combine((1.0, self), value=lambda: self.value + other)

    def __mul__(self, other: Any) -> RecordedArray:
        if isinstance(other, RecordedArray):
            value = self.value * other.value
            return self._record.combine((other.value, self), (self.value, other), value=value)
        return self._record.combine((other, self))

    def __neg__(self) -> RecordedArray:
        return self * -1.0

    def __sub__(self, other: Any) -> RecordedArray:
        return self + -other

    def __rsub__(self, other: Any) -> RecordedArray:
        return -self + other

    __radd__, __rmul__ = __add__, __mul__


def value_of(x: Array | RecordedArray | None) -> Any:
    """Return the value of a recorded array, or the argument if it is not recorded."""
    return x.value if isinstance(x, RecordedArray) else x


class _Operation(NamedTuple):
    result: int
    inputs: tuple[int, ...]
    forward: Callable[[list[Array | None]], Array]
    transposed: Callable[[Array], Sequence[Array]]


class Gradient(NamedTuple):
    """Derivatives of a weighted sum of the results of a record.

    Attributes
    ----------
    inputs
        Derivatives with respect to the inputs.
    numbers
        Derivatives with respect to the numbers p of the model, (n_p,).
    """

    inputs: tuple[Array, ...]
    numbers: Array


@dataclass
class Record:
    """Operations of a function of a state.

    Attributes
    ----------
    n_numbers
        Number of entries of p.
    delta
        Difference of time for partial derivatives with respect to time [s].
    inputs, outputs
        Arguments of the function, and its results, of which some may be constant.
    """

    n_numbers: int
    delta: float
    inputs: tuple[RecordedArray, ...] = ()
    outputs: Sequence[Array | RecordedArray] = ()
    _operations: list[_Operation] = field(default_factory=list)
    _count: int = 0

    def __post_init__(self) -> None:
        self.numbers = self._add(self.n_numbers, np.zeros(self.n_numbers))
        self.shift = self._add(1, np.zeros(1))

    def _add(self, size: int, value: Array | Callable[[], Array]) -> RecordedArray:
        self._count += 1
        return RecordedArray(self, self._count - 1, size, value)

    def variables(self, *values: Array) -> tuple[Any, ...]:
        """Return recorded arrays for the inputs of the function."""
        return tuple(self._add(len(x), x) for x in values)

    def combine(
        self, *terms: tuple[Any, RecordedArray], value: Array | Callable[[], Array] | None = None
    ) -> RecordedArray:
        """Return the sum of factor * array, or an array with the same derivative and `value`.

        Factors are numbers or arrays.
        """

        def compute() -> Array:
            return np.asarray(sum(factor * x.value for factor, x in terms))

        size = max(x.size * np.size(f) if x.size == 1 else x.size for f, x in terms)
        result = self._add(size, compute if value is None else value)

        def forward(changes: list[Array | None]) -> Array:
            pairs = zip(terms, changes, strict=True)
            return sum(f * dx for (f, _), dx in pairs if dx is not None)

        def transposed(weights: Array) -> list[Array]:
            parts = [f * weights for f, _ in terms]
            return [
                y if x.size == size else np.array([np.sum(y)])
                for y, (_, x) in zip(parts, terms, strict=True)
            ]

        inputs = tuple(x.index for _, x in terms)
        self._operations.append(_Operation(result.index, inputs, forward, transposed))
        return result

    def take(self, array: RecordedArray, part: slice | Array) -> RecordedArray:
        """Return the entries of an array at a slice or at indices without repetitions."""
        size = len(range(*part.indices(array.size))) if isinstance(part, slice) else len(part)
        result = self._add(size, lambda: array.value[part])

        def transposed(weights: Array) -> list[Array]:
            full = np.zeros(array.size)
            full[part] = weights
            return [full]

        def forward(changes: list[Array | None]) -> Array:
            return changes[0][..., part]  # type: ignore[index]

        self._operations.append(_Operation(result.index, (array.index,), forward, transposed))
        return result

    def evaluate(
        self, total: DifferentiableSum, time: Array, state: Sequence[Array | RecordedArray]
    ) -> RecordedArray:
        """Return a sum at (t, branch) for its inputs `state`."""
        x = np.concatenate([value_of(y) for y in state])
        ends = np.cumsum([len(value_of(y)) for y in state])
        parts = [
            (y.index, slice(end - y.size, end))
            for y, end in zip(state, ends, strict=True)
            if isinstance(y, RecordedArray)
        ]
        result = self._add(total.size, lambda: total.value(time, x))

        def time_rate() -> Array:
            step = np.array([self.delta, 0.0])
            ahead, behind = (total.value(time + shift, x) for shift in (step, -step))
            return (ahead - behind) / (2.0 * self.delta)

        def forward(changes: list[Array | None]) -> Array:
            dp, dt, *states = changes
            count = max(len(y) for y in changes if y is not None)
            rows = np.zeros((count, 2 * len(x) + self.n_numbers))
            rows[:, : len(x)] = x
            for (_, part), dx in zip(parts, states, strict=True):
                if dx is not None:
                    rows[:, len(x) + part.start : len(x) + part.stop] = dx
            if dp is not None:
                rows[:, 2 * len(x) :] = dp
            change = total.along(time, rows, total.size)
            if dt is not None and dt.any():
                change = change + dt * time_rate()
            return change

        def transposed(weights: Array) -> list[Array]:
            by_x, by_p = total.gradient(time, x, weights)
            return [by_p, np.zeros(1), *(by_x[part] for _, part in parts)]

        inputs = (self.numbers.index, self.shift.index, *(index for index, _ in parts))
        self._operations.append(_Operation(result.index, inputs, forward, transposed))
        return result

    def solve(
        self,
        solve: Callable[[Array, bool], Array],
        right: Sequence[Array | RecordedArray],
        value: Array,
    ) -> RecordedArray:
        """Return the solution A^-1 b, which is `value`, for the parts of b.

        `solve` returns A^-1 b or, if its second argument is True, A^-T b.
        """
        ends = np.cumsum([len(x) if isinstance(x, np.ndarray) else x.size for x in right])
        parts = [
            (x.index, slice(end - x.size, end))
            for x, end in zip(right, ends, strict=True)
            if isinstance(x, RecordedArray)
        ]
        result = self._add(len(value), value)

        def forward(changes: list[Array | None]) -> Array:
            b = np.zeros((max(len(x) for x in changes if x is not None), len(value)))
            for (_, part), change in zip(parts, changes, strict=True):
                if change is not None:
                    b[:, part] = change
            return np.array([solve(row, False) for row in b])

        def transposed(weights: Array) -> list[Array]:
            b = solve(weights, True)
            return [b[part] for _, part in parts]

        inputs = tuple(index for index, _ in parts)
        self._operations.append(_Operation(result.index, inputs, forward, transposed))
        return result

    def along(
        self, changes: Sequence[Array | None], numbers: Array, shifts: Array | None = None
    ) -> list[Array]:
        """Return the derivatives of the outputs along directions, (k, size) each.

        Parameters
        ----------
        changes, numbers
            Derivatives of the inputs, None for zeros, and of the numbers p, one direction a row.
        shifts
            Derivatives of the time, (k,) [s].
        """
        rows: list[Array | None] = [None] * self._count
        rows[self.numbers.index] = numbers
        if shifts is not None:
            rows[self.shift.index] = np.reshape(shifts, (-1, 1))
        for x, change in zip(self.inputs, changes, strict=True):
            rows[x.index] = change
        for operation in self._operations:
            given = [rows[k] for k in operation.inputs]
            if any(x is not None for x in given):
                rows[operation.result] = operation.forward(given)
        count = len(numbers)

        def read(x: Array | RecordedArray) -> Array:
            y = rows[x.index] if isinstance(x, RecordedArray) else None
            return np.broadcast_to(np.zeros(1) if y is None else y, (count, x.size))

        return [read(x) for x in self.outputs]

    def transposed(self, *weights: Array) -> Gradient:
        """Return the gradient of the sum of weights . outputs at fixed time and operators."""
        rows: list[Array | None] = [None] * self._count

        def add(index: int, by: Array) -> None:
            known = rows[index]
            rows[index] = by if known is None else known + by

        for x, weight in zip(self.outputs, weights, strict=True):
            if isinstance(x, RecordedArray):
                add(x.index, weight)
        for operation in reversed(self._operations):
            weight = rows[operation.result]
            if weight is not None and weight.any():
                for index, by in zip(operation.inputs, operation.transposed(weight), strict=True):
                    add(index, by)

        def read(x: RecordedArray) -> Array:
            by = rows[x.index]
            return np.zeros(x.size) if by is None else by

        return Gradient(tuple(map(read, self.inputs)), read(self.numbers))
