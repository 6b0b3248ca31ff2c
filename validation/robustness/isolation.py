"""Isolated trials: samples, worker processes, scratch folders and captured output."""

from __future__ import annotations

import os
import random
import resource
import shutil
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

_MEMORY_LIMIT = 12_000_000_000  # bytes of address space of a worker process
_POLL_INTERVAL = 0.1  # s between checks of the time limit
_PARENT_CHECK_INTERVAL = 1.0  # s
# A trial exceeds its time limit by its processor time, or by this multiple of it in wall time: on a
# loaded machine, processes get a small part of the time.
_MAX_WALL_RATIO = 10.0
_CPU_FIELDS = slice(11, 13)  # utime and stime after the name in /proc/PID/stat
_MAX_CAPTURED_OUTPUT = 20_000  # bytes


def draw_sample(names: Sequence[str], size: int, seed: int) -> list[str]:
    """Return a random sample in the order of `names`; all of them if there are fewer."""
    chosen = set(random.Random(seed).sample(range(len(names)), min(size, len(names))))
    return [name for k, name in enumerate(names) if k in chosen]


class ProcessPool:
    """Worker processes in which trials run; one that dies or exceeds its time is replaced."""

    def __init__(self, count: int) -> None:
        # With several BLAS threads in each process, the threads would wait for each other.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        self._workers = [_Worker() for _ in range(count)]

    def __enter__(self) -> ProcessPool:
        return self

    def __exit__(self, *problem: object) -> None:
        for worker in self._workers:
            worker.kill()

    def run_trials(
        self, function: Callable[[str], Any], names: Iterable[str], time_limit: float
    ) -> Iterator[tuple[str, Any]]:
        """Yield (name, function(name)) in order of completion.

        The result is None if the process died, and ... if it exceeded `time_limit` [s] of processor
        time, or ten times as much wall time.
        """
        waiting = deque(names)
        while waiting or any(worker.name for worker in self._workers):
            for worker in self._workers:
                if waiting and not worker.name:
                    worker.start_trial(function, waiting.popleft())
            busy = [worker for worker in self._workers if worker.name]
            ready = wait([worker.connection for worker in busy], timeout=_POLL_INTERVAL)
            for worker in busy:
                if worker.connection in ready or worker.exceeds(time_limit):
                    yield worker.finish_trial(worker.connection in ready)


class _Worker:
    """Worker process, the name of its trial and the start time of that trial."""

    def __init__(self) -> None:
        self.name = ""
        self._start_process()

    def _start_process(self) -> None:
        context = get_context("spawn")
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_serve_trials, args=(other,))
        self._process.start()
        # Only the worker keeps the other end open, so that the death of the worker raises EOFError.
        other.close()
        self.connection.recv()

    def exceeds(self, time_limit: float) -> bool:
        """Return True if the trial exceeds a limit of its processor time [s]."""
        elapsed = time.monotonic() - self._start
        if elapsed <= time_limit:
            return False
        processor_time = self._read_processor_time()
        used = elapsed if processor_time is None else processor_time - self._start_processor_time
        return used > time_limit or elapsed > _MAX_WALL_RATIO * time_limit

    def _read_processor_time(self) -> float | None:
        """Return the processor time of the process so far [s]; None if it is not available."""
        try:
            text = Path(f"/proc/{self._process.pid}/stat").read_text()
        except OSError:
            return None
        # The name of the program, in parentheses, may contain spaces.
        user, system = text.rpartition(")")[2].split()[_CPU_FIELDS]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def start_trial(self, function: Callable[[str], Any], name: str) -> None:
        self.name, self._start = name, time.monotonic()
        self._start_processor_time = self._read_processor_time() or 0.0
        self.connection.send((function, name))

    def finish_trial(self, has_answer: bool) -> tuple[str, Any]:
        """Return name and result; without an answer the process is replaced."""
        name, self.name, result = self.name, "", ...
        try:
            if has_answer:
                return name, self.connection.recv()
        except EOFError:
            result = None
        self.kill()
        self._start_process()
        return name, result

    def kill(self) -> None:
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve_trials(connection: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_LIMIT, _MEMORY_LIMIT))
    threading.Thread(target=_exit_with_parent, args=(os.getppid(),), daemon=True).start()
    connection.send("ready")
    while True:
        function, name = connection.recv()
        connection.send(function(name))


def _exit_with_parent(parent: int) -> None:
    """Exit this process once the process that started it has ended, in whatever way."""
    while os.getppid() == parent:
        time.sleep(_PARENT_CHECK_INTERVAL)
    os._exit(1)


class OutputCapture:
    """Context that captures standard output and standard error, including those of C libraries.

    `text` holds the first 20 kB of them afterwards.
    """

    def __enter__(self) -> OutputCapture:
        self._streams = sys.stdout, sys.stderr
        for stream in self._streams:
            stream.flush()
        self._copies = [os.dup(1), os.dup(2)]
        self._file = tempfile.TemporaryFile()
        for descriptor in (1, 2):
            os.dup2(self._file.fileno(), descriptor)
        sys.stdout = sys.stderr = open(1, "w", errors="replace", closefd=False, buffering=1)
        return self

    def __exit__(self, *problem: object) -> None:
        sys.stdout, sys.stderr = self._streams
        for descriptor, copy in zip((1, 2), self._copies, strict=True):
            os.dup2(copy, descriptor)
            os.close(copy)
        self._file.seek(0)
        self.text = self._file.read(_MAX_CAPTURED_OUTPUT).decode(errors="replace")
        self._file.close()


class ScratchFolder:
    """Context with an empty working folder, deleted afterwards.

    `remaining` holds the names of entries other than `allowed` that a trial left in it.
    """

    def __init__(self, *allowed: str) -> None:
        self._allowed = set(allowed)

    def __enter__(self) -> ScratchFolder:
        self._previous_folder = Path.cwd()
        self.folder = Path(tempfile.mkdtemp(prefix="robustness-"))
        os.chdir(self.folder)
        return self

    def __exit__(self, *problem: object) -> None:
        os.chdir(self._previous_folder)
        names = {path.name for path in self.folder.iterdir()}
        self.remaining = tuple(sorted(names - self._allowed))
        shutil.rmtree(self.folder, ignore_errors=True)
