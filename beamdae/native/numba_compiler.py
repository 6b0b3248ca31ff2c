"""From plain Python to LLVM IR, by numba. Importing this module imports numba."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any

import numba

from beamdae.errors import told
from beamdae.native import overloads, structs
from beamdae.native.machine import MachineError

_NUMBERS = {"int": numba.int64, "float": numba.float64}
_ARGUMENTS = {"d": numba.float64, "p": numba.int64, "@": numba.types.CPointer(numba.int64)}
# What numba's code calls where something is raised, or an array is freed: loops do neither.
_RAISING = re.compile(r"^declare ([^@]*)@((?:Py|NRT_|numba_)\w+)\(([^)]*)\).*$", re.MULTILINE)
_EXCEPTIONS = re.compile(r"^(@PyExc_\w+ = )external (global i8).*$", re.MULTILINE)

_registered: set[FunctionType] = set()

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
            numba.extending.register_jitable(error_model="numpy")(part)
    names = [f"a{k}" if kind != "@" else "table" for k, kind in enumerate(arguments)]
    given = ", ".join(["object_at(table)", *(name for name in names if name != "table")])
    space = {"function": function, "object_at": structs.at(_numba_type(kind))}
    exec(f"def entry({', '.join(names)}):\n    return function({given})\n", space)
    signature = numba.int32(*(_ARGUMENTS[argument] for argument in arguments))
    try:
        compiled = numba.cfunc(signature, error_model="numpy")(space["entry"])
    except numba.errors.NumbaError as problem:
        raise MachineError(f"numba cannot compile loops ({told(problem)})") from problem
    text = compiled.inspect_llvm()
    text = re.sub(rf'@"?{re.escape(compiled.native_name)}"?(?=\W)', f"@{symbol}", text)
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
