"""Compiled versions of `loop_functions`: loops without temporary arrays.

Importing this module imports numba and registers the compiled versions with it.
"""

from __future__ import annotations

import math
from functools import partial

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.extending import overload as _overload

from beamdae.native import linear_solver, loop_functions, structs

# The overloads are called only by compiled loops, which need no C wrappers.
overload = partial(_overload, jit_options={"no_cfunc_wrapper": True})


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


@overload(loop_functions.fill)
def _fill(out, value):
    def loop(out, value):
        for i in range(out.size):
            out[i] = value

    return loop


@overload(loop_functions.minimum)
def _minimum(out, vector, factor, other):
    def loop(out, vector, factor, other):
        for i in range(out.size):
            value, limit = vector[i], factor * other[i]
            # NaN is kept.
            out[i] = value if value < limit or value != value else limit

    return loop


@overload(loop_functions.split_complex)
def _parts(real, imaginary, vector):
    def loop(real, imaginary, vector):
        for i in range(real.size):
            real[i] = vector[i].real
            imaginary[i] = vector[i].imag

    return loop


@overload(loop_functions.max_norm)
def _largest(vector, weights):
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
    def loop(vector, weights):
        total = 0.0
        for i in range(vector.size):
            weighted = vector[i] * weights[i]
            total += weighted * weighted
        return math.sqrt(total)

    return loop


@overload(loop_functions.locate_largest)
def _where_largest(vector, weights):
    def loop(vector, weights):
        at, largest = 0, -1.0
        for i in range(vector.size):
            size = abs(vector[i] * weights[i])
            if size > largest:
                at, largest = i, size
            elif size != size:
                return i
        return at

    return loop


@overload(loop_functions.pick)
def _pick(out, at, vector, of, begin, end):
    def loop(out, at, vector, of, begin, end):
        for k in range(begin, end):
            out[at[k]] = vector[of[k]]

    return loop


@overload(loop_functions.gather)
def _gather(out, at, weights, vector, of, begin, end):
    def loop(out, at, weights, vector, of, begin, end):
        for k in range(begin, end):
            out[at[k]] = 0.0
        for k in range(begin, end):
            out[at[k]] += weights[k] * vector[of[k]]

    return loop


@overload(loop_functions.add)
def _add(out, rows, vector, of, begin, end):
    def loop(out, rows, vector, of, begin, end):
        for k in range(begin, end):
            out[rows[k]] += vector[of[k]]

    return loop


@overload(loop_functions.add_weighted)
def _add_weighted(out, rows, weights, vector, of, begin, end):
    def loop(out, rows, weights, vector, of, begin, end):
        for k in range(begin, end):
            out[rows[k]] += weights[k] * vector[of[k]]

    return loop


@overload(loop_functions.scatter)
def _scatter(out, rows, weights, vector, of):
    def loop(out, rows, weights, vector, of):
        for i in range(out.size):
            out[i] = 0.0
        for k in range(rows.size):
            out[rows[k]] += weights[k] * vector[of[k]]

    return loop


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


@overload(loop_functions.call_kernel)
def _kernel(kernels, k, shared, local, start, out, lanes):
    def loop(kernels, k, shared, local, start, out, lanes):
        inputs = _start_of(local[start:])
        _call_kernel(kernels[k], _start_of(shared), inputs, _start_of(out), lanes)

    return loop


@overload(loop_functions.factorize)
def _factorize(linear, nonzeros):
    def loop(linear, nonzeros):
        return linear_solver.factorize_linear(linear, nonzeros)

    return loop


@overload(loop_functions.omit_refinement)
def _omit_refinement(linear):
    def loop(linear):
        linear.factors.refinements[0] = 0

    return loop


@overload(loop_functions.solve)
def _solve(linear, right):
    def loop(linear, right):
        linear_solver.solve_linear(linear, right)

    return loop


@intrinsic
def _numbers_at(typing, address, size):
    """Return the array of `size` floats at an address."""
    kind = types.Array(types.float64, 1, "C")

    def code(context, builder, signature, arguments):
        data = builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())
        return structs.build_array(context, builder, kind, data, [arguments[1]])

    return kind(types.int64, types.int64), code


@overload(loop_functions.array_at)
def _array_at(address, size):
    def loop(address, size):
        return _numbers_at(address, size)

    return loop


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


@overload(loop_functions.call_for_int)
def _int_of(address, arguments):
    def loop(address, arguments):
        return _call_for_int(address, arguments)

    return loop


@overload(loop_functions.call_for_pointer)
def _pointer_of(address, arguments):
    def loop(address, arguments):
        return _call_for_pointer(address, arguments)

    return loop
