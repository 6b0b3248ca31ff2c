"""Where the work is done: here, in a pool of local processes, or by a Dask scheduler's workers."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, TimeoutError, wait
from contextlib import contextmanager
from multiprocessing import get_context, resource_tracker
from typing import Any, Protocol

from beamdae.errors import BeamdaeError
from beamdae.results.solution import Status
from beamdae.studies.work import Outcome, Task, perform

# A run that has not ended by its own time limit after so many seconds more is killed.
_GRACE = 60.0
_TRIES = 2
# How long a scheduler may take to answer [s].
_PATIENCE = 10.0


class Executor(Protocol):
    """Something that takes tasks and gives outcomes, in the order in which they end."""

    workers: int

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome, bool]]:
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

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome, bool]]:
        """(task, outcome, whether it is to be kept) of each task, in their order."""
        for task in tasks:
            outcome = perform(task.packed())
            yield task, outcome, True
            # The integrator took the interrupt for its run alone; it is meant for the study.
            if outcome.status.kind == "interrupted":
                raise KeyboardInterrupt


class LocalPool:
    """One process a core; one that dies takes its own case with it and no other."""

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or _cores()

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome, bool]]:
        """(task, outcome, whether it is to be kept) of each task."""
        from pebble import ProcessExpired, ProcessPool

        context = get_context("spawn")
        with _stopped(
            ProcessPool(self.workers, context=context, initializer=_leave_interrupts)
        ) as pool:

            def submit(task: Task) -> Any:
                limit = task.limits.time
                seconds = None if limit is None else task.repetitions * limit + _GRACE
                with _interrupts_later():
                    return pool.schedule(perform, (task.packed(),), timeout=seconds)

            waiting: dict[Any, tuple[Task, int]] = {}
            for task in tasks:
                try:
                    waiting[submit(task)] = (task, 1)
                except Exception as problem:  # Whatever a model holds that cannot be sent.
                    yield task, Outcome.failed(f"it cannot be sent to a process: {problem}"), False
            while waiting:
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    task, tries = waiting.pop(future)
                    try:
                        yield task, future.result(), True
                    except ProcessExpired as problem:
                        if tries < _TRIES:
                            waiting[submit(task)] = (task, tries + 1)
                        else:
                            reason = f"its process died {tries} times ({problem})"
                            yield task, Outcome.failed(reason), False
                    except TimeoutError:
                        reason = "killed, it did not end at its time limit"
                        yield task, Outcome(Status("limited", reason)), True
                    except Exception as problem:  # The end of one case is not that of a study.
                        yield task, Outcome.failed(f"{type(problem).__name__}: {problem}"), False


@contextmanager
def _stopped(pool: Any) -> Iterator[Any]:
    """The pool, without anything left running behind it."""
    try:
        yield pool
    finally:
        pool.stop()
        pool.join()


class DaskPool:
    """The workers of a Dask scheduler; a task whose worker dies goes to another one."""

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise BeamdaeError(
                f"--scheduler {address}: it needs Dask, pip install 'beamdae[cluster]'."
            ) from None
        try:
            self._client = Client(address, timeout=_PATIENCE)
        except (OSError, ValueError) as problem:
            raise BeamdaeError(
                f"--scheduler {address}: no Dask scheduler answers there ({problem})."
            ) from problem
        self.workers = sum(self._client.nthreads().values())
        if not self.workers:
            raise BeamdaeError(f"--scheduler {address}: the scheduler has no workers.")

    def outcomes(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome, bool]]:
        """(task, outcome, whether it is to be kept) of each task."""
        from distributed import KilledWorker
        from distributed import as_completed as completed

        futures = {
            self._client.submit(perform, task.packed(), key=f"beamdae-{task.key}", pure=False): task
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
                    yield task, Outcome.failed(f"{type(problem).__name__}: {problem}"), False
        finally:
            self._client.cancel(list(futures))
            self._client.close()


@contextmanager
def _interrupts_later() -> Iterator[None]:
    """Threads and processes that are started in here do not hear Ctrl-C, while they begin either.

    They inherit what is blocked.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Where it starts with the first of them, it lets interrupts through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _leave_interrupts() -> None:
    """Ctrl-C is for the process that runs the study."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
