"""LLVM IR of kernels across elements: the instructions of an SX function, a vector lane a copy."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import version
from pathlib import Path

import casadi as ca

from beamdae.native.llvm import MachineError, library_address
from beamdae.native.operations import (
    LANES,
    LIBRARY_FUNCTIONS,
    NUMBER,
    WIDTH,
    constant,
    declared,
    is_known,
    library_function,
    lines,
)


def lane_source(function: ca.Function) -> str:
    """LLVM IR of an SX function of (shared, local) with one dense output.

    Raises
    ------
    ValueError
        If it has an operation that cannot be compiled.
    """
    writer = _written(function)
    if writer is None or any(f"libm.{name}" not in imports() for name in writer.library):
        raise ValueError(f"{function.name()}: it has operations that cannot be compiled.")
    return writer.source


@cache
def imports() -> dict[str, int]:
    """Addresses of the functions of the C library that there are."""
    found = {}
    for name in LIBRARY_FUNCTIONS:
        with suppress(MachineError):
            found[f"libm.{name}"] = library_address(name)
    return found


@cache
def writing() -> tuple[str, ...]:
    """What writes the IR of a function."""
    own = Path(__file__)
    sources = (own, own.with_name("operations.py"))
    return (f"casadi {version('casadi')}", *(source.read_text("utf-8") for source in sources))


@dataclass
class _Writer:
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
        function = library_function(operation)
        if function is not None:
            self.library.add(function)
        if x[0] or y[0]:
            self.group.append(lines(LANES, operation, result, self._lanes(x), self._lanes(y)))
            return True, result
        self.before.append(lines(NUMBER, operation, result, x[1], y[1]))
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
                f"<{WIDTH} x i32> zeroinitializer",
            ]
            self._broadcast[text] = name
        return self._broadcast[text]

    @property
    def source(self) -> str:
        """The module."""
        return "\n".join(
            [
                *(declared(name) for name in sorted(self.library)),
                f"define void @{self.name}(ptr noalias readonly %shared, "
                "ptr noalias readonly %local, ptr noalias %out, i64 %padded) nounwind {",
                "before:",
                *self.before,
                "%some = icmp sgt i64 %padded, 0",
                "br i1 %some, label %group, label %end",
                "group:",
                "%first = phi i64 [0, %before], [%next, %group]",
                *self.group,
                f"%next = add i64 %first, {WIDTH}",
                "%more = icmp slt i64 %next, %padded",
                "br i1 %more, label %group, label %end",
                "end:",
                "ret void",
                "}",
                "",
            ]
        )


def _written(function: ca.Function) -> _Writer | None:
    """The function's instructions in IR, or None if one of them cannot be compiled."""
    require_form(function)
    writer = _Writer(function.name())
    work: dict[int, tuple[bool, str]] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation == ca.OP_OUTPUT:
            (_, row), (source,) = function.instruction_output(k), function.instruction_input(k)
            writer.store(f"%v{k}", row, work[source])
            continue
        (target,) = function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[target] = False, constant(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            which, row = function.instruction_input(k)
            work[target] = (writer.local if which else writer.shared)(f"%v{k}", row)
        elif operation == ca.OP_ASSIGN:
            (source,) = function.instruction_input(k)
            work[target] = work[source]
        elif is_known(operation):
            read = [work[i] for i in function.instruction_input(k)]
            work[target] = writer.operation(operation, f"%v{k}", read[0], read[-1])
        else:
            return None
    return writer


def require_form(function: ca.Function) -> None:
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
