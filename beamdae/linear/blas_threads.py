"""Restriction of BLAS to one thread during runs."""

from __future__ import annotations

import contextlib
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
        with self._lock:
            if self._limits is None:
                _call_in_thread(self._limit)
            self._n_active += 1

    def __exit__(self, *problem: object) -> None:
        with self._lock:
            self._n_active -= 1
            if self._n_active == 0:
                _call_in_thread(self._restore)

    def _limit(self) -> None:
        self._limits = ThreadpoolController().limit(limits=1, user_api="blas")

    def _restore(self) -> None:
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
            future = threads.submit(function)
        except RuntimeError:
            function()
        else:
            future.result()


single_threaded = _SingleThreadedBlas()
