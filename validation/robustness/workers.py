"""Inputs tried in processes of their own: what ends or stops one takes nothing else with it."""

from __future__ import annotations

import os
import resource
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import TimeoutError
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from pebble import ProcessExpired, ProcessPool

# A process may take so much memory [bytes].
MEMORY = 6_000_000_000


def cores() -> int:
    """How many processes this machine runs at once."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pool(workers: int) -> ProcessPool:
    """Processes that share nothing with this one."""
    # Several threads of a BLAS in each process would wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return ProcessPool(workers, context=get_context("spawn"), initializer=_limit)


def tried(
    processes: ProcessPool,
    function: Callable[[str], Any],
    names: Iterable[str],
    limit: float,
) -> Iterator[tuple[str, Any]]:
    """(name, what `function` makes of it), in order; None: its process died, ...: it did not end.

    A process that leaves as if all were well, with exit code 0, is waited for until the limit.
    """
    futures = [(name, processes.schedule(function, (name,), timeout=limit)) for name in names]
    for name, future in futures:
        try:
            yield name, future.result()
        except ProcessExpired:
            yield name, None
        except TimeoutError:
            yield name, ...


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    threading.Thread(target=_leave_with, args=(os.getppid(),), daemon=True).start()


def _leave_with(parent: int) -> None:
    """No worker goes on without the process that started it, however that ended."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


class Silence:
    """What is said on standard output and standard error, by whatever language, is caught.

    `said` has it afterwards.
    """

    def __enter__(self) -> Silence:
        self._streams = sys.stdout, sys.stderr
        for stream in self._streams:
            stream.flush()
        self._kept = [os.dup(1), os.dup(2)]
        self._file = tempfile.TemporaryFile()
        for number in (1, 2):
            os.dup2(self._file.fileno(), number)
        sys.stdout = sys.stderr = open(1, "w", errors="replace", closefd=False, buffering=1)
        return self

    def __exit__(self, *problem: object) -> None:
        sys.stdout, sys.stderr = self._streams
        for number, kept in zip((1, 2), self._kept, strict=True):
            os.dup2(kept, number)
            os.close(kept)
        self._file.seek(0)
        self.said = self._file.read(20_000).decode(errors="replace")
        self._file.close()


class Scratch:
    """An empty folder to work in, for a while; `left` is what was found in it at the end."""

    def __init__(self, *allowed: str) -> None:
        self._allowed = set(allowed)

    def __enter__(self) -> Scratch:
        self._before = Path.cwd()
        self.folder = Path(tempfile.mkdtemp(prefix="robustness-"))
        os.chdir(self.folder)
        return self

    def __exit__(self, *problem: object) -> None:
        os.chdir(self._before)
        self.left = tuple(
            sorted(f.name for f in self.folder.iterdir() if f.name not in self._allowed)
        )
        shutil.rmtree(self.folder, ignore_errors=True)
