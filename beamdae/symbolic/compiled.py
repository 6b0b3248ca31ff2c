"""CasADi functions that are called with numpy arrays, by machine code where rows are many.

Loading or compiling machine code takes longer than the rows of a single run take in CasADi's
virtual machine. A function is therefore compiled once its rows, in all runs of a process,
have taken about as long as the compiler takes. Results have the same bits in any case.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from functools import cached_property
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from beamdae.native.instructions import expand_powers
from beamdae.native.lane_kernels import LaneKernel, build_lane_kernel, pad_copies
from beamdae.symbolic.table_lookups import has_lookups, jacobian

Array = np.ndarray

# Fewer rows take as long in the virtual machine.
_MIN_ROWS = 32
# Rows evaluated together, so that inputs and outputs stay in the processor cache.
_MAX_ROWS = 1024
# Operations (rows times instructions) after which machine code is loaded from the cache, which
# takes 2 to 4 ms, and compiled, which takes 20 ms and 0.05 ms an instruction.
_OPERATIONS_BEFORE_LOADING = 3e6
_OPERATIONS_BEFORE_COMPILING = 5e7
# Numbers of instructions from which on compilers take as long as 10 000 rows, and from
# which on they take longer for each instruction: for 12 000 instructions one second, for 65 000,
# such as those of the largest stress along a beam of 32 elements, 18 seconds.
_MANY_INSTRUCTIONS, _TOO_MANY_INSTRUCTIONS = 5000, 20_000


class RowKernels:
    """Machine code of a function, for each choice of arguments that all rows share."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._operations: dict[tuple[int, ...], float] = defaultdict(float)
        self._kernels: dict[tuple[tuple[int, ...], bool], LaneKernel | None] = {}

    def __reduce__(self) -> tuple[type, tuple[ca.Function]]:
        return RowKernels, (self._function,)

    def find(self, shared: tuple[int, ...], rows: int) -> LaneKernel | None:
        """Return machine code for `rows` rows that share these arguments; None to use none."""
        if rows < _MIN_ROWS:
            return None
        self._operations[shared] += rows * self._worth_of_row
        if self._operations[shared] <= _OPERATIONS_BEFORE_LOADING:
            return None
        compiles = self._operations[shared] > _OPERATIONS_BEFORE_COMPILING
        if (shared, compiles) not in self._kernels:
            loaded = self._kernels.get((shared, False))
            self._kernels[shared, compiles] = loaded or self._build(shared, compiles)
        return self._kernels[shared, compiles]

    @cached_property
    def _worth_of_row(self) -> float:
        """Operations of a row, relative to the time that a compiler takes for the function."""
        instructions = self._function.n_instructions()
        growth = 1.0 + instructions / _TOO_MANY_INSTRUCTIONS
        return float(min(instructions, _MANY_INSTRUCTIONS / growth))

    def _build(self, shared: tuple[int, ...], compiles: bool) -> LaneKernel | None:
        function = self._function
        if not function.is_a("SXFunction") or has_lookups(function):
            return None
        arguments = function.sx_in()
        output = ca.densify(ca.vec(function(*arguments)))
        columns = [ca.vec(x) for x in arguments]
        inputs = [
            ca.vertcat(
                ca.SX(0, 1), *(x for i, x in enumerate(columns) if (i in shared) is is_shared)
            )
            for is_shared in (True, False)
        ]
        return build_lane_kernel(ca.Function(function.name(), inputs, [output]), compiles)


def evaluate_rows(kernel: LaneKernel, arguments: Sequence[Array], result: Array) -> None:
    """Evaluate machine code for all rows; arguments are (rows, k), or (k,) if rows share them.

    `result` (rows, size) receives the values.
    """
    shared = np.concatenate([np.zeros(0), *(a for a in arguments if a.ndim == 1)])
    columns = [a.T for a in arguments if a.ndim == 2]
    _BlockEvaluator(kernel, len(result))(shared, columns, result.T)


def evaluate_copies(kernel: LaneKernel, columns: Array, data: Array, result: Array) -> None:
    """Evaluate machine code of (q, data) for copies with `columns` (c, size, k), `data` (n, c).

    `result` (outputs, c, k) receives the values.
    """
    evaluate = _BlockEvaluator(kernel, columns.shape[2])
    for copy, column in enumerate(columns):
        evaluate(data[:, copy], [column], result[:, copy])


class _BlockEvaluator:
    """Evaluates machine code for blocks of rows with the same buffers."""

    def __init__(self, kernel: LaneKernel, rows: int) -> None:
        length = pad_copies(min(rows, _MAX_ROWS))
        self._shared = np.empty(kernel.n_shared)
        self._local, self._out = np.empty(kernel.n_local * length), np.empty(kernel.n_out * length)
        self._sizes = kernel.n_local, kernel.n_out
        self._call = kernel.bind(self._shared, self._local, self._out)

    def __call__(self, shared: Array, columns: Sequence[Array], result: Array) -> None:
        """Write the values of inputs (k, rows) each into `result` (outputs, rows)."""
        n_local, n_out = self._sizes
        rows = result.shape[1]
        self._shared[:] = shared
        for first in range(0, rows, _MAX_ROWS):
            block = slice(first, min(first + _MAX_ROWS, rows))
            count = block.stop - first
            length = pad_copies(count)
            local = self._local[: n_local * length].reshape(n_local, length)
            position = 0
            for column in columns:
                local[position : position + len(column), :count] = column[:, block]
                position += len(column)
            # Lanes without a row repeat the last one.
            local[:, count:] = local[:, count - 1 : count]
            self._call(length)
            result[:, block] = self._out[: n_out * length].reshape(n_out, length)[:, :count]


_Mapped = TypeVar("_Mapped")

_MAX_MAPPED_ROWS = 128
_MAPPED_ROWS_MULTIPLE = 16  # of blocks of more rows in total, so that few sizes are mapped
# Number of mapped functions that are cached per function: runs differ in their last, shorter block.
MAX_MAPPED_FUNCTIONS = 16


def _balance_blocks(rows: int) -> int:
    """Return the number of rows of blocks of similar size, so that few rows overlap."""
    if rows <= _MAX_MAPPED_ROWS:
        return rows
    least = math.ceil(rows / math.ceil(rows / _MAX_MAPPED_ROWS))
    return _MAPPED_ROWS_MULTIPLE * math.ceil(least / _MAPPED_ROWS_MULTIPLE)


def keep_latest(functions: dict[Any, _Mapped], key: Any, mapped: _Mapped) -> None:
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
        return self.evaluate()

    def evaluate(self) -> list[Array]:
        """Evaluate the function with the values in `inputs`; return the output buffers."""
        self._evaluate()
        self.calls += 1
        return self.outputs


class RowFunction:
    """A CasADi function with one dense output, evaluated for each row of its arguments."""

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._mapped_functions: dict[tuple[int, ...], ca.Function] = {}
        self._derivatives: dict[int, RowFunction] = {}
        self._kernels = RowKernels(function)

    def __call__(self, *arguments: Array) -> Array:
        """Return one row of output entries for each row of the arguments, shape (rows, size).

        Arguments have shape (rows, k), or (k,) if all rows share the argument; at least one
        argument must be two-dimensional.
        """
        arguments = tuple(map(np.asarray, arguments))
        shared = [i for i, a in enumerate(arguments) if a.ndim == 1]
        rows = max(len(a) for a in arguments if a.ndim == 2)
        result = np.empty((rows, self._function.nnz_out(0)))
        if not rows:
            return result
        if (kernel := self._kernels.find(tuple(shared), rows)) is not None:
            evaluate_rows(kernel, arguments, result)
            return result
        count = _balance_blocks(rows)
        evaluate = Compiled(self._map(count, shared))
        # The last chunk overlaps the previous chunk, because mapping to another size costs more.
        for first in [*range(0, rows - count, count), rows - count]:
            chunk = slice(first, first + count)
            values = ((a if a.ndim == 1 else a[chunk]).ravel() for a in arguments)
            result[chunk] = evaluate(*values)[0].reshape(count, -1)
        return result

    def on_copies(self, columns: Array, data: Array) -> Array:
        """Return the output entries of c copies of a function of (q, data) at k rows.

        Parameters
        ----------
        columns
            First argument of each copy at each row, (c, size, k).
        data
            Second argument of each copy, (n_data, c), the same at all rows.

        Returns
        -------
        ndarray
            Output entries (n, c, k), with the bits of a call with one row per copy and row.
        """
        copies, size, rows = columns.shape
        if (kernel := self._kernels.find((1,), rows * copies)) is not None:
            result = np.empty((self._function.nnz_out(0), copies, rows))
            evaluate_copies(kernel, columns, data, result)
            return result
        values = self(columns.transpose(2, 0, 1).reshape(-1, size), np.tile(data.T, (rows, 1)))
        return values.reshape(rows, copies, -1).transpose(2, 1, 0)

    def express(self, *symbols: ca.SX) -> ca.SX:
        """Return the outputs as an expression in symbols, one column per argument."""
        return ca.densify(ca.vec(self._function(*symbols)))

    def apply(self, *arguments: ca.MX) -> ca.MX:
        """Return the outputs as a call in an expression graph; missing last arguments are zero."""
        sizes = [self._function.size_in(i) for i in range(len(arguments), self._function.n_in())]
        return ca.vec(self._function(*arguments, *(ca.DM.zeros(*size) for size in sizes)))

    def derivative(self, argument: int) -> RowFunction:
        """Return a row function for the Jacobian with respect to argument number `argument`.

        Each row of its values contains all entries of one Jacobian, column by column.
        """
        if argument not in self._derivatives:
            inputs = self._function.sx_in()
            value = expand_powers(self._function, *inputs)
            if has_lookups(self._function):
                by_argument = jacobian(value, inputs[argument])
            else:
                by_argument = ca.jacobian(value, inputs[argument])
            entries = ca.densify(ca.vec(by_argument))
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
        if has_lookups(function):
            points = [np.reshape(x, (1, -1)) for x in arguments]
            derivatives = [self.derivative(k)(*points)[0] for k in range(len(points))]
            return [x.reshape(-1, function.numel_out(0)).T for x in derivatives]
        unused_value = np.zeros(function.numel_out(0))
        derivatives = function.jacobian()(*map(np.ravel, arguments), unused_value)
        blocks = derivatives if isinstance(derivatives, tuple) else (derivatives,)
        return [np.array(block.full(), float) for block in blocks]
