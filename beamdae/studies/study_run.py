"""Run of a study: load stored outcomes, run the missing tasks, and tabulate the results."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from beamdae.errors import (
    BeamdaeError,
    KernelWarning,
    ProgressError,
    kind_of_message,
)
from beamdae.interrupts import DeferredInterrupts, acknowledge, attach_partial
from beamdae.read_only import read_only_data
from beamdae.results.columns import observed_columns, select_observed_columns
from beamdae.results.outcome import REACHED_END, Status
from beamdae.results.storage.files import write_escaped_table
from beamdae.studies.case import Case, DigestCache
from beamdae.studies.case_table import assemble_case_table, summarize_cases, tabulate_case
from beamdae.studies.definition import Study
from beamdae.studies.executors import TaskExecutor
from beamdae.studies.file_reads import register_reads
from beamdae.studies.references import (
    REFERENCE_NOT_RUN,
    Reference,
    build_reference,
    create_reference_tasks,
    group_cases,
)
from beamdae.studies.store import Store, lock_folder
from beamdae.studies.tasks import MEASURED, NOT_RUN, Outcome, StudyProgress, Task, count_runs

_CHECKED_EVERY = 20  # cases whose errors are measured, and the last one
_MAX_WARNING_KINDS = 5  # kinds of warnings that are described


@dataclass(frozen=True)
class StudyPlan:
    """Tasks of a study; their fingerprints are computed only once.

    Attributes
    ----------
    study
        The study.
    task_by_case
        Task of each case, by the `id` of the case.
    group_by_case
        Label of the group of each case, by the `id` of the case.
    methods
        For each group whose errors are computed, the tasks of the reference methods; see
        `create_reference_tasks`.
    tasks
        All tasks without duplicates.
    """

    study: Study
    task_by_case: dict[int, Task]
    group_by_case: dict[int, str]
    methods: dict[str, list[list[Task]]]
    tasks: list[Task]

    @classmethod
    def of(cls, study: Study) -> StudyPlan:
        """Return the plan of a study with the current state of its models."""
        digests: DigestCache = {}
        task_by_case = {id(case): study.task(case, digests=digests) for case in study.cases}
        groups = group_cases(study, task_by_case, digests)
        group_by_case = {id(case): group for group, cases in groups.items() for case in cases}
        methods = {
            group: create_reference_tasks(study, cases, digests)
            for group, cases in groups.items()
            if study.computes_errors(len({task_by_case[id(case)].key for case in cases}))
        }
        # References measure the errors of the other cases.
        for k, case in enumerate(study.cases):
            is_checked = k % _CHECKED_EVERY == 0 or k == len(study.cases) - 1
            is_checked &= group_by_case[id(case)] not in methods
            task_by_case[id(case)] = replace(task_by_case[id(case)], is_checked=is_checked)
        reference_tasks = [task for group in methods.values() for m in group for task in m]
        tasks = _merge_tasks([*reference_tasks, *task_by_case.values()])
        return cls(study, task_by_case, group_by_case, methods, tasks)


def _merge_tasks(tasks: list[Task]) -> list[Task]:
    """Merge tasks with the same key, with the largest number of repetitions and of frames."""
    merged: dict[str, Task] = {}
    for task in tasks:
        earlier = merged.setdefault(task.key, task)
        merged[task.key] = replace(
            earlier,
            repetitions=max(earlier.repetitions, task.repetitions),
            frames=max(earlier.frames, task.frames),
            is_checked=earlier.is_checked or task.is_checked,
        )
    return list(merged.values())


@read_only_data
@dataclass(frozen=True)
class StudyResults:
    """Results of a study.

    Attributes
    ----------
    study
        The study.
    folder
        Results folder.
    table
        One row per case, failures included.
    summary
        Summary of the table by group; see `case_table`.
    references
        References by group, for the groups whose errors are computed; see `Reference`.
    outcomes
        Outcomes by the key of the task.
    frames
        Shapes of the bodies over time from runs that recorded them, by
        `Case.mechanism_fingerprint`.
    interrupted
        True if the study was interrupted; run the study again to resume.
    task_by_case
        Task of each case when the study was run, by the `id` of the case.
    """

    study: Study
    folder: Path
    table: pd.DataFrame
    summary: pd.DataFrame
    references: dict[str, Reference]
    outcomes: dict[str, Outcome]
    frames: dict[str, Any]
    interrupted: bool
    task_by_case: Mapping[int, Task] = field(default_factory=dict, repr=False)

    def outcome(self, case: Case) -> Outcome:
        """Return the outcome of a case; `NOT_RUN` if the case was not run."""
        return self.outcomes.get(self._find_task(case).key, NOT_RUN)

    def frames_of(self, case: Case) -> dict[str, Any] | None:
        """Return the shapes of the bodies over time from any run of the same mechanism, or None."""
        return self.frames.get(self._find_task(case).mechanism_fingerprint)

    def _find_task(self, case: Case) -> Task:
        # By identity, because objects that the model refers to may have changed since the run.
        return self.task_by_case.get(id(case)) or self.study.task(case)

    @property
    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables by file name; the summary is omitted if no errors are computed."""
        tables = {"cases.csv": self.table}
        return {**tables, "summary.csv": self.summary} if self.references else tables

    @property
    def not_run(self) -> list[Outcome]:
        """Outcomes with the status "not run".

        Processes or a cluster failed before these runs were complete; run the study again to
        resume.
        """
        return [x for x in self.outcomes.values() if x.status.kind == "not run"]

    @property
    def failed(self) -> bool:
        """True if no case succeeded, or if a group lacks its reference."""
        any_success = (self.table["status"] == "ok").any()
        return not any_success or any(r.table is None for r in self.references.values())

    def describe_completion(self, cases: Sequence[Case]) -> str:
        """Return the number of cases and how the successful ones ended."""
        ends = [self.outcome(case).status for case in cases]
        n_success = sum(status.success for status in ends)
        n_measured, n_end = ends.count(MEASURED), ends.count(REACHED_END)
        n_stopped = n_success - n_measured - n_end
        counts = {"measured": n_measured, "reached the end time": n_end}
        if n_stopped:
            counts["stopped by an event"] = n_stopped
        ended = [f"{n} {end}" for end, n in counts.items() if n]
        return f"{len(ends)} cases, {', '.join(ended) or 'none completed'}"

    def describe_warnings(self) -> list[str]:
        """Return a sentence on each of the first five kinds of warnings of cases.

        Warnings of one kind differ only in the part and in numbers.
        """
        # By kind, the first warning of each case.
        kinds: dict[str, dict[int, str]] = {}
        for k, text in enumerate(self.table.get("warnings", ())):
            for warning in text.splitlines() if isinstance(text, str) else ():
                kind = kind_of_message(f": {warning.partition(': ')[2] or warning}")
                kinds.setdefault(kind, {}).setdefault(k, warning)
        sentences = []
        for cases in list(kinds.values())[:_MAX_WARNING_KINDS]:
            row, text = next(iter(cases.items()))
            group, tag = self.table["group"].iloc[row], self.study.tag(self.study.cases[row])
            label = f"{group}, {tag}" if group in self.references else tag
            count = f"{len(cases)} of {len(self.table)} cases"
            sentences.append(f"{self.study.name}: warnings in {count}, for example {label}: {text}")
        if len(kinds) > _MAX_WARNING_KINDS:
            n_more = len(kinds) - _MAX_WARNING_KINDS
            sentences.append(f"{self.study.name}: {n_more} more kinds of warnings; see cases.csv.")
        return sentences


def run_study(
    study: Study,
    folder: Path | None,
    executor: TaskExecutor,
    progress: Callable[[StudyProgress], None] | None = None,
) -> StudyResults:
    """Run the cases of a study and their references, and write its tables to `folder`.

    Finished runs are stored in `folder` and are not repeated, unless something they depend on has
    changed. An interrupt (Ctrl-C) ends the current runs, and the tables contain the outcomes so
    far. Interrupts are deferred until the tables are written if they arrive while the tables are
    written, or after the first interrupt.

    Parameters
    ----------
    study
        The study.
    folder
        Results folder, created if needed. If None, nothing remains on the disk.
    executor
        Executor that runs the cases and references.
    progress
        Function that is called with a `StudyProgress` at the start and after each run.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written, another process runs a study in the folder, or the model of
        the first case does not observe one of the columns of the study.
    Exception
        Any exception of `progress`, with the results so far as the attribute `partial`.

    Warns
    -----
    KernelWarning
        If machine code cannot be compiled or cached, here or in a worker process, or not all
        processes can be started; once per message.
    """
    if folder is None:
        with TemporaryDirectory(prefix="beamdae-") as scratch:
            return run_study(study, Path(scratch), executor, progress)
    with DeferredInterrupts() as interrupts, lock_folder(folder):
        # Nothing has been computed yet.
        interrupts.immediate = True
        plan = StudyPlan.of(study)
        store = Store(folder)
        outcomes = _load_stored_outcomes(plan, store, interrupts)
        interrupted, progress_error = False, None
        try:
            interrupted = _run_missing_tasks(plan, outcomes, store, executor, progress, interrupts)
        except ProgressError as error:
            progress_error = error.problem
        results = _evaluate_outcomes(plan, folder, outcomes)
        for name, table in results.tables.items():
            write_escaped_table(folder / name, table)
        results = replace(results, interrupted=interrupted or interrupts.received)
        if progress_error is not None:
            attach_partial(progress_error, results)
            raise progress_error
        return results


def _load_stored_outcomes(
    plan: StudyPlan, store: Store, interrupts: DeferredInterrupts
) -> dict[str, Outcome]:
    """Return the usable outcomes by key."""
    outcomes: dict[str, Outcome] = {}
    try:
        for task in plan.tasks:
            outcome = store.load(task)
            if outcome is not None:
                outcomes[task.key] = outcome
                register_reads(outcome.read, task.case.model.home)
    except KeyboardInterrupt:
        acknowledge()
    finally:
        interrupts.immediate = False
    return outcomes


def _run_missing_tasks(
    plan: StudyPlan,
    outcomes: dict[str, Outcome],
    store: Store,
    executor: TaskExecutor,
    progress: Callable[[StudyProgress], None] | None,
    interrupts: DeferredInterrupts,
) -> bool:
    """Run the tasks without an outcome, add their outcomes, and return True if interrupted."""
    missing = [task for task in plan.tasks if task.key not in outcomes]
    report = count_runs(plan.tasks, outcomes, executor.workers, progress)
    report("")
    issued_messages: set[str] = set()
    if interrupts.received:
        return True
    try:
        interrupts.immediate = True
        # Needed even if nothing is missing: an executor releases its resources when exhausted.
        with closing(executor.run_tasks(missing)) as results:
            for task, outcome in results:
                is_first_model = task.case.model is plan.study.cases[0].model
                if plan.study.columns and is_first_model and outcome.rows is not None:
                    # Raises an error if the model does not observe the columns of the study.
                    headers = observed_columns(outcome.rows.headers)
                    select_observed_columns(plan.study.name, plan.study.columns, headers)
                for message in outcome.kernel_warnings:
                    if message not in issued_messages:
                        issued_messages.add(message)
                        warnings.warn(message, KernelWarning, stacklevel=3)
                register_reads(outcome.read, task.case.model.home)
                if outcome.is_final and outcome.status.kind != "interrupted":
                    outcome = store.save(task, outcome)
                outcomes[task.key] = outcome
                case = task.case
                label = case.group if task.is_measured else f"{case.group}, {case.label}"
                report(label, outcome)
        interrupts.immediate = False
    except KeyboardInterrupt:
        acknowledge()
        return True
    finally:
        interrupts.immediate = False
    return False


def _evaluate_outcomes(
    plan: StudyPlan,
    folder: Path,
    outcomes: dict[str, Outcome],
) -> StudyResults:
    study = plan.study
    references = {
        group: build_reference(study, methods, outcomes)
        if all(task.key in outcomes for method in methods for task in method)
        else REFERENCE_NOT_RUN
        for group, methods in plan.methods.items()
    }
    rows = []
    for case in study.cases:
        group = plan.group_by_case[id(case)]
        outcome = outcomes.get(plan.task_by_case[id(case)].key, NOT_RUN)
        try:
            row = tabulate_case(case, group, outcome, references.get(group))
        except BeamdaeError as problem:
            failed = Outcome(Status("failed", str(problem)), outcome.values)
            row = tabulate_case(case, group, failed, REFERENCE_NOT_RUN)
        file = f"trajectories/{outcome.file}" if outcome.file else ""
        rows.append(row | {"trajectory": file})
    table = assemble_case_table(rows)
    frames = {
        task.mechanism_fingerprint: outcomes[task.key].frames
        for task in plan.tasks
        if task.key in outcomes and outcomes[task.key].frames is not None
    }
    return StudyResults(
        study,
        folder,
        table,
        summarize_cases(table, study.over_header),
        references,
        outcomes,
        frames,
        interrupted=False,
        task_by_case=plan.task_by_case,
    )
