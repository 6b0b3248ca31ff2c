"""Runs, files and messages of `beamdae compare` and `sweep`; results survive an interrupt."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli import signals
from beamdae.cli.command_wrapper import NOT_RUN_CODE
from beamdae.cli.options import parse_start
from beamdae.cli.output import WrittenFiles, print_error
from beamdae.cli.output_paths import require_writable
from beamdae.cli.progress import show_study_progress
from beamdae.errors import BeamdaeError, require_positive
from beamdae.interrupts import Interrupted, acknowledge

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.studies import Study
    from beamdae.studies.execution.executors import TaskExecutor
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
_FILE_SUFFIXES = {".csv", ".html", ".png", ".svg"}
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
) -> Study:
    """Return the study with --time-limit, --t-end, --output-step and --start for all its cases.

    Raises
    ------
    BeamdaeError
        If a value is not positive, or a start has the wrong form.
    """
    if time_limit is not None:
        limit = require_positive(command, "--time-limit", time_limit)
        study = replace(study, limits=replace(study.limits, time=limit))
    if t_end is not None:
        study = replace(study, t_end=t_end)
    if output_step is not None:
        study = replace(study, output_step=output_step)
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
    print_results
        Function that prints the results and adds them to the JSON document.
    tables, page, pictures
        Functions that write the tables besides those of every study, the page and the pictures.
    """

    print_results: Callable[[], None]
    tables: FileWriters
    page: FileWriters
    pictures: FileWriters


@dataclass
class StudyOutputs:
    """Study with its results and files, which may be incomplete after an interrupt.

    Attributes
    ----------
    study, folder
        The study, and the folder of its results.
    create_report
        Function that returns the report on the results.
    parquet
        If True, also write the trajectories as Parquet files.
    page, picture
        If False, skip the page or the pictures.
    report, results
        Report on the results of the study, and the results; None until the study has been run.
    n_runs
        Number of runs, references included; 0 until the study has been started.
    files
        Files written so far.
    """

    study: Study
    folder: Path
    create_report: Callable[[StudyResults], StudyReport]
    parquet: bool = False
    page: bool = True
    picture: bool = True
    results: StudyResults | None = None
    report: StudyReport | None = None
    n_runs: int = 0
    files: WrittenFiles = field(default_factory=WrittenFiles)


def run_and_write(outputs: StudyOutputs, create_executor: Callable[[], TaskExecutor]) -> None:
    """Run a study, write its tables, print its results, and write its page and pictures.

    The command exits with 1 if no case succeeded or a reference or file is missing, with 3 if
    processes or a cluster failed so that runs are missing, and with 130 or 143 after an interrupt.
    SIGTERM skips the page and the pictures.

    Raises
    ------
    BeamdaeError
        If the folder cannot be written, or no Parquet engine is installed for --parquet.
    """
    require_writable(("--out", _planned_files(outputs.folder)))
    if outputs.parquet and not (find_spec("pyarrow") or find_spec("fastparquet")):
        raise BeamdaeError(
            "--parquet: no Parquet engine is installed; run pip install 'beamdae[parquet]'."
        )
    try:
        _run_study(outputs, create_executor)
    except KeyboardInterrupt:
        if outputs.report is None:
            reason = f"interrupted before any table was written; {_RESUME_HINT}"
            raise Interrupted(reason) from None
        acknowledge()
    results, report = outputs.results, outputs.report
    assert results is not None
    assert report is not None
    report.print_results()
    try:
        if not signals.is_terminated():
            _write_files(outputs, results, report)
    except KeyboardInterrupt:
        acknowledge()
    outputs.files.print_paths()
    missing = results.not_run
    if results.interrupted or signals.is_interrupted():
        n_done = sum(
            outcome.status.kind not in MISSING_KINDS for outcome in results.outcomes.values()
        )
        print_error(f"interrupted, {n_done} of {outputs.n_runs} runs done; {_RESUME_HINT}")
        raise typer.Exit(signals.exit_code())
    if missing:
        reason = missing[0].status.sentence
        print_error(
            f"not run: {len(missing)} of {outputs.n_runs} runs, because {reason}; {_RESUME_HINT}"
        )
        raise typer.Exit(NOT_RUN_CODE)
    if results.failed or outputs.files.failed:
        raise typer.Exit(1)


def _picture_names(report: StudyReport) -> list[str]:
    return [f"{name}{suffix}" for name in report.pictures for suffix in (".png", ".svg")]


def _planned_files(folder: Path) -> list[Path]:
    """Return paths that must be writable before the run.

    These are all existing tables, pages and pictures, the case table, and a file in the folder of
    the records.
    """
    existing = [path for path in folder.glob("*.*") if path.suffix in _FILE_SUFFIXES]
    planned = [folder / "cases.csv", folder / "outcomes" / "record.json"]
    return list(dict.fromkeys([*existing, *planned]))


def _run_study(outputs: StudyOutputs, create_executor: Callable[[], TaskExecutor]) -> None:
    """Run the study and write its tables; if interrupted, write the tables of the finished runs."""
    from beamdae.studies.execution import study_run

    if signals.is_interrupted():
        # The exception may have been swallowed, for example by a callback of other code.
        raise KeyboardInterrupt
    with signals.defer_interrupts(immediate=1):
        with show_study_progress() as show_progress:

            def update(progress: StudyProgress) -> None:
                outputs.n_runs = progress.total
                show_progress(progress)

            results = study_run.run_study(outputs.study, outputs.folder, create_executor(), update)
        outputs.files.paths += [results.folder / name for name in results.tables]
        outputs.results, outputs.report = results, outputs.create_report(results)
        names = [*outputs.report.page, *_picture_names(outputs.report)]
        outputs.files.views = tuple(results.folder / name for name in names)
        for name, write in outputs.report.tables.items():
            outputs.files.write(name, write)


def _write_files(outputs: StudyOutputs, results: StudyResults, report: StudyReport) -> None:
    """Write the page, the Parquet files and the pictures, which take longest."""
    for name, write in report.page.items() if outputs.page else ():
        outputs.files.write(name, write)
    if outputs.parquet:
        # There may be thousands of files, so their folder is reported.
        outputs.files.write(
            "trajectories", lambda: sorted({path.parent for path in results.to_parquet()})
        )
    for name, write in report.pictures.items() if outputs.picture else ():
        outputs.files.write(name, write)


def print_failures(results: StudyResults) -> None:
    """Print a line for each of the first 16 unsuccessful cases, and the number of further ones.

    Interrupted cases and cases that were not run are omitted.
    """
    from beamdae.report.terminal import text_tables

    reasons = text_tables.failure_sentences(
        results.table[~results.table["status"].isin(MISSING_KINDS)]
    )
    for reason in reasons[:MAX_SCREEN_ROWS]:
        print_error(f"failed: {reason}")
    if len(reasons) > MAX_SCREEN_ROWS:
        print_error(f"further failures: {len(reasons) - MAX_SCREEN_ROWS}; see cases.csv")
