"""Runs, files and messages of `beamdae compare` and `sweep`; results survive an interrupt."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli import process
from beamdae.cli.option_values import split_names
from beamdae.cli.options import (
    EndTime,
    Jobs,
    ModelName,
    Out,
    OutputStep,
    Page,
    Pictures,
    Scheduler,
    Settings,
    Starts,
    StudyPath,
    TimeLimit,
    parse_start,
)
from beamdae.cli.output import require_writable
from beamdae.cli.progress import show_study_progress
from beamdae.cli.results import Report, ResultFiles, run_analysis
from beamdae.errors import require_positive
from beamdae.interrupts import Interrupted

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.results.outcome import Status
    from beamdae.studies.definition import Study
    from beamdae.studies.study_run import StudyResults
    from beamdae.studies.tasks import StudyProgress

# Statuses of runs that are computed when the study resumes.
MISSING_KINDS = ("interrupted", "not run")
PAGE_FILE = "report.html"
_MAX_FOLDER_NAME = 100  # characters
_FILE_SUFFIXES = {".csv", ".html", ".png"}
_RESUME_HINT = "run the same command again to resume"


def results_folder_name(stem: str, settings: Mapping[str, Any]) -> str:
    """Return the name of the results folder; long names are shortened and end with a hash."""
    from beamdae.studies.fingerprints import digest

    parts = [re.sub(r"[^A-Za-z0-9.=-]+", "-", f"{key}={value}") for key, value in settings.items()]
    name = "_".join([stem, *parts])
    if len(name) > _MAX_FOLDER_NAME:
        name = f"{name[:_MAX_FOLDER_NAME]}_{digest(settings)[:8]}"
    return name


@dataclass(frozen=True)
class StudyReport:
    """Report on the results of a study.

    Attributes
    ----------
    results
        The results.
    report
        What the command prints.
    tables
        Paths of the tables.
    write_page
        Function that writes the page.
    pictures
        Functions that return the pictures, or None, by file name.
    """

    results: StudyResults
    report: Report
    tables: list[Path]
    write_page: Callable[[Path], Path]
    pictures: Mapping[str, Callable[[], Any]]


@dataclass
class StudyJob:
    """Study of a command, whose fields are its name, its first argument and its options.

    Attributes
    ----------
    command
        Name of the command.
    """

    command: str
    path: StudyPath
    settings: Settings = None
    model_name: ModelName = None
    out: Out = Path("results")
    time_limit: TimeLimit = None
    t_end: EndTime = None
    output_step: OutputStep = None
    start: Starts = None
    jobs: Jobs = None
    scheduler: Scheduler = None
    page: Page = True
    picture: Pictures = True

    def run(
        self,
        study: Study,
        columns: list[str] | None,
        create_report: Callable[[StudyResults], StudyReport],
    ) -> None:
        """Run a study, write its tables, print its results, and write its page and pictures.

        The command exits with 1 if no case succeeded or a reference or file is missing, with 3 if
        processes or a cluster failed so that runs are missing, and with 130 or 143 after an
        interrupt. SIGTERM skips the page and the pictures.

        Parameters
        ----------
        study, columns
            The study, and the observed columns of its errors or responses by an option.
        create_report
            Function that returns the report on the results, after writing further tables.

        Raises
        ------
        BeamdaeError
            If an option is not valid, or the folder cannot be written.
        """
        study, folder = self._configure(study, columns), self.out / study.name
        # All existing files, the case table, and a file in the folder of the records.
        existing = [path for path in folder.glob("*.*") if path.suffix in _FILE_SUFFIXES]
        planned = [*existing, folder / "cases.csv", folder / "outcomes" / "record.json"]
        require_writable(("--out", dict.fromkeys(planned)))
        page = folder / PAGE_FILE
        written, n_runs = ResultFiles(table=planned[-2], page=page if self.page else None), 0

        def analyze() -> StudyReport:
            try:
                # The exception may have been swallowed, for example by a callback of other code.
                if process.is_interrupted():
                    raise KeyboardInterrupt
                from beamdae.studies.executors import create_executor
                from beamdae.studies.study_run import run_study

                with show_study_progress() as show_progress:

                    def update(progress: StudyProgress) -> None:
                        nonlocal n_runs
                        n_runs = progress.total
                        show_progress(progress)

                    runner = create_executor(self.command, "--", self.jobs, self.scheduler)
                    return create_report(run_study(study, folder, runner, update))
            except KeyboardInterrupt:
                reason = f"interrupted before any table was written; {_RESUME_HINT}"
                raise Interrupted(reason) from None

        def write_tables(study: StudyReport) -> list[Path]:
            written.note_earlier((page, *map(folder.joinpath, study.pictures)))
            return study.tables

        def describe(study: StudyReport) -> Report:
            from beamdae.report import tables

            written.failed |= study.results.failed
            rows = study.results.table
            failed = tables.failure_sentences(rows[~rows["status"].isin(MISSING_KINDS)])
            failures = [*study.report.failures, *failed]
            status = _describe_end(study.results, n_runs)
            return replace(study.report, failures=failures, status=status)

        def write_pictures(study: StudyReport) -> None:
            for name, create in study.pictures.items() if self.picture else ():
                written.draw(folder / name, create)

        run_analysis(
            written,
            lambda _: study.name,
            analyze,
            write_tables,
            describe,
            lambda study, path, _: study.write_page(path),
            lambda *_: None,
            write_pictures,
        )

    def _configure(self, study: Study, columns: list[str] | None) -> Study:
        """Return the study with the settings of runs and the columns, for all its cases."""
        settings: dict[str, Any] = {"t_end": self.t_end, "output_step": self.output_step}
        if self.time_limit is not None:
            limit = require_positive(self.command, "--time-limit", self.time_limit)
            settings["time_limit"] = limit
        settings["columns"] = tuple(split_names(columns)) or None
        if self.start:
            from beamdae.parts.mechanism import require_start

            start = parse_start(self.start, study.cases[0].configured())
            start = require_start(self.command, start)
            settings["cases"] = tuple(replace(case, start=start) for case in study.cases)
        return replace(study, **{name: x for name, x in settings.items() if x is not None})


def _describe_end(results: StudyResults, n_runs: int) -> Status | None:
    """Return the status of a study with missing runs, which resumes with them."""
    from beamdae.results.outcome import Status

    if results.interrupted or process.is_interrupted():
        n_done = sum(x.status.kind not in MISSING_KINDS for x in results.outcomes.values())
        reason = f"interrupted, {n_done} of {n_runs} runs done; {_RESUME_HINT}"
        return Status("interrupted", reason)
    if missing := results.not_run:
        reason = f"because {missing[0].status.sentence}; {_RESUME_HINT}"
        return Status("not run", f"{len(missing)} of {n_runs} runs, {reason}")
    return None
