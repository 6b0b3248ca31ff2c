"""Kernels across elements: one SX function as machine code, one vector lane an element.

The code performs the operations of CasADi's virtual machine in the same order, without
contraction, so results are the same to the last bit, which is tried whenever one is built.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from beamdae.native.machine import Loaded, MachineError, library_address
from beamdae.native.objects import Source, is_on, machine_code
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

Array = np.ndarray

# Straight lines gain nothing from LLVM's passes, which take a third of the time.
_LEVEL = 0
# Rows so many numbers apart share few sets of the cache: a tangent takes up to 1.7 times as long.
_CRAMPED = 128
_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64)


def padded(copies: int) -> int:
    """A length of rows for so many copies: whole vectors, and rows that do not evict each other."""
    length = -(-copies // WIDTH) * WIDTH
    return length + WIDTH if length and length % _CRAMPED == 0 else length


@dataclass(frozen=True)
class LaneKernel:
    """A function of (shared, local) as machine code that evaluates `WIDTH` copies at once.

    void f(const double *shared, const double *local, double *out, int64_t padded), where `local`
    is [n_local][padded] and `out` is [n_out][padded]. The address is good as long as this is kept.

    Attributes
    ----------
    name
        Of the function.
    address
        Of the machine code.
    n_shared, n_local, n_out
        Numbers that all copies share, numbers of each copy, and its results.
    code
        What holds the machine code in memory.
    """

    name: str
    address: int
    n_shared: int
    n_local: int
    n_out: int
    code: Loaded = field(repr=False, compare=False)

    @cached_property
    def _call(self) -> Any:
        return _SIGNATURE(self.address)

    def __call__(self, shared: Array, local: Array, out: Array | None = None) -> Array:
        """Values (n_out, padded) at shared (n_shared,) and local (n_local, padded).

        Raises
        ------
        ValueError
            If a shape does not fit, or `out` is not a C-contiguous array of float64.
        """
        shared = np.ascontiguousarray(shared, dtype=np.float64)
        local = np.ascontiguousarray(local, dtype=np.float64)
        count = local.shape[-1]
        if shared.shape != (self.n_shared,):
            raise ValueError(
                f"{self.name}: shared must have shape {(self.n_shared,)}, got {shared.shape}."
            )
        if local.shape != (self.n_local, count) or count % WIDTH:
            raise ValueError(
                f"{self.name}: local must have shape ({self.n_local}, a multiple of {WIDTH}), "
                f"got {local.shape}."
            )
        if out is None:
            out = np.empty((self.n_out, count))
        if out.shape != (self.n_out, count) or out.dtype != float or not out.flags.carray:
            raise ValueError(
                f"{self.name}: out must be a writable C-contiguous float64 array of shape "
                f"{(self.n_out, count)}, got {out.dtype} {out.shape}."
            )
        self._call(shared.ctypes.data, local.ctypes.data, out.ctypes.data, count)
        return out


def lane_kernel(function: ca.Function) -> LaneKernel | None:
    """Machine code of an SX function of two columns, (shared, local), with one dense output.

    None where it has an operation that cannot be compiled, or machine code cannot be had or is not
    wanted.

    Warns
    -----
    KernelWarning
        Once a process, of a cache or a machine that cannot be used.
    """
    if not is_on():
        return None
    _require_form(function)
    name = function.name()

    def kernel(code: Loaded) -> LaneKernel:
        sizes = (function.nnz_in(0), function.nnz_in(1), function.nnz_out(0))
        return LaneKernel(name, code.addresses[name], *sizes, code)

    # What the function is written as follows from it and from these: writing takes longer.
    text = "\n".join([function.serialize(), *_writing()])
    source = Source(name, text, (name,), _imports(), _LEVEL, lambda: lane_source(function))
    try:
        code = machine_code(source, lambda code: _same(function, kernel(code)))
    except ValueError:
        return None
    return None if code is None else kernel(code)


def lane_source(function: ca.Function) -> str:
    """LLVM IR of an SX function of (shared, local) with one dense output.

    Raises
    ------
    ValueError
        If it has an operation that cannot be compiled.
    """
    writer = _written(function)
    if writer is None or any(f"libm.{name}" not in _imports() for name in writer.library):
        raise ValueError(f"{function.name()}: it has operations that cannot be compiled.")
    return writer.source


@cache
def _imports() -> dict[str, int]:
    """Addresses of the functions of the C library that there are."""
    found = {}
    for name in LIBRARY_FUNCTIONS:
        with suppress(MachineError):
            found[f"libm.{name}"] = library_address(name)
    return found


@cache
def _writing() -> tuple[str, ...]:
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
    _require_form(function)
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


def _require_form(function: ca.Function) -> None:
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


def _same(function: ca.Function, kernel: LaneKernel) -> bool:
    """Whether a kernel gives the bits of CasADi's virtual machine at some points."""
    random = np.random.default_rng(0)
    shared = random.uniform(0.5, 1.5, kernel.n_shared)
    local = random.uniform(0.5, 1.5, (kernel.n_local, 3 * WIDTH))
    found = kernel(shared, local)
    expected = np.hstack([function(shared, column).full() for column in local.T])
    return np.array_equal(found, expected, equal_nan=True)
