"""Pickler of functions that cannot be imported, such as models, laws and outputs of users."""

from __future__ import annotations

import io
import sys
from collections import ChainMap
from collections.abc import Callable
from functools import _lru_cache_wrapper, cached_property, lru_cache
from types import CodeType
from typing import Any, ClassVar

import cloudpickle


def _reduce_code(code: CodeType) -> tuple[Callable[..., CodeType], tuple[Any, ...]]:
    return _restore_code, (code.co_filename, *cloudpickle.Pickler.dispatch_table[CodeType](code))


def _restore_code(file: str, create: Callable[..., CodeType], values: tuple[Any, ...]) -> CodeType:
    return create(*values).replace(co_filename=file)


def _reduce_cached_property(value: cached_property[Any]) -> Any:
    return _create_cached_property, (value.func, value.attrname)


def _create_cached_property(
    function: Callable[[Any], Any], name: str | None
) -> cached_property[Any]:
    rebuilt = cached_property(function)
    if name is not None:
        rebuilt.__set_name__(object, name)
    return rebuilt


def _reduce_cached_function(function: _lru_cache_wrapper[Any]) -> Any:
    """Reduce an importable function to its name, and other functions to their definition."""
    module = sys.modules.get(function.__module__)
    if getattr(module, function.__qualname__, None) is function:
        return function.__qualname__
    return _create_cached_function, (function.__wrapped__, function.cache_parameters())


def _create_cached_function(
    function: Callable[..., Any], parameters: dict[str, Any]
) -> _lru_cache_wrapper[Any]:
    return lru_cache(**parameters)(function)


class FunctionPickler(cloudpickle.Pickler):
    """Pickler of cloudpickle that keeps the file names of functions, as cloudpickle < 3.1.3 did.

    The files of a model are sought in the folder of its function, and messages state its lines.
    """

    dispatch_table: ClassVar = ChainMap(
        {
            CodeType: _reduce_code,
            # In CPython 3.11, a cached property contains a lock, and a cached function its cache.
            cached_property: _reduce_cached_property,
            _lru_cache_wrapper: _reduce_cached_function,
        },
        cloudpickle.Pickler.dispatch_table,
    )


def pickle_with_functions(value: Any) -> bytes:
    """Pickle a value, including code that cannot be imported; `pickle.loads` restores it."""
    stream = io.BytesIO()
    FunctionPickler(stream).dump(value)
    return stream.getvalue()
