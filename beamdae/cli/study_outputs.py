"""Runs, files and messages of `beamdae compare` and `sweep`; results survive an interrupt."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli import signals
from beamdae.cli.command_wrapper import NOT_RUN_CODE
from beamdae.cli.options import parse_start, split_names
from beamdae.cli.output import print_error
from beamdae.cli.output_paths import require_writable
from beamdae.cli.progress import show_study_progress
from beamdae.cli.results import Report, ResultFiles
from beamdae.errors import format_count, require_positive
from beamdae.interrupts import Interrupted, acknowledge

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.report.terminal.responsive_table import ResponsiveTable
    from beamdae.studies import Study
    from beamdae.studies.execution.study_progress import StudyProgress
    from beamdae.studies.execution.study_run import StudyResults

    # Functions that write files and return their paths, by name.
    FileWriters = dict[str, Callable[[], list[Path]]]

# Statuses of runs that are computed when the study resumes.
MISSING_KINDS = ("interrupted", "not run")
PAGE_FILE = "report.html"
# Longer tables are only written to files and the page.
MAX_SCREEN_ROWS = 16
_MAX_FOLDER_NAME = 100  # characters
_FILE_SUFFIXES = {".csv", ".html", ".png"}
_RESUME_HINT = "run the same command again to resume"


def results_folder_name(stem: str, settings: Mapping[str, Any]) -> str:
    """Return the name of the results folder; long names are shortened and end with a hash."""
    from beamdae.studies.store.fingerprints import digest

    parts = [re.sub(r"[^A-Za-z0-9.=-]+", "-", f"{key}={value}") for key, value in settings.items()]
    name = "_".join([stem, *parts])
    if len(name) > _MAX_FOLDER_NAME:
        name = f"{name[:_MAX_FOLDER_NAME]}_{digest(settings)[:8]}"
    return name


def apply_run_options(
    command: str,
    study: Study,
    time_limit: float | None,
    t_end: float | None,
    output_step: float | None,
    start: list[str] | None,
    columns: list[str] | None,
) -> Study:
    """Return the study with the settings of runs and the columns of options, for all its cases.

    Raises
    ------
    BeamdaeError
        If a value is not positive, or a start has the wrong form.
    """
    if time_limit is not None:
        limit = require_positive(command, "--time-limit", time_limit)
        study = replace(study, time_limit=limit)
    if t_end is not None:
        study = replace(study, t_end=t_end)
    if output_step is not None:
        study = replace(study, output_step=output_step)
    if columns:
        study = replace(study, columns=tuple(split_names(columns, study.cases[0].model)))
    if start:
        from beamdae.parts.mechanism import require_start

        state = require_start(command, parse_start(start, study.cases[0].configured()))
        study = replace(study, cases=tuple(replace(case, start=state) for case in study.cases))
    return study


@dataclass(frozen=True)
class StudyReport:
    """Report on the results of a study.

    Attributes
    ----------
    report
        What the command prints.
    failures
        Lines about failures besides those of the cases.
    tables, page, pictures
        Functions that write the tables besides those of every study, the page and the pictures.
    """

    report: Report
    failures: list[str]
    tables: FileWriters
    page: FileWriters
    pictures: FileWriters


def run_and_write(
    command: str,
    study: Study,
    folder: Path,
    create_report: Callable[[StudyResults], StudyReport],
    executor: tuple[int | None, str | None],
    files: tuple[bool, bool],
) -> None:
    """Run a study, write its tables, print its results, and write its page and pictures.

    The command exits with 1 if no case succeeded or a reference or file is missing, with 3 if
    processes or a cluster failed so that runs are missing, and with 130 or 143 after an interrupt.
    SIGTERM skips the page and the pictures.

    Parameters
    ----------
    command, study, folder
        Name of the command, the study, and the folder of its results.
    create_report
        Function that returns the report on the results.
    executor
        Values of --jobs and --scheduler.
    files
        True to write the page, and the pictures.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written.
    """
    has_page, has_pictures = files
    # All existing files, the case table, and a file in the folder of the records.
    existing = [path for path in folder.glob("*.*") if path.suffix in _FILE_SUFFIXES]
    planned = [*existing, folder / "cases.csv", folder / "outcomes" / "record.json"]
    require_writable(("--out", dict.fromkeys(planned)))
    written, report, n_runs = ResultFiles(), None, 0
    try:
        # The exception may have been swallowed, for example by a callback of other code.
        if signals.is_interrupted():
            raise KeyboardInterrupt
        from beamdae.studies.execution.executors import create_executor
        from beamdae.studies.execution.study_run import run_study

        with signals.defer_interrupts(immediate=1):
            with show_study_progress() as show_progress:

                def update(progress: StudyProgress) -> None:
                    nonlocal n_runs
                    n_runs = progress.total
                    show_progress(progress)

                runner = create_executor(command, "--", *executor)
                results = run_study(study, folder, runner, update)
            written.paths += [results.folder / name for name in results.tables]
            report = create_report(results)
            for name in (*report.page, *(f"{x}.png" for x in report.pictures)):
                written.remove(results.folder / name)
            _write(written, report.tables)
    except KeyboardInterrupt:
        if report is None:
            reason = f"interrupted before any table was written; {_RESUME_HINT}"
            raise Interrupted(reason) from None
        acknowledge()
    report.report.print()
    print_failures(results, report.failures)
    try:
        if not signals.is_terminated():
            _write(written, report.page if has_page else {})
            _write(written, report.pictures if has_pictures else {})
    except KeyboardInterrupt:
        acknowledge()
    written.print_paths()
    missing = results.not_run
    if results.interrupted or signals.is_interrupted():
        n_done = sum(x.status.kind not in MISSING_KINDS for x in results.outcomes.values())
        print_error(f"interrupted, {n_done} of {n_runs} runs done; {_RESUME_HINT}")
        raise typer.Exit(signals.exit_code())
    if missing:
        reason = missing[0].status.sentence
        print_error(f"not run: {len(missing)} of {n_runs} runs, because {reason}; {_RESUME_HINT}")
        raise typer.Exit(NOT_RUN_CODE)
    if results.failed or written.failed:
        raise typer.Exit(1)


def _write(files: ResultFiles, writers: FileWriters) -> None:
    for name, write in writers.items():
        files.write(name, write)


def first_cases(name: str, table: ResponsiveTable) -> dict[str, Any]:
    """Return a table of cases by its title, and the number of cases beyond the first 16."""
    rows, n_more = table.rows[:MAX_SCREEN_ROWS], len(table.rows) - MAX_SCREEN_ROWS
    more = {f"more {name}": f"not shown: {format_count(n_more, 'case')}; see {table.source}"}
    return {name: replace(table, rows=rows), **(more if n_more > 0 else {})}


def print_failures(results: StudyResults, failures: list[str]) -> None:
    """Print a line for each of the first 16 unsuccessful cases, and the number of further ones.

    Interrupted cases and cases that were not run are omitted.
    """
    from beamdae.report.terminal import text_tables

    reasons = text_tables.failure_sentences(
        results.table[~results.table["status"].isin(MISSING_KINDS)]
    )
    for reason in [*failures[:MAX_SCREEN_ROWS], *reasons[:MAX_SCREEN_ROWS]]:
        print_error(f"failed: {reason}")
    if len(reasons) > MAX_SCREEN_ROWS:
        print_error(f"further failures: {len(reasons) - MAX_SCREEN_ROWS}; see cases.csv")
