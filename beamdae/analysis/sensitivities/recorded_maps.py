"""Recorded functions of a state, whose derivatives are applied forward or transposed.

A record lists the operations of a function: linear combinations, sums of kernels at known states,
and solutions of linear systems. The derivative along directions follows from the operations in
their order, and the gradient of a weighted sum of the results in the reverse order; Griewank &
Walther, Evaluating Derivatives, SIAM 2008. The solution z of R(z, x) = 0 is recorded as
z - A^-1 R(z, x) with a constant z and A = dR/dz, which has the same derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.operator_changes import directional_plan_along
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.sums.directional_sums import StackedSum, directional_plan
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_time
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator
from beamdae.symbolic.sums.transposed_sums import transposed_plan

Array = np.ndarray
PlanFunction = Callable[[Structure], SumPlan]


@cache_on_owner
def plan_direction(
    structure: Structure, plan: PlanFunction, n_inputs: int, min_base: float = 0.0
) -> SumPlan:
    """Return `directional_plan` of a sum; `plan` is a function of a module."""
    return directional_plan(plan(structure), n_inputs, min_base=min_base)


@cache_on_owner
def _plan_transpose(
    structure: Structure, plan: PlanFunction, n_inputs: int, min_base: float
) -> SumPlan:
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

    @property
    def _key(self) -> tuple[Structure, PlanFunction, int, float]:
        return self.equations.structure, self.plan, self.n_inputs, self.min_base

    @cached_property
    def along(self) -> StackedSum:
        """Directional derivatives, with the inputs (x, dx, dp)."""
        plan = self._moving_plan or plan_direction(*self._key)
        return StackedSum(plan, self.equations.p)

    @cached_property
    def _moving_plan(self) -> SumPlan | None:
        if self.moving is None:
            return None
        return directional_plan_along(
            self.moving, lambda e: self.plan(e.structure), self.n_inputs, self.min_base
        )

    @cached_property
    def _transposed(self) -> SumEvaluator:
        return SumEvaluator.borrow(_plan_transpose(*self._key), self.equations.p, self)

    @cached_property
    def _value(self) -> SumEvaluator:
        plan = self.plan(self.equations.structure)
        return SumEvaluator.borrow(plan, self.equations.p, self)

    def gradient(self, time: Array, x: Array, weights: Array) -> tuple[Array, Array]:
        """Return the derivatives of weights . sum by x and by p."""
        n_p = len(self.equations.p)
        set_time(self._transposed, *time)
        result = self._transposed(np.concatenate([x, weights]), self.n_inputs + n_p)
        return result[: self.n_inputs], result[self.n_inputs :]

    def time_rate(self, time: Array, x: Array, delta: float) -> Array:
        """Return the partial derivative with respect to time, by a difference over +-`delta`."""
        values = []
        for step in (delta, -delta):
            set_time(self._value, time[0] + step, time[1])
            values.append(self._value(x, self.size))
        return (values[0] - values[1]) / (2.0 * delta)


@dataclass(frozen=True, eq=False)
class Variable:
    """Array in a record; `value` is None for results on which no sum depends."""

    index: int
    size: int
    value: Array | None

    @property
    def point(self) -> Array:
        """The value, which is known."""
        assert self.value is not None
        return self.value


Term = tuple[float | Array, Variable]


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
    time
        (t, branch) of the state.
    delta
        Difference of time for partial derivatives with respect to time [s].
    """

    n_numbers: int
    time: Array
    delta: float
    inputs: tuple[Variable, ...] = ()
    outputs: tuple[Variable, ...] = ()
    _operations: list[_Operation] = field(default_factory=list)
    _count: int = 0

    def __post_init__(self) -> None:
        self.numbers, self.shift = self._add(self.n_numbers, None), self._add(1, np.zeros(1))

    def _add(self, size: int, value: Array | None) -> Variable:
        self._count += 1
        return Variable(self._count - 1, size, value)

    def variables(self, *values: Array) -> tuple[Variable, ...]:
        """Return variables for the inputs of the function, or for constants."""
        return tuple(self._add(len(x), x) for x in values)

    def combine(self, *terms: Term, value: Array | None = None) -> Variable:
        """Return the sum of factor * variable; numbers multiply arrays of factors.

        `value` is the result if the values of the variables are unknown.
        """
        if value is None and all(x.value is not None for _, x in terms):
            value = np.asarray(sum(factor * x.point for factor, x in terms))
        size = max(x.size * np.size(f) if x.size == 1 else x.size for f, x in terms)
        result = self._add(size, value)

        def forward(changes: list[Array | None]) -> Array:
            pairs = zip(terms, changes, strict=True)
            return sum(f * dx for (f, _), dx in pairs if dx is not None)  # type: ignore[return-value]

        def transposed(weights: Array) -> list[Array]:
            parts = [f * weights for f, _ in terms]
            return [
                y if x.size == size else np.array([np.sum(y)])
                for y, (_, x) in zip(parts, terms, strict=True)
            ]

        self._operations.append(
            _Operation(result.index, tuple(x.index for _, x in terms), forward, transposed)
        )
        return result

    def take(self, variable: Variable, part: slice, value: Array | None = None) -> Variable:
        """Return a part of a variable."""
        result = self._add(len(range(*part.indices(variable.size))), value)

        def transposed(weights: Array) -> list[Array]:
            full = np.zeros(variable.size)
            full[part] = weights
            return [full]

        self._operations.append(
            _Operation(
                result.index,
                (variable.index,),
                lambda changes: changes[0][..., part],  # type: ignore[index]
                transposed,
            )
        )
        return result

    def evaluate(
        self,
        total: DifferentiableSum,
        state: Sequence[Variable],
        *,
        direction: Sequence[Array] = (),
        shift: float = 0.0,
        moves: bool = False,
    ) -> Variable:
        """Return a sum at a state.

        Parameters
        ----------
        total
            The sum.
        state, direction
            Its inputs: variables, and constants that follow them.
        shift
            Time of the state, relative to that of the record [s].
        moves
            True if this time moves with that of the record.
        """
        x = np.concatenate([*(y.value for y in state), *direction])
        sizes = [y.size for y in state]
        ends = np.cumsum(sizes)
        time, rest = self.time + np.array([shift, 0.0]), np.zeros(len(x) - int(ends[-1]))
        result = self._add(total.size, None)

        def rate() -> Array:
            return total.time_rate(time, x, self.delta)

        def forward(changes: list[Array | None]) -> Array:
            dp, dt, *states = changes
            rows = max((len(y) for y in changes if y is not None), default=1)
            parts = [np.zeros(k) if y is None else y for k, y in zip(sizes, states, strict=True)]
            parts = [x, *parts, rest, np.zeros(self.n_numbers) if dp is None else dp]
            stacked = [np.broadcast_to(y, (rows, y.shape[-1])) for y in parts]
            change = total.along(time, np.concatenate(stacked, axis=1), total.size)
            if moves and dt is not None and dt.any():
                change = change + dt * rate()
            return change

        def transposed(weights: Array) -> list[Array]:
            by_x, by_p = total.gradient(time, x, weights)
            return [by_p, np.zeros(1), *np.split(by_x, ends)[:-1]]

        inputs = (self.numbers.index, self.shift.index, *(y.index for y in state))
        self._operations.append(_Operation(result.index, inputs, forward, transposed))
        return result

    def solve(
        self,
        solve: Callable[[Array, bool], Array],
        size: int,
        *right: tuple[Variable, slice | Array],
    ) -> Variable:
        """Return A^-1 b for the parts of b and where they are.

        `solve` returns A^-1 b or, if its second argument is True, A^-T b.
        """
        result = self._add(size, None)

        def forward(changes: list[Array | None]) -> Array:
            rows = max(len(x) for x in changes if x is not None)
            b = np.zeros((rows, size))
            for (_, part), change in zip(right, changes, strict=True):
                if change is not None:
                    b[:, part] += change
            return np.array([solve(row, False) for row in b])

        def transposed(weights: Array) -> list[Array]:
            b = solve(weights, True)
            return [b[part] for _, part in right]

        inputs = tuple(x.index for x, _ in right)
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
        for variable, change in zip(self.inputs, changes, strict=True):
            rows[variable.index] = change
        for operation in self._operations:
            given = [rows[k] for k in operation.inputs]
            if any(x is not None for x in given):
                rows[operation.result] = operation.forward(given)
        count = len(numbers)
        results = [(x, rows[x.index]) for x in self.outputs]
        return [
            np.zeros((count, x.size)) if y is None else np.broadcast_to(y, (count, x.size))
            for x, y in results
        ]

    def transposed(self, *weights: Array) -> Gradient:
        """Return the gradient of the sum of weights . outputs at fixed time and operators."""
        rows: list[Array | None] = [None] * self._count

        def add(index: int, by: Array) -> None:
            known = rows[index]
            rows[index] = by if known is None else known + by

        for variable, weight in zip(self.outputs, weights, strict=True):
            add(variable.index, weight)
        for operation in reversed(self._operations):
            weight = rows[operation.result]
            if weight is not None and weight.any():
                for index, by in zip(operation.inputs, operation.transposed(weight), strict=True):
                    add(index, by)

        def read(variable: Variable) -> Array:
            by = rows[variable.index]
            return np.zeros(variable.size) if by is None else by

        return Gradient(tuple(map(read, self.inputs)), read(self.numbers))
