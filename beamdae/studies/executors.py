"""Executors that run tasks in this process, in local processes or on any other executor."""

from __future__ import annotations

import logging
import math
import os
import signal
import sys
import threading
import time as clock
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, as_completed
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from beamdae.errors import (
    BeamdaeError,
    KernelWarning,
    format_exception,
    format_message,
    require_count,
    short_repr,
)
from beamdae.interrupts import DeferredInterrupts
from beamdae.linear.blas_threads import single_threaded
from beamdae.report.text import shorten_text
from beamdae.results.outcome import Status
from beamdae.studies.case_run import run_task
from beamdae.studies.file_reads import clear_module_reads
from beamdae.studies.tasks import Outcome, Task, describe_exception

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


_KILL_DELAY = 60.0  # time after the time limit of a task until its process is killed [s]
_MAX_ATTEMPTS = 2  # per task, if its process dies
_MAX_WORKERS_PER_CORE = 16  # more bring no benefit, even if some processes wait
_POLL_INTERVAL = 0.1  # time between checks of interrupts and deadlines [s]
_CONNECT_TIMEOUT = 10.0  # maximum time for a Dask scheduler to answer [s]
_MAX_ADDRESS_LETTERS = 80

# Tasks and outcomes in the order of completion.
# Callers that do not exhaust the generator must close it, which ends the processes.
TaskResults = Generator[tuple[Task, Outcome], None, None]


class SerialPool:
    """Runs tasks sequentially in this process, for debugging and small studies.

    A case that crashes the process ends the study, and a case that ignores its time limit blocks
    the study.
    """

    workers = 1

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task in the order of `tasks`.

        After the result of an interrupted task, KeyboardInterrupt is raised.
        """
        for task in tasks:
            clear_module_reads()
            outcome = run_task(task.serialize())
            yield task, outcome
            # After an interrupt, the integrator only ends its run, but the whole study must end.
            if outcome.status.kind == "interrupted":
                raise KeyboardInterrupt


class LocalPool:
    """Runs tasks in local processes, by default one per available core.

    A crash of a process ends one task only, which is run once more in another process. Interrupts
    are raised between results, after all processes have been killed. If the system cannot start all
    processes, fewer are used; if it can start none, the tasks run in this process, which starts no
    threads for the others: systems limit these, too.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or _count_cores()

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task in the order of completion."""
        waiting = deque((task, 1) for task in tasks)
        idle: list[_Process] = []
        running: dict[_Process, tuple[Task, int, float]] = {}
        results: list[tuple[Task, Outcome]] = []
        capacity = self.workers

        def reduce_capacity(problem: BaseException) -> int:
            if capacity == self.workers:
                _warn_of_missing_processes(self.workers, problem)
            return len(running) + len(idle)

        with DeferredInterrupts() as interrupts:
            try:
                while running or (waiting and capacity) or results:
                    # Start the next tasks first, so that they run while the caller handles results.
                    while waiting and len(running) < capacity:
                        task, attempt = waiting.popleft()
                        serialized = _serialize_task(task)
                        if isinstance(serialized, Outcome):
                            results.append((task, serialized))
                            continue
                        try:
                            process = idle.pop() if idle else _Process()
                        # A daemonic process must not start others; browsers have no processes.
                        except (AssertionError, ImportError, OSError, RuntimeError) as problem:
                            waiting.appendleft((task, attempt))
                            capacity = reduce_capacity(problem)
                            break
                        process.submit(serialized)
                        limit = task.time_limit
                        span = math.inf if limit is None else task.repetitions * limit + _KILL_DELAY
                        running[process] = task, attempt, clock.monotonic() + span
                    yield from results
                    if interrupts.received:
                        raise KeyboardInterrupt
                    if running:
                        _wait_for_messages(running)
                    results = []
                    for process, (task, attempt, deadline) in [*running.items()]:
                        try:
                            outcome = process.fetch()
                            if outcome is None and clock.monotonic() > deadline:
                                process.kill()
                                reason = "killed because the run did not stop at the time limit"
                                outcome = Outcome(Status("limited", reason))
                        except EOFError as problem:
                            process.kill()
                            if not process.has_started:
                                del running[process]
                                waiting.appendleft((task, attempt))
                                capacity = reduce_capacity(problem)
                                continue
                            if attempt < _MAX_ATTEMPTS:
                                del running[process]
                                waiting.appendleft((task, attempt + 1))
                                continue
                            status = Status("failed", f"the process died {attempt} times")
                            outcome = Outcome(status, is_final=False)
                        if outcome is not None:
                            del running[process]
                            results.append((task, outcome))
                            if process.is_alive:
                                idle.append(process)
                            else:
                                process.kill()
            finally:
                for process in (*idle, *running):
                    process.kill()
        # A task that has ended a process could end this one.
        for task in (task for task, attempt in waiting if attempt > 1):
            yield task, _lose("no process can be started for a second try")
        yield from SerialPool().run_tasks([task for task, attempt in waiting if attempt == 1])


class _Process:
    """Local process that runs one task at a time, and sends None when it has started.

    Attributes
    ----------
    connection
        The pipe to the process.
    has_started
        True after the process has sent its first message.
    """

    def __init__(self) -> None:
        # Imported here, because browsers have no processes.
        from multiprocessing import get_context

        context = get_context("spawn")
        self.connection, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,))
        self._task, self.has_started = b"", False
        with _isolated_start():
            self._process.start()
        other.close()

    @property
    def sentinel(self) -> int:
        """Handle that becomes ready when the process ends."""
        return self._process.sentinel

    @property
    def is_alive(self) -> bool:
        """True until the process has ended."""
        return self._process.is_alive()

    def submit(self, task: bytes) -> None:
        """Start a task, as soon as the process has started."""
        self._task = task
        if self.has_started:
            self._send()

    def _send(self) -> None:
        # `fetch` notices the end of a process.
        with suppress(OSError):
            self.connection.send_bytes(self._task)
        self._task = b""

    def fetch(self) -> Outcome | None:
        """Return the outcome of the task, or None while it runs.

        Raises
        ------
        EOFError
            If the process has ended without an outcome.
        """
        is_alive = self.is_alive
        if not is_alive:
            # Its child processes would keep the pipe open in the middle of a message.
            self._kill_group()
        try:
            if self.connection.poll():
                outcome: Outcome | None = self.connection.recv()
                if outcome is None:
                    self.has_started = True
                    self._send()
                return outcome
        except OSError as problem:
            raise EOFError(problem.strerror) from None
        if not is_alive:
            raise EOFError("a process ended")
        return None

    def kill(self) -> None:
        """Kill the process and its process group, which contains its child processes."""
        self._kill_group()
        self._process.kill()
        self._process.join()
        self.connection.close()

    def _kill_group(self) -> None:
        if hasattr(os, "killpg"):
            # A process that has just started has no group yet.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid or 0, signal.SIGKILL)


def _wait_for_messages(processes: Iterable[_Process]) -> None:
    """Wait until a process sends a message or ends, at most for the time between checks."""
    from multiprocessing.connection import wait

    wait(
        [x for process in processes for x in (process.connection, process.sentinel)], _POLL_INTERVAL
    )


@contextmanager
def _isolated_start() -> Iterator[None]:
    """Isolate processes that are started in this block.

    They ignore Ctrl-C, have one BLAS thread, and run neither the main program nor files of the
    working folder, which may be deleted while they start.
    """
    from multiprocessing import resource_tracker, spawn, util

    internals: Any = util
    prepare, flags = spawn.get_preparation_data, internals._args_from_interpreter_flags
    entries = os.environ
    added = {"OPENBLAS_NUM_THREADS": "1"}.items() - entries.items()
    omitted = {"dir", "init_main_from_name", "init_main_from_path"}
    before = {name: entries.get(name) for name, _ in added}
    mask: Any = None
    try:
        # Not an environment variable, which the option -E disables.
        internals._args_from_interpreter_flags = lambda: [*flags(), "-P"]
        if hasattr(signal, "pthread_sigmask"):
            # Otherwise, Python starts the tracker with the first process and unblocks the signal.
            resource_tracker.ensure_running()
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        entries.update(added)
        spawn.get_preparation_data = lambda name: {
            key: x for key, x in prepare(name).items() if key not in omitted
        }
        yield
    finally:
        spawn.get_preparation_data = prepare
        internals._args_from_interpreter_flags = flags
        for name, value in before.items():
            if value is None:
                entries.pop(name, None)
            else:
                entries[name] = value
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _serve(connection: Connection) -> None:
    """Run the tasks that another process sends, and send their outcomes."""
    _isolate_process()
    connection.send(None)
    with suppress(EOFError):
        while True:
            connection.send(_run_in_process(connection.recv_bytes()))


def _isolate_process() -> None:
    """Make this process a group leader without Ctrl-C and streams that ends with its parent."""
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
    # Without this thread, the process could outlive a study by the duration of a case.
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    # Entered once: entering and leaving this context for each run takes 0.5 ms.
    single_threaded.__enter__()


def _exit_with_parent() -> None:
    """Wait for the end of the process that started this one, then end this process group."""
    from multiprocessing import parent_process

    parent = parent_process()
    assert parent is not None
    parent.join()
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _run_in_process(serialized: bytes) -> Outcome:
    """Run a task in another process, which ignores Ctrl-C."""
    pid = os.getpid()
    try:
        outcome = run_task(serialized)
    except KeyboardInterrupt:
        outcome = Outcome.failed("the model raised KeyboardInterrupt")
    if os.getpid() != pid:
        # The model has forked, and this is the child.
        os._exit(0)
    return outcome


def _warn_of_missing_processes(workers: int, problem: BaseException) -> None:
    reason = getattr(problem, "strerror", None) or format_message(problem)
    warnings.warn(
        f"study: not all of the {workers} worker processes can be started ({reason}); the cases "
        "run in fewer processes or in the main process.",
        KernelWarning,
        stacklevel=3,
    )


def _lose(reason: str) -> Outcome:
    return Outcome(Status("not run", reason), is_final=False)


def _serialize_task(task: Task) -> bytes | Outcome:
    """Return the serialized task, or a failed outcome if it cannot be serialized."""
    try:
        return task.serialize()
    except Exception as problem:  # Pickling objects of a model can raise any error.
        return Outcome.failed(f"the task cannot be serialized: {describe_exception(problem)}")


class FuturePool:
    """Runs tasks on an executor of `concurrent.futures`, or on one with the same methods.

    Parameters
    ----------
    executor
        The executor, for example of Dask, mpi4py or loky. Its workers are processes, because runs
        change settings of their process, such as the filters of warnings.
    workers
        Number of tasks that it runs at the same time, for reports of progress.
    close
        Function that is called after the last task.
    name
        Name in messages.
    """

    def __init__(
        self, executor: Executor, workers: int, close: Callable[[], Any], name: str = "executor"
    ) -> None:
        self._executor, self.workers, self._close = executor, workers, close
        self._name = name

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task in the order of completion."""
        futures: dict[Any, Task] = {}
        try:
            for task in tasks:
                serialized = _serialize_task(task)
                if isinstance(serialized, Outcome):
                    yield task, serialized
                else:
                    futures[self._executor.submit(run_task, serialized)] = task
            for future in as_completed(futures):
                try:
                    outcome = future.result()
                # `run_task` raises no exceptions, so the cause is the executor.
                except CancelledError:
                    lost = f"the connection to the {self._name} was lost"
                    outcome = _lose(lost)
                except Exception as problem:
                    reason = f"the {self._name} failed: {format_exception(problem)}"
                    outcome = _lose(reason)
                yield futures[future], outcome
        finally:
            for future in futures:
                future.cancel()
            self._close()


TaskExecutor = SerialPool | LocalPool | FuturePool


def _connect_to_dask(label: str, address: str) -> FuturePool:
    """Return a pool that runs tasks on the workers of a Dask scheduler."""
    try:
        from distributed import Client
    except ImportError:
        raise BeamdaeError(
            f"{label} requires Dask, which is not installed; run pip install 'beamdae[cluster]'."
        ) from None
    try:
        client = Client(address, timeout=_CONNECT_TIMEOUT)
    except Exception as problem:  # of many kinds, depending on the scheme of the address
        raise BeamdaeError(
            f"{label} does not answer ({format_message(problem)}); start a Dask scheduler or "
            "correct the address."
        ) from problem
    workers = sum(client.nthreads().values())
    if not workers:
        client.close()
        raise BeamdaeError(f"{label} has no workers; start at least one worker.")
    # The outcomes report a lost connection; the client would log tracebacks of its own tasks.
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)

    def close() -> None:
        client.close()
        logger.setLevel(level)

    return FuturePool(client.get_executor(pure=False), workers, close, "Dask cluster")


def create_executor(part: str, prefix: str, workers: Any, scheduler: Any) -> TaskExecutor:
    """Return a pool of local processes or, with a `scheduler`, one that uses its workers.

    Messages begin with `part` and call the arguments `jobs` and `scheduler`, preceded by `prefix`.

    Raises
    ------
    BeamdaeError
        If `workers` is not a count or is too large, or `scheduler` is neither an executor nor the
        address of a Dask scheduler that answers.
    """
    if workers is not None:
        most = _MAX_WORKERS_PER_CORE * (os.cpu_count() or 1)
        workers = require_count(part, f"{prefix}jobs", workers, most=most)
    if scheduler is None:
        return LocalPool(workers)
    if isinstance(scheduler, Executor):
        # The caller shuts the executor down, which other studies may use.
        return FuturePool(scheduler, workers or _count_cores(), lambda: None)
    if not isinstance(scheduler, str):
        raise BeamdaeError(
            f"{part}: {prefix}scheduler must be the address of a Dask scheduler or an executor "
            f"of concurrent.futures, got {short_repr(scheduler)}."
        )
    name = shorten_text(scheduler, _MAX_ADDRESS_LETTERS)
    return _connect_to_dask(f"{part}: {prefix}scheduler {name}", scheduler)


def _count_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
