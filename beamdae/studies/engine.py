"""Run a study: what is on disk already is kept, the rest is done, then everything is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.studies.case import Case
from beamdae.studies.definition import Study
from beamdae.studies.pool import Executor
from beamdae.studies.references import Reference, agreed, group_key, groups, reference_tasks
from beamdae.studies.store import Store
from beamdae.studies.tables import case_table, mesh_summary, row, summary
from beamdae.studies.work import Outcome, Task

NOT_RUN = "not run, the study was interrupted"


@dataclass(frozen=True)
class Progress:
    """How far a study is.

    Attributes
    ----------
    total, done, failed, kept
        Runs there are (references included), done by now, failed among them, and found on disk.
    last
        Label of the run that ended last.
    """

    total: int
    done: int
    failed: int
    kept: int
    last: str


@dataclass(frozen=True)
class Results:
    """What became of a study.

    Attributes
    ----------
    table
        One row a case, failures included.
    summary
        What the rows come to, by group.
    references
        By group.
    outcomes
        By fingerprint.
    frames
        Shapes of the bodies over time, by `Case.mechanism`.
    interrupted
        Whether cases were left out; a second start goes on.
    """

    study: Study
    folder: Path
    table: pd.DataFrame
    summary: pd.DataFrame
    references: dict[str, Reference]
    outcomes: dict[str, Outcome]
    frames: dict[str, Any]
    interrupted: bool

    def outcome(self, case: Case) -> Outcome:
        """The outcome of a case."""
        return self.outcomes.get(self.study.task(case).key, Outcome(NOT_RUN))

    @property
    def failed(self) -> bool:
        """Whether no case succeeded, or a group has no reference to be measured against."""
        nothing = not (self.table["status"] == "ok").any()
        return nothing or any(r.table is None for r in self.references.values())

    def to_parquet(self) -> list[Path]:
        """Write the trajectories as Parquet beside their CSV; returns the paths.

        Raises
        ------
        BeamdaeError
            If there is no Parquet engine.
        """
        paths = []
        for key, outcome in self.outcomes.items():
            if outcome.table is None:
                continue
            paths.append(Store(self.folder).trajectory(key).with_suffix(".parquet"))
            try:
                outcome.table.reset_index().to_parquet(paths[-1], index=False)
            except ImportError:
                raise BeamdaeError(
                    "--parquet: it needs an engine, pip install 'beamdae[parquet]'."
                ) from None
        return paths


def run(
    study: Study,
    folder: Path,
    executor: Executor,
    progress: Callable[[Progress], None] | None = None,
) -> Results:
    """Run the cases of a study and their references, and write its tables to `folder`.

    Finished runs are kept there by a hash of what they depend on; they are not done again. An
    interrupt (Ctrl-C) ends the runs under way and measures what there is.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written.
    """
    store = Store(folder)
    methods = {g: reference_tasks(study, cases) for g, cases in groups(study).items()}
    tasks = _unique(
        [task for group in methods.values() for method in group for task in method]
        + [study.task(case) for case in study.cases]
    )
    outcomes = {task.key: store.outcome(task.key) for task in tasks if task.key in store}
    interrupted = _perform(tasks, outcomes, store, executor, progress)
    references = {
        group: agreed(study, tasks_of, outcomes)
        for group, tasks_of in methods.items()
        if all(task.key in outcomes for method in tasks_of for task in method)
    }
    rows = []
    for case in study.cases:
        outcome = outcomes.get(study.task(case).key, Outcome(NOT_RUN))
        group = group_key(study, case)
        try:
            rows.append(row(case, group, outcome, references.get(group)))
        except BeamdaeError as problem:
            rows.append(row(case, group, Outcome(str(problem), outcome.values), None))
    table = case_table(rows)
    found = summary(table) if study.over is None else mesh_summary(table, study.over)
    frames = {
        task.case.mechanism(): outcomes[task.key].frames
        for task in tasks
        if task.key in outcomes and outcomes[task.key].frames is not None
    }
    results = Results(study, folder, table, found, references, outcomes, frames, interrupted)
    _write(results)
    return results


def _unique(tasks: list[Task]) -> list[Task]:
    return list({task.key: task for task in tasks}.values())


def _perform(
    tasks: list[Task],
    outcomes: dict[str, Outcome],
    store: Store,
    executor: Executor,
    progress: Callable[[Progress], None] | None,
) -> bool:
    """Do what is not there yet and add it; returns whether it was interrupted."""
    missing = [task for task in tasks if task.key not in outcomes]
    kept = len(outcomes)
    failed = sum(outcome.status != "ok" for outcome in outcomes.values())
    if progress is not None:
        progress(Progress(len(tasks), kept, failed, kept, ""))
    if not missing:
        return False
    try:
        for task, outcome, keep in executor.outcomes(missing):
            outcomes[task.key] = outcome
            if keep and not outcome.status.startswith("interrupted"):
                store.keep(task.key, outcome)
            failed += outcome.status != "ok"
            if progress is not None:
                label = f"{task.case.group}, {task.case.label}"
                progress(Progress(len(tasks), len(outcomes), failed, kept, label))
    except KeyboardInterrupt:
        return True
    return False


def _write(results: Results) -> None:
    try:
        results.folder.mkdir(parents=True, exist_ok=True)
        results.table.to_csv(results.folder / "cases.csv", index=False)
        results.summary.to_csv(results.folder / "summary.csv", index=False)
    except OSError as problem:
        raise BeamdaeError(
            f"{results.folder}: it cannot be written, {problem.strerror}."
        ) from problem
