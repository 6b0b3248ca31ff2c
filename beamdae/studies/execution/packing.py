"""Packing for another process: whatever a model file defines goes along."""

from __future__ import annotations

import copyreg
import io
import pickle
import sys
from collections.abc import Callable
from functools import _lru_cache_wrapper, cached_property, lru_cache
from typing import Any

import cloudpickle
import numpy as np

_PLAIN = (bool, int, float, str, type(None))


def pack(value: Any) -> bytes:
    """A value, with all that is not defined in installed modules, as bytes."""
    return cloudpickle.dumps(value)


def is_plain(value: Any) -> bool:
    """Whether a value is a number or a text, and refers to nothing."""
    return type(value) in _PLAIN or isinstance(value, np.generic)


# Parts of values by their identity, which lasts as long as they do, and packed.
PackedParts = dict[int, tuple[Any, bytes]]


def pack_task_around(value: Any, part: Any, known: PackedParts) -> bytes:
    """A value that has no functions but those of `part`, which is packed once.

    The part is a copy of its own wherever the value is unpacked.
    """
    if id(part) not in known:
        known[id(part)] = part, pack(part)
    stream = io.BytesIO()
    pickler = pickle.Pickler(stream)
    table: dict[type, Callable[[Any], Any]] = {**copyreg.dispatch_table}
    table[type(part)] = lambda x: (cloudpickle.loads, (known[id(x)][1],))
    pickler.dispatch_table = table
    pickler.dump(value)
    return stream.getvalue()


def _cached_property(function: Callable[[Any], Any], name: str | None) -> cached_property[Any]:
    rebuilt = cached_property(function)
    if name is not None:
        rebuilt.__set_name__(object, name)
    return rebuilt


def _cached_function(
    function: Callable[..., Any], parameters: dict[str, Any]
) -> _lru_cache_wrapper[Any]:
    return lru_cache(**parameters)(function)


def _reduced_function(function: _lru_cache_wrapper[Any]) -> Any:
    """By name where it can be imported, and else what it caches."""
    module = sys.modules.get(function.__module__)
    if getattr(module, function.__qualname__, None) is function:
        return function.__qualname__
    return _cached_function, (function.__wrapped__, function.cache_parameters())


# Neither can be packed by itself: a property holds a lock in CPython 3.11, a function its cache.
copyreg.pickle(cached_property, lambda x: (_cached_property, (x.func, x.attrname)))
copyreg.pickle(_lru_cache_wrapper, _reduced_function)
