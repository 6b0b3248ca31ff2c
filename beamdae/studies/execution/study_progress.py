"""How long a study still takes, from the runs that are done."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from beamdae.studies.execution.case_run import Outcome, Task

# What a run by tolerance costs before any is done, in steps at rtol = 1e-3, and how that grows:
# the table of runs in the README is between 1.5 and 2.1 a decade, undamped beams are above.
_STEPS, _RTOL, _POWER = 300.0, 1e-3, 0.25
# How much the cost of a run says of one of another kind, beside one of its own.
_OTHER_SERIES, _OTHER_METHOD, _OTHER_GROUP = 0.2, 0.02, 0.1
# A run that has taken longer than expected takes this share of that time more.
_MORE = 0.5


class TimeEstimator:
    """Remaining seconds of a list of tasks that are begun in their order.

    The logarithm of a run's cost is taken to be that of its number of steps (for a tolerance, a
    power of it) and the mean of what runs that are done took more or less than that, where those of
    the same model and parameters, and of the same integrator, count most. What it takes to send
    and to keep a run is added.
    """

    def __init__(self, tasks: Sequence[Task], workers: int) -> None:
        self._workers = max(workers, 1)
        self._place = {task.key: k for k, task in enumerate(tasks)}
        self._prior = np.array([_log_step_count(task) for task in tasks])
        self._most = np.array([_max_duration(task) for task in tasks])
        groups, self._group = _number_names([task.case.group for task in tasks])
        series, self._series = _number_names([task.case.series for task in tasks])
        methods = [name.partition("(")[0] for name in series]
        of_series = np.array([[_OTHER_SERIES if a == b else _OTHER_METHOD for b in methods]
                              for a in methods])  # fmt: skip
        np.fill_diagonal(of_series, 1.0)
        self._of_series = of_series
        self._sums = np.zeros((len(series), len(groups)))
        self._counts = np.zeros((len(series), len(groups)))
        self._missing = np.ones(len(tasks), bool)
        self._begun = np.full(len(tasks), np.nan)
        # What runs took beyond what they say: sending, keeping, and other programs [s].
        self._more: list[float] = []

    def begin(self) -> None:
        """Take notice that as many tasks as there are workers are under way."""
        under_way = np.flatnonzero(self._missing)[: self._workers]
        fresh = under_way[np.isnan(self._begun[under_way])]
        self._begun[fresh] = clock.monotonic()

    def add(self, task: Task, outcome: Outcome) -> None:
        """Take notice of a run that is done."""
        k = self._place[task.key]
        self._missing[k] = False
        spent = _run_duration(task, outcome)
        if not np.isnan(self._begun[k]):
            passed = clock.monotonic() - self._begun[k]
            self._more.append(0.0 if spent is None else max(passed - spent, 0.0))
            spent = passed if spent is None else spent
        if spent is not None and spent > 0.0:
            cell = (self._series[k], self._group[k])
            self._sums[cell] += math.log(spent) - self._prior[k]
            self._counts[cell] += 1.0

    @property
    def left(self) -> float | None:
        """Remaining seconds; None if nothing is known of any run."""
        if not self._missing.any():
            return 0.0
        if not self._counts.any():
            return None
        weights = self._of_series @ _weight_groups(self._counts)
        means = self._of_series @ _weight_groups(self._sums) / weights
        expected = np.exp(self._prior + means[self._series, self._group])
        expected = np.minimum(expected, self._most)[self._missing]
        begun = self._begun[self._missing]
        passed = np.where(np.isnan(begun), 0.0, clock.monotonic() - begun)
        rest = np.maximum(expected - passed, _MORE * np.minimum(passed, expected))
        # The first run of each process has its start in it.
        more = self._more[self._workers :]
        rest += float(np.median(more)) if more else 0.0
        return float(max(rest.sum() / self._workers, rest.max()))


def _weight_groups(values: np.ndarray) -> np.ndarray:
    """What counts for a group: its own values, and a share of all others."""
    return _OTHER_GROUP * values.sum(axis=1, keepdims=True) + (1.0 - _OTHER_GROUP) * values


def _number_names(names: Sequence[str]) -> tuple[list[str], np.ndarray]:
    known = {name: k for k, name in enumerate(dict.fromkeys(names))}
    return list(known), np.array([known[name] for name in names], int)


def _log_step_count(task: Task) -> float:
    """Logarithm of the number of steps of a task, or what stands for it."""
    name, value = task.case.integrator.accuracy
    steps = task.t_end / value if name == "step" else _STEPS * (_RTOL / value) ** _POWER
    return math.log(max(steps, 1.0) * task.repetitions)


def _max_duration(task: Task) -> float:
    limit = task.limits.time
    return math.inf if limit is None else limit * task.repetitions


def _run_duration(task: Task, outcome: Outcome) -> float | None:
    """What a run took, if its outcome says so [s]."""
    times = [outcome.values.get(f"{what} time [s]") for what in ("setup", "wall", "measuring")]
    if not all(isinstance(x, float) and math.isfinite(x) for x in times):
        return None
    setup, wall, rest = (float(x) for x in times if x is not None)
    return setup + task.repetitions * wall + rest


@dataclass(frozen=True)
class StudyProgress:
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


class ProgressCounter:
    """How far a study is, for those who want to hear of it."""

    def __init__(
        self,
        tasks: list[Task],
        outcomes: Mapping[str, Outcome],
        workers: int,
        progress: Callable[[StudyProgress], None] | None,
    ) -> None:
        self._progress, self._workers = progress, workers
        self._total, self._done, self._kept = len(tasks), len(outcomes), len(outcomes)
        self._failed = sum(not outcome.status.success for outcome in outcomes.values())
        self._forecast = TimeEstimator(tasks, workers)
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
        self._progress(StudyProgress(*counts, last, self._forecast.left))
