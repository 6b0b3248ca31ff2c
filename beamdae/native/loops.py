"""Compiled loops: plain Python functions over arrays, compiled once per machine.

A loop is a function of one object whose fields are numbers, arrays and nested objects of this kind.
It may set numbers and entries of arrays. Its machine code receives the numbers and the addresses of
the arrays in a table. It does not use Python and therefore releases the interpreter lock while it
runs. Wheels contain the machine code of the loops of this package; code that is compiled on first
use is cached like the code of kernels. numba is imported only to compile a loop.
"""

from __future__ import annotations

import ctypes
import hashlib
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import fields
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np

from beamdae.errors import format_exception
from beamdae.garbage_collection import paused_collection
from beamdae.linear import fixed_order, lane_operations
from beamdae.native import linear_solver, loop_functions
from beamdae.native.llvm import LoadedObject, MachineCodeError
from beamdae.native.object_code import ObjectSource, is_native_enabled, load_object
from beamdae.package_versions import installed_version

Array = np.ndarray

_OPTIMIZATION_LEVEL = 2
_PACKAGE_PREFIX = f"{__name__.partition('.')[0]}."
# Modules whose source determines the machine code of a loop, besides the loop itself.
_RECIPE_MODULES = (
    lane_operations.__name__,
    *(f"{__package__}.{x}" for x in ("loop_functions", "overloads", "structs", "numba_compiler")),
)
# Modules of functions whose machine code comes from `overloads`.
_OVERLOADED_MODULES = (loop_functions.__name__, lane_operations.__name__)
# Functions that the overloads of these `loop_functions` call.
_IMPLEMENTATIONS: dict[Any, Any] = {
    loop_functions.factorize: linear_solver.factorize_linear,
    loop_functions.solve: linear_solver.solve_linear,
    loop_functions.solve_lanes: linear_solver.solve_linear_lanes,
    loop_functions.count_negative_pivots: fixed_order.eliminate,
}
_LOOP_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
# (symbol, (function, arguments)) of all functions that are compiled into one module.
_EntryPoints = tuple[tuple[str, tuple[Any, str]], ...]


def prepare_loop(
    function: Any, make: Any, native: bool, compiles: bool = True
) -> tuple[Any, CompiledLoop | None]:
    """Return the object that a loop works on, and the compiled loop.

    The compiled loop is None if the loop runs in plain Python.

    Parameters
    ----------
    function
        The loop.
    make
        Function that returns the object: `make(True)` for machine code, `make(False)` for plain
        Python.
    native
        True to try machine code, False for plain Python.
    compiles
        False to use only machine code in the cache.
    """
    if native:
        work = make(True)
        with suppress(MachineCodeError):
            return work, CompiledLoop(function, work, compiles=compiles)
    return make(False), None


class CompiledLoop:
    """A loop as machine code, bound to the object it works on.

    Parameters
    ----------
    function
        The loop, `function(work)`; returns an int.
    work
        A dataclass of numbers, C-contiguous arrays, and nested dataclasses or named tuples of
        these. Fields that are plain tuples are not accessible to the loop.
    compiles
        False to use only machine code in the cache.
    **callbacks
        Further C functions `function(work, *arguments)` on the same table, as (function,
        arguments). The characters of `arguments` are "d" for a double, "p" for a pointer, which the
        function receives as an integer, and "@" for the table.

    Attributes
    ----------
    addresses
        Addresses of the C functions by name: "loop", whose only argument is the address of `table`,
        and the callbacks.
    table
        Numbers of the object, and addresses and shapes of its arrays, as words of 64 bits.

    Raises
    ------
    MachineCodeError
        If machine code is unavailable or switched off, or not in the cache if `compiles` is False.
    """

    def __init__(
        self, function: Any, work: Any, *, compiles: bool = True, **callbacks: tuple[Any, str]
    ) -> None:
        layout = _TableLayout(work)
        self._objects, self._numbers = layout.objects, _group_numbers(layout.numbers)
        *_, self._kind = layout.objects[-1]
        self.table = np.array(layout.words, np.int64)
        self._views = {float: self.table.view(np.float64), int: self.table}
        entries = {"loop": (function, "@"), **callbacks}
        self.addresses = _load_entries(tuple(entries.items()), self._kind, compiles)
        self._call = _LOOP_SIGNATURE(self.addresses["loop"])
        self._table_address = self.table.ctypes.data
        # Kept because the table holds addresses of its arrays.
        self._work = work

    def __call__(self) -> int:
        """Run the loop, update the numbers of the object, and return the loop's return code."""
        self.load()
        code = self._call(self._table_address)
        self.unload()
        return int(code)

    def bind(self, *owners: Any) -> None:
        """Update the table after arrays of the object have been replaced.

        The address of the table does not change, so that callbacks may call this method while the
        loop runs. If only arrays of some nested objects have been replaced, `owners` are these
        objects: a table has many more arrays.
        """
        for owner in owners or (self._work,):
            start, kind = next((word, kind) for x, word, kind in self._objects if x is owner)
            layout = _TableLayout(owner)
            *_, new_kind = layout.objects[-1]
            assert new_kind == kind
            # Numbers of objects that have been replaced would not be copied.
            assert all(any(x is y for y, *_ in self._objects) for x, *_ in layout.numbers)
            self.table[start : start + len(layout.words)] = layout.words
        self.load()

    def load(self) -> None:
        """Copy the numbers of the object into the table."""
        for kind, words, numbers in self._numbers:
            self._views[kind][words] = [getattr(owner, name) for owner, name in numbers]

    def call_loaded(self) -> int:
        """Run the loop on the numbers in the table; return its code."""
        return int(self._call(self._table_address))

    def unload(self) -> None:
        """Copy the numbers in the table into the object."""
        for kind, words, numbers in self._numbers:
            # One access to the table: its entries, one by one, would take five times as long.
            values = self._views[kind][words].tolist()
            for (owner, name), value in zip(numbers, values, strict=True):
                setattr(owner, name, value)


def _group_numbers(
    numbers: list[tuple[Any, str, int, type]],
) -> list[tuple[type, Array, list[tuple[Any, str]]]]:
    """Return the words and the fields (owner, name) of the numbers of each type."""
    kinds: tuple[type, ...] = (float, int)
    groups = []
    for kind in kinds:
        fields_of_kind = [(owner, name, word) for owner, name, word, x in numbers if x is kind]
        words = np.array([word for *_, word in fields_of_kind], np.intp)
        groups.append((kind, words, [(owner, name) for owner, name, _ in fields_of_kind]))
    return groups


class _TableLayout:
    """Positions of the fields of an object in a table.

    Attributes
    ----------
    words
        The table, with zeros in place of numbers.
    numbers
        (owner, name, word, type) of the numbers.
    objects
        (owner, first word, kind) of the nested objects, and last of the object; named tuples, which
        contain no numbers, are omitted. The kind is (class name, ((field, word, type), ...)), the
        part on which machine code depends.
    """

    def __init__(self, work: Any) -> None:
        self.words: list[int] = []
        self.numbers: list[tuple[Any, str, int, type]] = []
        self.objects: list[tuple[Any, int, tuple[str, tuple[Any, ...]]]] = []
        self._add_object(work)

    def _add_object(self, owner: Any) -> tuple[str, tuple[Any, ...]]:
        words, entries = self.words, []
        start = len(words)
        for name in _field_names(owner.__class__):
            value, word = getattr(owner, name), len(words)
            kind: Any
            # Arrays first: most fields are arrays.
            if isinstance(value, np.ndarray):
                assert value.flags.c_contiguous, name
                words.append(_address_of(value))
                words += value.shape
                kind = _array_kind(value.dtype, value.ndim)
            elif type(value) is tuple:
                continue
            elif isinstance(value, (bool, int, float)):
                number = float if isinstance(value, float) else int
                self.numbers.append((owner, name, word, number))
                words.append(0)
                kind = number.__name__
            else:
                kind = self._add_object(value)
            entries.append((name, word - start, kind))
        result = type(owner).__name__, tuple(entries)
        if not isinstance(owner, tuple):
            self.objects.append((owner, start, result))
        return result


@cache
def _array_kind(dtype: np.dtype[Any], n_axes: int) -> tuple[str, int]:
    return str(dtype), n_axes


def _address_of(array: Array) -> int:
    """Return the address of an array; 0 if it is empty."""
    if not array.size:
        return 0
    if array.flags.writeable:
        # `array.ctypes` takes ten times as long.
        return ctypes.addressof(ctypes.c_char.from_buffer(array.data))
    return int(array.ctypes.data)


@cache
def _field_names(kind: type) -> tuple[str, ...]:
    return getattr(kind, "_fields", None) or tuple(field.name for field in fields(kind))


def _iterate_code(function: FunctionType, visited: dict[FunctionType, None]) -> Iterator[str]:
    """Yield the bytecode and the constants of a function and of all functions compiled with it.

    Bytecode is what numba compiles, and reading sources would take as long as the steps of a short
    run. `visited` collects the functions.
    """
    if function in visited or function.__module__ in _OVERLOADED_MODULES:
        return
    visited[function] = None
    code = function.__code__
    names = (code.co_name, code.co_varnames, code.co_names)
    yield repr((*names, code.co_code.hex(), code.co_consts, function.__defaults__))
    for name in code.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType):
            yield from _iterate_code(_IMPLEMENTATIONS.get(value, value), visited)
        elif (constant := _describe_constant(value)) is not None:
            yield f"{name} = {constant}"


def _describe_constant(value: Any) -> str | None:
    """Return the value of a global number, tuple or array of a loop, or None for other values."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, (int, float, complex, tuple)):
        return repr(value)
    return f"{value.dtype} {value.tolist()!r}" if isinstance(value, np.ndarray) else None


def _identify_entries(
    entries: _EntryPoints, functions: Iterable[FunctionType], kind: Any
) -> str | None:
    """Return a text that determines what loops of this package compute, None for other loops.

    In contrast to bytecode, the source files of the functions and the values of their constants are
    the same for all versions of Python.
    """
    modules = {*_RECIPE_MODULES, *(function.__module__ for function in functions)}
    if any(not module.startswith(_PACKAGE_PREFIX) for module in modules):
        return None
    try:
        lines = {f"{module} {_hash_source(module)}" for module in modules}
    except OSError:
        return None
    for function in functions:
        lines.add(f"{function.__module__}.{function.__qualname__}")
        for name in function.__code__.co_names:
            constant = _describe_constant(function.__globals__.get(name))
            if constant is not None:
                lines.add(f"{function.__module__}.{name} = {constant}")
    symbols = [
        f"{symbol}({arguments}) = {function.__module__}.{function.__qualname__}"
        for symbol, (function, arguments) in entries
    ]
    return "\n".join([repr(kind), *symbols, *sorted(lines)])


@cache
def _hash_source(module: str) -> str:
    """Return the hash of the source file of a module of this package."""
    folder, names = Path(__file__).parents[1], module.split(".")[1:]
    path = folder.joinpath(*names)
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return hashlib.sha256(file.read_bytes()).hexdigest()


@cache
def _describe_compiler() -> str:
    """Return the versions and sources on which the IR of loops depends."""
    hashes = map(_hash_source, _RECIPE_MODULES)
    return "\n".join([f"numba {installed_version('numba')}", sys.version, *hashes])


_loaded_objects: dict[Any, LoadedObject | None] = {}
# Without the lock, two threads could load the same loop; the second object would then replace the
# object that the first thread runs.
_loading_lock = threading.Lock()


def _load_entries(entries: _EntryPoints, kind: Any, compiles: bool) -> dict[str, int]:
    if not is_native_enabled():
        raise MachineCodeError("machine code is switched off")
    name = entries[0][1][0].__name__
    key = (entries, kind)
    with _loading_lock:
        if key not in _loaded_objects:
            called_functions: dict[FunctionType, None] = {}
            text = [repr(kind), _describe_compiler()]
            for symbol, (function, arguments) in entries:
                text += [symbol, arguments, *_iterate_code(function, called_functions)]
            source = ObjectSource(
                name,
                "\n".join(text),
                tuple(symbol for symbol, _ in entries),
                level=_OPTIMIZATION_LEVEL,
                ir=lambda: _compile_entries(entries, tuple(called_functions), kind),
                portable_text=lambda: _identify_entries(entries, called_functions, kind),
            )
            code = load_object(source, lambda code: True, compiles)
            if code is not None or compiles:
                _loaded_objects[key] = code
        else:
            code = _loaded_objects[key]
    if code is None:
        raise MachineCodeError(f"{name}: the loop cannot be compiled")
    return code.addresses


def _compile_entries(entries: _EntryPoints, functions: tuple[FunctionType, ...], kind: Any) -> str:
    """Return LLVM IR of the loops of one object and of all functions they call."""
    with paused_collection():  # numba creates millions of objects
        try:
            from beamdae.native import numba_compiler
        except ImportError as problem:
            raise MachineCodeError(
                f"numba cannot be imported ({format_exception(problem)})"
            ) from problem
        return numba_compiler.compile_loops(dict(entries), functions, kind)
