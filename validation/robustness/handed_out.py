"""Write into everything that objects of beamdae hand out, and list what then reads differently.

An object hands out its public attributes, the results of its methods without arguments, and the
entries of these. Tables, arrays, sparse matrices, dictionaries, lists and sets among them are
overwritten. Afterwards, all of them are read again.
"""

from __future__ import annotations

import dataclasses
import inspect
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse as sp

# Methods without required arguments that compute at length, draw or display.
_SKIPPED_METHODS = frozenset(
    {"animate", "check", "diagram", "draw", "plot", "run", "save", "snapshot", "solve", "verify"}
)
# Collections of a mechanism under construction, to which `Mechanism.add` and others add.
_OPEN_COLLECTIONS = frozenset({"events", "inactive", "observables", "parts"})
# Modules of objects that are opened: other objects are read by their repr.
_PACKAGE = "beamdae"
# Objects of these modules are internal: caches and expressions shared by models.
_CLOSED_MODULES = ("beamdae.symbolic", "beamdae.equations.structure", "beamdae.native")
_MAX_DEPTH = 8
_MAX_ENTRIES = 4  # of tuples and dictionaries, from the start


def collect_leaves(thing: Any, path: str = "") -> dict[str, Any]:
    """Return all containers of values that an object hands out, by the expression that gives it."""
    leaves: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _collect(thing, path, leaves, {}, 0)
    return leaves


def _collect(
    thing: Any, path: str, leaves: dict[str, Any], opened: dict[int, Any], depth: int
) -> None:
    if depth > _MAX_DEPTH:
        return
    is_leaf = isinstance(thing, (np.ndarray, pd.DataFrame, pd.Series, pd.Index, set))
    if is_leaf or sp.issparse(thing):
        if path.rpartition(".")[2] not in _OPEN_COLLECTIONS:
            leaves[path] = thing
    elif isinstance(thing, Mapping):
        if path.rpartition(".")[2] not in _OPEN_COLLECTIONS:
            leaves[path] = thing
        for key in list(thing)[:_MAX_ENTRIES]:
            _collect(thing[key], f"{path}[{key!r}]", leaves, opened, depth + 1)
    elif isinstance(thing, (list, tuple)) and not hasattr(thing, "_fields"):
        if isinstance(thing, list) and path.rpartition(".")[2] not in _OPEN_COLLECTIONS:
            leaves[path] = thing
        for k, entry in enumerate(thing[:_MAX_ENTRIES]):
            _collect(entry, f"{path}[{k}]", leaves, opened, depth + 1)
    elif _is_opened(thing) and id(thing) not in opened:
        opened[id(thing)] = thing  # kept, so that its id stays unique
        for name, read in _list_members(thing):
            value: Any = None
            with suppress(ValueError, NotImplementedError):  # including BeamdaeError
                value = read()
            _collect(value, f"{path}.{name}", leaves, opened, depth + 1)


def _is_opened(thing: Any) -> bool:
    module = type(thing).__module__
    return module.split(".")[0] == _PACKAGE and not module.startswith(_CLOSED_MODULES)


def _list_members(thing: Any) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield name and getter of public attributes, and name and method of argument-free methods."""
    names = {*dir(type(thing)), *getattr(thing, "__dict__", ())}
    for name in sorted(names):
        if name.startswith("_") or name in _SKIPPED_METHODS:
            continue
        declared = inspect.getattr_static(type(thing), name, None)
        if isinstance(declared, (classmethod, staticmethod)):
            continue
        if inspect.isfunction(declared):
            required = list(inspect.signature(declared).parameters.values())[1:]
            if all(
                p.default is not p.empty or p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
                for p in required
            ):
                yield f"{name}()", lambda name=name: getattr(thing, name)()
        else:
            yield name, lambda name=name: getattr(thing, name)


def describe_value(value: Any) -> Any:
    """Return a value that compares equal to that of an unchanged container."""
    if isinstance(value, (pd.DataFrame, pd.Series, pd.Index)):
        return value.to_string() if not isinstance(value, pd.Index) else str(list(value))
    if sp.issparse(value):
        # Not the dense matrix: overwritten indices would end the process.
        arrays = (getattr(value, name, np.zeros(0)) for name in ("data", "indices", "indptr"))
        return value.shape, *(repr(array.tolist()) for array in arrays)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, repr(value.tolist())
    if isinstance(value, Mapping):
        return repr([(key, _describe_entry(value[key])) for key in value])
    if isinstance(value, list):
        return repr([_describe_entry(entry) for entry in value])
    return repr(sorted(map(str, value)))


def _describe_entry(entry: Any) -> Any:
    if isinstance(entry, (np.ndarray, Mapping, list, pd.DataFrame, pd.Series)):
        return describe_value(entry)
    is_plain = isinstance(entry, (str, int, float, bool, tuple, type(None)))
    return repr(entry) if is_plain and not dataclasses.is_dataclass(entry) else type(entry).__name__


def overwrite(value: Any) -> None:
    """Try to change a container in all usual ways; refusals are ignored."""
    for write in _WRITES:
        with suppress(Exception):
            write(value)


def _write_array(value: Any) -> None:
    value[...] = value * 1000 + 1 if value.dtype.kind in "fiuc" else np.zeros_like(value)


def _write_columns(value: Any) -> None:
    for column in list(value):
        value[column] = 12345.0


def _write_entries(value: Any) -> None:
    for key in list(value):
        value[key] = "overwritten"


# Writing into the arrays behind tables comes first: the other ways replace these arrays.
_WRITES: tuple[Callable[[Any], Any], ...] = (
    _write_array,
    lambda value: _write_array(value.values),
    lambda value: _write_array(np.asarray(value)),
    lambda value: [_write_array(value[column].values) for column in value],
    lambda value: _write_array(value.data),
    lambda value: _write_array(value.indices),
    lambda value: value.mul(1000, inplace=True),
    lambda value: value.iloc.__setitem__((slice(None), 0), 777.0),
    lambda value: value.iloc.__setitem__(slice(None), 777.0),
    _write_columns,
    lambda value: value.drop(columns=list(value)[:1], inplace=True),
    _write_entries,
    lambda value: value.update({"overwritten": 1}),
    lambda value: value.pop(next(iter(value))),
    lambda value: value.clear(),
    lambda value: value.append("overwritten"),
    lambda value: value.reverse(),
    lambda value: value.add("overwritten"),
    lambda value: value.sort(),
)


def list_changes(thing: Any) -> list[str]:
    """Return the expressions whose values differ after writing into everything handed out.

    `thing` itself belongs to the caller.
    """
    before = collect_leaves(thing)
    expected = {path: describe_value(leaf) for path, leaf in before.items()}
    for leaf in before.values():
        overwrite(leaf)
    again = {path: describe_value(leaf) for path, leaf in collect_leaves(thing).items()}
    return sorted(path for path in expected if path and again.get(path) != expected[path])
