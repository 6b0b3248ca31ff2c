"""Loops in machine code: plain Python functions over arrays, compiled by numba once a machine.

A loop is a function of one object, whose fields are numbers, arrays and such objects again; it may
set numbers, and what is in arrays. Its machine code is given the numbers and the addresses of the
arrays in a table, knows nothing of Python, and so releases the interpreter while it runs; it is
kept like that of kernels, and numba is imported only to make it.
"""

from __future__ import annotations

import ctypes
import gc
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from beamdae.errors import format_exception
from beamdae.native import linear_solver, loop_functions
from beamdae.native.llvm import LoadedObject, MachineCodeError
from beamdae.native.object_code import ObjectSource, is_native_enabled, load_object

Array = np.ndarray

_OPTIMIZATION_LEVEL = 2
# What the machine code of a loop depends on besides its source.
_RECIPE_MODULES = ("loop_functions", "overloads", "structs", "numba_compiler")
# What stands behind functions of `vectors` that are more than a loop.
_IMPLEMENTATIONS: dict[Any, Any] = {
    loop_functions.factorize: linear_solver.factorize_linear,
    loop_functions.solve: linear_solver.solve_linear,
}
_LOOP_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
# Symbol, function and arguments of what is compiled into one module.
_EntryPoints = tuple[tuple[str, tuple[Any, str]], ...]


def prepare_loop(function: Any, make: Any, native: bool) -> tuple[Any, CompiledLoop | None]:
    """What a loop works on, and the loop; None where plain Python has to do.

    `make` makes the former, for machine code or for plain Python; `native` is whether the first is
    possible.
    """
    if native:
        work = make(True)
        with suppress(MachineCodeError):
            return work, CompiledLoop(function, work)
    return make(False), None


class CompiledLoop:
    """A loop in machine code, bound to the object it works on.

    Attributes
    ----------
    addresses
        Of C functions: of the loop, whose one argument is the address of `table`, and of callbacks.
    table
        Numbers and addresses.
    """

    def __init__(self, function: Any, work: Any, **callbacks: tuple[Any, str]) -> None:
        """`function(work)` in machine code, and other functions of the same object.

        Parameters
        ----------
        work
            A dataclass of int, float, arrays and such dataclasses.
        **callbacks
            (function, arguments) of C functions `function(work, *arguments)` of the same table:
            "d" for double, "p" for a pointer, which the function is given as an integer, "@" for
            the table.
        """
        layout = _Layout(work)
        self._numbers, self._kind = layout.numbers, layout.kind
        self.table = np.array(layout.words, np.int64)
        self._floats = self.table.view(np.float64)
        entries = {"loop": (function, "@"), **callbacks}
        self.addresses = _load_entries(tuple(entries.items()), self._kind)
        self._call = _LOOP_SIGNATURE(self.addresses["loop"])
        # What the table points to.
        self._work = work

    def __call__(self) -> int:
        """Run it; numbers of the object go in and come out."""
        self.load()
        code = self._call(self.table.ctypes.data)
        self.unload()
        return int(code)

    def bind(self) -> None:
        """Numbers and arrays of the object, which may be others now, into the table.

        The table stays where it is: a C function of it may do this while it runs.
        """
        layout = _Layout(self._work)
        assert layout.kind == self._kind
        self._numbers = layout.numbers
        self.table[:] = layout.words
        self.load()

    def load(self) -> None:
        """The numbers of the object, into the table."""
        for owner, name, word, kind in self._numbers:
            (self._floats if kind is float else self.table)[word] = getattr(owner, name)

    def unload(self) -> None:
        """The numbers of the table, into the object."""
        for owner, name, word, kind in self._numbers:
            setattr(owner, name, kind((self._floats if kind is float else self.table)[word]))


class _Layout:
    """Where the fields of an object stand in a table.

    Attributes
    ----------
    words
        The table.
    numbers
        (owner, name, word, type) of its numbers.
    kind
        ((name, word, type), ...): what machine code depends on.
    """

    def __init__(self, work: Any) -> None:
        self.words: list[int] = []
        self.numbers: list[tuple[Any, str, int, type]] = []
        self.kind = self._of(work)

    def _of(self, owner: Any) -> tuple[str, tuple[Any, ...]]:
        start, found = len(self.words), []
        for name in _field_names(owner):
            value, word = getattr(owner, name), len(self.words)
            if type(value) is tuple:
                continue
            kind: Any = type(value).__name__
            if isinstance(value, (bool, int, float)):
                number = float if isinstance(value, float) else int
                self.numbers.append((owner, name, word, number))
                self.words.append(0)
                kind = number.__name__
            elif isinstance(value, np.ndarray):
                assert value.flags.c_contiguous, name
                self.words += [value.ctypes.data, *value.shape]
                kind = (str(value.dtype), value.ndim)
            else:
                kind = self._of(value)
            found.append((name, word - start, kind))
        return type(owner).__name__, tuple(found)


def _field_names(owner: Any) -> tuple[str, ...]:
    """Fields of a dataclass, or of a named tuple."""
    return getattr(owner, "_fields", None) or tuple(field.name for field in fields(owner))


def _iterate_code(function: FunctionType, found: dict[FunctionType, None]) -> Iterator[str]:
    """What a function consists of: its bytecode, that of those it calls, and the constants.

    Bytecode is what numba compiles; reading sources takes as long as the steps of a short run.
    """
    if function in found or function.__module__ == loop_functions.__name__:
        return
    found[function] = None
    code = function.__code__
    named = (code.co_name, code.co_varnames, code.co_names)
    yield repr((*named, code.co_code.hex(), code.co_consts, function.__defaults__))
    for name in code.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType):
            yield from _iterate_code(_IMPLEMENTATIONS.get(value, value), found)
        elif isinstance(value, (int, float, complex, tuple)):
            yield f"{name} = {value!r}"
        elif isinstance(value, np.ndarray):
            yield f"{name} = {value.dtype} {value.tolist()!r}"


@cache
def _versions() -> str:
    return "\n".join(
        [f"numba {_numba_version()}", sys.version]
        + [Path(__file__).with_name(f"{name}.py").read_text("utf-8") for name in _RECIPE_MODULES]
    )


def _numba_version() -> str:
    try:
        return version("numba")
    except PackageNotFoundError:
        return "none"


_loaded_objects: dict[Any, LoadedObject | None] = {}
# Of two threads that load the same, the second would take the place of what the first runs.
_loading_lock = threading.Lock()


def _load_entries(entries: _EntryPoints, kind: Any) -> dict[str, int]:
    if not is_native_enabled():
        raise MachineCodeError("machine code is not wanted")
    name = entries[0][1][0].__name__
    key = (entries, kind)
    with _loading_lock:
        if key not in _loaded_objects:
            called: dict[FunctionType, None] = {}
            text = [repr(kind), _versions()]
            for symbol, (function, arguments) in entries:
                text += [symbol, arguments, *_iterate_code(function, called)]
            source = ObjectSource(
                name,
                "\n".join(text),
                tuple(symbol for symbol, _ in entries),
                level=_OPTIMIZATION_LEVEL,
                ir=lambda: _compile_entries(entries, tuple(called), kind),
            )
            _loaded_objects[key] = load_object(source, lambda code: True)
        code = _loaded_objects[key]
    if code is None:
        raise MachineCodeError(f"{name}: it cannot be compiled")
    return code.addresses


def _compile_entries(entries: _EntryPoints, parts: tuple[FunctionType, ...], kind: Any) -> str:
    """LLVM IR of loops of one object, with everything they need."""
    with _pause_garbage_collection():
        try:
            from beamdae.native import numba_compiler
        except ImportError as problem:
            raise MachineCodeError(
                f"numba cannot be imported ({format_exception(problem)})"
            ) from problem
        return numba_compiler.compile_loops(dict(entries), parts, kind)


@contextmanager
def _pause_garbage_collection() -> Iterator[None]:
    """Python looks for garbage later: numba makes objects by the million, most of which stay."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
