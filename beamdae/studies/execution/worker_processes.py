"""Processes that do one packed task after the other, and whose end is the end of a task alone."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as _wait
from types import ModuleType
from typing import Any

from beamdae.studies.execution.case_run import Outcome, run_task


class WorkerError(Exception):
    """A process ended before its task; the message says how."""


class Worker:
    """One process, started when it is made, and the task it has, if any.

    Attributes
    ----------
    task
        Whatever its user says it has been given.
    deadline
        When it is to have ended [s of `time.monotonic`]; None: whenever it likes.
    """

    def __init__(self) -> None:
        context = get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), name="beamdae worker")
        with _block_interrupts(), _hide_main_module(), theirs:
            self._process.start()
        self.task: Any = None
        self.deadline: float | None = None

    def begin(self, task: Any, packed: bytes, seconds: float | None) -> None:
        """Give it a task, known as `task`, and so many seconds for it."""
        self.task = task
        self.deadline = None if seconds is None else clock.monotonic() + seconds
        # One that is dead is found so when it is asked for the outcome.
        with suppress(OSError):
            self._connection.send_bytes(packed)

    @property
    def late(self) -> bool:
        """Whether it has had its time."""
        return self.deadline is not None and clock.monotonic() > self.deadline

    def outcome(self) -> Outcome:
        """What it came to; it is free then.

        Raises
        ------
        WorkerError
            If it will not tell any more.
        """
        if not self._process.is_alive():
            # What it has started may hold the other end of the connection open.
            self._end_group()
        try:
            found = pickle.loads(self._connection.recv_bytes())
        except (EOFError, OSError):
            self._process.join(timeout=1.0)
            raise WorkerError(_describe_exit(self._process.exitcode)) from None
        self.task = self.deadline = None
        assert isinstance(found, Outcome)
        return found

    def end(self) -> None:
        """End it and all it has started, whatever it does."""
        self._end_group()
        self._process.kill()
        self._process.join()
        self._connection.close()

    def _end_group(self) -> None:
        number = self._process.pid
        if number is not None and hasattr(os, "killpg"):
            # There is none yet, if it has only just begun.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(number, signal.SIGKILL)

    @property
    def signs(self) -> list[Any]:
        """What is ready when it has an outcome, or has died."""
        return [self._connection, self._process.sentinel]


def wait_for_workers(workers: list[Worker], seconds: float) -> list[Worker]:
    """Those that have an outcome, or have died, or do so within so many seconds."""
    found = _wait([sign for worker in workers for sign in worker.signs], timeout=seconds)
    return [worker for worker in workers if any(sign in found for sign in worker.signs)]


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """What is started inside never hears of Ctrl-C, not even before its first line."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Python starts it with the first process, and then hears of Ctrl-C again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _hide_main_module() -> Iterator[None]:
    """What is started inside does not run the main program, of which tasks bring what they need."""
    own = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = own


def _describe_exit(code: int | None) -> str:
    if code is None:
        return "closed its connection"
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"


def _serve(connection: Connection) -> None:
    """Perform what comes, until nothing can come any more."""
    _isolate_process()
    own = os.getpid()
    while True:
        try:
            packed = connection.recv_bytes()
        except (EOFError, OSError):
            _exit_group()
        outcome = _run_packed_task(packed)
        if os.getpid() != own:
            # A model that forks returns twice.
            os._exit(0)
        try:
            connection.send_bytes(pickle.dumps(outcome))
        except OSError:
            _exit_group()


def _run_packed_task(packed: bytes) -> Outcome:
    try:
        return run_task(packed)
    except KeyboardInterrupt:
        # No key was pressed: the process does not hear of them.
        return Outcome.failed("the model raised KeyboardInterrupt")
    except BaseException as problem:  # Of what no task is: the process has to go on.
        return Outcome.failed(f"it cannot be performed, {type(problem).__name__}")


def _isolate_process() -> None:
    """A group of its own, deaf to Ctrl-C, with nothing to say on the screen."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setsid"):
        with suppress(OSError):
            os.setsid()
    silence = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silence, stream)
    os.close(silence)
    for text in (sys.stdout, sys.stderr):
        # Whatever cannot be written to must not end a model.
        if text is not None and hasattr(text, "reconfigure"):
            text.reconfigure(errors="backslashreplace")


def _exit_group() -> None:
    """End at once, with all that was started here."""
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(0)
