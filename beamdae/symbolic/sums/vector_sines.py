"""Sines and cosines of kernels as polynomials, evaluated in all vector lanes at once.

The C library computes sines one by one. Polynomials consist of operations that are rounded in the
same way everywhere, so that machine code and CasADi's virtual machine still return the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import casadi as ca

from beamdae.native.instructions import (
    read_operations,
    rebuild_output,
    repeat_operation,
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
