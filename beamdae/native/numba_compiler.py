"""From plain Python to LLVM IR, by numba. Importing this module imports numba."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FunctionType
from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from beamdae.errors import told
from beamdae.native import overloads, structs
from beamdae.native.machine import MachineError

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
_NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

_registered: set[FunctionType] = set()


class _Text(JITCodeLibrary):
    """A function as IR alone.

    Numba by itself optimizes every function twice and makes machine code of it, which takes two
    thirds of the time; `machine` does all of that once, for the whole loop.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        pass

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0


@contextmanager
def _text_alone() -> Iterator[None]:
    """What numba compiles meanwhile is made IR of, and no machine code."""
    with global_compiler_lock:
        context = cpu_target.target_context
        codegen = context.codegen()
        kept = codegen._library_class
        codegen._library_class = _Text
        # Something of its own for Python to call, which never does.
        context.get_executable = lambda library, description, environment: [].count
        try:
            yield
        finally:
            codegen._library_class = kept
            del context.get_executable


assert overloads.__name__


def ir(
    function: Callable[..., int],
    parts: Sequence[FunctionType],
    kind: Any,
    arguments: str,
    symbol: str,
) -> str:
    """LLVM IR that needs nothing of numba or Python, with the loop as `symbol`.

    Parameters
    ----------
    parts
        The function and all functions it calls.
    kind
        Of the object it works on, see `loops`.

    Raises
    ------
    MachineError
        If this numba cannot compile it.
    """
    for part in parts:
        if part not in _registered:
            _registered.add(part)
            numba.extending.register_jitable(error_model="numpy", **_NO_WRAPPERS)(part)
    names = [f"a{k}" if kind != "@" else "table" for k, kind in enumerate(arguments)]
    given = ", ".join(["object_at(table)", *(name for name in names if name != "table")])
    space = {"function": function, "object_at": structs.at(_numba_type(kind))}
    exec(f"def entry({', '.join(names)}):\n    return function({given})\n", space)
    signature = numba.int32(*(_ARGUMENTS[argument] for argument in arguments))
    compiling = numba.cfunc(signature, error_model="numpy")
    try:
        try:
            with _text_alone():
                compiled = compiling(space["entry"])
        except (AttributeError, TypeError):
            # A numba whose inner parts are others than those known here: then it takes its time.
            compiled = compiling(space["entry"])
    except numba.errors.NumbaError as problem:
        raise MachineError(f"numba cannot compile loops ({told(problem)})") from problem
    text = compiled.inspect_llvm()
    text = re.sub(rf'@"?{re.escape(compiled.native_name)}"?(?=\W)', f"@{symbol}", text)
    text = _COUNTING.sub(r"define internal void @\1(ptr) alwaysinline {\n  ret void\n}", text)
    text = _RAISING.sub(r"define internal \1@\2(\3) {\n  unreachable\n}", text)
    return _EXCEPTIONS.sub(r"\1internal \2 0", text)


def _numba_type(kind: Any) -> Any:
    name, what = kind
    if isinstance(what, int):
        return numba.types.Array(getattr(numba.types, name), what, "C")
    found = {
        field: (word, _NUMBERS[own] if isinstance(own, str) else _numba_type(own))
        for field, word, own in what
    }
    return structs.Struct(name, found)
