"""Executors that run tasks in this process, in local processes or on any other executor."""

from __future__ import annotations

import logging
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time as clock
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, as_completed
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any

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
    processes, fewer are used; if it can start none, the tasks run in this process.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or _count_cores()

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task in the order of completion."""
        waiting: SimpleQueue[Task] = SimpleQueue()
        for task in tasks:
            waiting.put(task)
        # Results, and the reason for which each thread ends: None or an exception.
        messages: SimpleQueue[Any] = SimpleQueue()
        workers = [_Worker() for _ in range(min(self.workers, len(tasks)))]
        threads = [
            threading.Thread(target=worker.run_waiting, args=(waiting, messages), daemon=True)
            for worker in workers
        ]
        reasons: list[BaseException | None] = []
        with DeferredInterrupts() as interrupts:
            try:
                for thread in threads:
                    try:
                        thread.start()
                    except RuntimeError as problem:
                        messages.put(problem)
                while len(reasons) < len(threads):
                    with suppress(Empty):
                        message = messages.get(timeout=_POLL_INTERVAL)
                        if isinstance(message, tuple):
                            yield message
                        else:
                            if message is not None and not any(reasons):
                                reason = getattr(message, "strerror", None)
                                reason = reason or format_message(message)
                                warnings.warn(
                                    f"study: not all of the {self.workers} worker processes can be "
                                    f"started ({reason}); the cases run in fewer processes or in "
                                    "the main process.",
                                    KernelWarning,
                                    stacklevel=2,
                                )
                            reasons.append(message)
                    if interrupts.received:
                        raise KeyboardInterrupt
                    for worker in workers:
                        worker.kill_if_due()
            finally:
                unfinished = list(_take_all(waiting))
                for thread, worker in zip(threads, workers, strict=True):
                    while thread.is_alive():
                        worker.kill()
                        thread.join(_POLL_INTERVAL)
        yield from SerialPool().run_tasks(unfinished)


def _take_all(queue: SimpleQueue[Task]) -> Iterator[Task]:
    with suppress(Empty):
        while True:
            yield queue.get_nowait()


class _Worker:
    """Local process that runs one task at a time, and is replaced if it ends.

    A thread runs tasks; the main thread calls only `kill` and `kill_if_due`.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._deadline = math.inf

    def run_waiting(self, waiting: SimpleQueue[Task], messages: SimpleQueue[Any]) -> None:
        """Run waiting tasks until none is left or no process can be started."""
        reason = None
        for task in _take_all(waiting):
            try:
                messages.put((task, self._run(task)))
            except Exception as problem:
                waiting.put(task)
                reason = problem
                break
        self._end()
        messages.put(reason)

    def _run(self, task: Task) -> Outcome:
        serialized = _serialize_task(task)
        if isinstance(serialized, Outcome):
            return serialized
        limit = task.time_limit
        span = math.inf if limit is None else task.repetitions * limit + _KILL_DELAY
        for attempt in range(_MAX_ATTEMPTS):
            try:
                process = self._process or self._start()
            except OSError:
                # A task that has ended a process could end this one.
                if attempt:
                    return _lose("no process can be started for a second try")
                raise
            self._deadline = clock.monotonic() + span
            outcome: Outcome | None = self._exchange(process, serialized)
            is_late, self._deadline = clock.monotonic() > self._deadline, math.inf
            if outcome is not None:
                return outcome
            if is_late:
                reason = "killed because the run did not stop at the time limit"
                return Outcome(Status("limited", reason))
        status = Status("failed", f"the process died {_MAX_ATTEMPTS} times")
        return Outcome(status, is_final=False)

    def _start(self) -> subprocess.Popen[bytes]:
        """Start a process that runs neither the main program nor files of the working folder."""
        # A session of its own, which Ctrl-C in a terminal does not reach.
        process = self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _PROGRAM, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            start_new_session=True,
        )
        if self._exchange(process) is None:
            raise OSError("a process ended")
        return process

    def _exchange(self, process: subprocess.Popen[bytes], message: bytes = b"") -> Any:
        """Send a message if there is one, and return the next answer; None if the process ends."""
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            if message:
                pickle.dump(message, process.stdin)
                process.stdin.flush()
            return pickle.load(process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            self._end()
            return None

    def _end(self) -> None:
        self.kill()
        if self._process is not None:
            # Closing flushes a message that the process has not read.
            with suppress(OSError), self._process:
                pass
        self._process = None

    def kill_if_due(self) -> None:
        """Kill the process after its deadline; if it has ended, kill its child processes."""
        process = self._process
        is_late = clock.monotonic() > self._deadline
        if process is not None and (is_late or process.poll() is not None):
            # Child processes would keep the pipe open.
            self.kill()

    def kill(self) -> None:
        """Kill the process and its process group, which contains its child processes."""
        process = self._process
        if process is not None:
            if hasattr(os, "killpg"):
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
            process.kill()


_PROGRAM = (
    "import sys; sys.path[:] = sys.argv[1:]; from beamdae.studies.executors import serve; serve()"
)


def serve() -> None:
    """Run the tasks from standard input, and write their outcomes to standard output."""
    source, sink = (os.fdopen(os.dup(k), mode) for k, mode in ((0, "rb"), (1, "wb")))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    null = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1):
        os.dup2(null, descriptor)
    for stream in (sys.stdout, sys.stderr):
        # A character that cannot be encoded must not end a run.
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    # Entered once: entering and leaving this context for each run takes 0.5 ms.
    single_threaded.__enter__()
    tasks: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_receive, args=(source, tasks), daemon=True).start()
    answer: Any = True  # ready
    while True:
        pickle.dump(answer, sink)
        sink.flush()
        answer = _run_in_process(tasks.get())


def _receive(source: Any, tasks: SimpleQueue[bytes]) -> None:
    """Receive tasks; when the process that sends them has ended, end this process group."""
    with suppress(EOFError):
        while True:
            tasks.put(pickle.load(source))
    if hasattr(os, "killpg"):
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
    label = f"{part}: {prefix}scheduler {shorten_text(scheduler, _MAX_ADDRESS_LETTERS)}"
    try:
        from distributed import Client
    except ImportError:
        raise BeamdaeError(
            f"{label} requires Dask, which is not installed; run pip install 'beamdae[cluster]'."
        ) from None
    try:
        client = Client(scheduler, timeout=_CONNECT_TIMEOUT)
    except Exception as problem:  # of many kinds, depending on the scheme of the address
        raise BeamdaeError(
            f"{label} does not answer ({format_message(problem)}); start a Dask scheduler or "
            "correct the address."
        ) from problem
    threads = sum(client.nthreads().values())
    if not threads:
        client.close()
        raise BeamdaeError(f"{label} has no workers; start at least one worker.")
    # The outcomes report a lost connection; the client would log tracebacks of its own tasks.
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)

    def close() -> None:
        client.close()
        logger.setLevel(level)

    return FuturePool(client.get_executor(pure=False), threads, close, "Dask cluster")


def _count_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
