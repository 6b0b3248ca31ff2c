"""Instructions of SX functions, and their evaluation with values of any kind."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from typing import Any, TypeVar

import casadi as ca

SX = ca.SX
T = TypeVar("T")

# (operation, operands, results): CasADi's code of an operation, or the function that a call calls,
# and the slots of the work vector that it reads and writes. The operands of OP_INPUT are the input
# and the non-zero, as are the results of OP_OUTPUT; that of OP_CONST is the number.
Instruction = tuple[Any, tuple[Any, ...], tuple[int, ...]]
# Evaluates (operation, operands, number of results).
Operate = Callable[[Any, list[SX], int], Sequence[SX]]
# Replaces a base of zero in powers; powers with exponents above 1.1 are zero.
_TINY_BASE = 1e-300


def operation_codes(names: str) -> list[int]:
    """Return CasADi's codes of operations by name, such as those of "SIN COS"."""
    return [getattr(ca, f"OP_{name}") for name in names.split()]


def by_operation(**values: T) -> dict[int, T]:
    """Return values by CasADi's code of the operation that is the name of the argument."""
    return dict(zip(operation_codes(" ".join(values)), values.values(), strict=True))


def read_instructions(function: ca.Function) -> list[Instruction]:
    """Return the instructions of an SX function."""
    operations: list[Any] = read_operations(function)
    calls = function.instructions_sx() if ca.OP_CALL in operations else SX()
    instructions: list[Instruction] = []
    for k, operation in enumerate(operations):
        operands: tuple[Any, ...] = tuple(function.instruction_input(k))
        if operation == ca.OP_CONST:
            operands = (function.instruction_constant(k),)
        elif operation == ca.OP_CALL:
            operation = calls.nz[k].which_function()
        instructions.append((operation, operands, tuple(function.instruction_output(k))))
    return instructions


def read_operations(function: ca.Function) -> list[int]:
    """Return CasADi's code of each instruction of a function."""
    return [function.instruction_id(k) for k in range(function.n_instructions())]


def evaluate_instructions(
    instructions: Iterable[Instruction],
    read: Callable[[int, tuple[Any, ...]], T],
    operate: Callable[[Any, list[T], int], Sequence[T]],
    write: Callable[[int, int, T], None],
) -> None:
    """Evaluate instructions with values of any kind, such as expressions or their text.

    Parameters
    ----------
    instructions
        Instructions in order.
    read
        Function (code, operands) that returns the value of OP_INPUT or OP_CONST.
    operate
        Function (operation, operands, number of results) that returns the results of an operation.
    write
        Function (output, non-zero, value) that receives each result of the function.
    """
    work: dict[int, T] = {}
    for operation, operands, results in instructions:
        if operation == ca.OP_OUTPUT:
            output, entry = results
            write(output, entry, work[operands[0]])
        elif operation in (ca.OP_INPUT, ca.OP_CONST):
            work[results[0]] = read(operation, operands)
        else:
            values = operate(operation, [work[i] for i in operands], len(results))
            work.update(zip(results, values, strict=True))


def trace_dependence(
    function: ca.Function, arguments: Container[tuple[int, int]]
) -> list[tuple[int, list[bool]]]:
    """Return CasADi's code of each operation, and which of its operands depend on `arguments`.

    `arguments` are pairs (input, entry).
    """
    dependences: list[tuple[int, list[bool]]] = []

    def operate(operation: Any, flags: list[bool], count: int) -> list[bool]:
        dependences.append((operation if isinstance(operation, int) else ca.OP_CALL, flags))
        return [any(flags)] * count

    evaluate_instructions(
        read_instructions(function),
        lambda code, operands: code == ca.OP_INPUT and operands in arguments,
        operate,
        lambda *result: None,
    )
    return dependences


def remove_repetitions(function: ca.Function) -> ca.Function:
    """Return an SX function of one output that evaluates repeated subexpressions once."""
    inputs = function.sx_in()
    return ca.Function(function.name(), inputs, ca.cse(function.call(inputs)))


def repeat_operation(operation: Any, operands: Sequence[SX], count: int) -> Sequence[SX]:
    """Return the `count` results of an operation or of a called function."""
    if isinstance(operation, int):
        if len(operands) == 1:
            return [SX.unary(operation, *operands)]
        return [SX.binary(operation, *operands)]
    columns, first = [], 0
    for i in range(operation.n_in()):
        end = first + operation.nnz_in(i)
        columns.append(ca.vertcat(*operands[first:end]))
        first = end
    return [x for column in operation.call(columns) for x in ca.vertsplit(column)]


def repeat_instructions(
    instructions: Iterable[Instruction],
    inputs: Sequence[SX],
    outputs: Sequence[SX],
    constant: Callable[..., SX] = SX,
    operate: Operate = repeat_operation,
) -> None:
    """Write the results of instructions into the non-zeros of `outputs`.

    Columns `inputs` replace the inputs, and results of `constant` and `operate` the constants and
    the results of operations.
    """

    def read(code: int, operands: tuple[Any, ...]) -> SX:
        if code == ca.OP_CONST:
            return constant(*operands)
        return inputs[operands[0]].nz[operands[1]]

    def write(output: int, entry: int, value: SX) -> None:
        outputs[output].nz[entry] = value

    evaluate_instructions(instructions, read, operate, write)


def rebuild_output(
    function: ca.Function, inputs: Sequence[SX], operate: Operate = repeat_operation
) -> SX:
    """Return the output of a function with one output; see `repeat_instructions`."""
    output = SX.zeros(function.sparsity_out(0))
    repeat_instructions(read_instructions(function), inputs, [output], operate=operate)
    return output


def expand_powers(function: ca.Function, *arguments: SX) -> SX:
    """Return the value (n,) of a function at symbols, prepared for differentiation.

    The derivative of x^n with respect to n is x^n log x. At x = 0, for example for an open contact,
    it is NaN instead of its limit zero. Therefore, zero bases are replaced by a tiny number.

    The derivative of x^n with respect to x is infinite at x = 0 if n < 1, such as that of the
    stiffness of a contact at first touch. There, the derivative from the side on which the contact
    is open, zero, replaces it.
    """
    if ca.OP_POW not in read_operations(function):
        return ca.densify(ca.vec(function(*arguments)))

    def operate(operation: Any, operands: list[SX], count: int) -> Sequence[SX]:
        if operation == ca.OP_POW:
            base, exponent = operands
            operands = [_limit_slope(base, exponent), exponent]
        return repeat_operation(operation, operands, count)

    return ca.densify(ca.vec(rebuild_output(function, arguments, operate)))


def _limit_slope(base: SX, exponent: SX) -> SX:
    """Return a nonzero base whose derivative is zero where that of the power is not bounded."""
    result = (1.0 - (base == 0.0) * (exponent < 1.0)) * base
    return result + _TINY_BASE * (result == 0.0)
