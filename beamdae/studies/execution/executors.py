"""Where the work is done: here, in a pool of local processes, or by a Dask scheduler's workers."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError
from typing import Any, Protocol

from beamdae.errors import BeamdaeError, format_message, require_count, short_repr
from beamdae.report.text import shorten_text
from beamdae.results.outcome import Status
from beamdae.studies.execution.case_run import Outcome, Task, describe_exception, run_task
from beamdae.studies.execution.deferred_interrupts import DeferredInterrupts
from beamdae.studies.execution.packing import PackedParts
from beamdae.studies.execution.worker_processes import Worker, WorkerError, wait_for_workers
from beamdae.studies.store.file_reads import clear_module_reads

# A run that has not ended by its own time limit after so many seconds more is killed.
_KILL_DELAY = 60.0
_MAX_ATTEMPTS = 2
# Processes a core that are still of use, where some of them wait.
_MAX_WORKERS_PER_CORE = 16
# How long outcomes are waited for before interrupts and time limits are looked at [s].
_POLL_INTERVAL = 0.1
# How long a scheduler may take to answer [s].
_CONNECT_TIMEOUT = 10.0
# Letters of an address that are told.
_MAX_ADDRESS_LETTERS = 80


# A task, its outcome, and whether that is to be kept.
_Found = tuple[Task, Outcome, bool]
# To be closed where they are not gone through.
Outcomes = Generator[_Found, None, None]


class Executor(Protocol):
    """Something that takes tasks and gives outcomes, in the order in which they end."""

    workers: int

    def outcomes(self, tasks: Sequence[Task]) -> Outcomes:
        """(task, outcome, whether it is to be kept) of each task."""


class SerialPool:
    """The runs one after the other in this process: for debugging and small studies.

    Nothing stands between a case and the study: one that kills its process ends both, and one that
    does not end at its time limit is waited for.

    Attributes
    ----------
    workers
        One.
    """

    workers = 1

    def outcomes(self, tasks: Sequence[Task]) -> Outcomes:
        """(task, outcome, whether it is to be kept) of each task, in their order."""
        known: PackedParts = {}
        for task in tasks:
            clear_module_reads()
            outcome = run_task(task.packed(known))
            yield task, outcome, True
            # The integrator took the interrupt for its run alone; it is meant for the study.
            if outcome.status.kind == "interrupted":
                raise KeyboardInterrupt


class LocalPool:
    """One process a core; one that dies takes its own case with it and no other.

    Interrupts are raised between outcomes alone, once all processes have been ended.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or count_cores()

    def outcomes(self, tasks: Sequence[Task]) -> Outcomes:
        """(task, outcome, whether it is to be kept) of each task."""
        waiting = deque((task, 1) for task in tasks)
        workers: list[Worker] = []
        found: list[_Found] = []
        known: PackedParts = {}
        with DeferredInterrupts() as interrupts:
            try:
                while waiting or any(worker.task for worker in workers):
                    # What has ended is kept while the next ones run.
                    yield from _assign_tasks(waiting, workers, self.workers, known)
                    yield from found
                    if interrupts.noted:
                        raise KeyboardInterrupt
                    found = list(_collect_outcomes(waiting, workers))
                yield from found
            finally:
                for worker in workers:
                    worker.end()


# A task, and the how manieth try it is.
_Try = tuple[Task, int]


def _assign_tasks(
    waiting: deque[_Try], workers: list[Worker], most: int, known: PackedParts
) -> Outcomes:
    """Give every process a task, and start no more than are of use."""
    while waiting and sum(worker.task is not None for worker in workers) < most:
        task, tries = waiting.popleft()
        try:
            packed = task.packed(known)
        except Exception as problem:  # Whatever a model holds that cannot be sent.
            yield (
                task,
                Outcome.failed(f"it cannot be sent to a process, {describe_exception(problem)}"),
                False,
            )
            continue
        idle = [worker for worker in workers if worker.task is None]
        if not idle:
            workers.append(Worker())
            idle = workers[-1:]
        limit = task.limits.time
        seconds = None if limit is None else task.repetitions * limit + _KILL_DELAY
        idle[0].begin((task, tries), packed, seconds)


def _collect_outcomes(waiting: deque[_Try], workers: list[Worker]) -> Outcomes:
    """What has ended by now, or within a moment.

    All of it at once: a process that has ended its task is free then.
    """
    busy = [worker for worker in workers if worker.task is not None]
    for worker in wait_for_workers(busy, _POLL_INTERVAL):
        task, tries = worker.task
        try:
            yield task, worker.outcome(), True
        except WorkerError as problem:
            workers.remove(worker)
            worker.end()
            if tries < _MAX_ATTEMPTS:
                waiting.appendleft((task, tries + 1))
            else:
                reason = f"its process died {tries} times, it {problem}"
                yield task, Outcome.failed(reason), False
    for worker in [x for x in workers if x.task is not None and x.late]:
        task, _ = worker.task
        workers.remove(worker)
        worker.end()
        reason = "killed, it did not end at its time limit"
        yield task, Outcome(Status("limited", reason)), True


class DaskPool:
    """The workers of a Dask scheduler; a task whose worker dies goes to another one."""

    def __init__(self, address: str) -> None:
        named = f"--scheduler {shorten_text(address, _MAX_ADDRESS_LETTERS)}"
        try:
            from distributed import Client
        except ImportError:
            raise BeamdaeError(f"{named}: it needs Dask, pip install 'beamdae[cluster]'.") from None
        try:
            self._client = Client(address, timeout=_CONNECT_TIMEOUT)
        except (OSError, ValueError) as problem:
            raise BeamdaeError(
                f"{named}: no Dask scheduler answers there ({format_message(problem)})."
            ) from problem
        self.workers = sum(self._client.nthreads().values())
        if not self.workers:
            self._client.close()
            raise BeamdaeError(f"{named}: the scheduler has no workers.")

    def outcomes(self, tasks: Sequence[Task]) -> Outcomes:
        """(task, outcome, whether it is to be kept) of each task."""
        from distributed import KilledWorker
        from distributed import as_completed as completed

        known: PackedParts = {}
        futures = {
            self._client.submit(
                run_task, task.packed(known), key=f"beamdae-{task.key}", pure=False
            ): task
            for task in tasks
        }
        try:
            for future in completed(list(futures)):
                task = futures[future]
                try:
                    yield task, future.result(), True
                except (KilledWorker, CancelledError) as problem:
                    yield task, Outcome.failed(f"its workers died ({problem})"), False
                except Exception as problem:  # The end of one case is not that of a study.
                    yield task, Outcome.failed(describe_exception(problem)), False
        finally:
            self._client.cancel(list(futures))
            self._client.close()


def create_executor(part: str, name: str, workers: Any, scheduler: Any) -> Executor:
    """The workers of a Dask scheduler, if there is its address, or so many processes here.

    Raises
    ------
    BeamdaeError
        If no scheduler answers there, or `workers`, told as `name`, are none or too many.
    """
    if scheduler is not None and not isinstance(scheduler, str):
        raise BeamdaeError(
            f"{part}: scheduler must be the address of a Dask scheduler, got {short_repr(scheduler)}."
        )
    most = _MAX_WORKERS_PER_CORE * (os.cpu_count() or 1)
    if workers is not None and require_count(part, name, workers) > most:
        raise BeamdaeError(
            f"{part}: {name} must be at most {most}, {_MAX_WORKERS_PER_CORE} a core, got {workers}."
        )
    return DaskPool(scheduler) if scheduler else LocalPool(workers)


def count_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
