"""Read-only data: arrays and dictionaries that objects hold and hand out cannot be changed.

Results, meshes and equations share their data, and several parts of a program share a result. The
decorator `read_only_data` therefore makes the fields and the cached properties of a class
read-only. Tables (DataFrames) cannot be made read-only; each access returns an independent one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache, cached_property, wraps
from inspect import get_annotations
from operator import is_
from typing import Any, NoReturn, TypeVar

import numpy as np

from beamdae.errors import BeamdaeError

_T = TypeVar("_T", bound=type)
_MAX_DEPTH = 50  # of nested containers
_CONSTANTS = {"str", "float", "int", "bool"}  # annotations of entries that cannot change


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


def read_only(value: Any, depth: int = 0, known: dict[int, tuple[Any, Any]] | None = None) -> Any:
    """Return a value whose arrays, dictionaries and lists, also nested ones, cannot be changed.

    Arrays are returned as read-only views of the same memory, sparse matrices as copies,
    dictionaries as `ReadOnlyDict` and lists as tuples. Values that are read-only already,
    containers inside more than 50 others, and all other objects are returned unchanged. `depth` is
    the number of enclosing containers. `known` contains earlier values and results by the id of the
    value, so that an object that occurs several times remains one object.
    """
    kind: Any = type(value)
    if not _may_change(kind) or depth > _MAX_DEPTH:
        return value
    known = {} if known is None else known
    if id(value) not in known:
        known[id(value)] = value, _protect(value, depth, known)
    return known[id(value)][1]


def _protect(value: Any, depth: int, known: dict[int, tuple[Any, Any]]) -> Any:
    kind: Any = type(value)
    if isinstance(value, np.ndarray):
        view = value.view() if value.flags.writeable else value
        view.setflags(write=False)
        return view
    if kind is dict:
        return ReadOnlyDict(
            {key: read_only(entry, depth + 1, known) for key, entry in value.items()}
        )
    if not isinstance(value, (list, tuple)):
        if not any(read_only(x) is not x for x in vars(value).values()):
            return value
        matrix = value.copy()
        vars(matrix).update({name: read_only(x) for name, x in vars(matrix).items()})
        return matrix
    # Most long sequences contain numbers only.
    is_plain = not any(map(_may_change, set(map(type, value))))
    entries = tuple(value if is_plain else [read_only(x, depth + 1, known) for x in value])
    if isinstance(value, tuple) and all(map(is_, entries, value)):
        return value
    return getattr(kind, "_make", tuple)(entries)


@cache
def _may_change(kind: type) -> bool:
    """Return True for arrays, sparse matrices, and the containers that may contain them."""
    is_matrix = hasattr(kind, "nnz") and hasattr(kind, "dtype")
    entries = [getattr(x, "__forward_arg__", x) for x in get_annotations(kind).values()]
    if hasattr(kind, "_fields") and entries and _CONSTANTS.issuperset(entries):
        return False
    return is_matrix or kind in (dict, list) or issubclass(kind, (np.ndarray, tuple))


def read_only_copy(values: Any) -> np.ndarray:
    """Return a read-only float copy of an array or a sequence of numbers.

    Use this for arrays that a caller passes in and may change later.
    """
    array = np.array(values, float)
    array.setflags(write=False)
    return array


def copy_containers(value: Any, depth: int = 0) -> Any:
    """Return a value with copies of its arrays, lists, sets and dictionaries, also nested ones.

    Use this for values that a caller passes in and may change later. All other objects, and
    containers inside more than 50 others, are returned unchanged. `depth` is the number of
    enclosing containers.
    """
    kind = type(value)
    if depth > _MAX_DEPTH:
        return value
    if kind in (list, tuple):
        return kind([copy_containers(entry, depth + 1) for entry in value])
    if kind in (dict, ReadOnlyDict):
        return {key: copy_containers(entry, depth + 1) for key, entry in value.items()}
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
    cls: Any = type(instance)
    caches, values, known = _names_of_caches(cls), vars(instance), dict[int, tuple[Any, Any]]()
    for name, value in values.items():
        if name not in caches:
            values[name] = read_only(value, 0, known)


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
