"""Progress of a study: counts of its runs, and an estimate of the remaining time."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.errors import call_progress
from beamdae.studies.tasks import Outcome, Task

# Expected number of steps: 300 (1e-3 / rtol)^0.25. In the table of runs in the README, the number
# grows by a factor of 1.5 to 2.1 per decade of rtol; for undamped beams, it grows faster.
_DEFAULT_STEPS = 300.0
_DEFAULT_RTOL = 1e-3
_STEPS_EXPONENT = 0.25
# Weights of finished runs with another series, method or group, relative to a matching run.
_OTHER_SERIES_WEIGHT = 0.2
_OTHER_METHOD_WEIGHT = 0.02
_OTHER_GROUP_WEIGHT = 0.1
_OVERTIME_RATIO = 0.5  # remaining time of an overdue run, relative to its expected time


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
        Estimated remaining time [s]; None if no estimate is available yet.
    """

    total: int
    done: int
    failed: int
    stored: int
    running: int
    last_label: str
    remaining_time: float | None = None


class ProgressCounter:
    """Counts the runs of a study and reports its progress."""

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
        self._estimator = TimeEstimator(tasks, workers)
        for task in tasks:
            if task.key in outcomes:
                self._estimator.add(task, outcomes[task.key])

    def add(self, task: Task, outcome: Outcome) -> None:
        """Count a run that has ended."""
        self._done += 1
        self._failed += not outcome.status.success
        self._estimator.add(task, outcome)

    def report(self, last_label: str) -> None:
        """Report the progress, with the label of the run that ended last or "" at the start."""
        if self._report_progress is None:
            return
        self._estimator.start_running_tasks()
        progress = StudyProgress(
            total=self._total,
            done=self._done,
            failed=self._failed,
            stored=self._stored,
            running=min(self._workers, self._total - self._done),
            last_label=last_label,
            remaining_time=self._estimator.remaining_time,
        )
        call_progress(self._report_progress, progress)


class TimeEstimator:
    """Estimates the remaining time of tasks that are started in the order of a list.

    The cost of a run is assumed to be proportional to the expected number of steps, which is a
    power of the tolerance if the step is adaptive. The cost per step is a weighted geometric mean
    over the finished runs; runs with a similar integrator, and runs with the same model and
    parameters, have larger weights. The time to transfer and store a run is added.
    """

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._workers = max(workers, 1)
        self._index = {task.key: k for k, task in enumerate(tasks)}
        self._log_steps = np.array([_log_step_count(task) for task in tasks])
        self._max_durations = np.array([_max_duration(task) for task in tasks])
        groups, self._group = _number_names([task.case.group for task in tasks])
        series, self._series = _number_names([task.case.series for task in tasks])
        methods = [name.partition("(")[0] for name in series]
        weights = [
            [_OTHER_SERIES_WEIGHT if a == b else _OTHER_METHOD_WEIGHT for b in methods]
            for a in methods
        ]
        self._series_weights = np.array(weights)
        np.fill_diagonal(self._series_weights, 1.0)
        # Sums and counts of log(duration / expected steps) of finished runs, by series and group.
        self._sums = np.zeros((len(series), len(groups)))
        self._counts = np.zeros((len(series), len(groups)))
        self._is_missing = np.ones(len(tasks), bool)
        self._start_times = np.full(len(tasks), np.nan)
        # Elapsed minus recorded time of finished runs [s]: transfer, storage and load by other
        # programs.
        self._overheads: list[float] = []

    def start_running_tasks(self) -> None:
        """Start the clocks of the running tasks: the first unfinished tasks, one per worker."""
        running = np.flatnonzero(self._is_missing)[: self._workers]
        started = running[np.isnan(self._start_times[running])]
        self._start_times[started] = clock.monotonic()

    def add(self, task: Task, outcome: Outcome) -> None:
        """Record a finished run."""
        k = self._index[task.key]
        self._is_missing[k] = False
        duration = _run_duration(task, outcome)
        if not np.isnan(self._start_times[k]):
            elapsed = clock.monotonic() - self._start_times[k]
            self._overheads.append(0.0 if duration is None else max(elapsed - duration, 0.0))
            duration = elapsed if duration is None else duration
        if duration is not None and duration > 0.0:
            cell = (self._series[k], self._group[k])
            self._sums[cell] += math.log(duration) - self._log_steps[k]
            self._counts[cell] += 1.0

    @property
    def remaining_time(self) -> float | None:
        """Estimated remaining time [s].

        0 if all runs have ended; None if runs are missing and no duration of a run is known.
        """
        if not self._is_missing.any():
            return 0.0
        if not self._counts.any():
            return None
        weights = self._series_weights @ _weight_groups(self._counts)
        means = self._series_weights @ _weight_groups(self._sums) / weights
        expected = np.exp(self._log_steps + means[self._series, self._group])
        expected = np.minimum(expected, self._max_durations)[self._is_missing]
        start_times = self._start_times[self._is_missing]
        elapsed = np.where(np.isnan(start_times), 0.0, clock.monotonic() - start_times)
        rest = np.maximum(expected - elapsed, _OVERTIME_RATIO * np.minimum(elapsed, expected))
        # The first run of each process includes the start of the process.
        overheads = self._overheads[self._workers :]
        rest += float(np.median(overheads)) if overheads else 0.0
        return float(max(rest.sum() / self._workers, rest.max()))


def _weight_groups(values: np.ndarray) -> np.ndarray:
    """Add a fraction of the values of all other groups to the values of each group."""
    total = values.sum(axis=1, keepdims=True)
    return _OTHER_GROUP_WEIGHT * total + (1.0 - _OTHER_GROUP_WEIGHT) * values


def _number_names(names: Sequence[str]) -> tuple[list[str], np.ndarray]:
    """Return the distinct names, and the index of each entry of `names` among them."""
    index = {name: k for k, name in enumerate(dict.fromkeys(names))}
    return list(index), np.array([index[name] for name in names], int)


def _log_step_count(task: Task) -> float:
    """Return the logarithm of the expected number of steps of a task in all repetitions."""
    name, value = task.case.integrator.accuracy
    if name == "step":
        steps = task.t_end / value
    else:
        steps = _DEFAULT_STEPS * (_DEFAULT_RTOL / value) ** _STEPS_EXPONENT
    return math.log(max(steps, 1.0) * task.repetitions)


def _max_duration(task: Task) -> float:
    limit = task.limits.time
    return math.inf if limit is None else limit * task.repetitions


def _run_duration(task: Task, outcome: Outcome) -> float | None:
    """Return the recorded duration of a run [s], or None if the outcome contains no duration."""
    times = [outcome.values.get(f"{phase} time [s]") for phase in ("setup", "wall", "measuring")]
    if not all(isinstance(x, float) and math.isfinite(x) for x in times):
        return None
    setup, wall, measuring = (float(x) for x in times if x is not None)
    return setup + task.repetitions * wall + measuring
