"""Packing for another process: whatever a model file defines goes along."""

from __future__ import annotations

import copyreg
import sys
from collections.abc import Callable
from functools import _lru_cache_wrapper, cached_property, lru_cache
from typing import Any

import cloudpickle


def packed(value: Any) -> bytes:
    """A value, with all that is not defined in installed modules, as bytes."""
    return cloudpickle.dumps(value)


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
