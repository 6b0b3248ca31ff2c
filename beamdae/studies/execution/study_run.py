"""All runs of a study: its cases and their references, each once."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd

from beamdae.errors import BeamdaeError, BeamdaeWarning
from beamdae.results.columns import observed_columns
from beamdae.results.outcome import Status
from beamdae.results.storage.files import escape_table, write_bytes, write_text
from beamdae.studies.case import Case, DigestCache
from beamdae.studies.case_summaries import summarize_cases, summarize_mesh_study
from beamdae.studies.case_table import assemble_case_table, tabulate_case
from beamdae.studies.definition import Study
from beamdae.studies.deviations import select_observed_columns
from beamdae.studies.execution.case_run import NOT_RUN, Outcome, Task
from beamdae.studies.execution.deferred_interrupts import DeferredInterrupts
from beamdae.studies.execution.executors import Executor
from beamdae.studies.execution.study_progress import ProgressCounter, StudyProgress
from beamdae.studies.references import REFERENCE_NOT_RUN as NO_REFERENCE
from beamdae.studies.references import (
    Reference,
    build_reference,
    create_reference_tasks,
    group_cases,
)
from beamdae.studies.store.store import Store
from beamdae.studies.unique_names import create_file_names


@dataclass(frozen=True)
class StudyPlan:
    """All runs of a study, with fingerprints that were taken once.

    Attributes
    ----------
    of_cases
        The task of each case, by its identity.
    group_of
        The group of each case, likewise.
    methods
        The tasks of the two methods of the reference of each group in which errors are asked for.
    tasks
        Each run once.
    """

    study: Study
    of_cases: dict[int, Task]
    group_of: dict[int, str]
    methods: dict[str, list[list[Task]]]
    tasks: list[Task]

    @classmethod
    def of(cls, study: Study) -> StudyPlan:
        """The plan of a study as its models are now."""
        digests: DigestCache = {}
        of_cases = {id(case): study.task(case, digests=digests) for case in study.cases}
        found = group_cases(study, of_cases, digests)
        methods = {
            group: create_reference_tasks(study, cases, digests)
            for group, cases in found.items()
            if study.computes_errors(len({of_cases[id(case)].key for case in cases}))
        }
        of_references = [task for group in methods.values() for m in group for task in m]
        group_of = {id(case): group for group, cases in found.items() for case in cases}
        return cls(
            study, of_cases, group_of, methods, _merge_tasks([*of_references, *of_cases.values()])
        )


def _merge_tasks(tasks: list[Task]) -> list[Task]:
    """Each run once, with all that any of those who want it ask for, and a name of its own."""
    found: dict[str, Task] = {}
    for task in tasks:
        earlier = found.setdefault(task.key, task)
        found[task.key] = replace(
            earlier,
            repetitions=max(earlier.repetitions, task.repetitions),
            animated=earlier.animated or task.animated,
        )
    names = create_file_names((task.case.group, task.case.label) for task in found.values())
    return [replace(x, name=name) for x, name in zip(found.values(), names, strict=True)]


# More sentences of one kind are counted.
_MAX_NOTES = 20


@dataclass(frozen=True)
class StudyResults:
    """What became of a study.

    Attributes
    ----------
    table
        One row a case, failures included.
    summary
        What the rows come to, by group.
    references
        By group, of those in which errors are asked for.
    outcomes
        By fingerprint.
    frames
        Shapes of the bodies over time, by `Case.mechanism_fingerprint`.
    interrupted
        Whether there was an interrupt; a second start goes on.
    notes
        What there is to say of results on disk that could not be used.
    keys
        Fingerprints of the cases, as they were when it was run.
    """

    study: Study
    folder: Path
    table: pd.DataFrame
    summary: pd.DataFrame
    references: dict[str, Reference]
    outcomes: dict[str, Outcome]
    frames: dict[str, Any]
    interrupted: bool
    notes: tuple[str, ...] = ()
    keys: Mapping[int, Task] = field(default_factory=dict, repr=False)

    def outcome(self, case: Case) -> Outcome:
        """The outcome of a case."""
        return self.outcomes.get(self._task(case).key, NOT_RUN)

    def frames_of(self, case: Case) -> dict[str, Any] | None:
        """Shapes of the bodies over time, of whatever run of the same mechanism has them."""
        return self.frames.get(self._task(case).mechanism_fingerprint)

    def _task(self, case: Case) -> Task:
        # By identity: what a model refers to may have changed since.
        return self.keys.get(id(case)) or self.study.task(case)

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """By the names of their files; where no error can be asked for there is no summary."""
        asked = self.study.computes_errors(len(self.study.cases))
        return {"cases.csv": self.table} | ({"summary.csv": self.summary} if asked else {})

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
        for outcome in self.outcomes.values():
            table = outcome.table
            if table is None or not outcome.file:
                continue
            path = (self.folder / "trajectories" / outcome.file).with_suffix(".parquet")
            content = table.reset_index().to_parquet(index=False)
            write_bytes(path, content)
            paths.append(path)
        return paths


def run_study(
    study: Study,
    folder: Path,
    executor: Executor,
    progress: Callable[[StudyProgress], None] | None = None,
) -> StudyResults:
    """Run the cases of a study and their references, and write its tables to `folder`.

    Finished runs are kept there by a hash of what they depend on; they are not done again. An
    interrupt (Ctrl-C) ends the runs under way and measures what there is.

    An interrupt at any other time, and any further one, waits until the tables are written.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written, or the first case has no such columns.

    Warns
    -----
    BeamdaeWarning
        Of results on disk that are damaged, which are run again.
    """
    with DeferredInterrupts() as interrupts:
        plan = StudyPlan.of(study)
        store = Store(folder)
        store.remove_scratch_files()
        notes, outcomes = load_stored_outcomes(plan, store, interrupts)
        for sentence in notes:
            warnings.warn(sentence, BeamdaeWarning, stacklevel=2)
        interrupted = _run_missing_tasks(plan, outcomes, store, executor, progress, interrupts)
        results = _evaluate_outcomes(plan, folder, outcomes, notes)
        _write_tables(results)
        return replace(results, interrupted=interrupted or interrupts.noted)


def load_stored_outcomes(
    plan: StudyPlan, store: Store, interrupts: DeferredInterrupts
) -> tuple[tuple[str, ...], dict[str, Outcome]]:
    """Sentences on what is damaged, and the outcomes that are on disk and serve."""
    outcomes: dict[str, Outcome] = {}
    damaged: list[str] = []
    for task in plan.tasks:
        if interrupts.noted:
            break
        outcome, problem = store.load(task)
        if outcome is not None:
            outcomes[task.key] = outcome
        if problem:
            damaged.append(f"{store.folder}: {problem}, so {task.case.label} is run again.")
    if len(damaged) > _MAX_NOTES:
        more = len(damaged) - _MAX_NOTES
        damaged[_MAX_NOTES:] = [f"{store.folder}: {more} more results are damaged and run again."]
    return tuple(damaged), outcomes


def _evaluate_outcomes(
    plan: StudyPlan,
    folder: Path,
    outcomes: dict[str, Outcome],
    notes: tuple[str, ...],
) -> StudyResults:
    """The tables, from whatever outcomes there are."""
    study = plan.study
    references = {
        group: build_reference(study, tasks_of, outcomes)
        if all(task.key in outcomes for method in tasks_of for task in method)
        else NO_REFERENCE
        for group, tasks_of in plan.methods.items()
    }
    rows = [_create_row(plan, case, outcomes, references) for case in study.cases]
    table = assemble_case_table(rows)
    found = (
        summarize_cases(table) if study.over is None else summarize_mesh_study(table, study.over)
    )
    frames = {
        task.mechanism_fingerprint: outcomes[task.key].frames
        for task in plan.tasks
        if task.key in outcomes and outcomes[task.key].frames is not None
    }
    return StudyResults(
        study, folder, table, found, references, outcomes, frames, False, notes, plan.of_cases
    )


def _create_row(
    plan: StudyPlan, case: Case, outcomes: dict[str, Outcome], references: dict[str, Reference]
) -> dict[str, Any]:
    group = plan.group_of[id(case)]
    outcome = outcomes.get(plan.of_cases[id(case)].key, NOT_RUN)
    try:
        found = tabulate_case(case, group, outcome, references.get(group))
    except BeamdaeError as problem:
        failed = Outcome(Status("failed", str(problem)), outcome.values)
        found = tabulate_case(case, group, failed, NO_REFERENCE)
    return found | {"trajectory": f"trajectories/{outcome.file}" if outcome.file else ""}


def _run_missing_tasks(
    plan: StudyPlan,
    outcomes: dict[str, Outcome],
    store: Store,
    executor: Executor,
    progress: Callable[[StudyProgress], None] | None,
    interrupts: DeferredInterrupts,
) -> bool:
    """Do what is not there yet and add it; returns whether it was interrupted."""
    missing = [task for task in plan.tasks if task.key not in outcomes]
    count = ProgressCounter(plan.tasks, outcomes, executor.workers, progress)
    count.tell("")
    if interrupts.noted:
        return True
    try:
        interrupts.raising = True
        # Where nothing is missing as well: a pool ends what it has opened once it is gone through.
        with closing(executor.outcomes(missing)) as found:
            for task, outcome, keep in found:
                _require_columns(plan, task, outcome)
                if keep and outcome.status.kind != "interrupted":
                    outcome = store.save(task, outcome)
                outcomes[task.key] = outcome
                count.add(task, outcome)
                count.tell(f"{task.case.group}, {task.case.label}")
        interrupts.raising = False
    except KeyboardInterrupt:
        return True
    finally:
        interrupts.raising = False
    return False


def _require_columns(plan: StudyPlan, task: Task, outcome: Outcome) -> None:
    """Refuse a column the model of the first case does not observe, as soon as that is known.

    Not by a look at the model: whatever it does when it is built, no process but its own does it.
    """
    study = plan.study
    table = outcome.table if study.columns and task.case.model is study.cases[0].model else None
    if table is not None:
        select_observed_columns(study.name, study.columns, observed_columns(table))


def _write_tables(results: StudyResults) -> None:
    for name, table in results.tables.items():
        text = escape_table(table).to_csv(index=False, lineterminator="\n")
        write_text(results.folder / name, text)
