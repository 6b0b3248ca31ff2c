"""How far a study is, told while it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from beamdae.studies.execution.case_run import Outcome, Task
from beamdae.studies.execution.time_estimates import Forecast


@dataclass(frozen=True)
class Standing:
    """How far a study is.

    Attributes
    ----------
    total, done, failed, kept, running
        Runs there are (references included), done by now, failed among them, found on disk, and
        under way.
    last
        Label of the run that ended last.
    left
        Estimate of the remaining time [s] at the end of that run; None if nothing is known yet.
    """

    total: int
    done: int
    failed: int
    kept: int
    running: int
    last: str
    left: float | None = None


class Count:
    """How far a study is, for those who want to hear of it."""

    def __init__(
        self,
        tasks: list[Task],
        outcomes: Mapping[str, Outcome],
        workers: int,
        progress: Callable[[Standing], None] | None,
    ) -> None:
        self._progress, self._workers = progress, workers
        self._total, self._done, self._kept = len(tasks), len(outcomes), len(outcomes)
        self._failed = sum(not outcome.status.success for outcome in outcomes.values())
        self._forecast = Forecast(tasks, workers)
        for task in tasks:
            if task.key in outcomes:
                self._forecast.add(task, outcomes[task.key])

    def add(self, task: Task, outcome: Outcome) -> None:
        """Count a run that has ended."""
        self._done += 1
        self._failed += not outcome.status.success
        self._forecast.add(task, outcome)

    def tell(self, last: str) -> None:
        """Tell how far it is, and what has ended last."""
        if self._progress is None:
            return
        self._forecast.begin()
        running = min(self._workers, self._total - self._done)
        counts = (self._total, self._done, self._failed, self._kept, running)
        self._progress(Standing(*counts, last, self._forecast.left))
