"""Machine code of row functions that a process evaluates often, usually in many runs.

Loading or compiling machine code takes longer than the rows of a single run take in CasADi's
virtual machine. A function is therefore compiled once its rows, in all runs of a process,
have taken about as long as the compiler takes. Results have the same bits in any case.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from beamdae.native.lane_kernels import LaneKernel, build_lane_kernel, pad_copies
from beamdae.symbolic.functions.table_lookups import has_lookups

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
