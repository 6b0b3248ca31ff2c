"""Compiled functions: call with numpy arrays, get numpy arrays, nothing allocated in between."""

from __future__ import annotations

import casadi as ca
import numpy as np

Array = np.ndarray

_ROWS_AT_ONCE = 128


class Compiled:
    """A CasADi function bound to its own buffers.

    Calling it copies the arguments into the leading input buffers, evaluates, and returns the
    output buffers: they are overwritten by the next call. All outputs must be dense. The remaining
    inputs keep what was written to `inputs` before, such as the parameters of a model.

    Attributes
    ----------
    calls
        How often it was evaluated.
    inputs, outputs
        The buffers, one flat float array (column-major) an argument.
    """

    def __init__(self, function: ca.Function, *last: Array) -> None:
        """Bind `function`; `last` are values for its last inputs."""
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
        """Evaluate with these leading arguments; returns the output buffers."""
        for buffer, argument in zip(self.inputs, arguments):  # noqa: B905 trailing inputs stay
            buffer[:] = argument
        self._evaluate()
        self.calls += 1
        return self.outputs


class RowFunction:
    """A CasADi function with one dense output, evaluated once a row of its arguments."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._mapped: dict[tuple[int, ...], ca.Function] = {}
        self._derivatives: dict[int, RowFunction] = {}

    def __call__(self, *arguments: Array) -> Array:
        """Values (rows, size) at arguments (rows, size each), or (size,) where shared."""
        shared = [i for i, a in enumerate(arguments) if np.ndim(a) == 1]
        rows = max(len(a) for a in arguments if np.ndim(a) == 2)
        result = np.empty((rows, self._function.nnz_out(0)))
        if not rows:
            return result
        count = min(rows, _ROWS_AT_ONCE)
        compiled = Compiled(self._map(count, shared))
        # The last rows come with some of those before them: another map would cost more.
        for first in [*range(0, rows - count, count), rows - count]:
            part = slice(first, first + count)
            values = (a if np.ndim(a) == 1 else np.ravel(a[part]) for a in arguments)
            result[part] = compiled(*values)[0].reshape(count, -1)
        return result

    def derivative(self, argument: int) -> RowFunction:
        """Rows of the derivative by an argument: the entries of a column of it, then the next."""
        if argument not in self._derivatives:
            inputs = self._function.sx_in()
            (value,) = self._function.call(inputs)
            entries = ca.densify(ca.vec(ca.jacobian(value, inputs[argument])))
            function = ca.Function(self._function.name(), inputs, [entries])
            self._derivatives[argument] = RowFunction(function)
        return self._derivatives[argument]

    def _map(self, count: int, shared: list[int]) -> ca.Function:
        """The function over `count` rows: making it costs as much as using it."""
        function, key = self._function, (count, *shared)
        if key not in self._mapped:
            self._mapped[key] = (
                function.map(function.name(), "serial", count, shared, [])
                if count > 1
                else function
            )
        return self._mapped[key]

    def jacobians(self, *arguments: Array) -> list[Array]:
        """Derivatives (size, .) by each argument, at one row of them."""
        function = self._function
        zero = np.zeros(function.numel_out(0))
        found = function.jacobian()(*map(np.ravel, arguments), zero)
        blocks = found if isinstance(found, tuple) else (found,)
        return [np.array(block.full(), float) for block in blocks]
