"""Compiled `loop_functions` and `linear.lane_operations`, without temporary arrays.

Importing this module imports numba and registers the compiled versions with it.
"""

from __future__ import annotations

import inspect
import math
from functools import partial
from types import FunctionType

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils, errors
from numba.extending import intrinsic, register_jitable
from numba.extending import overload as _overload

from beamdae.linear import fixed_order, lane_operations
from beamdae.native import linear_solver, loop_functions, structs

# The overloads are called only by compiled loops, which need no C wrappers.
overload = partial(_overload, jit_options={"no_cfunc_wrapper": True})


def _compile_as(function):
    """Decorate the plain Python function that is compiled in place of another one."""

    def register(loop):
        def choose(*_):
            return loop

        # Numba requires the same signature.
        choose.__signature__ = inspect.signature(loop)
        overload(function)(choose)
        return loop

    return register


@overload(loop_functions.combine)
def _combine(out, factors, vectors):
    def one(out, factors, vectors):
        for i in range(out.size):
            out[i] = factors[0] * vectors[0][i]

    def two(out, factors, vectors):
        for i in range(out.size):
            out[i] = factors[0] * vectors[0][i] + factors[1] * vectors[1][i]

    def three(out, factors, vectors):
        for i in range(out.size):
            first = factors[0] * vectors[0][i] + factors[1] * vectors[1][i]
            out[i] = first + factors[2] * vectors[2][i]

    def four(out, factors, vectors):
        for i in range(out.size):
            first = factors[0] * vectors[0][i] + factors[1] * vectors[1][i]
            out[i] = first + factors[2] * vectors[2][i] + factors[3] * vectors[3][i]

    return (one, two, three, four)[len(factors) - 1]


@_compile_as(loop_functions.multiply)
def _multiply_entries(out, one, other):
    for i in range(out.size):
        out[i] = one[i] * other[i]


@_compile_as(loop_functions.rotate)
def _rotate(x, y, angles):
    for i in range(x.size):
        cosine, sine = math.cos(angles[i]), math.sin(angles[i])
        x[i], y[i] = cosine * x[i] - sine * y[i], sine * x[i] + cosine * y[i]


@_compile_as(loop_functions.accumulate)
def _accumulate(out, targets, sources, steps):
    for k in range(np.uint64(targets.size)):
        out[targets[k]] = out[sources[k]] + steps[k]


@_compile_as(loop_functions.fill)
def _fill(out, value):
    for i in range(out.size):
        out[i] = value


@_compile_as(loop_functions.minimum)
def _minimum(out, vector, factor, other):
    for i in range(out.size):
        value, limit = vector[i], factor * other[i]
        # NaN is kept.
        out[i] = value if value < limit or value != value else limit


@_compile_as(loop_functions.split_complex)
def _parts(real, imaginary, vector):
    for i in range(real.size):
        real[i] = vector[i].real
        imaginary[i] = vector[i].imag


def _are_dense_reals(*arrays):
    """Return True if arrays can be read as columns of doubles; the stages of Radau are complex."""
    return all(x.dtype == types.float64 and x.ndim == 1 and x.layout == "C" for x in arrays)


@overload(loop_functions.max_norm)
def _largest(vector, weights):
    if _are_dense_reals(vector, weights):
        return lambda vector, weights: _max_norm_ir((vector, weights))

    def loop(vector, weights):
        largest = 0.0
        for i in range(vector.size):
            size = abs(vector[i] * weights[i])
            # NaN is kept.
            if size > largest or size != size:
                largest = size
        return largest

    return loop


@overload(loop_functions.euclidean_norm)
def _norm(vector, weights):
    if not _are_dense_reals(vector, weights):
        raise errors.TypingError("euclidean_norm: both arrays must be contiguous and real.")
    return lambda vector, weights: math.sqrt(_sum_of_squares_ir((vector, weights)))


@overload(loop_functions.inner_product)
def _inner_product(one, other):
    if not _are_dense_reals(one, other):
        raise errors.TypingError("inner_product: both arrays must be contiguous and real.")
    return lambda one, other: _sum_of_products_ir((one, other))


@_compile_as(loop_functions.locate_largest)
def _where_largest(vector, weights):
    at, largest = 0, -1.0
    for i in range(vector.size):
        size = abs(vector[i] * weights[i])
        if size > largest:
            at, largest = i, size
        elif size != size:
            return i
    return at


# The loops over entries have unsigned indices, so that they do not check for negative ones.


@_compile_as(loop_functions.pick)
def _pick(out, at, vector, of, begin, end):
    for k in range(np.uint64(begin), np.uint64(end)):
        out[at[k]] = vector[of[k]]


@_compile_as(loop_functions.gather)
def _gather(out, at, weights, vector, of, begin, end):
    for k in range(np.uint64(begin), np.uint64(end)):
        out[at[k]] = 0.0
    for k in range(np.uint64(begin), np.uint64(end)):
        out[at[k]] += weights[k] * vector[of[k]]


@_compile_as(loop_functions.add)
def _add(out, rows, vector, of, begin, end):
    for k in range(np.uint64(begin), np.uint64(end)):
        out[rows[k]] += vector[of[k]]


@_compile_as(loop_functions.add_weighted)
def _add_weighted(out, rows, weights, vector, of, begin, end):
    for k in range(np.uint64(begin), np.uint64(end)):
        out[rows[k]] += weights[k] * vector[of[k]]


@_compile_as(loop_functions.scatter)
def _scatter(out, rows, weights, vector, of):
    for i in range(out.size):
        out[i] = 0.0
    for k in range(rows.size):
        out[rows[k]] += weights[k] * vector[of[k]]


@_compile_as(loop_functions.scatter_magnitudes)
def _scatter_magnitudes(out, rows, weights, vector, of):
    for i in range(out.size):
        out[i] = 0.0
    for k in range(rows.size):
        out[rows[k]] += abs(weights[k] * vector[of[k]])


@intrinsic
def _call_kernel(typing, address, shared, local, out, padded):
    """Call the machine code of a kernel; `lane_kernels.LaneKernel` defines its prototype."""

    def code(context, builder, signature, arguments):
        number, integer = ir.DoubleType().as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [number, number, number, integer])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    pointer = types.CPointer(types.float64)
    return types.void(types.int64, pointer, pointer, pointer, types.int64), code


@intrinsic
def _start_of(typing, array):
    """Return the address of the first entry of an array."""

    def code(context, builder, signature, arguments):
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), code


@_compile_as(loop_functions.call_kernel)
def _kernel(kernels, k, shared, local, start, out, lanes):
    inputs = _start_of(local[start:])
    _call_kernel(kernels[k], _start_of(shared), inputs, _start_of(out), lanes)


class _LaneArray:
    """Array of lanes: real parts of all lanes of an entry, then imaginary parts if complex."""

    def __init__(self, context, builder, kind, array):
        data = context.make_array(kind)(context, builder, array).data
        self._builder = builder
        self._data = builder.bitcast(data, _DOUBLE.as_pointer())
        self.parts = 2 if kind.dtype == types.complex128 else 1

    def _pointers(self, entry):
        builder, width = self._builder, ir.IntType(64)(lane_operations.LANES)
        if entry.type != width.type:  # an unsigned index of a table
            entry = builder.zext(entry, width.type)
        first = builder.mul(entry, ir.IntType(64)(self.parts * lane_operations.LANES))
        for _ in range(self.parts):
            pointer = builder.gep(self._data, [first])
            yield builder.bitcast(pointer, _LANE_VECTOR.as_pointer())
            first = builder.add(first, width)

    def load(self, entry):
        return [self._builder.load(pointer, align=8) for pointer in self._pointers(entry)]

    def store(self, entry, values):
        for pointer, value in zip(self._pointers(entry), values, strict=True):
            self._builder.store(value, pointer, align=8)


class _IndexedArray:
    """Array of numbers with one index per lane and entry."""

    def __init__(self, context, builder, kind, array, index_kind, indices):
        self._builder = builder
        self._data = context.make_array(kind)(context, builder, array).data
        self._indices = context.make_array(index_kind)(context, builder, indices).data
        self._is_complex = kind.dtype == types.complex128

    def pointers(self, entry):
        """Yield pointers to the numbers of all lanes; pairs of real and imaginary part."""
        for lane in range(lane_operations.LANES):
            yield self._pointers(entry, lane)

    def pointer_of_first(self, entry):
        """Return the pointers of the first lane."""
        return self._pointers(entry, 0)

    def _pointers(self, entry, lane):
        builder, word = self._builder, ir.IntType(64)
        position = builder.add(builder.mul(entry, word(lane_operations.LANES)), word(lane))
        index = builder.zext(builder.load(builder.gep(self._indices, [position])), word)
        if not self._is_complex:
            return (builder.gep(self._data, [index]),)
        data = builder.bitcast(self._data, _DOUBLE.as_pointer())
        real = builder.gep(data, [builder.mul(index, word(2))])
        return real, builder.gep(real, [word(1)])


_DOUBLE = ir.DoubleType()
_LANE_VECTOR = ir.VectorType(_DOUBLE, lane_operations.LANES)
_ZEROS = ir.Constant(_LANE_VECTOR, [0.0] * lane_operations.LANES)


def _multiply(builder, x, y):
    if len(x) == 1:
        return [builder.fmul(x[0], y[0])]
    (a, b), (c, d) = x, y
    real = builder.fsub(builder.fmul(a, c), builder.fmul(b, d))
    return [real, builder.fadd(builder.fmul(a, d), builder.fmul(b, c))]


def _subtract(builder, x, y):
    return [builder.fsub(a, b) for a, b in zip(x, y, strict=True)]


def _lane_operation(write):
    """Return an intrinsic of one tuple, whose IR `write(context, builder, kinds, values)` emits."""

    @intrinsic
    def call(typing, arguments):
        def code(context, builder, signature, operands):
            values = cgutils.unpack_tuple(builder, operands[0])
            write(context, builder, list(arguments.types), values)
            return context.get_dummy_value()

        return types.void(arguments), code

    return call


def _overload_with(function):
    """Decorate the writer of a `_lane_operation` on the arguments of a function, and compile it."""

    def register(write):
        operation = _lane_operation(write)

        @overload(function)
        def call(*arguments):
            def loop(*arguments):
                operation(arguments)

            return loop

        return operation

    return register


def _weighted_reduction(term, join):
    """Return an intrinsic that reduces vector * weights, with one result for each lane at first.

    A single result would wait for the preceding operation at every entry. `term(builder, weighted)`
    returns the terms, and `join(builder, total, term)` adds them to a total, which is 0 at first.
    """

    @intrinsic
    def call(typing, arguments):
        def code(context, builder, signature, operands):
            vector, weights = (
                context.make_array(kind)(context, builder, array)
                for kind, array in zip(
                    arguments.types, cgutils.unpack_tuple(builder, operands[0]), strict=True
                )
            )
            (size,) = cgutils.unpack_tuple(builder, vector.shape, 1)
            width = size.type(lane_operations.LANES)

            def accumulate(place, first, kind):
                one, other = (
                    builder.load(
                        builder.bitcast(builder.gep(x.data, [first]), kind.as_pointer()), align=8
                    )
                    for x in (vector, weights)
                )
                terms = term(builder, builder.fmul(one, other))
                builder.store(join(builder, builder.load(place), terms), place)

            lanes = cgutils.alloca_once_value(builder, _ZEROS)
            total = cgutils.alloca_once_value(builder, _DOUBLE(0.0))
            whole = builder.udiv(size, width)
            with cgutils.for_range(builder, whole) as loop:
                accumulate(lanes, builder.mul(loop.index, width), _LANE_VECTOR)
            done = builder.mul(whole, width)
            with cgutils.for_range(builder, builder.sub(size, done)) as loop:
                accumulate(total, builder.add(done, loop.index), _DOUBLE)
            result, lanes = builder.load(total), builder.load(lanes)
            for lane in range(lane_operations.LANES):
                part = builder.extract_element(lanes, ir.IntType(32)(lane))
                result = join(builder, result, part)
            return result

        return types.float64(arguments), code

    return call


def _square(builder, values):
    return builder.fmul(values, values)


def _magnitude(builder, values):
    negative = builder.fneg(values)
    return builder.select(builder.fcmp_ordered("<", values, negative), negative, values)


def _add_terms(builder, total, terms):
    return builder.fadd(total, terms)


def _join_largest(builder, total, terms):
    # NaN is kept.
    is_new = builder.or_(
        builder.fcmp_ordered(">", terms, total), builder.fcmp_unordered("uno", terms, terms)
    )
    return builder.select(is_new, terms, total)


_sum_of_products_ir = _weighted_reduction(lambda builder, values: values, _add_terms)
_sum_of_squares_ir = _weighted_reduction(_square, _add_terms)
_max_norm_ir = _weighted_reduction(_magnitude, _join_largest)


def _unpack_indexed(context, builder, kinds, values, lanes):
    """Return (lanes, begin, count, indexed numbers, first), or the first three of them.

    The other three operands are (vector, at, first).
    """
    of_lanes, of_vector = slice(lanes, lanes + 3), slice(3 - lanes, 6 - lanes)
    (array, begin, count), (vector, at, first) = values[of_lanes], values[of_vector]
    kind, index_kind = kinds[of_vector][:2]
    indexed = _IndexedArray(context, builder, kind, vector, index_kind, at)
    return _LaneArray(context, builder, kinds[lanes], array), begin, count, indexed, first


def _copy_indexed(store, lanes):
    """Return the writer of an operation for each index; see `_unpack_indexed` for `lanes`.

    `store(builder, lane_value, pointer)` returns the value to store in the lane, or stores in the
    vector and returns None.
    """

    def write(context, builder, kinds, values):
        array, begin, count, indexed, first = _unpack_indexed(
            context, builder, kinds, values, lanes
        )
        with cgutils.for_range(builder, count) as loop:
            entry = builder.add(begin, loop.index)
            parts = array.load(entry)
            for lane, pointers in enumerate(indexed.pointers(builder.add(first, loop.index))):
                at = ir.IntType(32)(lane)
                for part, pointer in enumerate(pointers):
                    value = store(builder, builder.extract_element(parts[part], at), pointer)
                    if value is not None:
                        parts[part] = builder.insert_element(parts[part], value, at)
            if store is _load_number:
                array.store(entry, parts)

    return write


def _load_number(builder, lane, pointer):
    return builder.load(pointer)


def _store_number(builder, lane, pointer):
    builder.store(lane, pointer)


def _add_number(builder, lane, pointer):
    builder.store(builder.fadd(builder.load(pointer), lane), pointer)


_overload_with(lane_operations.gather_lanes)(_copy_indexed(_load_number, 0))
_overload_with(lane_operations.scatter_lanes)(_copy_indexed(_store_number, 3))
_overload_with(lane_operations.add_lanes)(_copy_indexed(_add_number, 3))


@_overload_with(lane_operations.add_lane_sums)
def _add_lane_sums(context, builder, kinds, values):
    lanes, begin, count, indexed, at = _unpack_indexed(context, builder, kinds, values, 3)
    with cgutils.for_range(builder, count) as loop:
        pointers = indexed.pointer_of_first(builder.add(at, loop.index))
        parts = lanes.load(builder.add(begin, loop.index))
        for pointer, part in zip(pointers, parts, strict=True):
            builder.store(builder.fadd(builder.load(pointer), _sum_of(builder, part)), pointer)


def _sum_of(builder, vector):
    """Return the sum of all lanes, by halves."""
    width = lane_operations.LANES
    while width > 1:
        width //= 2
        halves = [
            builder.shuffle_vector(vector, vector, _index_vector(range(start, start + width)))
            for start in (0, width)
        ]
        vector = builder.fadd(*halves)
    return builder.extract_element(vector, ir.IntType(32)(0))


def _index_vector(indices):
    indices = list(indices)
    return ir.Constant(ir.VectorType(ir.IntType(32), len(indices)), indices)


@_overload_with(lane_operations.broadcast_lanes)
def _broadcast_lanes(context, builder, kinds, values):
    lanes, begin, count, indexed, at = _unpack_indexed(context, builder, kinds, values, 0)
    with cgutils.for_range(builder, count) as loop:
        pointers = indexed.pointer_of_first(builder.add(at, loop.index))
        parts = [_broadcast(builder, builder.load(pointer)) for pointer in pointers]
        lanes.store(builder.add(begin, loop.index), parts)


@_compile_as(lane_operations.clear_lanes)
def _clear_lanes(lanes, begin, count):
    for i in range(lane_operations.LANES * begin, lane_operations.LANES * (begin + count)):
        lanes[i] = 0.0


@_overload_with(lane_operations.invert_lanes)
def _invert_lanes(context, builder, kinds, values):
    lanes = _LaneArray(context, builder, kinds[0], values[0])
    one = ir.Constant(_LANE_VECTOR, [1.0] * lane_operations.LANES)
    parts = lanes.load(values[1])
    if len(parts) == 1:
        inverse = [builder.fdiv(one, parts[0])]
    else:
        # 1 / z = conjugate of z / |z|^2.
        real, imaginary = parts
        squares = builder.fmul(real, real), builder.fmul(imaginary, imaginary)
        reciprocal = builder.fdiv(one, builder.fadd(*squares))
        inverse = [
            builder.fmul(real, reciprocal),
            builder.fmul(builder.fneg(imaginary), reciprocal),
        ]
    lanes.store(values[1], inverse)


@_overload_with(lane_operations.multiply_lanes)
def _multiply_lanes(context, builder, kinds, values):
    lanes = _LaneArray(context, builder, kinds[0], values[0])
    factor = _LaneArray(context, builder, kinds[3], values[3]).load(values[4])
    with cgutils.for_range(builder, values[2]) as loop:
        entry = builder.add(values[1], loop.index)
        lanes.store(entry, _multiply(builder, lanes.load(entry), factor))


def _broadcast(builder, number):
    """Return a vector of equal numbers."""
    none = ir.Constant(_LANE_VECTOR, ir.Undefined)
    first = builder.insert_element(none, number, ir.IntType(32)(0))
    return builder.shuffle_vector(first, none, _index_vector([0] * lane_operations.LANES))


def _move_entry(join):
    """Return the writer of an operation on (out, k, lanes, j, factor).

    `join(builder, out, k, parts)` returns the new entry `k` of `out` from the scaled entry `j`. The
    factor may be complex if the lanes are.
    """

    def write(context, builder, kinds, values):
        out = _LaneArray(context, builder, kinds[0], values[0])
        parts = _LaneArray(context, builder, kinds[2], values[2]).load(values[3])
        if kinds[4] == types.complex128:
            numbers = (builder.extract_value(values[4], part) for part in range(2))
            scaled = _multiply(builder, parts, [_broadcast(builder, x) for x in numbers])
        else:
            factor = _broadcast(builder, values[4])
            scaled = [builder.fmul(factor, part) for part in parts]
        out.store(values[1], join(builder, out, values[1], scaled))

    return write


def _add_to_entry(builder, out, k, parts):
    return [builder.fadd(*pair) for pair in zip(out.load(k), parts, strict=True)]


_overload_with(lane_operations.set_entry)(_move_entry(lambda builder, out, k, parts: parts))
_overload_with(lane_operations.add_entry)(_move_entry(_add_to_entry))


@_overload_with(lane_operations.multiply_rows)
def _multiply_rows(context, builder, kinds, values):
    out, lanes = (_LaneArray(context, builder, kinds[k], values[k]) for k in (0, 5))
    starts, columns, nonzeros, sources = (
        context.make_array(kinds[k])(context, builder, values[k]) for k in (1, 2, 3, 4)
    )
    (count,) = cgutils.unpack_tuple(builder, starts.shape, 1)
    one, word = count.type(1), ir.IntType(64)

    def load(array, k):
        return builder.load(builder.gep(array.data, [k]))

    with cgutils.for_range(builder, builder.sub(count, one)) as row:
        begin, end = (
            builder.zext(load(starts, k), word) for k in (row.index, builder.add(row.index, one))
        )
        total = cgutils.alloca_once(builder, _LANE_VECTOR)
        builder.store(_ZEROS, total)
        with cgutils.for_range_slice(builder, begin, end, one, inc=True) as (entry, _):
            factor = _broadcast(builder, load(nonzeros, load(sources, entry)))
            (vector,) = lanes.load(load(columns, entry))
            product = builder.fmul(factor, vector)
            builder.store(builder.fadd(builder.load(total), product), total)
        out.store(row.index, [builder.load(total)])


@_overload_with(lane_operations.subtract_lanes)
def _subtract_lanes(context, builder, kinds, values):
    lanes = _LaneArray(context, builder, kinds[0], values[0])
    column = _LaneArray(context, builder, kinds[3], values[3])
    factor = lanes.load(values[5])
    with cgutils.for_range(builder, values[2]) as loop:
        entry = builder.add(values[1], loop.index)
        product = _multiply(builder, column.load(builder.add(values[4], loop.index)), factor)
        lanes.store(entry, _subtract(builder, lanes.load(entry), product))


# Rows that `subtract_products` keeps in registers: nodes of beams have three coordinates.
_ROWS_IN_REGISTERS = 3


@_overload_with(lane_operations.subtract_products)
def _subtract_products(context, builder, kinds, values):
    lanes = _LaneArray(context, builder, kinds[0], values[0])
    matrix = _LaneArray(context, builder, kinds[3], values[3])
    factors = _LaneArray(context, builder, kinds[6], values[6])
    begin, rows, first, stride, k, columns = (values[i] for i in (1, 2, 4, 5, 7, 8))

    def subtract_rows(row, count):
        sums = []
        for i in range(count):
            entry = builder.add(builder.add(begin, row), row.type(i))
            parts = lanes.load(entry)
            sums.append((entry, [cgutils.alloca_once_value(builder, part) for part in parts]))
        with cgutils.for_range(builder, columns) as loop:
            factor = factors.load(builder.add(k, loop.index))
            column = builder.add(builder.add(first, row), builder.mul(loop.index, stride))
            for i, (_, places) in enumerate(sums):
                product = _multiply(builder, matrix.load(builder.add(column, row.type(i))), factor)
                old = [builder.load(place) for place in places]
                for place, part in zip(places, _subtract(builder, old, product), strict=True):
                    builder.store(part, place)
        for entry, places in sums:
            lanes.store(entry, [builder.load(place) for place in places])

    together = _ROWS_IN_REGISTERS
    whole = builder.udiv(rows, rows.type(together))
    with cgutils.for_range(builder, whole) as loop:
        subtract_rows(builder.mul(loop.index, rows.type(together)), together)
    done = builder.mul(whole, rows.type(together))
    with cgutils.for_range(builder, builder.sub(rows, done)) as loop:
        subtract_rows(builder.add(done, loop.index), 1)


def _transpose_halves(builder, rows):
    """Transpose the two 4 x 4 matrices in the halves of four vectors."""
    even, odd = [0, 8, 2, 10, 4, 12, 6, 14], [1, 9, 3, 11, 5, 13, 7, 15]
    low, high = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]

    def shuffle(one, other, indices):
        return builder.shuffle_vector(one, other, _index_vector(indices))

    pairs = [[shuffle(*rows[k : k + 2], x) for k in (0, 2)] for x in (even, odd)]
    return [shuffle(*pair, x) for x in (low, high) for pair in pairs]


class _Tile:
    """Row of a table of tiles in compiled code."""

    def __init__(self, context, builder, kind, array, k):
        data = context.make_array(kind)(context, builder, array).data
        self._builder = builder
        width = ir.IntType(64)(2 + lane_operations.LANES)
        self._data = builder.gep(data, [builder.mul(k, width)])
        self.start, self.height = self._word(0), self._word(1)

    def _word(self, column):
        pointer = self._builder.gep(self._data, [ir.IntType(64)(column)])
        return self._builder.zext(self._builder.load(pointer), ir.IntType(64))

    def runs(self, data):
        """Return pointers to the runs of all lanes in an array."""
        builder = self._builder
        return [
            builder.bitcast(builder.gep(data, [self._word(2 + lane)]), _RUN.as_pointer())
            for lane in range(lane_operations.LANES)
        ]

    def row(self, data, start, stride, i):
        """Return the pointer to row `i` in an array of rows of lanes."""
        builder = self._builder
        first = builder.add(builder.add(self.start, start), builder.mul(stride, stride.type(i)))
        return builder.bitcast(builder.gep(data, [first]), _LANE_VECTOR.as_pointer())


_RUN = ir.VectorType(_DOUBLE, loop_functions.TILE_ROWS)
_HALVES = [list(range(first, first + 4)) for first in (0, 4)]


@_overload_with(loop_functions.pick_tiles)
def _pick_tiles(context, builder, kinds, values):
    out, vector = (context.make_array(kinds[k])(context, builder, values[k]).data for k in (0, 3))
    start, stride, begin, end = (values[k] for k in (1, 2, 5, 6))
    with cgutils.for_range(builder, builder.sub(end, begin)) as loop:
        tile = _Tile(context, builder, kinds[4], values[4], builder.add(begin, loop.index))
        runs = [builder.load(pointer, align=8) for pointer in tile.runs(vector)]
        halves = [
            builder.shuffle_vector(runs[k], runs[k + 4], _index_vector(range(8))) for k in range(4)
        ]
        for i, row in enumerate(_transpose_halves(builder, halves)):
            with builder.if_then(builder.icmp_unsigned(">", tile.height, tile.height.type(i))):
                builder.store(row, tile.row(out, start, stride, i), align=8)


@_overload_with(loop_functions.add_tiles)
def _add_tiles(context, builder, kinds, values):
    out, vector = (context.make_array(kinds[k])(context, builder, values[k]).data for k in (0, 1))
    stride, begin, end = (values[k] for k in (2, 4, 5))
    with cgutils.for_range(builder, builder.sub(end, begin)) as loop:
        tile = _Tile(context, builder, kinds[3], values[3], builder.add(begin, loop.index))
        rows = []
        for i in range(loop_functions.TILE_ROWS):
            is_row = builder.icmp_unsigned(">", tile.height, tile.height.type(i))
            # Rows beyond the tile read the first row.
            distance = builder.select(is_row, builder.mul(stride, stride.type(i)), stride.type(0))
            pointer = tile.row(vector, distance, stride, 0)
            rows.append(builder.select(is_row, builder.load(pointer, align=8), _ZEROS))
        halves = _transpose_halves(builder, rows)
        runs = [
            builder.shuffle_vector(part, part, _index_vector(half))
            for half in _HALVES
            for part in halves
        ]
        pointers = tile.runs(out)
        for pointer, run in zip(pointers, runs, strict=True):
            total = builder.fadd(builder.load(pointer, align=8), run)
            builder.store(total, pointer, align=8)


# Numbers of interior unknowns for which substitution keeps all of them in registers: one or two
# nodes of three coordinates.
_NODE_COORDINATES = 3
_TWO_NODES = 2 * _NODE_COORDINATES


class _BlockSubstitution:
    """Operands of `substitute_forward` and `substitute_backward` for `n` interior unknowns."""

    def __init__(self, n, context, builder, kinds, values):
        self.n, self.builder = n, builder
        self.at = _IndexedArray(context, builder, kinds[0], values[0], kinds[1], values[1])
        self.x = _LaneArray(context, builder, kinds[2], values[2])
        self.factors = _LaneArray(context, builder, kinds[4], values[4])
        self.begin, self.first = values[3], values[5]
        self.neighbors, self.shared = values[6], values[7]
        self.separate = builder.sub(self.neighbors, self.shared)
        word = self.begin.type
        self.size = builder.add(self.neighbors, word(n))
        self.first_neighbor = builder.add(self.begin, word(n))

    def shift(self, entry, distance):
        return self.builder.add(entry, entry.type(distance))

    def column(self, k):
        """Return the first entry of a column of the interior unknowns."""
        return self.builder.add(self.first, self.builder.mul(self.size, self.size.type(k)))

    def gather(self, entry):
        """Return one entry of all lanes of the right-hand side, as real and imaginary part."""
        parts = [ir.Constant(_LANE_VECTOR, ir.Undefined) for _ in range(self.x.parts)]
        for lane, pointers in enumerate(self.at.pointers(entry)):
            for part, pointer in enumerate(pointers):
                number, position = self.builder.load(pointer), ir.IntType(32)(lane)
                parts[part] = self.builder.insert_element(parts[part], number, position)
        return parts

    def broadcast(self, entry):
        """Return an entry that all lanes share."""
        pointers = self.at.pointer_of_first(entry)
        return [_broadcast(self.builder, self.builder.load(pointer)) for pointer in pointers]

    def subtract_product(self, value, entry, factor):
        product = _multiply(self.builder, self.factors.load(entry), factor)
        return _subtract(self.builder, value, product)


def _substitute_forward_ir(n):
    @_lane_operation
    def call(context, builder, kinds, values):
        block = _BlockSubstitution(n, context, builder, kinds, values)
        x = [block.gather(block.shift(block.begin, i)) for i in range(n)]
        for k in range(n):
            for i in range(k + 1, n):
                x[i] = block.subtract_product(x[i], block.shift(block.column(k), i), x[k])
        for i in range(n):
            block.x.store(block.shift(block.begin, i), x[i])

        def sum_row(row):
            total = [_ZEROS] * block.x.parts
            for k in range(n):
                entry = builder.add(block.shift(block.column(k), n), row)
                total = block.subtract_product(total, entry, x[k])
            return total

        with cgutils.for_range(builder, block.separate) as loop:
            total = sum_row(loop.index)
            entry = builder.add(block.first_neighbor, loop.index)
            for lane, pointers in enumerate(block.at.pointers(entry)):
                for part, pointer in zip(total, pointers, strict=True):
                    number = builder.extract_element(part, ir.IntType(32)(lane))
                    builder.store(builder.fadd(builder.load(pointer), number), pointer)
        with cgutils.for_range(builder, block.shared) as loop:
            row = builder.add(block.separate, loop.index)
            total = sum_row(row)
            pointers = block.at.pointer_of_first(builder.add(block.first_neighbor, row))
            for part, pointer in zip(total, pointers, strict=True):
                number = builder.fadd(builder.load(pointer), _sum_of(builder, part))
                builder.store(number, pointer)

    return call


def _substitute_backward_ir(n):
    @_lane_operation
    def call(context, builder, kinds, values):
        block = _BlockSubstitution(n, context, builder, kinds, values)
        x = [
            [cgutils.alloca_once_value(builder, part) for part in block.x.load(entry)]
            for entry in (block.shift(block.begin, i) for i in range(n))
        ]

        def subtract_column(row, factor):
            upper = builder.add(block.column(n), builder.mul(row, row.type(n)))
            for i, places in enumerate(x):
                value = [builder.load(place) for place in places]
                value = block.subtract_product(value, block.shift(upper, i), factor)
                for place, part in zip(places, value, strict=True):
                    builder.store(part, place)

        with cgutils.for_range(builder, block.separate) as loop:
            entry = builder.add(block.first_neighbor, loop.index)
            subtract_column(loop.index, block.gather(entry))
        with cgutils.for_range(builder, block.shared) as loop:
            row = builder.add(block.separate, loop.index)
            subtract_column(row, block.broadcast(builder.add(block.first_neighbor, row)))
        x = [[builder.load(place) for place in places] for places in x]
        for k in reversed(range(n)):
            column = block.column(k)
            x[k] = _multiply(builder, x[k], block.factors.load(block.shift(column, k)))
            for i in range(k):
                x[i] = block.subtract_product(x[i], block.shift(column, i), x[k])
        for i in range(n):
            for lane, pointers in enumerate(block.at.pointers(block.shift(block.begin, i))):
                for part, pointer in zip(x[i], pointers, strict=True):
                    builder.store(builder.extract_element(part, ir.IntType(32)(lane)), pointer)

    return call


def _overload_substitution(function, write):
    """Register compiled versions of a substitution: for one node, two nodes, and any block."""
    one_node, two_nodes = write(_NODE_COORDINATES), write(_TWO_NODES)
    # A copy, because the function itself stands for all versions.
    copy = FunctionType(function.__code__, function.__globals__)
    any_block = register_jitable(error_model="numpy", no_cfunc_wrapper=True)(copy)

    @overload(function)
    def substitute(right, at, block_x, begin, blocks, first, interior, neighbors, shared):
        def loop(right, at, block_x, begin, blocks, first, interior, neighbors, shared):
            arguments = (right, at, block_x, begin, blocks, first, neighbors, shared)
            if interior == _TWO_NODES:
                two_nodes(arguments)
            elif interior == _NODE_COORDINATES:
                one_node(arguments)
            else:
                any_block(right, at, block_x, begin, blocks, first, interior, neighbors, shared)

        return loop


_overload_substitution(lane_operations.substitute_forward, _substitute_forward_ir)
_overload_substitution(lane_operations.substitute_backward, _substitute_backward_ir)


@_compile_as(lane_operations.subtract_unit_triangle)
def _subtract_unit_triangle(lanes, begin, count, rows, blocks, first, size):
    for k in range(count):
        _subtract_lanes(
            (
                lanes,
                begin + k + 1,
                rows - k - 1,
                blocks,
                first + k * size + k + 1,
                begin + k,
            )
        )


_compile_as(loop_functions.factorize)(linear_solver.factorize_linear)


_compile_as(loop_functions.solve)(linear_solver.solve_linear)
_compile_as(loop_functions.solve_lanes)(linear_solver.solve_linear_lanes)
_compile_as(loop_functions.count_negative_pivots)(fixed_order.eliminate)


@intrinsic
def _numbers_at(typing, address, size):
    """Return the array of `size` floats at an address."""
    kind = types.Array(types.float64, 1, "C")

    def code(context, builder, signature, arguments):
        data = builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())
        return structs.build_array(context, builder, kind, data, [arguments[1]])

    return kind(types.int64, types.int64), code


@_compile_as(loop_functions.array_at)
def _array_at(address, size):
    return _numbers_at(address, size)


def _c_function(result):
    """Return an intrinsic that calls C functions with a result of this type."""

    @intrinsic
    def call(typing, address, arguments):
        def code(context, builder, signature, operands):
            c_address, packed = operands
            values = cgutils.unpack_tuple(builder, packed)
            kinds = [value.type for value in values]
            kind = ir.FunctionType(context.get_value_type(result), kinds)
            return builder.call(builder.inttoptr(c_address, kind.as_pointer()), values)

        return result(types.int64, arguments), code

    return call


_call_for_int, _call_for_pointer = _c_function(types.int32), _c_function(types.int64)


@_compile_as(loop_functions.call_for_int)
def _int_of(address, arguments):
    return _call_for_int(address, arguments)


@_compile_as(loop_functions.call_for_pointer)
def _pointer_of(address, arguments):
    return _call_for_pointer(address, arguments)
