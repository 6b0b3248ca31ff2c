"""Restriction of BLAS to one thread during runs."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from threadpoolctl import ThreadpoolController


class _SingleThreadedBlas(contextlib.ContextDecorator):
    """Context in which BLAS uses one thread.

    Threads do not speed up operations on matrices as small as those of mechanisms. If cores are
    busy, threads slow these operations down by a factor of ten. Contexts of several Python threads
    may overlap: the last context to end restores the limits that the first context replaced. (MKL
    and OpenMP limit each thread on its own: for them, only the thread of the first context.)
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_active = 0
        # Libraries that are limited, with their previous numbers of threads; None if none is.
        self._limited: list[tuple[Any, int]] | None = None

    def __enter__(self) -> None:
        with self._lock:
            self._n_active += 1
            try:
                self._follow_count()
            except BaseException:
                self._n_active -= 1
                self._follow_count()
                raise

    def __exit__(self, *problem: object) -> None:
        with self._lock:
            self._n_active -= 1
            try:
                self._follow_count()
            except BaseException:
                # An interrupt, which does not arrive twice in this short time.
                self._follow_count()
                raise

    def _follow_count(self) -> None:
        """Limit or restore as the number of contexts requires.

        After an interrupt at any place, another call completes or reverts the changes.
        """
        if self._n_active > 0 and self._limited is None:
            limited = [(x, x.num_threads) for x in _find_libraries()]
            self._limited = [(x, number) for x, number in limited if number > 1]
            for library, _ in self._limited:
                _set_threads(library, 1)
        elif self._n_active == 0 and self._limited is not None:
            for library, number in self._limited:
                _set_threads(library, number)
            self._limited = None


def _set_threads(library: Any, number: int) -> None:
    """Set the number of threads of a library, which any thread may change next.

    Threadpoolctl from 3.8 on accepts changes of OpenBLAS only from the thread that made the first
    change, until this thread ends or releases the library.
    """
    library.set_num_threads(number)
    if hasattr(library, "clear_controlling_thread"):
        library.clear_controlling_thread()


# Libraries in memory, by the number of imported modules when they were searched for.
_libraries: dict[int, list[Any]] = {}


def _find_libraries() -> list[Any]:
    """Return the BLAS libraries in memory.

    A search takes half a millisecond; libraries are loaded by imports of modules, or else
    `find_new_libraries` is called.
    """
    libraries = _libraries.get(len(sys.modules))
    return _call_in_thread(_search_libraries) if libraries is None else libraries


def _search_libraries() -> list[Any]:
    n_modules = len(sys.modules)
    libraries: list[Any] = ThreadpoolController().select(user_api="blas").lib_controllers
    _libraries.clear()
    _libraries[n_modules] = libraries
    return libraries


def _call_in_thread(function: Callable[[], list[Any]]) -> list[Any]:
    """Call a function in a new thread, which no interrupt reaches.

    If no thread can be started, as in a browser or at the process limit of the user, the function
    is called in the calling thread.
    """
    with ThreadPoolExecutor(1) as threads:
        try:
            future = threads.submit(function)
        except RuntimeError:
            return function()
        return future.result()


def find_new_libraries() -> None:
    """Include a library that was opened without an import, from the next context on."""
    _libraries.clear()


single_threaded = _SingleThreadedBlas()
