"""CasADi functions that are called with numpy arrays."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

Array = np.ndarray

_MAX_MAPPED_ROWS = 128
# Number of mapped functions that are cached per function: runs differ in their last, shorter block.
MAX_MAPPED_FUNCTIONS = 16


def keep_latest(functions: dict[Any, ca.Function], key: Any, mapped: ca.Function) -> None:
    """Add a mapped function to a cache, and remove the oldest one if there are too many."""
    functions[key] = mapped
    if len(functions) > MAX_MAPPED_FUNCTIONS:
        functions.pop(next(iter(functions)), None)


class Compiled:
    """A CasADi function with preallocated buffers, called without allocation.

    A call copies the arguments into the first input buffers, evaluates the function and returns the
    output buffers, which the next call overwrites. Inputs that a call omits keep their values in
    `inputs`, such as the parameters of a model.

    Parameters
    ----------
    function
        CasADi function whose outputs are all dense.
    *last
        Initial values of the last inputs; calls that omit these inputs use them.

    Attributes
    ----------
    calls
        Number of evaluations.
    inputs, outputs
        Buffers: one flat float array per input or output, with its non-zeros column by column.
    """

    def __init__(self, function: ca.Function, *last: Array) -> None:
        self.calls = 0
        self.inputs = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        self.outputs = [np.zeros(function.nnz_out(i)) for i in range(function.n_out())]
        for buffer, value in zip(self.inputs[len(self.inputs) - len(last) :], last, strict=True):
            buffer[:] = value
        self._memory, self._evaluate = function.buffer()
        for i, array in enumerate(self.inputs):
            self._memory.set_arg(i, memoryview(array))  # type: ignore[call-arg,arg-type]
        for i, array in enumerate(self.outputs):
            self._memory.set_res(i, memoryview(array))  # type: ignore[call-arg,arg-type]

    def __call__(self, *arguments: Array | float) -> list[Array]:
        """Evaluate the function with `arguments` as its first inputs; return the output buffers."""
        for buffer, argument in zip(self.inputs, arguments):  # noqa: B905 trailing inputs stay
            buffer[:] = argument
        self._evaluate()
        self.calls += 1
        return self.outputs


class RowFunction:
    """A CasADi function with one dense output, evaluated for each row of its arguments."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._mapped_functions: dict[tuple[int, ...], ca.Function] = {}
        self._derivatives: dict[int, RowFunction] = {}

    def __call__(self, *arguments: Array) -> Array:
        """Return one row of output entries for each row of the arguments, shape (rows, size).

        Arguments have shape (rows, k), or (k,) if all rows share the argument; at least one
        argument must be two-dimensional.
        """
        shared = [i for i, a in enumerate(arguments) if np.ndim(a) == 1]
        rows = max(len(a) for a in arguments if np.ndim(a) == 2)
        result = np.empty((rows, self._function.nnz_out(0)))
        if not rows:
            return result
        count = min(rows, _MAX_MAPPED_ROWS)
        compiled = Compiled(self._map(count, shared))
        # The last chunk overlaps the previous chunk, because mapping to another size costs more.
        for first in [*range(0, rows - count, count), rows - count]:
            chunk = slice(first, first + count)
            values = (a if np.ndim(a) == 1 else np.ravel(a[chunk]) for a in arguments)
            result[chunk] = compiled(*values)[0].reshape(count, -1)
        return result

    def derivative(self, argument: int) -> RowFunction:
        """Return a row function for the Jacobian with respect to argument number `argument`.

        Each row of its values contains all entries of one Jacobian, column by column.
        """
        if argument not in self._derivatives:
            inputs = self._function.sx_in()
            (value,) = self._function.call(inputs)
            entries = ca.densify(ca.vec(ca.jacobian(value, inputs[argument])))
            function = ca.Function(self._function.name(), inputs, [entries])
            self._derivatives[argument] = RowFunction(function)
        return self._derivatives[argument]

    def _map(self, count: int, shared: list[int]) -> ca.Function:
        """Return the function over `count` rows; cached, as mapping costs as much as a call."""
        function, key = self._function, (count, *shared)
        # A concurrent thread may remove the entry between a test and an access.
        mapped = self._mapped_functions.get(key)
        if mapped is None:
            name = function.name()
            mapped = function.map(name, "serial", count, shared, []) if count > 1 else function
            keep_latest(self._mapped_functions, key, mapped)
        return mapped

    def jacobians(self, *arguments: Array) -> list[Array]:
        """Return the dense Jacobians at one point: an array (size, k) per argument (k,)."""
        function = self._function
        unused_value = np.zeros(function.numel_out(0))
        derivatives = function.jacobian()(*map(np.ravel, arguments), unused_value)
        blocks = derivatives if isinstance(derivatives, tuple) else (derivatives,)
        return [np.array(block.full(), float) for block in blocks]
