"""LLVM IR of kernels: the instructions of an SX function, with one copy per vector lane.

Each operation gives the result of CasADi's virtual machine, including NaN, infinities and signed
zeros. Operations that IEEE 754 does not define exactly call the C library, one lane at a time, so
that results agree to the last bit. (Sign and payload of a NaN are not preserved, because no rule
says which operand they come from.)
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca

from beamdae.native.instructions import (
    by_operation,
    evaluate_instructions,
    operation_codes,
    read_instructions,
)
from beamdae.native.llvm import MachineCodeError, library_address

# Functions that read single rows of tables: kernels call them instead of evaluating all rows, so
# that neither compilation nor evaluation takes longer for long tables. `symbolic.table_lookups`
# differentiates them.
FIND = "table_find"
PICK = "table_pick"
SPREAD = "table_spread"

_MAX_FUNCTIONS = 256


def _define(name: str, inputs: list[Any], output: Any, is_linear: bool = True) -> ca.Function:
    # Rows are constant in derivatives. CasADi would not set derivatives of a function without any
    # differentiable input.
    options: dict[str, Any] = {"never_inline": True, "is_diff_in": [False, is_linear]}
    return ca.Function(name, inputs, [output], options)


@lru_cache(_MAX_FUNCTIONS)
def find_function(count: int) -> ca.Function:
    """Return the function (x, axis) of the last row k < count - 1 with axis[k] <= x, or 0."""
    x, axis = ca.MX.sym("x"), ca.MX.sym("axis", count)
    return _define(FIND, [x, axis], ca.low(axis, x, {"lookup_mode": "binary"}), False)


@lru_cache(_MAX_FUNCTIONS)
def pick_function(count: int, width: int) -> ca.Function:
    """Return the function (k, numbers) of `width` of `count` numbers, starting with number k."""
    row, numbers = ca.MX.sym("row"), ca.MX.sym("numbers", count)
    return _define(PICK, [row, numbers], ca.vertcat(*(numbers[row + i] for i in range(width))))


@lru_cache(_MAX_FUNCTIONS)
def spread_function(count: int, width: int) -> ca.Function:
    """Return the function (k, values) of `count` zeros, with the values starting at number k."""
    row, values, numbers = ca.MX.sym("row"), ca.MX.sym("values", width), ca.MX.zeros(count)
    for i in range(width):
        numbers.nz[row + i] = values[i]
    return _define(SPREAD, [row, values], numbers)


# %rows is the first row of the table; rows are `padded` doubles apart. The bisection is that of
# `casadi_low`, so that axes which do not ascend give the same row, too.
_LANE_FUNCTIONS = """
define internal {T} @lanes.find(ptr %rows, i64 %padded, i64 %n, {T} %x) noinline nounwind {{
begin:
%last = sub i64 %n, 1
%lastbutone = sub i64 %n, 2
br label %lane
lane:
%l = phi i64 [0, %begin], [%l.next, %done]
%r = phi {T} [zeroinitializer, %begin], [%r.next, %done]
%z = extractelement {T} %x, i64 %l
%p = getelementptr double, ptr %rows, i64 %l
%p.second = getelementptr double, ptr %p, i64 %padded
%second = load double, ptr %p.second, align 8
%isbefore = fcmp olt double %z, %second
br i1 %isbefore, label %done, label %after
after:
%o.last = mul i64 %padded, %last
%p.last = getelementptr double, ptr %p, i64 %o.last
%final = load double, ptr %p.last, align 8
%isafter = fcmp ogt double %z, %final
br i1 %isafter, label %done, label %bisect
bisect:
%start = phi i64 [0, %after], [%start.next, %bisect]
%stop = phi i64 [%last, %after], [%stop.next, %bisect]
%sum = add i64 %start, %stop
%pivot = lshr i64 %sum, 1
%o = mul i64 %padded, %pivot
%p.pivot = getelementptr double, ptr %p, i64 %o
%value = load double, ptr %p.pivot, align 8
%isless = fcmp olt double %z, %value
%start.next = select i1 %isless, i64 %start, i64 %pivot
%stop.next = select i1 %isless, i64 %pivot, i64 %stop
%bound = select i1 %isless, i64 %stop, i64 %start
%isfound = icmp eq i64 %pivot, %bound
br i1 %isfound, label %done, label %bisect
done:
%k = phi i64 [0, %lane], [%lastbutone, %after], [%pivot, %bisect]
%kd = sitofp i64 %k to double
%r.next = insertelement {T} %r, double %kd, i64 %l
%l.next = add i64 %l, 1
%more = icmp slt i64 %l.next, {W}
br i1 %more, label %lane, label %end
end:
ret {T} %r.next
}}
define internal {T} @lanes.pick(ptr %rows, i64 %padded, {T} %k) noinline nounwind {{
begin:
br label %lane
lane:
%l = phi i64 [0, %begin], [%l.next, %lane]
%r = phi {T} [zeroinitializer, %begin], [%r.next, %lane]
%kd = extractelement {T} %k, i64 %l
%ki = fptosi double %kd to i64
%o = mul i64 %padded, %ki
%i = add i64 %o, %l
%p = getelementptr double, ptr %rows, i64 %i
%value = load double, ptr %p, align 8
%r.next = insertelement {T} %r, double %value, i64 %l
%l.next = add i64 %l, 1
%more = icmp slt i64 %l.next, {W}
br i1 %more, label %lane, label %end
end:
ret {T} %r.next
}}
define internal void @lanes.clear(ptr %rows, i64 %padded, i64 %n) noinline nounwind {{
begin:
br label %row
row:
%k = phi i64 [0, %begin], [%k.next, %row]
%o = mul i64 %padded, %k
%p = getelementptr double, ptr %rows, i64 %o
store {T} zeroinitializer, ptr %p, align 8
%k.next = add i64 %k, 1
%more = icmp slt i64 %k.next, %n
br i1 %more, label %row, label %end
end:
ret void
}}
define internal void @lanes.put(ptr %rows, i64 %padded, {T} %k, {T} %x) noinline nounwind {{
begin:
br label %lane
lane:
%l = phi i64 [0, %begin], [%l.next, %lane]
%kd = extractelement {T} %k, i64 %l
%ki = fptosi double %kd to i64
%o = mul i64 %padded, %ki
%i = add i64 %o, %l
%p = getelementptr double, ptr %rows, i64 %i
%value = extractelement {T} %x, i64 %l
store double %value, ptr %p, align 8
%l.next = add i64 %l, 1
%more = icmp slt i64 %l.next, {W}
br i1 %more, label %lane, label %end
end:
ret void
}}"""


def write_lane_functions(vector: str, width: int) -> str:
    """Return the IR of the functions for vectors of the LLVM type `vector` with `width` lanes."""
    return _LANE_FUNCTIONS.format(T=vector, W=width)


# Copies per vector.
LANE_WIDTH = 8
# Modules that determine the IR of a function.
_SOURCES = ("instructions.py", "lane_code.py")

# {r}: result, {T}: type of the operands {x} and {y}, {B}: type of truth values, {s}: suffix of
# intrinsics.
_INLINE_TEMPLATES = by_operation(
    ADD="{r} = fadd {T} {x}, {y}",
    SUB="{r} = fsub {T} {x}, {y}",
    MUL="{r} = fmul {T} {x}, {y}",
    DIV="{r} = fdiv {T} {x}, {y}",
    NEG="{r} = fneg {T} {x}",
    SQ="{r} = fmul {T} {x}, {x}",
    TWICE="{r} = fadd {T} {x}, {x}",
    INV="{r} = fdiv {T} {one}, {x}",
    SQRT="{r} = call {T} @llvm.sqrt.{s}({T} {x})",
    FABS="{r} = call {T} @llvm.fabs.{s}({T} {x})",
    FLOOR="{r} = call {T} @llvm.floor.{s}({T} {x})",
    CEIL="{r} = call {T} @llvm.ceil.{s}({T} {x})",
    COPYSIGN="{r} = call {T} @llvm.copysign.{s}({T} {x}, {T} {y})",
    LT="{r}.a = fcmp olt {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    LE="{r}.a = fcmp ole {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    EQ="{r}.a = fcmp oeq {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    NE="{r}.a = fcmp une {T} {x}, {y}\n{r} = uitofp {B} {r}.a to {T}",
    NOT="{r}.a = fcmp oeq {T} {x}, zeroinitializer\n{r} = uitofp {B} {r}.a to {T}",
    # NaN is true.
    AND=(
        "{r}.a = fcmp une {T} {x}, zeroinitializer\n{r}.b = fcmp une {T} {y}, zeroinitializer\n"
        "{r}.c = and {B} {r}.a, {r}.b\n{r} = uitofp {B} {r}.c to {T}"
    ),
    OR=(
        "{r}.a = fcmp une {T} {x}, zeroinitializer\n{r}.b = fcmp une {T} {y}, zeroinitializer\n"
        "{r}.c = or {B} {r}.a, {r}.b\n{r} = uitofp {B} {r}.c to {T}"
    ),
    IF_ELSE_ZERO=(
        "{r}.a = fcmp oeq {T} {x}, zeroinitializer\n"
        "{r} = select {B} {r}.a, {T} zeroinitializer, {T} {y}"
    ),
    # If one operand is NaN, return the other; of two zeros, return the first.
    FMIN=(
        "{r}.a = fcmp ogt {T} {x}, {y}\n{r}.b = fcmp uno {T} {x}, {x}\n"
        "{r}.c = or {B} {r}.a, {r}.b\n{r} = select {B} {r}.c, {T} {y}, {T} {x}"
    ),
    FMAX=(
        "{r}.a = fcmp olt {T} {x}, {y}\n{r}.b = fcmp uno {T} {x}, {x}\n"
        "{r}.c = or {B} {r}.a, {r}.b\n{r} = select {B} {r}.c, {T} {y}, {T} {x}"
    ),
    # Zeros and NaN are returned unchanged.
    SIGN=(
        "{r}.a = fcmp olt {T} {x}, zeroinitializer\n{r}.b = fcmp ogt {T} {x}, zeroinitializer\n"
        "{r}.c = select {B} {r}.b, {T} {one}, {T} {x}\n"
        "{r} = select {B} {r}.a, {T} {minus_one}, {T} {r}.c"
    ),
)

# Functions of the C library that have the names of their operations.
_FUNCTIONS = (
    "exp expm1 log log1p pow sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh erf "
    "hypot fmod remainder"
)
LIBRARY_FUNCTIONS = _FUNCTIONS.split()
# Functions of the C library by operation.
LIBRARY_NAMES = {
    ca.OP_CONSTPOW: "pow",
    **dict(zip(operation_codes(_FUNCTIONS.upper()), LIBRARY_FUNCTIONS, strict=True)),
}
BINARY_FUNCTIONS = ("pow", "atan2", "hypot", "fmod", "remainder")


class OperandType(NamedTuple):
    """LLVM type of scalars or vectors, with its operations.

    Attributes
    ----------
    number
        Name of the LLVM type, such as `double`.
    inline
        Instructions by operation of CasADi, with the placeholders {r}, {x} and {y}.
    functions
        Prefix of the names under which functions of the C library are called.
    """

    number: str
    inline: dict[int, str]
    functions: str


def format_constant(value: float) -> str:
    """Return the LLVM literal of a constant, its bits in hexadecimal."""
    return f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"


def _operand_type(number: str, truth: str, suffix: str, functions: str, lanes: int) -> OperandType:
    replacements = {"{T}": number, "{B}": truth, "{s}": suffix}
    for name, value in (("{one}", 1.0), ("{minus_one}", -1.0)):
        elements = ", ".join([f"double {format_constant(value)}"] * lanes)
        replacements[name] = f"<{elements}>" if lanes > 1 else format_constant(value)
    inline = dict(_INLINE_TEMPLATES)
    for placeholder, text in replacements.items():
        inline = {operation: ir.replace(placeholder, text) for operation, ir in inline.items()}
    return OperandType(number, inline, functions)


SCALAR = _operand_type("double", "i1", "f64", "libm", 1)
LANES = _operand_type(
    f"<{LANE_WIDTH} x double>", f"<{LANE_WIDTH} x i1>", f"v{LANE_WIDTH}f64", "lanes", LANE_WIDTH
)


def is_supported(operation: int) -> bool:
    """Return True if `write_operation` can write this operation of CasADi."""
    return operation in _INLINE_TEMPLATES or operation in LIBRARY_NAMES


def write_operation(kind: OperandType, operation: int, result: str, x: str, y: str) -> str:
    """Return the IR of one operation; unary operations ignore y."""
    if operation in LIBRARY_NAMES:
        name = LIBRARY_NAMES[operation]
        operands = ", ".join(f"{kind.number} {z}" for z in (x, y)[: _count_arguments(name)])
        return f"{result} = call {kind.number} @{kind.functions}.{name}({operands})"
    return kind.inline[operation].format(r=result, x=x, y=y)


def _count_arguments(name: str) -> int:
    return 2 if name in BINARY_FUNCTIONS else 1


def write_lane_wrapper(name: str) -> str:
    """Return IR that declares a function of the C library and calls it for each lane.

    A lane with the same operands as the lane before it reuses the result, so that padding lanes
    make no calls. The prefix "libm." prevents LLVM from recognizing and replacing the function.
    """
    operands = "xy"[: _count_arguments(name)]
    scalar_types = ", ".join(["double"] * len(operands))
    parameters = ", ".join(f"{LANES.number} %{z}" for z in operands)
    body = []
    for lane in range(LANE_WIDTH):
        for z in operands:
            body += [
                f"%{z}{lane} = extractelement {LANES.number} %{z}, i32 {lane}",
                # Compare bits: zeros that are equal may differ in their sign.
                f"%{z}{lane}.b = bitcast double %{z}{lane} to i64",
            ]
    arguments = [", ".join(f"double %{z}{lane}" for z in operands) for lane in range(LANE_WIDTH)]
    body += [f"%f0 = call double @libm.{name}({arguments[0]})", "br label %next0", "next0:"]
    for lane in range(1, LANE_WIDTH):
        last = lane - 1
        body += [f"%{z}{lane}.s = icmp eq i64 %{z}{lane}.b, %{z}{last}.b" for z in operands]
        body += [
            f"%s{lane} = and i1 %{operands[0]}{lane}.s, %{operands[-1]}{lane}.s",
            f"br i1 %s{lane}, label %next{lane}, label %call{lane}",
            f"call{lane}:",
            f"%g{lane} = call double @libm.{name}({arguments[lane]})",
            f"br label %next{lane}",
            f"next{lane}:",
            f"%f{lane} = phi double [%f{last}, %next{last}], [%g{lane}, %call{lane}]",
        ]
    for lane in range(LANE_WIDTH):
        vector = "poison" if lane == 0 else f"%r{lane - 1}"
        body.append(
            f"%r{lane} = insertelement {LANES.number} {vector}, double %f{lane}, i32 {lane}"
        )
    return "\n".join(
        [
            f"declare double @libm.{name}({scalar_types}) nounwind willreturn memory(none)",
            f"define internal {LANES.number} @lanes.{name}({parameters}) noinline nounwind {{",
            *body,
            f"ret {LANES.number} %r{LANE_WIDTH - 1}",
            "}",
        ]
    )


def write_lane_module(function: ca.Function) -> str:
    """Return LLVM IR of an SX function of the form that `require_lane_form` checks.

    Raises
    ------
    ValueError
        If the function has another form or contains an operation that cannot be compiled.
    """
    require_lane_form(function)
    writer, instructions = _LaneWriter(function.name()), read_instructions(function)
    try:
        evaluate_instructions(instructions, writer.read, writer.operate, writer.store_output)
        writer.write_spreads()
        if any(f"libm.{x}" not in library_imports() for x in writer.library):
            raise _UnsupportedOperationError
    except _UnsupportedOperationError:
        raise ValueError(
            f"{function.name()}: the function has operations that cannot be compiled."
        ) from None
    return writer.module


@cache
def library_imports() -> dict[str, int]:
    """Return the addresses of the `LIBRARY_FUNCTIONS` that exist on this system, by symbol."""
    addresses = {}
    for name in LIBRARY_FUNCTIONS:
        with suppress(MachineCodeError):
            addresses[f"libm.{name}"] = library_address(name)
    return addresses


@cache
def describe_writer() -> str:
    """Return the text that determines the IR of a function, such as the source of this module."""
    sources = [Path(__file__).with_name(x).read_text("utf-8") for x in _SOURCES]
    return "".join(sources) + write_lane_functions(LANES.number, LANE_WIDTH)


class _Operand(NamedTuple):
    is_vector: bool
    text: str
    # Row of a local input, which is loaded by its first operation; rows of tables are not loaded.
    row: int | None = None
    # Call of SPREAD and number of the result, which is written by its output.
    spread: tuple[int, int] | None = None


class _UnsupportedOperationError(Exception):
    """Raised for what cannot be compiled, such as the call of a table with constant rows."""


@dataclass
class _LaneWriter:
    """Collects the IR of one function.

    Attributes
    ----------
    name
        Name of the function.
    before, group
        Instructions on shared numbers, which are executed once, and instructions executed for each
        group of `LANE_WIDTH` copies.
    library
        Names of the C library functions that the function calls.
    has_tables
        True if the function calls functions that read tables.
    """

    name: str
    before: list[str] = field(default_factory=list)
    group: list[str] = field(default_factory=list)
    library: set[str] = field(default_factory=set)
    has_tables: bool = False
    _numbers: Iterator[int] = field(default_factory=itertools.count)
    _broadcast: dict[str, str] = field(default_factory=dict)
    _loaded: set[str] = field(default_factory=set)
    _spreads: dict[int, tuple[_Operand, list[_Operand], int]] = field(default_factory=dict)
    _spread_rows: dict[int, list[tuple[int, int]]] = field(default_factory=dict)

    def read(self, code: int, operands: tuple[Any, ...]) -> _Operand:
        if code == ca.OP_CONST:
            return _Operand(False, format_constant(*operands))
        is_local, row = operands
        result = self._name_result()
        if is_local:
            return _Operand(True, result, row)
        self.before += [
            f"{result}.p = getelementptr double, ptr %shared, i64 {row}",
            f"{result} = load double, ptr {result}.p, align 8",
        ]
        return _Operand(False, result)

    def _name_result(self) -> str:
        return f"%v{next(self._numbers)}"

    def store_output(self, output: int, row: int, value: _Operand) -> None:
        if value.spread is not None:
            call, number = value.spread
            self._spread_rows.setdefault(call, []).append((row, number))
            return
        text, result = self._broadcast_lanes(value), self._name_result()
        self._locate_row(result, "%out", row)
        self.group.append(f"store {LANES.number} {text}, ptr {result}.p, align 8")

    def operate(self, operation: Any, operands: list[_Operand], count: int) -> list[_Operand]:
        if isinstance(operation, ca.Function):
            return self._call(operation.name(), operands, count)
        if operation == ca.OP_ASSIGN:
            return operands
        x, y = operands[0], operands[-1]
        if not is_supported(operation) or x.spread is not None or y.spread is not None:
            raise _UnsupportedOperationError
        if operation in LIBRARY_NAMES:
            self.library.add(LIBRARY_NAMES[operation])
        result = self._name_result()
        if x.is_vector or y.is_vector:
            lanes_of_x, lanes_of_y = self._broadcast_lanes(x), self._broadcast_lanes(y)
            self.group.append(write_operation(LANES, operation, result, lanes_of_x, lanes_of_y))
            return [_Operand(True, result)]
        self.before.append(write_operation(SCALAR, operation, result, x.text, y.text))
        return [_Operand(False, result)]

    def _call(self, name: str, operands: list[_Operand], count: int) -> list[_Operand]:
        """Write a call of a function that reads a table; return its `count` results."""
        self.has_tables = True
        if name == SPREAD:
            number = len(self._spreads)
            self._spreads[number] = operands[0], operands[1:], count
            return [_Operand(True, "", spread=(number, i)) for i in range(count)]
        if name not in (FIND, PICK):
            raise _UnsupportedOperationError
        argument, result, rows = (
            self._broadcast_lanes(operands[0]),
            self._name_result(),
            operands[1:],
        )
        first = rows[0].row
        if first is None or [x.row for x in rows] != list(range(first, first + len(rows))):
            raise _UnsupportedOperationError
        results = []
        for i in range(count):
            text = f"{result}.{i}"
            self._locate_row(text, "%local", first + i)
            rest = f"i64 {len(rows)}, " if name == FIND else ""
            self.group.append(
                f"{text} = call {LANES.number} @lanes.{'find' if name == FIND else 'pick'}"
                f"(ptr {text}.p, i64 %padded, {rest}{LANES.number} {argument})"
            )
            results.append(_Operand(True, text))
        return results

    def write_spreads(self) -> None:
        """Write the results of the calls of SPREAD, which must be successive outputs."""
        for number, (row, values, count) in self._spreads.items():
            rows = sorted(self._spread_rows.get(number, []), key=lambda pair: pair[1])
            if not rows:
                continue
            first = rows[0][0]
            if rows != [(first + i, i) for i in range(count)]:
                raise _UnsupportedOperationError
            name, lane = f"%spread{number}", f"{LANES.number} {self._broadcast_lanes(row)}"
            self._locate_row(name, "%out", first)
            start = f"(ptr {name}.p, i64 %padded, "
            self.group.append(f"call void @lanes.clear{start}i64 {count})")
            for i, value in enumerate(values):
                text = self._broadcast_lanes(value)
                self._locate_row(f"{name}.{i}", "%out", first + i)
                self.group.append(
                    f"call void @lanes.put(ptr {name}.{i}.p, i64 %padded, {lane}, "
                    f"{LANES.number} {text})"
                )

    def _locate_row(self, result: str, base: str, row: int) -> None:
        self.group += [
            f"{result}.r = mul i64 %padded, {row}",
            f"{result}.i = add i64 {result}.r, %first",
            f"{result}.p = getelementptr double, ptr {base}, i64 {result}.i",
        ]

    def _broadcast_lanes(self, value: _Operand) -> str:
        text = value.text
        if value.spread is not None:
            raise _UnsupportedOperationError
        if value.is_vector:
            if value.row is not None and text not in self._loaded:
                self._loaded.add(text)
                self._locate_row(text, "%local", value.row)
                self.group.append(f"{text} = load {LANES.number}, ptr {text}.p, align 8")
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
    def module(self) -> str:
        """Text of the module: the function and the wrappers of library functions."""
        return "\n".join(
            [
                *(write_lane_wrapper(name) for name in sorted(self.library)),
                *([write_lane_functions(LANES.number, LANE_WIDTH)] if self.has_tables else []),
                *write_lane_function(self.name, self.before, self.group),
                "",
            ]
        )


def write_lane_function(name: str, before: Sequence[str], group: Sequence[str]) -> list[str]:
    """Return a function of (shared, local, out, padded), see `LaneKernel`.

    The instructions `before` are executed once, those of `group` for each group of `LANE_WIDTH`
    copies, which begins with copy %first.
    """
    return [
        f"define void @{name}(ptr noalias readonly %shared, ptr noalias readonly %local, "
        "ptr noalias %out, i64 %padded) nounwind {",
        "before:",
        *before,
        "%some = icmp sgt i64 %padded, 0",
        "br i1 %some, label %group, label %end",
        "group:",
        "%first = phi i64 [0, %before], [%next, %last]",
        *group,
        "br label %last",
        "last:",
        f"%next = add i64 %first, {LANE_WIDTH}",
        "%more = icmp slt i64 %next, %padded",
        "br i1 %more, label %group, label %end",
        "end:",
        "ret void",
        "}",
    ]


def require_lane_form(function: ca.Function) -> None:
    """Require an SX function of two dense columns (shared, local) that returns one dense column.

    Raises
    ------
    ValueError
        If the function has another form.
    """
    shapes = [function.sparsity_in(i) for i in range(function.n_in())]
    shapes += [function.sparsity_out(i) for i in range(function.n_out())]
    if not (
        function.class_name() == "SXFunction"
        and (function.n_in(), function.n_out()) == (2, 1)
        and all(shape.is_dense() and shape.size2() == 1 for shape in shapes)
    ):
        raise ValueError(
            f"{function.name()}: a kernel must be an SX function of two columns with one dense "
            f"column as its output, got {function}."
        )
