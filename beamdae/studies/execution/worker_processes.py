"""Worker processes that run one serialized task at a time; a crash ends only that task.

A worker process ends as soon as the process that started it has ended, for whatever reason.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from beamdae.errors import format_message
from beamdae.linear.blas_threads import single_threaded
from beamdae.python_processes import isolated_processes
from beamdae.studies.execution.case_run import run_task
from beamdae.studies.tasks import Outcome

# The package multiprocessing is imported inside functions, because browsers do not have it.
if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_EXIT_CODE_TIMEOUT = 1.0  # maximum time for a process to end after closing its connection [s]
# File descriptors that must be free before a process is started, in which about as many files are
# open. Starting a process takes 6, and the rest is left to imports and result files.
_FREE_DESCRIPTORS = 16
_READY = b""  # first message of a process; any other message is the reason why it cannot start

Label = TypeVar("Label")


class WorkerError(Exception):
    """Raised if a worker process ends before its task is finished.

    The message states how the process ended.
    """


class WorkerStartError(Exception):
    """Raised if a worker process cannot be started; the message gives the reason."""


class WorkerProcess(Generic[Label]):
    """Process that runs one task at a time.

    Attributes
    ----------
    current
        Label of the running task; None if the process is idle.
    deadline
        Value of `time.monotonic` [s] by which the task must end; None without a limit or a task.

    Raises
    ------
    WorkerStartError
        If the process cannot be started, for example because the system has no multiprocessing or a
        limit on processes or open files is reached.
    """

    def __init__(self) -> None:
        try:
            _require_descriptors()
            self._connection, self._process = _start_process()
        except OSError as problem:
            raise WorkerStartError(problem.strerror or format_message(problem)) from problem
        # A daemonic process must not start others.
        except (AssertionError, ImportError, RuntimeError) as problem:
            raise WorkerStartError(format_message(problem)) from problem
        self._is_ready = False
        self.current: Label | None = None
        self.deadline: float | None = None

    def start_task(self, label: Label, serialized: bytes, time_limit: float | None) -> None:
        """Start a serialized task, identified by `label`, with a time limit [s] or None."""
        self.current = label
        self.deadline = None if time_limit is None else clock.monotonic() + time_limit
        # If the process has died, `receive_outcome` raises the error.
        with suppress(OSError):
            self._connection.send_bytes(serialized)

    @property
    def is_late(self) -> bool:
        """True if the task has exceeded its deadline."""
        return self.deadline is not None and clock.monotonic() > self.deadline

    def receive_outcome(self) -> Outcome | None:
        """Return the outcome of the task, after which the process is idle.

        The first message of a process reports its start; the result is then None.

        Raises
        ------
        WorkerStartError
            If the process could not start to run tasks.
        WorkerError
            If the process ended without an outcome.
        """
        if not self._process.is_alive():
            # Child processes may keep the other end of the connection open.
            self._kill_group()
        try:
            message = self._connection.recv_bytes()
        except (EOFError, OSError):
            self._process.join(timeout=_EXIT_CODE_TIMEOUT)
            error = WorkerError if self._is_ready else WorkerStartError
            raise error(_describe_exit(self._process.exitcode)) from None
        if not self._is_ready:
            if message != _READY:
                raise WorkerStartError(message.decode())
            self._is_ready = True
            return None
        outcome = pickle.loads(message)
        self.current = self.deadline = None
        assert isinstance(outcome, Outcome)
        return outcome

    def kill(self) -> None:
        """Kill the process and its process group, which contains its child processes."""
        self._kill_group()
        self._process.kill()
        self._process.join()
        self._connection.close()

    def _kill_group(self) -> None:
        pid = self._process.pid
        if pid is not None and hasattr(os, "killpg"):
            # A process that has just started has no group yet.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(pid, signal.SIGKILL)

    @property
    def handles(self) -> list[Any]:
        """Handles that become ready when the process has sent a message or has died."""
        return [self._connection, self._process.sentinel]


def wait_for_workers(
    workers: list[WorkerProcess[Label]], timeout: float
) -> list[WorkerProcess[Label]]:
    """Return the workers that send a message or die within `timeout` [s]."""
    if not workers:
        return []
    from multiprocessing import connection as connections

    handles = [handle for worker in workers for handle in worker.handles]
    ready = connections.wait(handles, timeout=timeout)
    return [worker for worker in workers if any(handle in ready for handle in worker.handles)]


def _start_process() -> tuple[Connection, Any]:
    """Start a process that serves tasks; return the connection to it and the process."""
    from multiprocessing import get_context

    context = get_context("spawn")
    connection, worker_connection = context.Pipe()
    process = context.Process(target=_serve_tasks, args=(worker_connection,), name="beamdae worker")
    try:
        with (
            isolated_processes(),
            _block_interrupts(),
            _inherit_working_folder(),
            _one_blas_thread(),
            worker_connection,
        ):
            process.start()
    except BaseException:
        connection.close()
        raise
    return connection, process


def _require_descriptors() -> None:
    """Raise OSError unless enough file descriptors are free to start and use a process."""
    descriptors: list[int] = []
    try:
        while len(descriptors) < _FREE_DESCRIPTORS:
            descriptors.append(os.open(os.devnull, os.O_RDONLY))
    finally:
        for descriptor in descriptors:
            os.close(descriptor)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Give processes started in this block one BLAS thread, because runs use no more.

    OPENBLAS_NUM_THREADS is not changed if it is set.
    """
    is_set = "OPENBLAS_NUM_THREADS" in os.environ
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        yield
    finally:
        if not is_set:
            del os.environ["OPENBLAS_NUM_THREADS"]


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block Ctrl-C in processes started in this block, even before they run their first line."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # Otherwise, Python starts the tracker with the first process and unblocks the signal.
    resource_tracker.ensure_running()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@contextmanager
def _inherit_working_folder() -> Iterator[None]:
    """Prevent processes started in this block from changing to the folder that they inherit.

    If the folder is deleted while a process starts, the process would print a traceback.
    """
    from multiprocessing import spawn

    prepare = spawn.get_preparation_data
    spawn.get_preparation_data = lambda name: {k: x for k, x in prepare(name).items() if k != "dir"}
    try:
        yield
    finally:
        spawn.get_preparation_data = prepare


def _describe_exit(code: int | None) -> str:
    if code is None:
        return "closed the connection"
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"was killed by signal {-code}"


def _serve_tasks(connection: Connection) -> None:
    """Main function of a worker process: run tasks from the connection until it is closed."""
    _isolate_process()
    pid = os.getpid()
    try:
        threading.Thread(target=_exit_with_parent, daemon=True).start()
        connection.send_bytes(_READY)
    except RuntimeError as problem:
        # No task may run without the thread: it could outlive its study by hours.
        connection.send_bytes(format_message(problem).encode())
        _exit_group()
    except OSError:
        _exit_group()
    # Entered once: entering and leaving this context for each run takes 0.5 ms.
    with single_threaded:
        _run_tasks(connection, pid)


def _run_tasks(connection: Connection, pid: int) -> None:
    while True:
        try:
            serialized = connection.recv_bytes()
        except (EOFError, OSError):
            _exit_group()
        try:
            outcome = run_task(serialized)
        except KeyboardInterrupt:
            # Raised by the model: the process ignores Ctrl-C.
            outcome = Outcome.failed("the model raised KeyboardInterrupt")
        except BaseException as problem:  # No exception may end the process.
            outcome = Outcome.failed(f"the task cannot be run: {type(problem).__name__}")
        if os.getpid() != pid:
            # The model has forked, and this is the child.
            os._exit(0)
        try:
            connection.send_bytes(pickle.dumps(outcome))
        except OSError:
            _exit_group()


def _isolate_process() -> None:
    """Make this process a group leader without Ctrl-C, and silence its streams.

    Standard input is empty, and output is discarded.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setsid"):
        with suppress(OSError):
            os.setsid()
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(null, descriptor)
    os.close(null)
    for stream in (sys.stdout, sys.stderr):
        # A character that cannot be encoded must not end a run.
        if stream is not None and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _exit_with_parent() -> None:
    """Wait for the end of the process that started this one, then end this process group.

    The parent process holds a pipe open until it ends; the system closes the pipe even if the
    parent is killed.
    """
    from multiprocessing import parent_process

    parent = parent_process()
    assert parent is not None
    parent.join()
    _exit_group()


def _exit_group() -> None:
    """End this process immediately, together with its process group if it is the leader."""
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(0)
