"""Translation of plain Python functions to LLVM IR by numba.

Importing this module imports numba. While loops are compiled, `_emit_ir_only` replaces internal
parts of numba (`_library_class`, `get_executable` and `nrt` of its target), so that numba emits
only IR. pyproject.toml therefore limits numba and llvmlite to tested versions. If the replacements
fail with another version, `compile_loops` falls back to the standard behavior of numba.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary, ll
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.runtime.context import NRTContext

from beamdae.errors import format_exception
from beamdae.native import overloads as _overloads  # noqa: F401 registers them with numba
from beamdae.native import structs
from beamdae.native.llvm import MachineCodeError, link_modules

_NUMBER_TYPES = {"int": numba.int64, "float": numba.float64}
_ARGUMENT_TYPES = {"d": numba.float64, "p": numba.int64, "@": numba.types.CPointer(numba.int64)}
# Functions that numba's code calls to raise errors or free arrays; loops do neither.
_RAISING = re.compile(r"^declare ([^@]*)@((?:Py|NRT_|numba_)\w+)\(([^)]*)\).*$", re.MULTILINE)
# Reference counting of arrays, whose memory always belongs to Python.
_COUNTING = re.compile(
    r"^define [^@\n]*@(NRT_incref|NRT_decref)\(.*?^\}$", re.MULTILINE | re.DOTALL
)
_EXCEPTIONS = re.compile(r"^(@PyExc_\w+ = )external (global i8).*$", re.MULTILINE)

# Entry points for calls from Python, which loops do not need.
_WRAPPER_OPTIONS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

# Separates the texts of modules.
_MODULE_SEPARATOR = "\n; next\n"

_registered_functions: set[FunctionType] = set()


class _IrLibrary(JITCodeLibrary):
    """Code library that holds only the IR of a function.

    By default, numba optimizes every function twice, compiles it to machine code, and copies it
    with all functions it calls into every caller, which takes two thirds of the compilation time.
    Instead, `llvm` optimizes and compiles the whole loop once.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self._modules: list[str] = []

    def add_ir_module(self, ir_module: Any) -> None:
        self._raise_if_finalized()
        self._modules.append(str(ir_module))

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def get_llvm_str(self) -> str:
        return _MODULE_SEPARATOR.join(self._iterate_modules(set()))

    def _iterate_modules(self, visited: set[Any]) -> Iterator[str]:
        """Yield the modules of this function and of all functions it calls, each once."""
        visited.add(self)
        yield from self._modules
        for library in self._linking_libraries:
            if library in visited:
                continue
            if isinstance(library, _IrLibrary):
                yield from library._iterate_modules(visited)
            # rtsys counts references and frees arrays.
            elif library is not rtsys.library:
                visited.add(library)
                yield library.get_llvm_str()

    def _get_module_for_linking(self) -> Any:
        # Called if another package meanwhile compiles code that calls this function.
        return ll.parse_assembly(link_modules(self._iterate_modules(set()), ()))


class _NoReferenceCounting(NRTContext):
    """Omits reference counting of arrays, whose memory always belongs to Python."""

    def incref(self, builder: Any, kind: Any, value: Any) -> None:
        pass

    def decref(self, builder: Any, kind: Any, value: Any) -> None:
        pass


@contextmanager
def _emit_ir_only() -> Iterator[None]:
    """Make numba emit IR and no machine code in this context."""
    with global_compiler_lock:
        context = cpu_target.target_context
        codegen = context.codegen()
        library_class = codegen._library_class
        codegen._library_class = _IrLibrary
        # A new placeholder for the Python callable, which is never called.
        context.get_executable = lambda library, description, environment: [].count
        reference_counting = vars(context).pop("nrt", None)
        context.nrt = _NoReferenceCounting(context, True)
        try:
            yield
        finally:
            codegen._library_class = library_class
            del context.get_executable, context.nrt
            if reference_counting is not None:
                context.nrt = reference_counting


def compile_loops(
    entries: Mapping[str, tuple[Callable[..., int], str]],
    functions: Sequence[FunctionType],
    kind: Any,
) -> str:
    """Compile the loops of one object to LLVM IR that calls neither numba nor Python.

    Parameters
    ----------
    entries
        Pairs (loop, arguments) by symbol; see `loops.CompiledLoop`.
    functions
        The loops and all functions they call.
    kind
        Layout of the object on which the loops work, see `loops`.

    Raises
    ------
    MachineCodeError
        If numba cannot compile the loops, or LLVM cannot link them.
    """
    for function in functions:
        if function not in _registered_functions:
            _registered_functions.add(function)
            numba.extending.register_jitable(error_model="numpy", **_WRAPPER_OPTIONS)(function)
    entry_points = {symbol: _define_entry_point(*entry, kind) for symbol, entry in entries.items()}
    try:
        try:
            with _emit_ir_only():
                text = _compile_entries(entry_points)
        except (AttributeError, TypeError, MachineCodeError):
            # This version of numba differs in the replaced parts; compiling without them takes
            # longer.
            text = _compile_entries(entry_points)
    except numba.errors.NumbaError as problem:
        raise MachineCodeError(
            f"numba cannot compile loops ({format_exception(problem)})"
        ) from problem
    text = _COUNTING.sub(r"define internal void @\1(ptr) alwaysinline {\n  ret void\n}", text)
    text = _RAISING.sub(r"define internal \1@\2(\3) {\n  unreachable\n}", text)
    return _EXCEPTIONS.sub(r"\1internal \2 0", text)


def _define_entry_point(function: Callable[..., int], arguments: str, kind: Any) -> tuple[Any, Any]:
    """Return a function from which numba makes the C entry point of a loop, and its signature."""
    names = ["table" if argument == "@" else f"a{k}" for k, argument in enumerate(arguments)]
    call_arguments = ", ".join(["object_at(table)", *(name for name in names if name != "table")])
    namespace = {"function": function, "object_at": structs.object_at_table(_numba_type(kind))}
    exec(f"def entry({', '.join(names)}):\n    return function({call_arguments})\n", namespace)
    return namespace["entry"], numba.int32(*(_ARGUMENT_TYPES[argument] for argument in arguments))


def _compile_entries(entry_points: Mapping[str, tuple[Any, Any]]) -> str:
    """Return one module of LLVM IR with the C entry points, named by their symbols."""
    texts: dict[str, None] = {}
    symbols = {}
    for symbol, (entry, signature) in entry_points.items():
        compiled = numba.cfunc(signature, error_model="numpy")(entry)
        symbols[compiled.native_name] = symbol
        texts.update(dict.fromkeys(compiled.inspect_llvm().split(_MODULE_SEPARATOR)))
    text = link_modules(texts, symbols)
    for name, symbol in symbols.items():
        text = re.sub(rf'@"?{re.escape(name)}"?(?=\W)', f"@{symbol}", text)
    return text


def _numba_type(kind: Any) -> Any:
    """Return the numba type of (dtype, number of dimensions) or of (class name, fields)."""
    name, content = kind
    if isinstance(content, int):
        return numba.types.Array(getattr(numba.types, name), content, "C")
    fields = {
        field: (
            word,
            _NUMBER_TYPES[field_kind] if isinstance(field_kind, str) else _numba_type(field_kind),
        )
        for field, word, field_kind in content
    }
    return structs.Struct(name, fields)
