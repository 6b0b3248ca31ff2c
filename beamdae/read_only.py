"""Read-only data: arrays and dictionaries that objects hold and hand out cannot be changed.

Results, meshes and equations share their data, and several parts of a program share a result. The
decorator `read_only_data` therefore makes the fields and the cached properties of a class
read-only. Tables (DataFrames) cannot be made read-only; each access returns an independent one.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import fields, is_dataclass
from functools import cache, cached_property, wraps
from inspect import get_annotations
from operator import is_
from typing import Any, NoReturn, TypeVar

import numpy as np

from beamdae.errors import BeamdaeError

_T = TypeVar("_T", bound=type)
# Values and their read-only counterparts, by the id of the value.
_Known = dict[int, tuple[Any, Any]]
_MAX_DEPTH = 50  # of nested containers
_SPARSE_ARRAYS = ("data", "indices", "indptr", "offsets", "row", "col")
_COMPRESSED_FORMATS = ("csr", "csc")
_COMPRESSED_ARRAYS = _SPARSE_ARRAYS[:3]
_IMMUTABLE_TYPES = frozenset({"str", "int", "float", "bool"})


class ReadOnlyDict(dict[Any, Any]):
    """A dictionary that rejects changes; `dict(...)` or `copy()` returns a writable one.

    In contrast to `MappingProxyType`, it can be written as JSON and pickled.
    """

    def _reject(self, *arguments: Any, **options: Any) -> NoReturn:
        raise BeamdaeError("dictionary: it is read-only; change a copy, dict(...).")

    __setitem__ = __delitem__ = __ior__ = _reject
    clear = pop = popitem = setdefault = update = _reject

    def __reduce__(self) -> Any:
        return type(self), (dict(self),)


# Other values are immutable, or objects that are not copied.
_COPIED_TYPES = frozenset({list, dict, ReadOnlyDict, tuple, set, np.ndarray})


def read_only(value: Any, depth: int = 0, known: _Known | None = None) -> Any:
    """Return a value whose arrays, dictionaries and lists, also nested ones, cannot be changed.

    Arrays are returned as read-only views of the same memory, sparse matrices as copies,
    dictionaries as `ReadOnlyDict` and lists as tuples. Values that are read-only already,
    containers inside more than 50 others, and all other objects are returned unchanged. `depth` is
    the number of enclosing containers. `known` contains earlier results, so that an object that
    occurs several times is converted only once.
    """
    kind: Any = type(value)
    protect = _protection(kind)
    if protect is None:
        return value
    # Most values are read-only already.
    if protect is _protect_array and not value.flags.writeable:
        return value
    if kind is tuple and not any(map(_protection, set(map(type, value)))):
        return value
    known = {} if known is None else known
    # Called once, because audit hooks, such as the one that records file reads, slow it down.
    key = id(value)
    if key not in known:
        # The value is kept, because the id of a deleted object may be used again.
        known[key] = value, protect(value, depth, known)
    return known[key][1]


@cache
def _protection(kind: type) -> Callable[[Any, int, _Known], Any] | None:
    """Return the function that makes values of this type read-only; None if it does nothing."""
    if issubclass(kind, np.ndarray):
        return _protect_array
    if kind is dict:
        return _protect_dictionary
    if kind in (list, tuple):
        return _protect_sequence
    if issubclass(kind, tuple) and hasattr(kind, "_fields"):
        # Models have hundreds of names with units, which need no conversion.
        types = (get_annotations(kind).get(name) for name in kind._fields)
        # `NamedTuple` converts annotations that are strings to references.
        names = (getattr(x, "__forward_arg__", getattr(x, "__name__", x)) for x in types)
        is_immutable = all(name in _IMMUTABLE_TYPES for name in names)
        return None if is_immutable else _protect_sequence
    if hasattr(kind, "nnz") and hasattr(kind, "dtype"):
        return _protect_matrix
    return None


def _protect_array(value: np.ndarray, depth: int, known: _Known) -> np.ndarray:
    return _view(value)


def _protect_dictionary(value: dict[Any, Any], depth: int, known: _Known) -> Any:
    if depth > _MAX_DEPTH:
        return value
    return ReadOnlyDict({key: read_only(entry, depth + 1, known) for key, entry in value.items()})


def _protect_sequence(value: Any, depth: int, known: _Known) -> Any:
    is_tuple = isinstance(value, tuple)
    # Most long sequences contain numbers only.
    is_plain = not any(map(_protection, set(map(type, value))))
    if depth > _MAX_DEPTH or (is_tuple and is_plain):
        return value
    entries = tuple(value if is_plain else [read_only(x, depth + 1, known) for x in value])
    if is_tuple and all(map(is_, entries, value)):
        return value
    return getattr(type(value), "_make", tuple)(entries)


def read_only_copy(values: Any) -> np.ndarray:
    """Return a read-only float copy of an array or a sequence of numbers.

    Use this for arrays that a caller passes in and may change later.
    """
    array = np.array(values, float)
    array.setflags(write=False)
    return array


def copy_containers(value: Any) -> Any:
    """Return a value with copies of its arrays, lists, sets and dictionaries, also nested ones.

    Use this for values that a caller passes in and may change later. All other objects, and
    containers inside more than 50 others, are returned unchanged.
    """
    return _copy(value, {}, 0)


def _copy(value: Any, copies: dict[int, Any], depth: int) -> Any:
    kind = type(value)
    if kind not in _COPIED_TYPES:
        return value
    if id(value) in copies or depth > _MAX_DEPTH:
        # A container may contain itself.
        return copies.get(id(value), value)
    if kind is list:
        copies[id(value)] = entries = []
        entries += [_copy(entry, copies, depth + 1) for entry in value]
        return entries
    if kind in (dict, ReadOnlyDict):
        items: dict[Any, Any] = {}
        copies[id(value)] = items
        items |= {key: _copy(entry, copies, depth + 1) for key, entry in value.items()}
        return items
    if kind is tuple:
        return tuple([_copy(entry, copies, depth + 1) for entry in value])
    return value.copy()


def read_only_data(cls: _T) -> _T:
    """Make the fields and the values of cached properties of a class read-only, see `read_only`.

    Fields that contain tables return copies; dataclass fields with init=False stay writable. This
    is a decorator of classes whose instances have a `__dict__`, also of frozen dataclasses.
    Subclasses must be decorated, too.
    """
    decorated: Any = cls
    initialize: Callable[..., None] = decorated.__init__
    restore = getattr(cls, "__setstate__", None)

    @wraps(initialize)
    def initialize_and_protect(self: Any, *arguments: Any, **options: Any) -> None:
        initialize(self, *arguments, **options)
        _protect_fields(self)

    def restore_and_protect(self: Any, state: Any) -> None:
        # Arrays that were pickled or copied are writable.
        if restore is None:
            vars(self).update(state)
        else:
            restore(self, state)
        _protect_fields(self)

    decorated.__init__ = initialize_and_protect
    decorated.__setstate__ = restore_and_protect
    for name, annotation in get_annotations(cls).items():
        if "DataFrame" in str(annotation):
            setattr(cls, name, _table_property(name))
    for member in vars(cls).values():
        if isinstance(member, cached_property):
            member.func = _protect_result(member.func)
    return cls


def _protect_fields(instance: Any) -> None:
    cls: Any = type(instance)
    caches, values = _names_of_caches(cls), vars(instance)
    known: _Known = {}
    for name, value in values.items():
        kind: Any = type(value)
        if name not in caches and _protection(kind) is not None:
            values[name] = read_only(value, known=known)


@cache
def _names_of_caches(cls: type) -> frozenset[str]:
    """Return the names of the dataclass fields that are not arguments of `__init__`."""
    if not is_dataclass(cls):
        return frozenset()
    return frozenset(field.name for field in fields(cls) if not field.init)


def _table_property(name: str) -> property:
    """Return a property that stores a table and returns copies of it."""

    def read(self: Any) -> Any:
        table = vars(self)[name]
        # The table may be None, or a function that reads it.
        return table if table is None or callable(table) else table.copy()

    def write(self: Any, table: Any) -> None:
        vars(self)[name] = table

    return property(read, write)


def _protect_result(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    @wraps(function)
    def compute(self: Any) -> Any:
        return read_only(function(self))

    return compute


def _protect_matrix(matrix: Any, depth: int, known: _Known) -> Any:
    if depth > _MAX_DEPTH:
        return matrix
    attributes, is_compressed = vars(matrix), matrix.format in _COMPRESSED_FORMATS
    names = _COMPRESSED_ARRAYS if is_compressed else _SPARSE_ARRAYS
    for name in names:
        array = attributes.get(name)
        if isinstance(array, np.ndarray) and array.flags.writeable:
            break
    else:
        return matrix
    arrays = {x: attributes[x] for x in names if isinstance(attributes.get(x), np.ndarray)}
    if not is_compressed:
        copied = matrix.copy()
        arrays = {name: getattr(copied, name) for name in arrays}
    else:
        # Ten times as fast, because nothing is checked again.
        copied = copy(matrix)
        arrays = {name: array.copy() for name, array in arrays.items()}
    # The copy has the same format, and sorted indices stay sorted.
    for name, array in arrays.items():
        setattr(copied, name, _view(array))
    return copied


def _view(array: np.ndarray) -> np.ndarray:
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view
