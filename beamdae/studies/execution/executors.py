"""Executors that run tasks in this process, in local processes or on any other executor."""

from __future__ import annotations

import logging
import os
import warnings
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError, Executor, as_completed
from typing import Any, NamedTuple, Protocol

from beamdae.errors import (
    BeamdaeError,
    KernelWarning,
    format_exception,
    format_message,
    require_count,
    short_repr,
)
from beamdae.interrupts import DeferredInterrupts
from beamdae.report.text import shorten_text
from beamdae.results.outcome import Status
from beamdae.studies.execution.case_run import run_task
from beamdae.studies.execution.worker_processes import (
    WorkerError,
    WorkerProcess,
    WorkerStartError,
    wait_for_workers,
)
from beamdae.studies.store.file_reads import clear_module_reads
from beamdae.studies.tasks import Outcome, Task, describe_exception

_KILL_DELAY = 60.0  # time after the time limit of a task until its process is killed [s]
_MAX_ATTEMPTS = 2  # per task, if its process dies
_MAX_WORKERS_PER_CORE = 16  # more bring no benefit, even if some processes wait
_POLL_INTERVAL = 0.1  # time between checks of interrupts and deadlines [s]
_CONNECT_TIMEOUT = 10.0  # maximum time for a Dask scheduler to answer [s]
_MAX_ADDRESS_LETTERS = 80


class TaskResult(NamedTuple):
    """Result of an executor for one task.

    Attributes
    ----------
    task, outcome
        The task, and its outcome.
    storable
        True if the outcome may be stored; False if the task could not be transferred, its process
        died or the cluster failed.
    """

    task: Task
    outcome: Outcome
    storable: bool


# Callers that do not exhaust the generator must close it, which ends the processes.
TaskResults = Generator[TaskResult, None, None]


class TaskExecutor(Protocol):
    """Runs tasks and yields their results in the order of completion.

    Attributes
    ----------
    workers
        Maximum number of tasks that run at the same time.
    """

    workers: int

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task."""


class SerialPool:
    """Runs tasks sequentially in this process, for debugging and small studies.

    A case that crashes the process ends the study, and a case that ignores its time limit blocks
    the study.

    Attributes
    ----------
    workers
        Always 1.
    """

    workers = 1

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task in the order of `tasks`.

        After the result of an interrupted task, KeyboardInterrupt is raised.
        """
        for task in tasks:
            clear_module_reads()
            outcome = run_task(task.serialize())
            yield TaskResult(task, outcome, storable=True)
            # After an interrupt, the integrator only ends its run, but the whole study must end.
            if outcome.status.kind == "interrupted":
                raise KeyboardInterrupt


class _Attempt(NamedTuple):
    """A task and the number of the attempt to run it, starting from 1."""

    task: Task
    number: int


class LocalPool:
    """Runs tasks in local processes, by default one per available core.

    If a process dies, only its task is affected; the task is run once more in another process.
    Interrupts are raised between results, after all processes have been killed. If the system
    cannot start all processes, fewer are used; if it can start none, all tasks that have not been
    tried yet run in this process.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or _count_cores()
        # Number of processes that the system can run.
        self._capacity = self.workers

    def run_tasks(self, tasks: Sequence[Task]) -> TaskResults:
        """Yield the result of each task in the order of completion."""
        self._capacity = self.workers
        waiting = deque(_Attempt(task, 1) for task in tasks)
        workers: list[WorkerProcess[_Attempt]] = []
        results: list[TaskResult] = []
        with DeferredInterrupts() as interrupts:
            try:
                while (waiting and self._capacity) or any(worker.current for worker in workers):
                    # Start the next tasks first, so that they run while the caller handles results.
                    yield from self._assign_tasks(waiting, workers)
                    yield from results
                    if interrupts.received:
                        raise KeyboardInterrupt
                    results = list(self._collect_outcomes(waiting, workers))
                yield from results
            finally:
                for worker in workers:
                    worker.kill()
        # A task that has ended a process could end this one.
        for task, number in waiting:
            if number > 1:
                outcome = Outcome(Status("not run", "no process can be started for a second try"))
                yield TaskResult(task, outcome, storable=False)
        yield from SerialPool().run_tasks([task for task, number in waiting if number == 1])

    def _assign_tasks(
        self, waiting: deque[_Attempt], workers: list[WorkerProcess[_Attempt]]
    ) -> TaskResults:
        """Assign tasks to idle or new processes; yield results of unserializable tasks."""
        while waiting and sum(worker.current is not None for worker in workers) < self._capacity:
            attempt = waiting.popleft()
            task = attempt.task
            serialized = _serialize_task(task)
            if isinstance(serialized, TaskResult):
                yield serialized
                continue
            idle = [worker for worker in workers if worker.current is None]
            if not idle:
                try:
                    idle = [WorkerProcess()]
                except WorkerStartError as problem:
                    waiting.appendleft(attempt)
                    self._reduce_capacity(len(workers), problem)
                    return
                workers += idle
            limit = task.limits.time
            time_limit = None if limit is None else task.repetitions * limit + _KILL_DELAY
            idle[0].start_task(attempt, serialized, time_limit)

    def _reduce_capacity(self, count: int, problem: WorkerStartError) -> None:
        """Use at most `count` processes from now on, and warn the first time."""
        if self._capacity == self.workers:
            warnings.warn(
                f"study: not all of the {self.workers} worker processes can be started "
                f"({problem}); the cases run in fewer processes or in the main process.",
                KernelWarning,
                stacklevel=2,
            )
        self._capacity = min(self._capacity, count)

    def _collect_outcomes(
        self, waiting: deque[_Attempt], workers: list[WorkerProcess[_Attempt]]
    ) -> TaskResults:
        """Yield the results of one poll interval, and kill processes past their deadline.

        Exhaust this generator before handling the results, so that idle processes get new tasks
        first.
        """
        busy = [worker for worker in workers if worker.current is not None]
        for worker in wait_for_workers(busy, _POLL_INTERVAL):
            assert worker.current is not None
            task, number = worker.current
            try:
                outcome = worker.receive_outcome()
                if outcome is not None:
                    yield TaskResult(task, outcome, storable=True)
            except (WorkerError, WorkerStartError) as problem:
                workers.remove(worker)
                worker.kill()
                if isinstance(problem, WorkerStartError):
                    waiting.appendleft(_Attempt(task, number))
                    self._reduce_capacity(len(workers), problem)
                elif number < _MAX_ATTEMPTS:
                    waiting.appendleft(_Attempt(task, number + 1))
                else:
                    reason = f"the process died {number} times; the last process {problem}"
                    yield TaskResult(task, Outcome.failed(reason), storable=False)
        for worker in list(workers):
            if worker.current is not None and worker.is_late:
                workers.remove(worker)
                worker.kill()
                status = Status("limited", "killed because the run did not stop at the time limit")
                yield TaskResult(worker.current.task, Outcome(status), storable=True)


def _serialize_task(task: Task) -> bytes | TaskResult:
    """Return the serialized task, or a failed result if it cannot be serialized."""
    try:
        return task.serialize()
    except Exception as problem:  # Pickling objects of a model can raise any error.
        reason = f"the task cannot be serialized: {describe_exception(problem)}"
        return TaskResult(task, Outcome.failed(reason), storable=False)


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
                if isinstance(serialized, TaskResult):
                    yield serialized
                else:
                    futures[self._executor.submit(run_task, serialized)] = task
            for future in as_completed(futures):
                try:
                    yield TaskResult(futures[future], future.result(), storable=True)
                # `run_task` raises no exceptions, so the cause is the executor.
                except CancelledError:
                    status = Status("not run", f"the connection to the {self._name} was lost")
                    yield TaskResult(futures[future], Outcome(status), storable=False)
                except Exception as problem:
                    status = Status(
                        "not run", f"the {self._name} failed: {format_exception(problem)}"
                    )
                    yield TaskResult(futures[future], Outcome(status), storable=False)
        finally:
            for future in futures:
                future.cancel()
            self._close()


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
    option = f"{prefix}jobs"
    limit = _MAX_WORKERS_PER_CORE * (os.cpu_count() or 1)
    if workers is not None and require_count(part, option, workers) > limit:
        raise BeamdaeError(
            f"{part}: {option} must be at most {limit} ({_MAX_WORKERS_PER_CORE} per core), "
            f"got {workers}."
        )
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
