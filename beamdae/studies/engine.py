"""Run a study: what is on disk already is kept, the rest is done, then everything is measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.results.solution import Status
from beamdae.simulation import as_equations
from beamdae.studies.case import Case
from beamdae.studies.definition import Study
from beamdae.studies.deviations import require_columns
from beamdae.studies.pool import Executor
from beamdae.studies.references import NOT_RUN as NO_REFERENCE
from beamdae.studies.references import Reference, agreed, group_key, groups, reference_tasks
from beamdae.studies.store import Store
from beamdae.studies.tables import case_table, mesh_summary, row, summary
from beamdae.studies.work import NOT_RUN, Outcome, Task


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
    """

    total: int
    done: int
    failed: int
    kept: int
    running: int
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
        return self.outcomes.get(self.study.task(case).key, NOT_RUN)

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
            If a file cannot be written.
        """
        paths = []
        for key, outcome in self.outcomes.items():
            if outcome.table is None:
                continue
            paths.append(Store(self.folder).trajectory(key).with_suffix(".parquet"))
            try:
                outcome.table.reset_index().to_parquet(paths[-1], index=False)
            except OSError as problem:
                raise BeamdaeError(
                    f"{paths[-1]}: it cannot be written, {problem.strerror}."
                ) from problem
        return paths


def run(
    study: Study,
    folder: Path,
    executor: Executor,
    progress: Callable[[Standing], None] | None = None,
) -> Results:
    """Run the cases of a study and their references, and write its tables to `folder`.

    Finished runs are kept there by a hash of what they depend on; they are not done again. An
    interrupt (Ctrl-C) ends the runs under way and measures what there is.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written, or the first case has no such columns.
    """
    _check_columns(study)
    store = Store(folder)
    methods = {g: reference_tasks(study, cases) for g, cases in groups(study).items()}
    tasks = _unique(
        [task for group in methods.values() for method in group for task in method]
        + [study.task(case) for case in study.cases]
    )
    stored = ((task.key, store.outcome(task)) for task in tasks)
    outcomes = {key: outcome for key, outcome in stored if outcome is not None}
    interrupted = _perform(tasks, outcomes, store, executor, progress)
    references = {
        group: agreed(study, tasks_of, outcomes)
        if all(task.key in outcomes for method in tasks_of for task in method)
        else NO_REFERENCE
        for group, tasks_of in methods.items()
    }
    rows = [_row(study, case, outcomes, references) for case in study.cases]
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


def _check_columns(study: Study) -> None:
    """Refuse a column the first case does not observe, before the work is done."""
    if not study.columns:
        return
    try:
        observables = as_equations(study.cases[0].configured()).observables
    except Exception:  # What is wrong with it is for its own row to say.
        return
    present = [header for observable in observables for header in observable.headers]
    require_columns(study.name, study.columns, present)


def _row(
    study: Study, case: Case, outcomes: dict[str, Outcome], references: dict[str, Reference]
) -> dict[str, Any]:
    task, group = study.task(case), group_key(study, case)
    outcome = outcomes.get(task.key, NOT_RUN)
    try:
        found = row(case, group, outcome, references[group])
    except BeamdaeError as problem:
        failed = Outcome(Status("failed", str(problem)), outcome.values)
        found = row(case, group, failed, NO_REFERENCE)
    has_rows = outcome.table is not None
    return found | {"trajectory": f"trajectories/{task.key}.csv" if has_rows else ""}


def _unique(tasks: list[Task]) -> list[Task]:
    """Each run once, with all that any of those who want it ask for."""
    found: dict[str, Task] = {}
    for task in tasks:
        earlier = found.setdefault(task.key, task)
        found[task.key] = replace(
            earlier,
            repetitions=max(earlier.repetitions, task.repetitions),
            animated=earlier.animated or task.animated,
        )
    return list(found.values())


def _perform(
    tasks: list[Task],
    outcomes: dict[str, Outcome],
    store: Store,
    executor: Executor,
    progress: Callable[[Standing], None] | None,
) -> bool:
    """Do what is not there yet and add it; returns whether it was interrupted."""
    missing = [task for task in tasks if task.key not in outcomes]
    kept = len(outcomes)
    failed = sum(not outcome.status.success for outcome in outcomes.values())
    if progress is not None:
        busy = min(executor.workers, len(missing))
        progress(Standing(len(tasks), kept, failed, kept, busy, ""))
    if not missing:
        return False
    try:
        for task, outcome, keep in executor.outcomes(missing):
            outcomes[task.key] = outcome
            if keep and outcome.status.kind != "interrupted":
                store.keep(task, outcome)
            failed += not outcome.status.success
            if progress is not None:
                label = f"{task.case.group}, {task.case.label}"
                busy = min(executor.workers, len(tasks) - len(outcomes))
                progress(Standing(len(tasks), len(outcomes), failed, kept, busy, label))
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
