"""C source of kernels and of constant tables."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from beamdae.native.instructions import by_operation, evaluate_instructions, read_instructions
from beamdae.native.lane_code import BINARY_FUNCTIONS, FIND, LIBRARY_NAMES, PICK
from beamdae.native.point_programs import Call, Load, Loop, Mix, Place, Program, Set, Spread, Step
from beamdae.symbolic.table_lookups import has_lookups

Array = np.ndarray

_NUMBERS_PER_LINE = 12

# C expressions of operations of CasADi with the operands {x} and {y}: those of numbers and vectors,
# and those of numbers.
_ARITHMETIC = by_operation(
    ASSIGN="{x}",
    ADD="{x} + {y}",
    SUB="{x} - {y}",
    MUL="{x} * {y}",
    DIV="{x} / {y}",
    NEG="-{x}",
    SQ="{x} * {x}",
    TWICE="{x} + {x}",
    INV="1.0 / {x}",
)
_EXPRESSIONS = by_operation(
    LT="{x} < {y}",
    LE="{x} <= {y}",
    EQ="{x} == {y}",
    NE="{x} != {y}",
    NOT="{x} == 0.0",
    AND="{x} != 0.0 && {y} != 0.0",
    OR="{x} != 0.0 || {y} != 0.0",
    IF_ELSE_ZERO="{x} != 0.0 ? {y} : 0.0",
    SIGN="{x} < 0.0 ? -1.0 : {x} > 0.0 ? 1.0 : {x}",
    SQRT="sqrt({x})",
    FABS="fabs({x})",
    FLOOR="floor({x})",
    CEIL="ceil({x})",
    COPYSIGN="copysign({x}, {y})",
    FMIN="fmin({x}, {y})",
    FMAX="fmax({x}, {y})",
) | {
    code: f"{name}({{x}}, {{y}})" if name in BINARY_FUNCTIONS else f"{name}({{x}})"
    for code, name in LIBRARY_NAMES.items()
}


class UnsupportedOperationError(ValueError):
    """Raised for a function with an operation that has no C expression."""


def write_kernel(name: str, function: ca.Function) -> str:
    """Return a C function of the type `Kernel` that evaluates an SX function.

    The function takes two dense columns (shared, local) and returns one dense column.

    Raises
    ------
    UnsupportedOperationError
        If the function contains an operation that cannot be written.
    """
    if function.class_name() != "SXFunction":
        function = function.expand()
    lines: list[str] = []
    names = (f"v{k}" for k in itertools.count())
    has_tables = has_lookups(function)

    # Values are C expressions, and whether they are vectors.
    def define(expression: str, is_vector: bool) -> tuple[str, bool]:
        name = next(names)
        lines.append(f"const {'Register' if is_vector else 'double'} {name} = {expression};")
        return name, is_vector

    def read(code: int, operands: tuple[Any, ...]) -> tuple[str, bool]:
        if code == ca.OP_CONST:
            return format_number(*operands), False
        is_local, row = operands
        expression = f"LOAD({row})" if is_local else f"shared[{row}]"
        # Rows of tables are not read before their lookup.
        return (expression, bool(is_local)) if has_tables else define(expression, bool(is_local))

    def operate(operation: Any, operands: list[tuple[str, bool]], count: int) -> list[Any]:
        if isinstance(operation, ca.Function):
            vectors = [_as_vector(*x) for x in operands]
            return [define(x, True) for x in _write_call(operation.name(), vectors, count)]
        x, y = operands[0], operands[-1]
        is_vector = x[1] or y[1]
        if operation in _ARITHMETIC:
            expression = _ARITHMETIC[operation].format(x=x[0], y=y[0])
        elif operation not in _EXPRESSIONS:
            raise UnsupportedOperationError(f"operation {operation} of CasADi")
        elif is_vector:
            expression = f"operation{operation}({_as_vector(*x)}, {_as_vector(*y)})"
        else:
            expression = _EXPRESSIONS[operation].format(x=x[0], y=y[0])
        return [define(expression, is_vector)]

    def write(_: int, row: int, value: tuple[str, bool]) -> None:
        lines.append(f"STORE({row}, {_as_vector(*value)});")

    evaluate_instructions(read_instructions(function), read, operate, write)
    body = "\n".join(f"    {line}" for line in lines)
    unused = "    (void)shared, (void)local, (void)out, (void)lanes;"
    return f"{write_head(name)} {{\n{unused}\n{body}\n}}\n"


def _as_vector(expression: str, is_vector: bool) -> str:
    return expression if is_vector else f"ALL({expression})"


def write_operations() -> str:
    """Return C functions of the operations of kernels that C does not define for vectors."""
    return "\n".join(
        f"#define NUMBER{code}(i) ({expression.format(x='x[i]', y='y[i]')})\n"
        f"static inline Register operation{code}(Register x, Register y) {{\n"
        f"    (void)y;\n    return (Register)NUMBERS(NUMBER{code});\n}}\n"
        for code, expression in _EXPRESSIONS.items()
    )


def write_head(name: str) -> str:
    """Return the head of a C function of the type `Kernel`."""
    arguments = "const double *shared, const double *local, double *out, int64_t lanes"
    return f"static void {name}({arguments})"


def write_point_kernel(
    name: str, program: Program, names: Mapping[str, str], integers: str, weights: str
) -> str:
    """Return a C function of the type `Kernel` that executes a program.

    `names` maps the kernels of points to their C functions; `integers` and `weights` are the names
    of the tables of constants.
    """
    arrays = {"integers": integers, "weights": weights}

    def locate(place: Place) -> str:
        moved = f" + {place.per_point} * point" if place.per_point else ""
        return f"{arrays.get(place.array, place.array)} + {place.offset}{moved}"

    def write(step: Step) -> list[str]:
        if isinstance(step, Loop):
            body = [line for x in step.steps for line in write(x)]
            return [f"for (uint32_t point = 0; point < {step.points}; point++) {{", *body, "}"]
        places = ", ".join(locate(x) for x in step if isinstance(x, Place))
        if isinstance(step, Call):
            local, values = locate(step.local), locate(step.values)
            numbers = f"(const double *)({local}), (double *)({values})"
            return [f"{names[step.symbol]}(shared, {numbers}, WIDTH);"]
        if isinstance(step, Mix):
            sizes = (step.tiles, step.tile, step.entries, step.length, *step.strides)
            settings = f"(Mix){{{', '.join(map(str, sizes))}, {int(step.adds)}}}"
            *four, rest = [*map(locate, step[:4]), settings]
            if step.numbers is None:
                return [f"mix({', '.join([*four, rest])});"]
            return [f"mix_numbers({', '.join([*four, rest])}, {locate(step.numbers)});"]
        if isinstance(step, Spread):
            return [f"spread({places}, {step.runs}, {step.entries}, {step.size});"]
        if isinstance(step, Set):
            return [f"set_rows({places}, {step.size}, {format_number(step.value)});"]
        if isinstance(step, Load):
            return [f"load_rows({places}, {step.size}, local, lanes);"]
        return [f"store_rows({places}, {step.size}, out, lanes);"]

    lines = [f"Register {x}[{count}];" for x, count in program.buffers.items()]
    lines += [line for step in program.steps for line in write(step)]
    body = "\n".join(f"    {line}" for line in lines)
    return f"{write_head(name)} {{\n{body}\n}}\n"


def _write_call(name: str, operands: Sequence[str], count: int) -> list[str]:
    """Return the results of a call of a function of `beamdae.native.lane_code`."""
    argument, rows = operands[0], operands[1:]
    match = re.fullmatch(r"LOAD\((\d+)\)", rows[0])
    first = int(match[1]) if match else 0
    if name not in (FIND, PICK) or list(rows) != [f"LOAD({first + i})" for i in range(len(rows))]:
        raise UnsupportedOperationError(f"call of {name}")
    if name == FIND:
        return [f"find_rows(local + {first} * lanes, lanes, {len(rows)}, {argument})"]
    return [f"pick_rows(local + {first + i} * lanes, lanes, {argument})" for i in range(count)]


def format_number(value: float) -> str:
    """Return a C expression of exactly this number."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text


def format_string(text: str) -> str:
    """Return a C literal of a string in UTF-8."""
    plain = "".join(
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}"
        for byte in text.encode()
    )
    return f'"{plain}"'


class Tables:
    """Constant arrays of a source file; equal arrays are written once."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, bytes], str] = {}
        self._lines: list[str] = []

    def numbers(self, values: Sequence[float] | Array) -> str:
        """Return the name of an array of doubles; "NULL" for no values."""
        array = np.asarray(values, float)
        return self._add("double", array, [format_number(x) for x in array.tolist()])

    def indices(self, values: Sequence[int] | Array) -> str:
        """Return the name of an array of indices; "NULL" for no values."""
        array = np.asarray(values, np.int64)
        return self._add("uint32_t", array, [str(x) for x in array.tolist()])

    def integers(self, values: Sequence[int] | Array) -> str:
        """Return the name of an array of words with these bits; "NULL" for no values."""
        array = np.asarray(values, np.int64)
        return self._add("uint64_t", array, [f"{x:#x}u" for x in array.view(np.uint64).tolist()])

    def rows(self, kind: str, rows: Sequence[str]) -> str:
        """Return the name of an array of structs; "NULL" for no rows."""
        return self._add(kind, np.frombuffer("\n".join(rows).encode(), np.uint8), list(rows), 1)

    def _add(
        self, kind: str, array: Array, texts: list[str], width: int = _NUMBERS_PER_LINE
    ) -> str:
        if not texts:
            return "NULL"
        key = (kind, array.tobytes())
        if key not in self._names:
            name = self._names[key] = f"table{len(self._names)}"
            lines = [", ".join(texts[i : i + width]) for i in range(0, len(texts), width)]
            body = ",\n    ".join(lines)
            self._lines.append(f"static const {kind} {name}[] = {{\n    {body}}};\n")
        return self._names[key]

    @property
    def source(self) -> str:
        """Definitions of all arrays."""
        return "\n".join(self._lines)
