"""Hashes of values that are the same in every process, whatever the values are."""

from __future__ import annotations

import copyreg
import dis
import hashlib
import struct
import sys
from collections.abc import Iterable, Iterator
from functools import _lru_cache_wrapper, cache, cached_property, singledispatch
from inspect import getattr_static
from types import (
    BuiltinFunctionType,
    CellType,
    CodeType,
    FunctionType,
    GetSetDescriptorType,
    MappingProxyType,
    MemberDescriptorType,
    MethodDescriptorType,
    MethodType,
    ModuleType,
    WrapperDescriptorType,
)
from typing import Any

import cloudpickle
import numpy as np

from beamdae.studies.store.file_hashes import PACKAGE_FOLDER, is_installed

# Members of classes that Python makes, some of them late or in no fixed order.
_GENERATED_MEMBERS = {
    "__dict__",
    "__weakref__",
    "__module__",
    "__slotnames__",
    "__abstractmethods__",
}
_GENERATED_MEMBERS |= {
    "_abc_impl",
    "__firstlineno__",
    "__static_attributes__",
    "__annotations_cache__",
}
_GENERATED_MEMBERS |= {"__annotate_func__", "__classcell__"}
# Globals that Python makes of each module, and of each place it is in.
_GENERATED_GLOBALS = {"__annotations__", "__builtins__", "__cached__", "__doc__", "__file__"}
_GENERATED_GLOBALS |= {"__loader__", "__name__", "__package__", "__path__", "__spec__"}
_GLOBAL_READS = {"LOAD_GLOBAL", "LOAD_NAME"}
# What a value consists of: names of its parts, and the parts.
Parts = Iterable[tuple[str, Any]]


class FingerprintError(TypeError):
    """A value that nothing tells again in another process.

    Attributes
    ----------
    kind
        Its type.
    inside
        What it is a part of, from the inside out.
    """

    def __init__(self, value: Any) -> None:
        super().__init__(type(value).__name__)
        self.kind = type(value).__qualname__
        self.inside: list[str] = []

    @property
    def place(self) -> str:
        """Where it is, from the outside in."""
        return ", ".join(name for name in reversed(self.inside) if name) or "the value"


def encode_scalar(value: Any) -> bytes | None:
    """The text of a value without parts."""
    kind = type(value)
    if value is None or value is Ellipsis or value is NotImplemented or kind is bool:
        return repr(value).encode()
    if kind is int:
        # Of any length, in hexadecimal digits.
        return b"int %x" % value if value >= 0 else b"int -%x" % -value
    if kind is float:
        return b"float " + struct.pack(">d", value)
    if kind is complex:
        return b"complex " + struct.pack(">dd", value.real, value.imag)
    if kind is str:
        return b"str " + value.encode("utf-8", "surrogatepass")
    return b"bytes " + value if kind is bytes else None


@singledispatch
def decompose(value: Any) -> tuple[str, Parts]:
    """What a value is, in words, and what it consists of: here, what it is pickled as."""
    try:
        reducer = copyreg.dispatch_table.get(type(value))
        reduced = reducer(value) if reducer else value.__reduce_ex__(4)
    except Exception as problem:  # Whatever objects do when they are pickled.
        raise FingerprintError(value) from problem
    if isinstance(reduced, str):
        return f"name {type(value).__module__}.{reduced}", ()
    function, arguments, state, items, pairs = (*reduced, None, None, None)[:5]
    parts = [("", function), *(("", x) for x in arguments), ("", None)]
    parts += _state(value, state)
    parts += [("", x) for x in items or ()]
    parts += [("", x) for pair in pairs or () for x in pair]
    return "object", parts


def _state(value: Any, state: Any) -> Iterator[tuple[str, Any]]:
    """Attributes of an object but those that are computed from the others when they are asked."""
    for part in state if isinstance(state, tuple) else (state,):
        if not isinstance(part, dict):
            yield "", part
            continue
        for name, x in part.items():
            if not isinstance(getattr_static(type(value), str(name), None), cached_property):
                yield f"attribute {name}", x


@decompose.register(list)
@decompose.register(tuple)
@decompose.register(set)
@decompose.register(frozenset)
def _of_items(value: Any) -> tuple[str, Parts]:
    if type(value) not in (list, tuple, set, frozenset):
        return _reduced(value)
    return type(value).__name__, [("", x) for x in value]


@decompose.register(dict)
@decompose.register(MappingProxyType)
def _of_pairs(value: Any) -> tuple[str, Parts]:
    if type(value) not in (dict, MappingProxyType):
        return _reduced(value)
    parts: list[tuple[str, Any]] = []
    for key, x in value.items():
        parts += [("", key), (f"item {key}" if isinstance(key, str) else "", x)]
    return "dict", parts


_reduced = decompose.dispatch(object)


@decompose.register
def _of_array(value: np.ndarray) -> tuple[str, Parts]:
    if type(value) is not np.ndarray:
        return _reduced(value)
    kind = f"array {value.dtype.str} {value.dtype.descr} {value.shape}"
    if value.dtype.hasobject:
        return kind, [("", value.tolist())]
    return kind, [("", hashlib.sha256(np.ascontiguousarray(value).data).digest())]


@decompose.register
def _of_function(value: FunctionType) -> tuple[str, Parts]:
    wrapped = [("", getattr(value, "__wrapped__", None))]
    file = value.__code__.co_filename
    cells = list(zip(value.__code__.co_freevars, value.__closure__ or (), strict=True))
    if is_installed(file):
        name = f"function {_versioned(value.__module__)} {value.__qualname__}"
        # What others wrap users' functions with holds them; what beamdae does is known.
        return name, wrapped if file.startswith(str(PACKAGE_FOLDER)) else [*wrapped, *cells]
    code = value.__code__
    scope = value.__globals__
    parts = [
        ("", code),
        *((f"its default {k}", x) for k, x in enumerate(value.__defaults__ or ())),
        *((f"its default {k}", x) for k, x in (value.__kwdefaults__ or {}).items()),
        *cells,
        *((f"its global {k}", scope[k]) for k in _globals_of(code) if k in scope),
        *((f"its import {k}", sys.modules.get(k)) for k in _imports_of(code)),
        *((f"its attribute {k}", x) for k, x in vars(value).items()),
    ]
    return f"function {value.__qualname__}", parts


@cache
def _globals_of(code: CodeType) -> tuple[str, ...]:
    """Names of globals the code reads, and that inside it, but those Python makes."""
    read = {x.argval for x in dis.get_instructions(code) if x.opname in _GLOBAL_READS}
    found = read.union(*(_globals_of(c) for c in code.co_consts if isinstance(c, CodeType)))
    return tuple(sorted(found - _GENERATED_GLOBALS))


@cache
def _imports_of(code: CodeType) -> tuple[str, ...]:
    read = {x.argval for x in dis.get_instructions(code) if x.opname == "IMPORT_NAME"}
    found = read.union(*(_imports_of(c) for c in code.co_consts if isinstance(c, CodeType)))
    return tuple(sorted(found))


@decompose.register
def _of_code(value: CodeType) -> tuple[str, Parts]:
    # Neither file nor lines: a model is the same in another folder.
    names = (value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars)
    counts = (value.co_argcount, value.co_posonlyargcount, value.co_kwonlyargcount, value.co_flags)
    inner = [("", x) for x in (value.co_code, value.co_exceptiontable, names, counts)]
    return f"code {value.co_name}", [*inner, *(("", x) for x in value.co_consts)]


@decompose.register
def _of_class(value: type) -> tuple[str, Parts]:
    module = sys.modules.get(value.__module__)
    found: Any = module
    for name in value.__qualname__.split("."):
        found = getattr(found, name, None)
    if found is value and _is_foreign(module):
        return f"class {_versioned(value.__module__)} {value.__qualname__}", ()
    members = {k: x for k, x in vars(value).items() if k not in _GENERATED_MEMBERS}
    bases = [("", x) for x in (*value.__bases__, type(value))]
    return f"class {value.__qualname__}", [*bases, *((k, members[k]) for k in sorted(members))]


@decompose.register
def _of_module(value: ModuleType) -> tuple[str, Parts]:
    if _is_foreign(value):
        return f"module {_versioned(value.__name__)}", ()
    members = {k: x for k, x in vars(value).items() if k not in _GENERATED_GLOBALS}
    return "module", [(k, members[k]) for k in sorted(members)]


def _is_foreign(module: ModuleType | None) -> bool:
    """Whether a module is installed, or part of Python."""
    file = getattr(module, "__file__", None)
    if file is not None:
        return is_installed(file)
    origin = getattr(getattr(module, "__spec__", None), "origin", None)
    folders = list(getattr(module, "__path__", ()))
    return origin in ("built-in", "frozen") or (
        bool(folders) and all(is_installed(str(folder)) for folder in folders)
    )


def _versioned(name: str | None) -> str:
    top = sys.modules.get((name or "").partition(".")[0])
    return f"{name} {getattr(top, '__version__', '')}"


@decompose.register
def _of_method(value: MethodType) -> tuple[str, Parts]:
    return "method", [("", value.__func__), ("", value.__self__)]


@decompose.register
def _of_builtin(value: BuiltinFunctionType) -> tuple[str, Parts]:
    owner = value.__self__
    bound = [] if owner is None or isinstance(owner, ModuleType) else [("", owner)]
    return f"builtin {value.__module__} {value.__qualname__}", bound


@decompose.register(GetSetDescriptorType)
@decompose.register(MemberDescriptorType)
@decompose.register(MethodDescriptorType)
@decompose.register(WrapperDescriptorType)
def _of_descriptor(value: Any) -> tuple[str, Parts]:
    return f"member {value.__qualname__}", ()


@decompose.register
def _of_property(value: property) -> tuple[str, Parts]:
    return "property", [("", value.fget), ("", value.fset), ("", value.fdel)]


@decompose.register(cached_property)
def _of_cached_property(value: Any) -> tuple[str, Parts]:
    return "cached property", [("", value.func)]


@decompose.register(staticmethod)
@decompose.register(classmethod)
def _of_decorated(value: Any) -> tuple[str, Parts]:
    return type(value).__name__, [("", value.__func__)]


@decompose.register(_lru_cache_wrapper)
def _of_cached_function(value: Any) -> tuple[str, Parts]:
    return "cached function", [("", value.__wrapped__), ("", value.cache_parameters())]


@decompose.register
def _of_cell(value: CellType) -> tuple[str, Parts]:
    try:
        return "cell", [("", value.cell_contents)]
    except ValueError:
        return "empty cell", ()


def digest(value: Any) -> str:
    """Hash of a value: equal for equal values, in every process.

    Raises
    ------
    FingerprintError
        If the value, or a part of it, has no contents to tell it by: a lock, a generator, an open
        file, a pickle with an address in it.
    """
    return _Walk().digest(value).hex()


def digest_transferable(value: Any) -> str:
    """`digest` of a value that goes to another process, and has to be the same there.

    Raises
    ------
    FingerprintError
        See `digest`; also where its copy is told apart from it.
    """
    found = digest(value)
    if not isinstance(value, (bool, int, float, str, bytes, type(None), np.ndarray)):
        try:
            copy = cloudpickle.loads(cloudpickle.dumps(value))
        except Exception as problem:  # Whatever objects do when they are pickled.
            raise FingerprintError(value) from problem
        if digest(copy) != found:
            raise FingerprintError(value)
    return found


class _Walk:
    """One way through a value and all it refers to; cycles are told by their length."""

    def __init__(self) -> None:
        self._above: dict[int, int] = {}
        # With the values, for their addresses are theirs as long as they live.
        self._known: dict[tuple[int, bool], tuple[bytes, Any]] = {}
        self._in_module = False

    def digest(self, value: Any) -> bytes:
        text = encode_scalar(value)
        if text is not None:
            return hashlib.sha256(text).digest()
        in_module = self._in_module
        key = (id(value), in_module)
        if key in self._known:
            return self._known[key][0]
        if id(value) in self._above:
            above = len(self._above) - self._above[id(value)]
            return hashlib.sha256(b"cycle %d" % above).digest()
        self._above[id(value)] = len(self._above)
        self._in_module = in_module or isinstance(value, ModuleType)
        try:
            found = self._content(value)
        except RecursionError:
            raise FingerprintError(value) from None
        finally:
            del self._above[id(value)]
            self._in_module = in_module
        self._known[key] = (found, value)
        return found

    def _content(self, value: Any) -> bytes:
        kind, parts = decompose(value)
        digests = []
        for name, part in parts:
            try:
                digests.append(hashlib.sha256(name.encode()).digest() + self.digest(part))
            except FingerprintError as problem:
                if self._in_module:
                    # Of all a module has, it is not known what is used; what is beside this counts.
                    digests.append(f"{name} {problem.kind}".encode())
                    continue
                problem.inside.append(name)
                raise
        if isinstance(value, (set, frozenset)):
            digests.sort()
        return hashlib.sha256(b"\0".join([kind.encode(), *digests])).digest()
