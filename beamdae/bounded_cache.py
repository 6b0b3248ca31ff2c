"""Caches of function results, bounded by the total size of the results."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, ParamSpec, TypeVar, cast

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


def bounded_cache(
    limit: float, measure_size: Callable[[Any], float]
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Return a decorator that caches the most recently used results of a function.

    A bound on the number of results, as in `functools.lru_cache`, does not bound the memory: in a
    process that runs models with many mesh sizes, results differ by orders of magnitude in size.

    Parameters
    ----------
    limit
        Largest total size of the cached results. A larger result is not cached.
    measure_size
        Function that returns the size of a result.
    """

    def decorate(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        results: OrderedDict[Hashable, tuple[Any, float]] = OrderedDict()
        total, lock = 0.0, threading.Lock()

        @wraps(function)
        def cached(*arguments: Parameters.args, **options: Parameters.kwargs) -> Result:
            nonlocal total
            key = (arguments, tuple(sorted(options.items())))
            with lock:
                if key in results:
                    results.move_to_end(key)
                    return cast("Result", results[key][0])
            result = function(*arguments, **options)
            size = measure_size(result)
            if size > limit:
                return result
            with lock:
                # Concurrent threads obtain the same object for equal arguments.
                if key in results:
                    return cast("Result", results[key][0])
                results[key] = result, size
                # A sum over all results would make each new one slower than the one before.
                total += size
                while total > limit:
                    total -= results.popitem(last=False)[1][1]
            return result

        def clear() -> None:
            nonlocal total
            with lock:
                results.clear()
                total = 0.0

        cast("Any", cached).cache_clear = clear
        return cached

    return decorate


def array_bytes(arrays: Any) -> float:
    """Return the memory [bytes] of an array or of all arrays in a tuple; 0 for other objects."""
    if isinstance(arrays, tuple):
        return float(sum(map(array_bytes, arrays)))
    return float(getattr(arrays, "nbytes", 0))
