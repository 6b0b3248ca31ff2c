"""The work of `beamdae compare` and `beamdae sweep`: runs, files, and what is said of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli import signals
from beamdae.cli.options import require_writable
from beamdae.cli.output import WrittenFiles, create_console, print_error, print_written_files
from beamdae.cli.progress import show_study_progress
from beamdae.errors import BeamdaeError, require_positive

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.studies import Study
    from beamdae.studies.execution.executors import Executor
    from beamdae.studies.execution.study_progress import StudyProgress
    from beamdae.studies.execution.study_run import StudyResults

    FileWriters = dict[str, Callable[[], list[Path]]]

# More rows than these are for the page, not for the screen.
MAX_SCREEN_ROWS = 16
_MAX_FOLDER_NAME = 100
_RESUME_HINT = "start the same command again and it goes on"


def results_folder_name(begin: str, chosen: Mapping[str, Any]) -> str:
    """Name of the folder of results for each choice of parameters."""
    from beamdae.studies.store.fingerprints import digest

    said = [re.sub(r"[^A-Za-z0-9.=-]+", "-", f"{name}={value}") for name, value in chosen.items()]
    folder = "_".join([begin, *said])
    if len(folder) > _MAX_FOLDER_NAME:
        folder = f"{folder[:_MAX_FOLDER_NAME]}_{digest(chosen)[:8]}"
    return folder


def apply_limits(
    command: str,
    study: Study,
    time_limit: float | None,
    t_end: float | None,
    output_step: float | None,
) -> Study:
    """The study with what options say of all its cases."""
    if time_limit is not None:
        limit = require_positive(command, "--time-limit", time_limit)
        study = replace(study, limits=replace(study.limits, time=limit))
    if t_end is not None:
        study = replace(study, t_end=t_end)
    if output_step is not None:
        study = replace(study, output_step=output_step)
    return study


@dataclass
class StudyOutputs:
    """A study and what has become of it, as far as it got.

    Attributes
    ----------
    draws
        What writes its files, by name: the table and the page first, then the pictures.
    parquet
        Whether trajectories are written as Parquet as well.
    """

    study: Study
    folder: Path
    draws: Callable[[StudyResults], tuple[FileWriters, FileWriters]]
    parquet: bool = False
    results: StudyResults | None = None
    runs: int = 0
    written: WrittenFiles = field(default_factory=WrittenFiles)


def run_and_write(
    work: StudyOutputs, executor: Callable[[], Executor], say: Callable[[StudyResults], None]
) -> None:
    """Run a study, write its files, say what came of it, and end the command by that."""
    require_writable(work.folder / "outcomes")
    if work.parquet and not (find_spec("pyarrow") or find_spec("fastparquet")):
        raise BeamdaeError("--parquet: it needs an engine, pip install 'beamdae[parquet]'.")
    try:
        _run_study(work, executor)
    except KeyboardInterrupt:
        if work.results is None:
            raise KeyboardInterrupt(f"before there were tables: {_RESUME_HINT}") from None
    results = work.results
    assert results is not None
    say(results)
    print_written_files(create_console(), work.written.paths)
    if results.interrupted or signals.is_interrupted():
        done = sum(outcome.status.kind != "interrupted" for outcome in results.outcomes.values())
        print_error(f"stopped, {done} of {work.runs} done: {_RESUME_HINT}")
        raise typer.Exit(signals.exit_code())
    if results.failed or work.written.failed:
        raise typer.Exit(1)


def _run_study(work: StudyOutputs, executor: Callable[[], Executor]) -> None:
    """Run a study and write its files, the page before the pictures, until an interrupt."""
    from beamdae.studies.execution import study_run

    if signals.is_interrupted():
        # One that was lost, as in a callback of other code, is made up for.
        raise KeyboardInterrupt
    with signals.defer_interrupts(through=1):
        with show_study_progress() as progress:

            def heard(standing: StudyProgress) -> None:
                work.runs = standing.total
                progress(standing)

            results = work.results = study_run.run_study(work.study, work.folder, executor(), heard)
        work.written.paths += [results.folder / name for name in results.tables]
        first, pictures = work.draws(results)
        for name, draw in first.items():
            work.written.draw(name, draw)
    if work.parquet:
        # A thousand names are no help.
        work.written.draw("trajectories", lambda: sorted({x.parent for x in results.to_parquet()}))
    for name, draw in pictures.items():
        work.written.draw(name, draw)


def print_failures(results: StudyResults) -> None:
    """A sentence for each case that did not reach its end, if it was begun."""
    from beamdae.report.terminal import text_tables

    reasons = text_tables.failure_sentences(results.table[results.table["status"] != "interrupted"])
    for reason in reasons[:MAX_SCREEN_ROWS]:
        print_error(f"failed: {reason}")
    if len(reasons) > MAX_SCREEN_ROWS:
        print_error(f"failed: {len(reasons) - MAX_SCREEN_ROWS} more, see cases.csv")
