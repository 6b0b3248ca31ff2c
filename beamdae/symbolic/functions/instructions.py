"""Instructions of SX functions, and their repetition with other operands or operations."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from typing import Any

import casadi as ca

SX = ca.SX

# (operation, operands, results): CasADi's code of an operation, or a call, and the slots of the
# work vector that it reads and writes. The operands of OP_INPUT are the input and the non-zero, as
# are the results of OP_OUTPUT; unused results of calls have slot -1.
Instruction = tuple[Any, tuple[int, ...], tuple[int, ...]]
# Replaces a base of zero in powers; powers with exponents above 1.1 are zero.
_TINY_BASE = 1e-300
# Bases with a derivative of zero are rounded to multiples of this number.
_BASE_RESOLUTION = 2.0**-80


def read_instructions(function: ca.Function) -> list[Instruction]:
    """Return the instructions of an SX function; calls are entries of `instructions_sx`."""
    operations: list[Any] = read_operations(function)
    if ca.OP_CALL in operations:
        calls = function.instructions_sx()
        operations = [calls.nz[k] if x == ca.OP_CALL else x for k, x in enumerate(operations)]
    return [
        (operation, tuple(function.instruction_input(k)), tuple(function.instruction_output(k)))
        for k, operation in enumerate(operations)
    ]


def read_operations(function: ca.Function) -> list[int]:
    """Return CasADi's code of each instruction of a function."""
    return [function.instruction_id(k) for k in range(function.n_instructions())]


def trace_dependence(
    function: ca.Function, arguments: Container[tuple[int, int]]
) -> Iterator[tuple[int, list[bool]]]:
    """Yield CasADi's code of each operation, and which of its operands depend on `arguments`.

    `arguments` are pairs (input, entry).
    """
    depends: dict[int, bool] = {}
    for k, code in enumerate(read_operations(function)):
        operands, results = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            continue
        if code == ca.OP_INPUT:
            flags = [(operands[0], operands[1]) in arguments]
        else:
            flags = [depends[i] for i in operands]
            yield code, flags
        depends.update(dict.fromkeys(results, any(flags)))


def remove_repetitions(function: ca.Function) -> ca.Function:
    """Return an SX function of one output that evaluates repeated subexpressions once."""
    inputs = function.sx_in()
    return ca.Function(function.name(), inputs, ca.cse(function.call(inputs)))


def read_constants(function: ca.Function) -> list[float]:
    """Return the numbers in a function, in the order of its instructions."""
    codes = read_operations(function)
    return [function.instruction_constant(k) for k, x in enumerate(codes) if x == ca.OP_CONST]


def repeat_operation(code: int, operands: Sequence[SX]) -> SX:
    """Return the result of a unary or binary operation of CasADi."""
    return SX.unary(code, *operands) if len(operands) == 1 else SX.binary(code, *operands)


def repeat_call(call: SX, operands: Sequence[SX], count: int) -> list[SX]:
    """Return the `count` results of a call, an entry of `instructions_sx`."""
    function = call.which_function()
    columns, first = [], 0
    for i in range(function.n_in()):
        end = first + function.nnz_in(i)
        columns.append(ca.vertcat(*operands[first:end]))
        first = end
    return [x for column in function.call(columns) for x in ca.vertsplit(column)]


def repeat_instructions(
    instructions: Iterable[Instruction],
    inputs: Sequence[SX],
    outputs: Sequence[SX],
    constants: Iterator[SX],
    operate: Callable[[int, list[SX]], SX] = repeat_operation,
    call: Callable[[Any, list[SX], int], Sequence[SX]] = repeat_call,
) -> None:
    """Write the results of instructions into the non-zeros of `outputs`.

    Parameters
    ----------
    instructions
        Instructions in order; operations that are not integers are calls.
    inputs
        Columns that replace the inputs.
    outputs
        One expression per output, which is overwritten.
    constants
        Numbers, in the order of the instructions with OP_CONST.
    operate
        Function (code, operands) that returns the result of an operation.
    call
        Function (operation, operands, number of results) that returns the results of a call.
    """
    work: dict[int, SX] = {}
    for operation, operands, results in instructions:
        if not isinstance(operation, int):
            values = call(operation, [work[i] for i in operands], len(results))
            work.update(zip(results, values, strict=True))
        elif operation == ca.OP_OUTPUT:
            outputs[results[0]].nz[results[1]] = work[operands[0]]
        elif operation == ca.OP_INPUT:
            work[results[0]] = inputs[operands[0]].nz[operands[1]]
        elif operation == ca.OP_CONST:
            work[results[0]] = next(constants)
        else:
            work[results[0]] = operate(operation, [work[i] for i in operands])


def rebuild_output(
    function: ca.Function,
    inputs: Sequence[SX],
    operate: Callable[[int, list[SX]], SX] = repeat_operation,
    call: Callable[[Any, list[SX], int], Sequence[SX]] = repeat_call,
) -> SX:
    """Return the output of a function with one output; see `repeat_instructions`."""
    output = SX.zeros(function.sparsity_out(0))
    instructions = read_instructions(function)
    constants = (
        SX(function.instruction_constant(k))
        for k, (operation, _, _) in enumerate(instructions)
        if isinstance(operation, int) and operation == ca.OP_CONST
    )
    repeat_instructions(instructions, inputs, [output], constants, operate, call)
    return output


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
