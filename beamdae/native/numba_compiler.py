"""From plain Python to LLVM IR, by numba. Importing this module imports numba."""

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
from beamdae.native import overloads, structs
from beamdae.native.llvm import MachineCodeError, link_modules

_NUMBERS = {"int": numba.int64, "float": numba.float64}
_ARGUMENTS = {"d": numba.float64, "p": numba.int64, "@": numba.types.CPointer(numba.int64)}
# What numba's code calls where something is raised, or an array is freed: loops do neither.
_RAISING = re.compile(r"^declare ([^@]*)@((?:Py|NRT_|numba_)\w+)\(([^)]*)\).*$", re.MULTILINE)
# Whose memory arrays are: here always somebody else's.
_COUNTING = re.compile(
    r"^define [^@\n]*@(NRT_incref|NRT_decref)\(.*?^\}$", re.MULTILINE | re.DOTALL
)
_EXCEPTIONS = re.compile(r"^(@PyExc_\w+ = )external (global i8).*$", re.MULTILINE)

# By which Python would call it.
_WRAPPER_OPTIONS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

# Between texts of modules.
_MODULE_SEPARATOR = "\n; next\n"

_registered_functions: set[FunctionType] = set()


class _IrLibrary(JITCodeLibrary):
    """A function as IR alone.

    Numba by itself optimizes every function twice, makes machine code of it, and copies it and all
    it calls into every caller, which takes two thirds of the time; `machine` does all of that
    once, for the whole loop.
    """

    def __init__(self, codegen: Any, name: str) -> None:
        super().__init__(codegen, name)
        self._own: list[str] = []

    def add_ir_module(self, ir_module: Any) -> None:
        self._raise_if_finalized()
        self._own.append(str(ir_module))

    def finalize(self) -> None:
        self._raise_if_finalized()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def get_llvm_str(self) -> str:
        return _MODULE_SEPARATOR.join(self._texts(set()))

    def _texts(self, found: set[Any]) -> Iterator[str]:
        """Of it and of all that it calls, each once."""
        found.add(self)
        yield from self._own
        for library in self._linking_libraries:
            if library in found:
                continue
            if isinstance(library, _IrLibrary):
                yield from library._texts(found)
            # That one counts and frees arrays.
            elif library is not rtsys.library:
                found.add(library)
                yield library.get_llvm_str()

    def _get_module_for_linking(self) -> Any:
        # Of others, who compile something that calls it.
        return ll.parse_assembly(link_modules(self._texts(set()), ()))


class _NoReferenceCounting(NRTContext):
    """Nobody counts who uses an array: its memory is always somebody else's."""

    def incref(self, builder: Any, kind: Any, value: Any) -> None:
        pass

    def decref(self, builder: Any, kind: Any, value: Any) -> None:
        pass


@contextmanager
def _emit_ir_only() -> Iterator[None]:
    """What numba compiles meanwhile is made IR of, and no machine code."""
    with global_compiler_lock:
        context = cpu_target.target_context
        codegen = context.codegen()
        kept = codegen._library_class
        codegen._library_class = _IrLibrary
        # Something of its own for Python to call, which never does.
        context.get_executable = lambda library, description, environment: [].count
        counting = vars(context).pop("nrt", None)
        context.nrt = _NoReferenceCounting(context, True)
        try:
            yield
        finally:
            codegen._library_class = kept
            del context.get_executable, context.nrt
            if counting is not None:
                context.nrt = counting


assert overloads.__name__


def compile_loops(
    entries: Mapping[str, tuple[Callable[..., int], str]],
    parts: Sequence[FunctionType],
    kind: Any,
) -> str:
    """LLVM IR that needs nothing of numba or Python, with loops of one object as symbols.

    Parameters
    ----------
    entries
        Symbol -> (loop, its arguments).
    parts
        The loops and all functions they call.
    kind
        Of the object they work on, see `loops`.

    Raises
    ------
    MachineError
        If this numba cannot compile it.
    """
    for part in parts:
        if part not in _registered_functions:
            _registered_functions.add(part)
            numba.extending.register_jitable(error_model="numpy", **_WRAPPER_OPTIONS)(part)
    wanted = {symbol: _define_entry_point(*entry, kind) for symbol, entry in entries.items()}
    try:
        try:
            with _emit_ir_only():
                text = _compile_entries(wanted)
        except (AttributeError, TypeError, MachineCodeError):
            # A numba whose inner parts are others than those known here: then it takes its time.
            text = _compile_entries(wanted)
    except numba.errors.NumbaError as problem:
        raise MachineCodeError(
            f"numba cannot compile loops ({format_exception(problem)})"
        ) from problem
    text = _COUNTING.sub(r"define internal void @\1(ptr) alwaysinline {\n  ret void\n}", text)
    text = _RAISING.sub(r"define internal \1@\2(\3) {\n  unreachable\n}", text)
    return _EXCEPTIONS.sub(r"\1internal \2 0", text)


def _define_entry_point(function: Callable[..., int], arguments: str, kind: Any) -> tuple[Any, Any]:
    """A C function that calls a loop, and its signature."""
    names = [f"a{k}" if one != "@" else "table" for k, one in enumerate(arguments)]
    given = ", ".join(["object_at(table)", *(name for name in names if name != "table")])
    space = {"function": function, "object_at": structs.object_at_table(_numba_type(kind))}
    exec(f"def entry({', '.join(names)}):\n    return function({given})\n", space)
    return space["entry"], numba.int32(*(_ARGUMENTS[argument] for argument in arguments))


def _compile_entries(wanted: Mapping[str, tuple[Any, Any]]) -> str:
    """One module of C functions, with the symbols they are wanted as."""
    texts: dict[str, None] = {}
    symbols = {}
    for symbol, (entry, signature) in wanted.items():
        made = numba.cfunc(signature, error_model="numpy")(entry)
        symbols[made.native_name] = symbol
        texts.update(dict.fromkeys(made.inspect_llvm().split(_MODULE_SEPARATOR)))
    text = link_modules(texts, symbols)
    for name, symbol in symbols.items():
        text = re.sub(rf'@"?{re.escape(name)}"?(?=\W)', f"@{symbol}", text)
    return text


def _numba_type(kind: Any) -> Any:
    name, what = kind
    if isinstance(what, int):
        return numba.types.Array(getattr(numba.types, name), what, "C")
    found = {
        field: (word, _NUMBERS[own] if isinstance(own, str) else _numba_type(own))
        for field, word, own in what
    }
    return structs.Struct(name, found)
