"""Code of kernels: loops over points, sines and cosines in vector lanes, tiles of inputs.

The C library computes sines one by one. Polynomials consist of operations that are rounded in the
same way everywhere, so that machine code and CasADi's virtual machine still return the same bits.

The coordinates of a node are neighbors in the input vector, and neighbors in the inputs of a copy.
A tile consists of up to `TILE_ROWS` such components of `LANE_WIDTH` copies side by side: one run of
numbers per lane outside, one row per component inside a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.native.instructions import (
    read_operations,
    rebuild_output,
    repeat_operation,
)
from beamdae.native.lane_code import LANE_WIDTH
from beamdae.native.lane_kernels import LaneKernel, Rewrite, build_lane_kernel, build_loop_kernel
from beamdae.native.point_programs import (
    Output,
    PointLoop,
    Program,
    write_point_module,
    write_point_program,
)
from beamdae.symbolic.local_symbols import SX

# Coefficients of (sin x - x) / x^3 and of (cos x - 1 + x^2 / 2) / x^4, in powers of x^2, for
# |x| < pi / 4: fdlibm (Sun Microsystems, 1993), k_sin.c and k_cos.c.
_SINE_COEFFICIENTS = (
    *(-1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04),
    *(2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10),
)
_COSINE_COEFFICIENTS = (
    *(4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05),
    *(-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11),
)
# pi / 2 in three parts of 33 bits, whose products with integers below 2^20 are exact: fdlibm,
# e_rem_pio2.c.
_QUARTER_TURN = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)
_LARGEST_ANGLE = 1e15  # rad; the products with the parts above would leave a remainder that grows
_OVERFLOW = 1e300  # makes larger angles infinite
_QUARTER_TURNS_PER_RADIAN = 6.36619772367581382433e-01
# Fewer sines and cosines take less time than rewriting a function. Exact elements have two at each
# integration point, most joints two in all.
_MIN_SINES = 3
# Functions with more instructions per sine or cosine spend most of their time elsewhere, and take
# longer to rewrite.
_MAX_INSTRUCTIONS_PER_SINE = 150
# Larger derivatives, those of matrices, are evaluated once per run.
_MAX_DERIVATIVE_INSTRUCTIONS = 4000


def sine_and_cosine(x: SX) -> tuple[SX, SX]:
    """Return sin x and cos x in arithmetic operations, for scalar x [rad].

    Errors are below 2.5 units in the last place for |x| < 1e6, and below 1.5 for |x| < 1000. For
    larger |x|, they also contain the effect of an error of one unit in the last place of x. Beyond
    1e15, where neighboring numbers are up to a radian apart, both are NaN, as those of infinity.
    """
    x = x + _where(x * x > _LARGEST_ANGLE**2, x) * _OVERFLOW
    turns = ca.floor(x * _QUARTER_TURNS_PER_RADIAN + 0.5)
    for part in _QUARTER_TURN:
        x = x - turns * part
    square = x * x
    sine = x + square * x * _evaluate_polynomial(_SINE_COEFFICIENTS, square)
    quartic = square * square * _evaluate_polynomial(_COSINE_COEFFICIENTS, square)
    cosine = 1.0 - (0.5 * square - quartic)
    quadrant = turns - 4.0 * ca.floor(0.25 * turns)
    half_turns = ca.floor(0.5 * quadrant)
    is_odd = quadrant - 2.0 * half_turns
    is_even = 1.0 - is_odd
    # The sine is negative in quadrants 2 and 3, the cosine in quadrants 1 and 2.
    sine_sign = 1.0 - 2.0 * half_turns
    cosine_sign = sine_sign * (is_even - is_odd)
    return (
        sine_sign * (_where(is_even, sine) + _where(is_odd, cosine)),
        cosine_sign * (_where(is_even, cosine) + _where(is_odd, sine)),
    )


@cache
def _sine_and_cosine_function() -> ca.Function:
    """Return `sine_and_cosine` as a function, which is expanded without calls from Python."""
    x = SX.sym("x")
    return ca.Function("sine_and_cosine", [x], list(sine_and_cosine(x)))


def _where(condition: SX, value: SX) -> SX:
    """Return the value if the condition is not 0, else 0."""
    return SX.binary(ca.OP_IF_ELSE_ZERO, condition, value)


def _evaluate_polynomial(coefficients: tuple[float, ...], x: SX) -> SX:
    value = SX(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * x + coefficient
    return value


def expand_sines(function: ca.Function, is_derivative: bool = False) -> ca.Function:
    """Return an SX function with its sines and cosines as polynomials.

    The function itself is returned if it has none, or few, or few among many instructions. Fewer
    are enough if `is_derivative`: directional derivatives are evaluated many times per step.
    """
    codes = read_operations(function)
    sines = codes.count(ca.OP_SIN) + codes.count(ca.OP_COS)
    if is_derivative:
        is_rewritten = sines > 0 and len(codes) <= _MAX_DERIVATIVE_INSTRUCTIONS
    else:
        is_rewritten = sines >= _MIN_SINES and len(codes) <= _MAX_INSTRUCTIONS_PER_SINE * sines
    if not is_rewritten:
        return function
    pairs: dict[int, Sequence[SX]] = {}

    def operate(operation: Any, operands: list[SX], count: int) -> Sequence[SX]:
        if operation not in (ca.OP_SIN, ca.OP_COS):
            return repeat_operation(operation, operands, count)
        key = operands[0].element_hash()
        if key not in pairs:
            pairs[key] = _sine_and_cosine_function().call(operands)
        return [pairs[key][operation == ca.OP_COS]]

    arguments = function.sx_in()
    return ca.Function(function.name(), arguments, [rebuild_output(function, arguments, operate)])


def expand_all_sines(function: ca.Function) -> ca.Function:
    """Return an SX function of a point with all its sines and cosines as polynomials."""
    return expand_sines(function, is_derivative=True)


Array = np.ndarray


class PointTerm(NamedTuple):
    """Points with one kernel in a `PointSum`.

    Attributes
    ----------
    source, rewrites, outputs
        Those of the kernel of a point; its local inputs are the coordinates of the point for each
        local vector, then data.
    differences
        Matrix D that is applied to the local vectors first.
    weights
        Matrices W (points, rows, local coordinates): the coordinates of a point are W D x.
    data
        Rows of the local data of each point (points, data).
    """

    source: ca.Function
    rewrites: tuple[Rewrite, ...]
    outputs: tuple[ca.Sparsity, ...]
    differences: Array
    weights: Array
    data: Array


@dataclass(frozen=True, eq=False)
class PointSum:
    """Sum over points that equals a kernel.

    Attributes
    ----------
    terms
        The points.
    vectors
        Number of local vectors.
    n_data
        Number of data of a copy, before the numbers of a rotation.
    rotation
        Matrix T of ones and zeros (local coordinates, inputs), and matrix of the indices + 1 of the
        entries that are numbers of the rotation; None if the inputs are the local coordinates.
    """

    terms: tuple[PointTerm, ...]
    vectors: int
    n_data: int
    rotation: tuple[Array, Array] | None = None

    def compile(
        self, function: ca.Function, outputs: Sequence[ca.Sparsity], compiles: bool
    ) -> LaneKernel | None:
        """Return machine code of `function`, the whole sum, as `build_lane_kernel` does."""
        called = {}
        for symbol, term in zip(self.symbols, self.terms, strict=True):
            steps = (*term.rewrites, expand_all_sines)
            code = build_lane_kernel(term.source, compiles, steps)
            if code is None:
                return None
            called[symbol] = code
        text = write_point_module(function.name(), self.program(outputs))
        return build_loop_kernel(function, text, called, compiles)

    @property
    def symbols(self) -> list[str]:
        """Names of the kernels of points."""
        return [f"{term.source.name()}{k}" for k, term in enumerate(self.terms)]

    def program(self, outputs: Sequence[ca.Sparsity]) -> Program:
        """Return the program of the sum with these outputs."""
        size = self.terms[0].weights.shape[2]
        n_inputs = size if self.rotation is None else self.rotation[0].shape[1]
        loops = []
        for symbol, term in zip(self.symbols, self.terms, strict=True):
            height, source = term.weights.shape[1], term.source
            starts = source.jac_sparsity(0, 1).colind()[: self.vectors * height + 1 : height]
            used = tuple(k for k, (a, b) in enumerate(pairwise(starts)) if a < b)
            patterns = tuple(map(_locate_nonzeros, term.outputs))
            data = term.data + self.vectors * n_inputs
            sizes = source.numel_in(1), source.numel_out(0)
            matrices = term.differences, term.weights
            loops.append(PointLoop(symbol, *sizes, used, *matrices, data, patterns))
        results = []
        for pattern in outputs:
            is_column = pattern.shape == (n_inputs, 1)
            kind = "column" if is_column else "matrix" if pattern.size2() > 1 else "numbers"
            results.append(Output(*_locate_nonzeros(pattern), kind))
        sizes_of_sum = (self.vectors, size, self.n_data)
        return write_point_program(sizes_of_sum, self.rotation, loops, results)


def _locate_nonzeros(pattern: ca.Sparsity) -> tuple[Array, Array]:
    """Return the rows and columns of the non-zeros."""
    rows, columns = pattern.get_triplet()
    return np.array(rows, int), np.array(columns, int)


# Largest number of rows of a tile.
TILE_ROWS = 4
# Least number of copies in a vector for which a tile of inputs takes less time than its numbers.
_MIN_COPIES = 4


class BatchRows(NamedTuple):
    """Rows of the inputs of a batch: (height, lanes) numbers.

    The last lanes beyond `copies` are padding.
    """

    height: int
    lanes: int
    copies: int


class Tiles(NamedTuple):
    """Tiles of all batches of a sum.

    Attributes
    ----------
    table
        One row per tile, in the order of the batches and of their lanes: position of its first
        number in the batch, number of its rows, and index of the first number of each lane.
    ends
        Ends of the batches in `table`.
    covered
        Mask of the entries that belong to a tile.
    """

    table: Array
    ends: Array
    covered: Array


def find_tiles(batches: Sequence[BatchRows], positions: Array, indices: Array) -> Tiles:
    """Return the tiles of inputs of batches that are numbers of a vector.

    Parameters
    ----------
    batches
        Rows of all batches, one batch after the other.
    positions, indices
        Position of each entry among the rows of all batches, and its index in the vector.
    """
    count = len(positions)
    covered, no_rows = np.zeros(count, bool), np.zeros((0, 2 + LANE_WIDTH), np.uint32)
    none = Tiles(no_rows, np.zeros(len(batches), np.intp), covered)
    if not count or max(batch.copies for batch in batches) < _MIN_COPIES:
        return none
    vectors, vector_batch, is_first_row, copies = _order_vectors(batches)
    entry = np.full(LANE_WIDTH * len(vectors), -1)
    entry[positions] = np.arange(count)
    entry = entry.reshape(-1, LANE_WIDTH)[vectors]
    is_copy = np.arange(LANE_WIDTH) < copies[:, None]
    is_complete = (copies >= _MIN_COPIES) & ((entry >= 0) | ~is_copy).all(axis=1)
    last_copy = entry[np.arange(len(entry)), np.maximum(copies - 1, 0)]
    index = indices[np.where(is_copy, entry, last_copy[:, None])]
    # A run of rows whose indices ascend by one in all lanes is divided into tiles.
    continues = ~is_first_row
    continues[1:] &= is_complete[1:] & is_complete[:-1] & (index[1:] == index[:-1] + 1).all(axis=1)
    begins = np.flatnonzero(~continues)
    lengths = np.diff(np.append(begins, len(continues)))
    offset = np.arange(len(continues)) - np.repeat(begins, lengths)
    rows = np.minimum(np.repeat(lengths, lengths) - offset, TILE_ROWS)
    is_tile = is_complete & (offset % TILE_ROWS == 0)
    # All `TILE_ROWS` numbers of a lane are read, also those that are not used.
    is_tile &= index.max(axis=1) + TILE_ROWS <= indices.max() + 1
    first = np.flatnonzero(is_tile)
    if not len(first):
        return none
    of_batch, rows = vector_batch[first], rows[first]
    sizes = [batch.height * batch.lanes for batch in batches]
    positions_in_batch = LANE_WIDTH * vectors[first] - (np.cumsum(sizes) - sizes)[of_batch]
    table = np.column_stack([positions_in_batch, rows, index[first]]).astype(np.uint32)
    ends = np.searchsorted(of_batch, np.arange(len(batches)), "right")
    # (tile, row, lane), without rows that the tile does not have and padding.
    members = entry[np.minimum(first[:, None] + np.arange(TILE_ROWS), len(entry) - 1)]
    members[np.arange(TILE_ROWS) >= rows[:, None]] = -1
    covered[members[members >= 0]] = True
    return Tiles(table, ends, covered)


def _order_vectors(batches: Sequence[BatchRows]) -> tuple[Array, Array, Array, Array]:
    """Return the vectors of all batches, ordered by batch, lanes and row.

    Also return the batch of each vector, True for those of a first row, and the number of copies.
    """
    vectors, copies, start = [], [], 0
    for batch in batches:
        width = batch.lanes // LANE_WIDTH
        numbers = start + np.arange(batch.height * width)
        vectors.append(numbers.reshape(batch.height, width).T.ravel())
        first_copies = np.arange(0, batch.lanes, LANE_WIDTH)
        copies.append(np.repeat(np.clip(batch.copies - first_copies, 0, LANE_WIDTH), batch.height))
        start += batch.height * width
    sizes = [len(part) for part in vectors]
    vector_batch = np.repeat(np.arange(len(batches)), sizes)
    heights = np.repeat([max(batch.height, 1) for batch in batches], sizes)
    starts = np.repeat(np.cumsum(sizes) - sizes, sizes)
    is_first_row = (np.arange(sum(sizes)) - starts) % heights == 0
    return np.concatenate(vectors), vector_batch, is_first_row, np.concatenate(copies)
