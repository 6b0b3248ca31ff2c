"""Progress of a study: counts of its runs, and an estimate of the remaining time."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from beamdae.errors import call_progress
from beamdae.studies.tasks import Outcome, Task


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study.

    Attributes
    ----------
    total
        Number of runs, including references.
    done
        Number of runs that have ended or were stored before.
    failed
        Number of runs in `done` that were not successful.
    stored
        Number of runs whose outcome was already stored in the results folder.
    running
        Number of runs in progress, assuming that no worker is idle.
    last_label
        Label of the run that ended last; "" at the start.
    remaining_time
        Estimated remaining time [s]; None until a run has ended.
    """

    total: int
    done: int
    failed: int
    stored: int
    running: int
    last_label: str
    remaining_time: float | None = None


def count_runs(
    tasks: Sequence[Task],
    outcomes: Mapping[str, Outcome],
    workers: int,
    progress: Callable[[StudyProgress], None] | None,
) -> Callable[..., None]:
    """Return a function that reports the progress after a run.

    Its arguments are the label and the outcome of the run, or "" at the start.

    `outcomes` are those by key of the task, to which the caller adds.
    """
    start, stored = clock.monotonic(), len(outcomes)
    failed = sum(not outcome.status.success for outcome in outcomes.values())

    def report(last_label: str, outcome: Outcome | None = None) -> None:
        nonlocal failed
        failed += outcome is not None and not outcome.status.success
        if progress is None:
            return
        missing, ended = len(tasks) - len(outcomes), len(outcomes) - stored
        elapsed = clock.monotonic() - start
        remaining = 0.0 if not missing else elapsed * missing / ended if ended else None
        running = min(workers, missing)
        call_progress(
            progress,
            StudyProgress(
                len(tasks), len(outcomes), failed, stored, running, last_label, remaining
            ),
        )

    return report
