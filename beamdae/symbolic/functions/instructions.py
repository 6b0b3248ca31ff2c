"""Instructions of SX functions, and their repetition with other operands or operations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import casadi as ca

SX = ca.SX

# (operation, operands, results): CasADi's code of an operation, or a call, and the slots of the
# work vector that it reads and writes. The operands of OP_INPUT are the input and the non-zero, as
# are the results of OP_OUTPUT; unused results of calls have slot -1.
Instruction = tuple[Any, tuple[int, ...], tuple[int, ...]]


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
