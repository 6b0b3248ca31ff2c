"""CasADi functions of scalars as sequences of NumPy operations on columns of many rows.

CasADi's virtual machine interprets a function once per row, at about 3 ns per operation. For
hundreds of rows, one NumPy operation on a whole column takes less than a sixth of that per row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

Array = np.ndarray


def _write_minimum(x: Array, y: Array, out: Array) -> None:
    """Write the smaller number; NumPy's `fmin` may return either of two zeros, not the first."""
    out[...] = np.where((x > y) | np.isnan(x), y, x)


def _write_maximum(x: Array, y: Array, out: Array) -> None:
    """Write the larger number; see `_write_minimum`."""
    out[...] = np.where((x < y) | np.isnan(x), y, x)


# Only operations that IEEE 754 defines, so that results have the same bits as those of the virtual
# machine, and sines and cosines, for which NumPy calls the same mathematical library. Functions
# with other operations are left to the virtual machine.
_UNARY: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: np.positive,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.abs,
    ca.OP_SIN: np.sin,
    ca.OP_COS: np.cos,
}
_BINARY: dict[int, Callable[..., Any]] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_FMIN: _write_minimum,
    ca.OP_FMAX: _write_maximum,
}
# Longer functions of few rows are faster in the virtual machine, whose operations need no calls.
_MAX_OPERATIONS = 1000


# Cached because most operations of a program have the same few shapes.
_broadcast_shapes = lru_cache(np.broadcast_shapes)


class RowProgram:
    """A function with one dense output, evaluated at many points at a time.

    Parameters
    ----------
    function
        Function that `can_vectorize` accepts.
    shapes
        Shape of the points at which each argument is given, such as (count,) for `count` rows. The
        shapes are broadcast: operations on arguments with few points are evaluated at few points.

    Attributes
    ----------
    inputs
        One buffer (size, *shape) per argument.
    output
        Buffer (size, *shape) of the results at all points.
    """

    def __init__(self, function: ca.Function, shapes: Sequence[tuple[int, ...]]) -> None:
        self.inputs = [np.zeros((function.nnz_in(i), *shape)) for i, shape in enumerate(shapes)]
        all_points = np.broadcast_shapes(*shapes)
        one_point = (1,) * len(all_points)
        self.output = np.zeros((function.nnz_out(0), *all_points))
        # Results that the slots of the work vector stand for; constants and inputs have their own.
        values = [np.zeros(one_point)] * function.sz_w()
        work: dict[Any, Array] = {}
        self._steps: list[tuple[Callable[..., Any], tuple[Array, ...]]] = []
        operation: Callable[..., Any]
        for k in range(function.n_instructions()):
            code = function.instruction_id(k)
            operands, results = function.instruction_input(k), function.instruction_output(k)
            if code == ca.OP_CONST:
                values[results[0]] = np.full(one_point, function.instruction_constant(k))
            elif code == ca.OP_INPUT:
                values[results[0]] = self.inputs[operands[0]][operands[1]]
            elif code == ca.OP_OUTPUT:
                self._steps.append((np.positive, (values[operands[0]], self.output[results[1]])))
            else:
                arguments = [values[i] for i in operands]
                shape = _broadcast_shapes(*(x.shape for x in arguments))
                slot = results[0], shape
                if slot not in work:
                    work[slot] = np.zeros(shape)
                values[results[0]] = work[slot]
                if code == ca.OP_TWICE:
                    operation, arguments = np.add, arguments * 2
                else:
                    operation = _UNARY.get(code) or _BINARY[code]
                self._steps.append((operation, (*arguments, values[results[0]])))

    def __call__(self) -> Array:
        """Evaluate the function at `inputs`; return `output`, which the next call overwrites."""
        with np.errstate(all="ignore"):
            for operation, columns in self._steps:
                operation(*columns)
        return self.output

    def evaluate(self, arguments: Sequence[Array]) -> Array:
        """Return the results (count, size) at arguments (count, k), or (k,) for all rows.

        All shapes must be (count,).
        """
        for buffer, argument in zip(self.inputs, arguments, strict=True):
            buffer[:] = argument[:, None] if argument.ndim == 1 else argument.T
        return self().T


def can_vectorize(function: ca.Function) -> bool:
    """Return True if `RowProgram` supports a function."""
    if not function.is_a("SXFunction") or function.n_instructions() > _MAX_OPERATIONS:
        return False
    supported = {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_TWICE, *_UNARY, *_BINARY}
    return all(function.instruction_id(k) in supported for k in range(function.n_instructions()))
