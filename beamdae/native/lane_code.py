"""LLVM IR of kernels across elements: the instructions of an SX function, a vector lane a copy."""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import casadi as ca

from beamdae.native.llvm import MachineCodeError, library_address

LANE_WIDTH = 8

# {r} is the result, {T} the type of the operands {x} and {y}, {B} that of truth values, {s} the
# suffix of intrinsics.
_INLINE_TEMPLATES = {
    ca.OP_ADD: "{r} = fadd {T} {x}, {y}",
    ca.OP_SUB: "{r} = fsub {T} {x}, {y}",
    ca.OP_MUL: "{r} = fmul {T} {x}, {y}",
    ca.OP_DIV: "{r} = fdiv {T} {x}, {y}",
    ca.OP_NEG: "{r} = fneg {T} {x}",
    ca.OP_SQ: "{r} = fmul {T} {x}, {x}",
    ca.OP_TWICE: "{r} = fadd {T} {x}, {x}",
    ca.OP_INV: "{r} = fdiv {T} {one}, {x}",
    ca.OP_SQRT: "{r} = call {T} @llvm.sqrt.{s}({T} {x})",
    ca.OP_FABS: "{r} = call {T} @llvm.fabs.{s}({T} {x})",
    ca.OP_FLOOR: "{r} = call {T} @llvm.floor.{s}({T} {x})",
    ca.OP_CEIL: "{r} = call {T} @llvm.ceil.{s}({T} {x})",
    ca.OP_COPYSIGN: "{r} = call {T} @llvm.copysign.{s}({T} {x}, {T} {y})",
    ca.OP_LT: "{r}.a = fcmp olt {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    ca.OP_LE: "{r}.a = fcmp ole {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    ca.OP_EQ: "{r}.a = fcmp oeq {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    ca.OP_NE: "{r}.a = fcmp une {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    ca.OP_NOT: "{r}.a = fcmp oeq {T} {x}, zeroinitializer\n{r} = uitofp {B} {r}.a to {T}",
    # NaN is true.
    ca.OP_AND: (
        "{r}.a = fcmp une {T} {x}, zeroinitializer\n{r}.b = fcmp une {T} {y}, zeroinitializer\n"
        "{r}.c = and {B} {r}.a, {r}.b\n{r} = uitofp {B} {r}.c to {T}"
    ),
    ca.OP_OR: (
        "{r}.a = fcmp une {T} {x}, zeroinitializer\n{r}.b = fcmp une {T} {y}, zeroinitializer\n"
        "{r}.c = or {B} {r}.a, {r}.b\n{r} = uitofp {B} {r}.c to {T}"
    ),
    ca.OP_IF_ELSE_ZERO: (
        "{r}.a = fcmp oeq {T} {x}, zeroinitializer\n"
        "{r} = select {B} {r}.a, {T} zeroinitializer, {T} {y}"
    ),
    # The other one in place of a NaN, and of two zeros the first.
    ca.OP_FMIN: (
        "{r}.a = fcmp ogt {T} {x}, {y}\n{r}.b = fcmp uno {T} {x}, {x}\n"
        "{r}.c = or {B} {r}.a, {r}.b\n{r} = select {B} {r}.c, {T} {y}, {T} {x}"
    ),
    ca.OP_FMAX: (
        "{r}.a = fcmp olt {T} {x}, {y}\n{r}.b = fcmp uno {T} {x}, {x}\n"
        "{r}.c = or {B} {r}.a, {r}.b\n{r} = select {B} {r}.c, {T} {y}, {T} {x}"
    ),
    # A zero and a NaN stay as they are.
    ca.OP_SIGN: (
        "{r}.a = fcmp olt {T} {x}, zeroinitializer\n{r}.b = fcmp ogt {T} {x}, zeroinitializer\n"
        "{r}.c = select {B} {r}.b, {T} {one}, {T} {x}\n"
        "{r} = select {B} {r}.a, {T} {minus_one}, {T} {r}.c"
    ),
}

_LIBRARY_NAMES = {
    ca.OP_EXP: "exp",
    ca.OP_EXPM1: "expm1",
    ca.OP_LOG: "log",
    ca.OP_LOG1P: "log1p",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_ATAN2: "atan2",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh",
    ca.OP_ERF: "erf",
    ca.OP_HYPOT: "hypot",
    ca.OP_FMOD: "fmod",
    ca.OP_REMAINDER: "remainder",
}


LIBRARY_FUNCTIONS = tuple(dict.fromkeys(_LIBRARY_NAMES.values()))


class OperandType(NamedTuple):
    """Types of one number, or of a vector of them; the operations in them."""

    number: str
    inline: dict[int, str]
    functions: str


def format_constant(value: float) -> str:
    """A constant to the last bit."""
    return f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"


def _operand_type(number: str, truth: str, suffix: str, functions: str, lanes: int) -> OperandType:
    words = {"{T}": number, "{B}": truth, "{s}": suffix}
    for name, value in (("{one}", 1.0), ("{minus_one}", -1.0)):
        each = ", ".join([f"double {format_constant(value)}"] * lanes)
        words[name] = f"<{each}>" if lanes > 1 else format_constant(value)
    inline = dict(_INLINE_TEMPLATES)
    for word, text in words.items():
        inline = {operation: lines.replace(word, text) for operation, lines in inline.items()}
    return OperandType(number, inline, functions)


SCALAR = _operand_type("double", "i1", "f64", "libm", 1)
LANES = _operand_type(
    f"<{LANE_WIDTH} x double>", f"<{LANE_WIDTH} x i1>", f"v{LANE_WIDTH}f64", "lanes", LANE_WIDTH
)


def library_function_name(operation: int) -> str | None:
    """The function of the C library that an operation calls, if it does."""
    return _LIBRARY_NAMES.get(operation)


def is_supported(operation: int) -> bool:
    """Whether `write_operation` has this operation."""
    return operation in _INLINE_TEMPLATES or operation in _LIBRARY_NAMES


def write_operation(kind: OperandType, operation: int, result: str, x: str, y: str) -> str:
    """IR of one operation; of a unary one y is not read."""
    if operation in _LIBRARY_NAMES:
        name = _LIBRARY_NAMES[operation]
        operands = ", ".join(f"{kind.number} {z}" for z in (x, y)[: _count_arguments(name)])
        return f"{result} = call {kind.number} @{kind.functions}.{name}({operands})"
    return kind.inline[operation].format(r=result, x=x, y=y)


def _count_arguments(name: str) -> int:
    """Number of arguments of a function of the C library."""
    binary = ("pow", "atan2", "hypot", "fmod", "remainder")
    return 2 if name in binary else 1


def write_lane_wrapper(name: str) -> str:
    """IR that declares a function of the C library and calls it a lane at a time.

    A lane with the operands of the one before it has its result: lanes to spare cost nothing. By
    another name: LLVM would put other functions in the place of those it knows.
    """
    operands = "xy"[: _count_arguments(name)]
    plain = ", ".join(["double"] * len(operands))
    lanes = ", ".join(f"{LANES.number} %{z}" for z in operands)
    body = []
    for lane in range(LANE_WIDTH):
        for z in operands:
            body += [
                f"%{z}{lane} = extractelement {LANES.number} %{z}, i32 {lane}",
                # Zeros that are equal may differ in their sign.
                f"%{z}{lane}.b = bitcast double %{z}{lane} to i64",
            ]
    given = [", ".join(f"double %{z}{lane}" for z in operands) for lane in range(LANE_WIDTH)]
    body += [f"%f0 = call double @libm.{name}({given[0]})", "br label %next0", "next0:"]
    for lane in range(1, LANE_WIDTH):
        last = lane - 1
        body += [f"%{z}{lane}.s = icmp eq i64 %{z}{lane}.b, %{z}{last}.b" for z in operands]
        body += [
            f"%s{lane} = and i1 %{operands[0]}{lane}.s, %{operands[-1]}{lane}.s",
            f"br i1 %s{lane}, label %next{lane}, label %call{lane}",
            f"call{lane}:",
            f"%g{lane} = call double @libm.{name}({given[lane]})",
            f"br label %next{lane}",
            f"next{lane}:",
            f"%f{lane} = phi double [%f{last}, %next{last}], [%g{lane}, %call{lane}]",
        ]
    for lane in range(LANE_WIDTH):
        before = "poison" if lane == 0 else f"%r{lane - 1}"
        body.append(
            f"%r{lane} = insertelement {LANES.number} {before}, double %f{lane}, i32 {lane}"
        )
    return "\n".join(
        [
            f"declare double @libm.{name}({plain}) nounwind willreturn memory(none)",
            f"define internal {LANES.number} @lanes.{name}({lanes}) noinline nounwind {{",
            *body,
            f"ret {LANES.number} %r{LANE_WIDTH - 1}",
            "}",
        ]
    )


def write_lane_module(function: ca.Function) -> str:
    """LLVM IR of an SX function of (shared, local) with one dense output.

    Raises
    ------
    ValueError
        If it has an operation that cannot be compiled.
    """
    writer = _write_function(function)
    if writer is None or any(f"libm.{name}" not in library_imports() for name in writer.library):
        raise ValueError(f"{function.name()}: it has operations that cannot be compiled.")
    return writer.source


@cache
def library_imports() -> dict[str, int]:
    """Addresses of the functions of the C library that there are."""
    found = {}
    for name in LIBRARY_FUNCTIONS:
        with suppress(MachineCodeError):
            found[f"libm.{name}"] = library_address(name)
    return found


@cache
def describe_writer() -> tuple[str, ...]:
    """What writes the IR of a function."""
    return f"casadi {version('casadi')}", Path(__file__).read_text("utf-8")


@dataclass
class _LaneWriter:
    """IR of one function: what all copies share, then what is each copy's own.

    Operands are named by whether they are vectors, and by their text.
    """

    name: str
    before: list[str] = field(default_factory=list)
    group: list[str] = field(default_factory=list)
    library: set[str] = field(default_factory=set)
    _broadcast: dict[str, str] = field(default_factory=dict)

    def shared(self, result: str, row: int) -> tuple[bool, str]:
        self.before += [
            f"{result}.p = getelementptr double, ptr %shared, i64 {row}",
            f"{result} = load double, ptr {result}.p, align 8",
        ]
        return False, result

    def local(self, result: str, row: int) -> tuple[bool, str]:
        self._pointer(result, "%local", row)
        self.group.append(f"{result} = load {LANES.number}, ptr {result}.p, align 8")
        return True, result

    def store(self, result: str, row: int, value: tuple[bool, str]) -> None:
        text = self._lanes(value)
        self._pointer(result, "%out", row)
        self.group.append(f"store {LANES.number} {text}, ptr {result}.p, align 8")

    def operation(
        self, operation: int, result: str, x: tuple[bool, str], y: tuple[bool, str]
    ) -> tuple[bool, str]:
        function = library_function_name(operation)
        if function is not None:
            self.library.add(function)
        if x[0] or y[0]:
            self.group.append(
                write_operation(LANES, operation, result, self._lanes(x), self._lanes(y))
            )
            return True, result
        self.before.append(write_operation(SCALAR, operation, result, x[1], y[1]))
        return False, result

    def _pointer(self, result: str, base: str, row: int) -> None:
        self.group += [
            f"{result}.r = mul i64 %padded, {row}",
            f"{result}.i = add i64 {result}.r, %first",
            f"{result}.p = getelementptr double, ptr {base}, i64 {result}.i",
        ]

    def _lanes(self, value: tuple[bool, str]) -> str:
        is_vector, text = value
        if is_vector:
            return text
        if text not in self._broadcast:
            name = f"%b{len(self._broadcast)}"
            self.before += [
                f"{name}.s = insertelement {LANES.number} poison, double {text}, i32 0",
                f"{name} = shufflevector {LANES.number} {name}.s, {LANES.number} poison, "
                f"<{LANE_WIDTH} x i32> zeroinitializer",
            ]
            self._broadcast[text] = name
        return self._broadcast[text]

    @property
    def source(self) -> str:
        """The module."""
        return "\n".join(
            [
                *(write_lane_wrapper(name) for name in sorted(self.library)),
                f"define void @{self.name}(ptr noalias readonly %shared, "
                "ptr noalias readonly %local, ptr noalias %out, i64 %padded) nounwind {",
                "before:",
                *self.before,
                "%some = icmp sgt i64 %padded, 0",
                "br i1 %some, label %group, label %end",
                "group:",
                "%first = phi i64 [0, %before], [%next, %group]",
                *self.group,
                f"%next = add i64 %first, {LANE_WIDTH}",
                "%more = icmp slt i64 %next, %padded",
                "br i1 %more, label %group, label %end",
                "end:",
                "ret void",
                "}",
                "",
            ]
        )


def _write_function(function: ca.Function) -> _LaneWriter | None:
    """The function's instructions in IR, or None if one of them cannot be compiled."""
    require_lane_form(function)
    writer = _LaneWriter(function.name())
    work: dict[int, tuple[bool, str]] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation == ca.OP_OUTPUT:
            (_, row), (source,) = function.instruction_output(k), function.instruction_input(k)
            writer.store(f"%v{k}", row, work[source])
            continue
        (target,) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[target] = False, format_constant(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            which, row = function.instruction_input(k)
            work[target] = (writer.local if which else writer.shared)(f"%v{k}", row)
        elif operation == ca.OP_ASSIGN:
            (source,) = function.instruction_input(k)
            work[target] = work[source]
        elif is_supported(operation):
            read = [work[i] for i in function.instruction_input(k)]
            work[target] = writer.operation(operation, f"%v{k}", read[0], read[-1])
        else:
            return None
    return writer


def require_lane_form(function: ca.Function) -> None:
    """Refuse a function that is not one of (shared, local) with one dense output."""
    shapes = [function.sparsity_in(i) for i in range(function.n_in())]
    shapes += [function.sparsity_out(i) for i in range(function.n_out())]
    if not (
        function.class_name() == "SXFunction"
        and (function.n_in(), function.n_out()) == (2, 1)
        and all(shape.is_dense() and shape.size2() == 1 for shape in shapes)
    ):
        raise ValueError(
            f"{function.name()}: a kernel is an SX function of two columns with one dense column "
            f"as its output, got {function}."
        )
