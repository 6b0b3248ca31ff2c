"""Hashes of arbitrary Python values that are the same in every process.

A value is decomposed recursively into scalars: a function into its code and the values that the
code refers to, a class into its members, a collection into its entries, and most other objects into
the parts of their pickles. Installed functions, classes and modules are identified by name and
version.
"""

from __future__ import annotations

import dis
import hashlib
import sys
from collections.abc import Iterable, Iterator
from functools import _lru_cache_wrapper, cache, cached_property, singledispatch
from inspect import getattr_static
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from beamdae.function_pickler import FunctionPickler
from beamdae.read_only import ReadOnlyDict
from beamdae.studies.file_reads import PACKAGE_FOLDER, is_installed

# Class members that Python generates, some of them lazily or in no fixed order.
_GENERATED_MEMBERS = {
    "__abstractmethods__",
    "__annotate_func__",
    "__annotations_cache__",
    "__classcell__",
    "__dict__",
    "__firstlineno__",
    "__module__",
    "__slotnames__",
    "__static_attributes__",
    "__weakref__",
    "_abc_impl",
}
# Module globals that Python generates; some depend on the folder of the module.
_GENERATED_GLOBALS = {
    "__annotations__",
    "__builtins__",
    "__cached__",
    "__doc__",
    "__file__",
    "__loader__",
    "__name__",
    "__package__",
    "__path__",
    "__spec__",
}
_SCALARS = {*map(type, (None, ..., NotImplemented)), bool, int, float, complex, str, bytes}
_GLOBAL_READS = ("LOAD_GLOBAL", "LOAD_NAME")
_IMPORTS = ("IMPORT_NAME",)
_PICKLE_PROTOCOL = 4
_REDUCERS = FunctionPickler.dispatch_table  # also of methods, properties and cells
# Names of the parts, for error messages, and their values.
Parts = Iterable[tuple[str, Any]]


class FingerprintError(TypeError):
    """Raised for a value that cannot be reproduced in another process.

    Attributes
    ----------
    kind
        Type name of the value.
    containers
        Names of the parts that contain the value, from the innermost to the outermost; "" for parts
        without a name.
    """

    def __init__(self, value: Any) -> None:
        super().__init__(type(value).__name__)
        self.kind = type(value).__qualname__
        self.containers: list[str] = []

    @property
    def location(self) -> str:
        """Named parts that contain the value, from the outermost to the innermost, as text.

        Without named parts, the text is "the value".
        """
        return ", ".join(name for name in reversed(self.containers) if name) or "the value"


def digest(value: Any) -> str:
    """Return a hash of a value, including its type and parts, that is equal in all processes.

    Raises
    ------
    FingerprintError
        If the value or a part of it cannot be reproduced, such as a lock, a generator or an open
        file, or if the parts are nested too deeply.
    """
    return _Hasher().digest(value).hex()


class _Hasher:
    """Recursive hash of a value and its parts; cycles are hashed by their length."""

    def __init__(self) -> None:
        self._depths: dict[int, int] = {}
        # Storing the value keeps it alive, so that its id is not reused.
        self._digests: dict[tuple[int, bool], tuple[bytes, Any]] = {}
        self._in_module = False

    def digest(self, value: Any) -> bytes:
        if type(value) in _SCALARS:
            # Decimal conversion of long integers takes quadratic time.
            text = hex(value) if type(value) is int else repr(value)
            return hashlib.sha256(text.encode()).digest()
        in_module = self._in_module
        key = (id(value), in_module)
        if key in self._digests:
            return self._digests[key][0]
        if id(value) in self._depths:
            length = len(self._depths) - self._depths[id(value)]
            return hashlib.sha256(b"cycle %d" % length).digest()
        self._depths[id(value)] = len(self._depths)
        self._in_module = in_module or isinstance(value, ModuleType)
        try:
            result = self._digest_parts(value)
        except RecursionError:
            raise FingerprintError(value) from None
        finally:
            del self._depths[id(value)]
            self._in_module = in_module
        self._digests[key] = (result, value)
        return result

    def _digest_parts(self, value: Any) -> bytes:
        kind, parts = _decompose(value)
        digests = []
        for name, part in parts:
            try:
                digests.append(hashlib.sha256(name.encode()).digest() + self.digest(part))
            except FingerprintError as problem:
                if self._in_module:
                    # The model may not need this member; the hash includes the other members of the
                    # module.
                    digests.append(f"{name} {problem.kind}".encode())
                    continue
                problem.containers.append(name)
                raise
        if isinstance(value, (set, frozenset)):
            digests.sort()
        return hashlib.sha256(b"\0".join([kind.encode(), *digests])).digest()


@singledispatch
def _decompose(value: Any) -> tuple[str, Parts]:
    """Return the kind of a value and its parts; by default, the parts of its pickle."""
    try:
        reducer = _REDUCERS.get(type(value))
        reduced = reducer(value) if reducer else value.__reduce_ex__(_PICKLE_PROTOCOL)
    except Exception as problem:  # __reduce__ can raise any error.
        raise FingerprintError(value) from problem
    if isinstance(reduced, str):
        module = getattr(value, "__module__", None) or type(value).__module__
        return f"name {module}.{reduced}", ()
    function, arguments, state, items, pairs = (*reduced, None, None, None)[:5]
    parts = [("", function), *(("", x) for x in arguments), ("", None)]
    parts += _state_parts(value, state)
    parts += [("", x) for x in items or ()]
    parts += [("", x) for pair in pairs or () for x in pair]
    return "object", parts


_decompose_pickle = _decompose.dispatch(object)


def _state_parts(value: Any, state: Any) -> Iterator[tuple[str, Any]]:
    """Yield the pickled attributes of an object, except for the values of cached properties."""
    for part in state if isinstance(state, tuple) else (state,):
        if not isinstance(part, dict):
            yield "", part
            continue
        for name, x in part.items():
            if not isinstance(getattr_static(type(value), str(name), None), cached_property):
                yield f"attribute {name}", x


@_decompose.register(list)
@_decompose.register(tuple)
@_decompose.register(set)
@_decompose.register(frozenset)
def _decompose_collection(value: Any) -> tuple[str, Parts]:
    if type(value) not in (list, tuple, set, frozenset):
        return _decompose_pickle(value)
    return type(value).__name__, [("", x) for x in value]


@_decompose.register(dict)
def _decompose_mapping(value: Any) -> tuple[str, Parts]:
    if type(value) not in (dict, ReadOnlyDict):
        return _decompose_pickle(value)
    parts: list[tuple[str, Any]] = []
    for key, x in value.items():
        parts += [("", key), (f"item {key}" if isinstance(key, str) else "", x)]
    return "dict", parts


@_decompose.register
def _decompose_array(value: np.ndarray) -> tuple[str, Parts]:
    if type(value) is not np.ndarray:
        return _decompose_pickle(value)
    kind = f"array {value.dtype.str} {value.dtype.descr} {value.shape}"
    if value.dtype.hasobject:
        return kind, [("", value.tolist())]
    return kind, [("", hashlib.sha256(value.tobytes()).digest())]


@_decompose.register
def _decompose_function(value: FunctionType) -> tuple[str, Parts]:
    code = value.__code__
    wrapped = [("", getattr(value, "__wrapped__", None))]
    cells = list(zip(code.co_freevars, value.__closure__ or (), strict=True))
    if is_installed(code.co_filename):
        name = f"function {_versioned_name(value.__module__)} {value.__qualname__}"
        # Installed decorators store user functions in cells; decorators of beamdae do not.
        is_own = code.co_filename.startswith(str(PACKAGE_FOLDER))
        return name, wrapped if is_own else [*wrapped, *cells]
    scope = value.__globals__
    parts = [
        ("", code),
        *((f"its default {k}", x) for k, x in enumerate(value.__defaults__ or ())),
        *((f"its default {k}", x) for k, x in (value.__kwdefaults__ or {}).items()),
        *cells,
        *((f"its global {k}", scope[k]) for k in _names_read(code, _GLOBAL_READS) if k in scope),
        *((f"its import {k}", sys.modules.get(k)) for k in _names_read(code, _IMPORTS)),
        *((f"its attribute {k}", x) for k, x in vars(value).items()),
    ]
    return f"function {value.__qualname__}", parts


@cache
def _names_read(code: CodeType, instructions: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names that instructions of a code object and its nested functions read."""
    names = {x.argval for x in dis.get_instructions(code) if x.opname in instructions}
    for nested in code.co_consts:
        if isinstance(nested, CodeType):
            names.update(_names_read(nested, instructions))
    return tuple(sorted(names - _GENERATED_GLOBALS))


@_decompose.register
def _decompose_code(value: CodeType) -> tuple[str, Parts]:
    # File name and line numbers are omitted, because they do not affect results.
    names = (value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars)
    counts = (value.co_argcount, value.co_posonlyargcount, value.co_kwonlyargcount, value.co_flags)
    parts = (value.co_code, value.co_exceptiontable, names, counts, *value.co_consts)
    return f"code {value.co_name}", [("", x) for x in parts]


@_decompose.register
def _decompose_class(value: type) -> tuple[str, Parts]:
    module = sys.modules.get(value.__module__)
    imported: Any = module
    for name in value.__qualname__.split("."):
        imported = getattr(imported, name, None)
    # Some built-in types, such as that of functions, cannot be imported.
    is_named = imported is value or value.__module__ == "builtins"
    if is_named and _is_installed_module(module):
        return f"class {_versioned_name(value.__module__)} {value.__qualname__}", ()
    members = {k: x for k, x in vars(value).items() if k not in _GENERATED_MEMBERS}
    bases = [("", x) for x in (*value.__bases__, type(value))]
    return f"class {value.__qualname__}", [*bases, *((k, members[k]) for k in sorted(members))]


@_decompose.register
def _decompose_module(value: ModuleType) -> tuple[str, Parts]:
    if _is_installed_module(value):
        return f"module {_versioned_name(value.__name__)}", ()
    members = {k: x for k, x in vars(value).items() if k not in _GENERATED_GLOBALS}
    return "module", [(k, members[k]) for k in sorted(members)]


def _is_installed_module(module: ModuleType | None) -> bool:
    file = getattr(module, "__file__", None)
    if file is not None:
        return is_installed(file)
    origin = getattr(getattr(module, "__spec__", None), "origin", None)
    folders = list(getattr(module, "__path__", ()))
    return origin in ("built-in", "frozen") or (
        bool(folders) and all(is_installed(str(folder)) for folder in folders)
    )


def _versioned_name(module_name: str | None) -> str:
    package = sys.modules.get((module_name or "").partition(".")[0])
    return f"{module_name} {getattr(package, '__version__', '')}"


@_decompose.register(_lru_cache_wrapper)
def _decompose_cached_function(value: Any) -> tuple[str, Parts]:
    return "cached function", [("", value.__wrapped__), ("", value.cache_parameters())]
