"""Compiled functions: call with numpy arrays, get numpy arrays, nothing allocated in between."""

from __future__ import annotations

import casadi as ca
import numpy as np

Array = np.ndarray


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


def evaluate_rows(function: ca.Function, *arguments: Array) -> Array:
    """Evaluate a function once a row: arguments (rows, size), or (size,) where shared.

    Returns the first output, (rows, size).
    """
    rows = max(len(a) for a in arguments if np.ndim(a) == 2)
    columns = [
        np.ascontiguousarray(np.broadcast_to(a, (rows, np.shape(a)[-1])).T) for a in arguments
    ]
    mapped = function.map(rows)
    return np.array(mapped(*columns)[0] if function.n_out() > 1 else mapped(*columns)).T
