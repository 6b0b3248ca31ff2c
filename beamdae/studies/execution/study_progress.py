"""Progress of a study: counts of its runs, and an estimate of the remaining time."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
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


class ProgressCounter:
    """Counts the runs of a study and reports its progress.

    The remaining runs are assumed to take as long as those that have ended since the start.
    """

    def __init__(
        self,
        tasks: list[Task],
        outcomes: Mapping[str, Outcome],
        workers: int,
        progress: Callable[[StudyProgress], None] | None,
    ) -> None:
        self._report_progress = progress
        self._workers = workers
        self._total = len(tasks)
        self._done = self._stored = len(outcomes)
        self._failed = sum(not outcome.status.success for outcome in outcomes.values())
        self._start = clock.monotonic()

    def add(self, outcome: Outcome) -> None:
        """Count a run that has ended."""
        self._done += 1
        self._failed += not outcome.status.success

    def report(self, last_label: str) -> None:
        """Report the progress, with the label of the run that ended last or "" at the start."""
        if self._report_progress is None:
            return
        missing, ended = self._total - self._done, self._done - self._stored
        elapsed = clock.monotonic() - self._start
        remaining = 0.0 if not missing else elapsed * missing / ended if ended else None
        progress = StudyProgress(
            total=self._total,
            done=self._done,
            failed=self._failed,
            stored=self._stored,
            running=min(self._workers, missing),
            last_label=last_label,
            remaining_time=remaining,
        )
        call_progress(self._report_progress, progress)
