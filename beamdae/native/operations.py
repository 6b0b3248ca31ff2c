"""CasADi's operations in LLVM IR, for one number or for a vector of them.

Each does what CasADi's virtual machine does, with NaN, infinities and signed zeros. What is not
exact by IEEE 754 is left to the functions of the C library, a lane at a time, so that results have
the same bits. (Of a NaN neither sign nor payload is kept: no rule says which operand's they are.)
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import casadi as ca

WIDTH = 8

# {r} is the result, {T} the type of the operands {x} and {y}, {B} that of truth values, {s} the
# suffix of intrinsics.
_INLINE = {
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

_LIBRARY = {
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


LIBRARY_FUNCTIONS = tuple(dict.fromkeys(_LIBRARY.values()))


class Kind(NamedTuple):
    """Types of one number, or of a vector of them; the operations in them."""

    number: str
    inline: dict[int, str]
    functions: str


def constant(value: float) -> str:
    """A constant to the last bit."""
    return f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"


def _kind(number: str, truth: str, suffix: str, functions: str, lanes: int) -> Kind:
    words = {"{T}": number, "{B}": truth, "{s}": suffix}
    for name, value in (("{one}", 1.0), ("{minus_one}", -1.0)):
        each = ", ".join([f"double {constant(value)}"] * lanes)
        words[name] = f"<{each}>" if lanes > 1 else constant(value)
    inline = dict(_INLINE)
    for word, text in words.items():
        inline = {operation: lines.replace(word, text) for operation, lines in inline.items()}
    return Kind(number, inline, functions)


NUMBER = _kind("double", "i1", "f64", "libm", 1)
LANES = _kind(f"<{WIDTH} x double>", f"<{WIDTH} x i1>", f"v{WIDTH}f64", "lanes", WIDTH)


def library_function(operation: int) -> str | None:
    """The function of the C library that an operation calls, if it does."""
    return _LIBRARY.get(operation)


def is_known(operation: int) -> bool:
    """Whether `lines` has this operation."""
    return operation in _INLINE or operation in _LIBRARY


def lines(kind: Kind, operation: int, result: str, x: str, y: str) -> str:
    """IR of one operation; of a unary one y is not read."""
    if operation in _LIBRARY:
        name = _LIBRARY[operation]
        operands = ", ".join(f"{kind.number} {z}" for z in (x, y)[: arity(name)])
        return f"{result} = call {kind.number} @{kind.functions}.{name}({operands})"
    return kind.inline[operation].format(r=result, x=x, y=y)


def arity(name: str) -> int:
    """Number of arguments of a function of the C library."""
    binary = ("pow", "atan2", "hypot", "fmod", "remainder")
    return 2 if name in binary else 1


def declared(name: str) -> str:
    """IR that declares a function of the C library and calls it a lane at a time.

    A lane with the operands of the one before it has its result: lanes to spare cost nothing. By
    another name: LLVM would put other functions in the place of those it knows.
    """
    operands = "xy"[: arity(name)]
    plain = ", ".join(["double"] * len(operands))
    lanes = ", ".join(f"{LANES.number} %{z}" for z in operands)
    body = []
    for lane in range(WIDTH):
        for z in operands:
            body += [
                f"%{z}{lane} = extractelement {LANES.number} %{z}, i32 {lane}",
                # Zeros that are equal may differ in their sign.
                f"%{z}{lane}.b = bitcast double %{z}{lane} to i64",
            ]
    given = [", ".join(f"double %{z}{lane}" for z in operands) for lane in range(WIDTH)]
    body += [f"%f0 = call double @libm.{name}({given[0]})", "br label %next0", "next0:"]
    for lane in range(1, WIDTH):
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
    for lane in range(WIDTH):
        before = "poison" if lane == 0 else f"%r{lane - 1}"
        body.append(
            f"%r{lane} = insertelement {LANES.number} {before}, double %f{lane}, i32 {lane}"
        )
    return "\n".join(
        [
            f"declare double @libm.{name}({plain}) nounwind willreturn memory(none)",
            f"define internal {LANES.number} @lanes.{name}({lanes}) noinline nounwind {{",
            *body,
            f"ret {LANES.number} %r{WIDTH - 1}",
            "}",
        ]
    )
