"""Powers whose derivatives with respect to the exponent exist at a base of zero."""

from __future__ import annotations

import casadi as ca

from beamdae.symbolic.table_lookups import repeat_call, repeat_operation

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
    codes = [function.instruction_id(k) for k in range(function.n_instructions())]
    if ca.OP_POW not in codes:
        return ca.densify(ca.vec(function(*arguments)))
    calls = function.instructions_sx() if ca.OP_CALL in codes else None
    work, value = [SX(0)] * function.sz_w(), SX.zeros(function.numel_out(0))
    for k, code in enumerate(codes):
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            value[targets[1]] = work[sources[0]]
        elif code == ca.OP_INPUT:
            work[targets[0]] = arguments[sources[0]].nz[sources[1]]
        elif code == ca.OP_CONST:
            work[targets[0]] = SX(function.instruction_constant(k))
        elif calls is not None and code == ca.OP_CALL:
            results = repeat_call(calls.nz[k], [work[i] for i in sources])
            for target, result in zip(targets, results, strict=True):
                # Unused results have no place.
                if target >= 0:
                    work[target] = result
        else:
            operands = [work[i] for i in sources]
            if code == ca.OP_POW:
                operands[0] = _limit_slope(*operands, min_base)
            work[targets[0]] = repeat_operation(code, operands)
    return value


def _limit_slope(base: SX, exponent: SX, min_base: float) -> SX:
    """Return a nonzero base whose derivative is zero where that of the power is not bounded."""
    is_steep = (ca.fabs(base) <= min_base) * (exponent < 1.0)
    result = (1.0 - is_steep) * base + _TINY_BASE * (base == 0.0)
    if min_base > 0.0:
        # The derivative of `floor` is zero.
        result += is_steep * _BASE_RESOLUTION * ca.floor(base / _BASE_RESOLUTION)
    return result
