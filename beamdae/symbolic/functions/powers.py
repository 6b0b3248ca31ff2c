"""Powers whose derivatives with respect to the exponent exist at a base of zero."""

from __future__ import annotations

import casadi as ca

from beamdae.symbolic.functions.instructions import (
    read_operations,
    rebuild_output,
    repeat_operation,
)

SX = ca.SX

# Replaces a base of zero in powers; powers with exponents above 1.1 are zero.
_TINY_BASE = 1e-300
# Bases with a derivative of zero are rounded to multiples of this number.
_BASE_RESOLUTION = 2.0**-80


def expand_powers(function: ca.Function, *arguments: SX, min_base: float = 0.0) -> SX:
    """Return the value (n,) of a function at symbols, prepared for differentiation.

    The derivative of x^n with respect to n is x^n log x. At x = 0, for example for an open contact,
    it is NaN instead of its limit zero. Therefore, zero bases are replaced by a tiny number.

    The derivative of x^n with respect to x is infinite at x = 0 if n < 1, such as that of the
    stiffness of a contact at first touch. There, the derivative from the side on which the contact
    is open, zero, replaces it. With `min_base`, it does so up to this size of x.
    """
    if ca.OP_POW not in read_operations(function):
        return ca.densify(ca.vec(function(*arguments)))

    def operate(code: int, operands: list[SX]) -> SX:
        if code == ca.OP_POW:
            base, exponent = operands
            operands = [_limit_slope(base, exponent, min_base), exponent]
        return repeat_operation(code, operands)

    return ca.densify(ca.vec(rebuild_output(function, arguments, operate)))


def _limit_slope(base: SX, exponent: SX, min_base: float) -> SX:
    """Return a nonzero base whose derivative is zero where that of the power is not bounded."""
    is_steep = (ca.fabs(base) <= min_base) * (exponent < 1.0)
    result = (1.0 - is_steep) * base
    if min_base > 0.0:
        # The derivative of `floor` is zero.
        result += is_steep * _BASE_RESOLUTION * ca.floor(base / _BASE_RESOLUTION)
    return result + _TINY_BASE * (result == 0.0)
