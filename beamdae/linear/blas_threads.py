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
    may overlap: the last context to end restores the limits that the first context replaced.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_active = 0
        self._limits: Any = None

    def __enter__(self) -> None:
        try:
            self._count(1)
        except BaseException:
            self._count(-1)
            raise

    def __exit__(self, *problem: object) -> None:
        self._count(-1)

    def _count(self, change: int) -> None:
        with self._lock:
            self._n_active += change
            is_limited = self._limits is not None
            if is_limited == (self._n_active > 0):
                return
        # A thread takes 0.1 ms, on busy machines up to 8 ms.
        if is_limited or _may_have_threads():
            _call_in_thread(self._follow_count)

    def _follow_count(self) -> None:
        """Limit or restore as the number of contexts requires now.

        An interrupted caller does not wait for the thread of this call, so that the number may have
        changed when the call begins.
        """
        with self._lock:
            if self._n_active > 0 and self._limits is None:
                self._limits = _find_libraries().limit(limits=1, user_api="blas")
            elif self._n_active == 0 and self._limits is not None:
                self._limits.restore_original_limits()
                self._limits = None


def _call_in_thread(function: Callable[[], None]) -> None:
    """Call a function that changes BLAS limits, in a new thread that ends afterwards.

    Threadpoolctl accepts changes only from the thread that made the first change, until that thread
    ends. In addition, no interrupt reaches the new thread. If no thread can be started, as in a
    browser or at the process limit of the user, the function is called in the calling thread.
    """
    with ThreadPoolExecutor(1) as threads:
        try:
            future = threads.submit(_call_after_last_thread, function)
        except RuntimeError:
            function()
        else:
            future.result()


_order_of_threads = threading.Lock()
_last_thread: threading.Thread | None = None


def _call_after_last_thread(function: Callable[[], None]) -> None:
    """Call a function as soon as the thread of the last call has ended.

    An interrupted caller does not wait for its thread.
    """
    global _last_thread
    with _order_of_threads:
        last, _last_thread = _last_thread, threading.current_thread()
    if last is not None:
        last.join()
    function()


# Libraries in memory, by the number of imported modules when they were searched for.
_libraries: dict[int, ThreadpoolController] = {}


def _find_libraries() -> ThreadpoolController:
    """Return the BLAS libraries in memory.

    A search takes half a millisecond; libraries are loaded by imports of modules, or else
    `find_new_libraries` is called.
    """
    n_modules = len(sys.modules)
    libraries = _libraries.get(n_modules)
    if libraries is None:
        libraries = ThreadpoolController()
        _libraries.clear()
        _libraries[n_modules] = libraries
    return libraries


def _may_have_threads() -> bool:
    """Return True if BLAS has several threads, or has not been searched for."""
    known = _libraries.get(len(sys.modules))
    return known is None or any(
        x.num_threads > 1 for x in known.select(user_api="blas").lib_controllers
    )


def find_new_libraries() -> None:
    """Include a library that was opened without an import, from the next context on."""
    _libraries.clear()


single_threaded = _SingleThreadedBlas()
