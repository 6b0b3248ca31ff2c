"""Inputs tried in processes of their own: what ends or stops one takes nothing else with it."""

from __future__ import annotations

import os
import resource
import shutil
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

# A process may take so much memory [bytes].
MEMORY = 6_000_000_000


def cores() -> int:
    """How many processes this machine runs at once."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Processes:
    """So many processes apart from this one; one that dies or is killed is replaced."""

    def __init__(self, count: int) -> None:
        # Several threads of a BLAS in each process would wait for each other.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        self._workers = [_Worker() for _ in range(count)]

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *problem: object) -> None:
        for worker in self._workers:
            worker.kill()

    def tried(
        self, function: Callable[[str], Any], names: Iterable[str], limit: float
    ) -> Iterator[tuple[str, Any]]:
        """(name, what `function` makes of it) as they end.

        None: its process died; ...: it did not end within `limit` [s].
        """
        waiting = deque(names)
        while waiting or any(worker.name for worker in self._workers):
            for worker in self._workers:
                if waiting and not worker.name:
                    worker.begin(function, waiting.popleft())
            busy = [worker for worker in self._workers if worker.name]
            ready = wait([worker.connection for worker in busy], timeout=0.1)
            for worker in busy:
                if worker.connection in ready or worker.lasts > limit:
                    yield worker.end(worker.connection in ready)


class _Worker:
    """One process, what it is at, and since when."""

    def __init__(self) -> None:
        self.name = ""
        self._start()

    def _start(self) -> None:
        context = get_context("spawn")
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,))
        self._process.start()
        # The other end is the process's alone: its death is the end of what can be received.
        other.close()
        self.connection.recv()

    @property
    def lasts(self) -> float:
        """For how long it has been at that [s]."""
        return time.monotonic() - self._since

    def begin(self, function: Callable[[str], Any], name: str) -> None:
        """Give it something to do."""
        self.name, self._since = name, time.monotonic()
        self.connection.send((function, name))

    def end(self, answered: bool) -> tuple[str, Any]:
        """The name and the answer; without one the process is replaced."""
        name, self.name, found = self.name, "", ...
        try:
            if answered:
                return name, self.connection.recv()
        except EOFError:
            found = None
        self.kill()
        self._start()
        return name, found

    def kill(self) -> None:
        """End it, whatever it is at."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Connection) -> None:
    _limit()
    connection.send("ready")
    while True:
        function, name = connection.recv()
        connection.send(function(name))


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
