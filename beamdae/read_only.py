"""Read-only data: arrays and dictionaries that objects hold and hand out cannot be changed.

Results, meshes and equations share their data, and several parts of a program share a result. The
decorator `read_only_data` therefore makes the fields and the cached properties of a class
read-only. Tables (DataFrames) cannot be made read-only; each access returns an independent one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cached_property, wraps
from inspect import get_annotations
from operator import is_
from typing import Any, NoReturn, TypeVar

import numpy as np

from beamdae.errors import BeamdaeError

_T = TypeVar("_T", bound=type)
# Values and their read-only counterparts, by the id of the value.
_Known = dict[int, tuple[Any, Any]]
_MAX_DEPTH = 50  # of nested containers
_IMMUTABLE = frozenset({str, int, float, bool, type(None)})
_SPARSE_ARRAYS = ("data", "indices", "indptr", "offsets", "row", "col")


class ReadOnlyDict(dict[Any, Any]):
    """A dictionary that rejects changes; `dict(...)` or `copy()` returns one that can be changed.

    In contrast to `MappingProxyType`, it can be written as JSON and pickled.
    """

    def _reject(self, *arguments: Any, **options: Any) -> NoReturn:
        raise BeamdaeError("dictionary: it is read-only; change a copy, dict(...).")

    __setitem__ = __delitem__ = __ior__ = _reject
    clear = pop = popitem = setdefault = update = _reject

    def __reduce__(self) -> Any:
        return ReadOnlyDict, (dict(self),)


def read_only(value: Any, depth: int = 0, known: _Known | None = None) -> Any:
    """Return a value whose arrays, dictionaries and lists, also nested ones, cannot be changed.

    Arrays are returned as read-only views of the same memory, sparse matrices as copies,
    dictionaries as `ReadOnlyDict` and lists as tuples. Values that are read-only already,
    containers inside more than 50 others, and all other objects are returned unchanged. `depth` is
    the number of enclosing containers. `known` contains earlier results, so that an object that
    occurs several times is converted only once.
    """
    if type(value) in _IMMUTABLE:
        return value
    known = {} if known is None else known
    if id(value) not in known:
        # The value is kept, because the id of a deleted object may be used again.
        known[id(value)] = value, _protect(value, depth, known)
    return known[id(value)][1]


def _protect(value: Any, depth: int, known: _Known) -> Any:
    if isinstance(value, np.ndarray):
        return _view(value)
    if depth > _MAX_DEPTH:
        return value
    if type(value) is dict:
        return ReadOnlyDict(
            {key: read_only(entry, depth + 1, known) for key, entry in value.items()}
        )
    if type(value) in (list, tuple) or (isinstance(value, tuple) and hasattr(value, "_fields")):
        entries = tuple([read_only(entry, depth + 1, known) for entry in value])
        if isinstance(value, tuple) and all(map(is_, entries, value)):
            return value
        return getattr(type(value), "_make", tuple)(entries)
    if hasattr(value, "nnz") and hasattr(value, "dtype"):
        return _protect_matrix(value)
    return value


def read_only_copy(values: Any) -> np.ndarray:
    """Return a read-only float copy of an array or a sequence of numbers.

    Use this for arrays that a caller passes in and may change later.
    """
    copy = np.array(values, float)
    copy.setflags(write=False)
    return copy


def copy_containers(value: Any) -> Any:
    """Return a value with copies of its arrays, lists, sets and dictionaries, also nested ones.

    Use this for values that a caller passes in and may change later. All other objects, and
    containers inside more than 50 others, are returned unchanged.
    """
    return _copy(value, {}, 0)


def _copy(value: Any, copies: dict[int, Any], depth: int) -> Any:
    kind = type(value)
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
    return value.copy() if kind in (set, np.ndarray) else value


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
    # Fields that are no arguments are caches.
    caches = {x.name for x in fields(instance) if not x.init} if is_dataclass(instance) else set()
    values = vars(instance)
    known: _Known = {}
    for name, value in values.items():
        if name not in caches:
            values[name] = read_only(value, known=known)


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


def _protect_matrix(matrix: Any) -> Any:
    arrays = {name: vars(matrix).get(name) for name in _SPARSE_ARRAYS}
    arrays = {name: x for name, x in arrays.items() if isinstance(x, np.ndarray)}
    if not any(array.flags.writeable for array in arrays.values()):
        return matrix
    # The copy has the same format, and sorted indices stay sorted.
    copy = matrix.copy()
    for name in arrays:
        setattr(copy, name, _view(getattr(copy, name)))
    return copy


def _view(array: np.ndarray) -> np.ndarray:
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view
