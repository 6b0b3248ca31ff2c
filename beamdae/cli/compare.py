"""`beamdae compare`: run a study, or one model with several integrators."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import interrupts
from beamdae.cli.options import (
    EndTime,
    ModelName,
    Out,
    OutputStep,
    Settings,
    TimeLimit,
    assignments,
    require_writable,
)
from beamdae.cli.progress import study_progress
from beamdae.cli.saying import complain, console, say_written
from beamdae.cli.work import Written
from beamdae.errors import BeamdaeError, count, positive

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.studies import Study
    from beamdae.studies.engine import Results, Standing

# More rows than these are for the page, not for the screen.
_MOST_ROWS = 16
# Processes a core that are still of use, where some of them wait.
_MOST_WORKERS = 16
_LONGEST_NAME = 100
_GO_ON = "start the same command again and it goes on"


def compare_command(
    path: Annotated[Path, typer.Argument(metavar="FILE.py", help="Study file or model file.")],
    settings: Settings = None,
    model_name: ModelName = None,
    time_limit: TimeLimit = None,
    t_end: EndTime = None,
    output_step: OutputStep = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes; default one a core.", metavar="N")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
    ] = None,
    parquet: Annotated[
        bool,
        typer.Option("--parquet", metavar="", help="Write trajectories as Parquet as well."),
    ] = False,
    out: Out = Path("results"),
) -> None:
    """Run a study, or one model with several integrators, against a reference.

    Finished cases are kept in the results folder: a second start goes on where the first one
    stopped. Ends with 0 where cases succeeded and have a reference, with 1 where not, with 2 after
    a mistake, with 130 after Ctrl-C, and with 143 after SIGTERM.
    """
    study = _study(path, model_name, assignments(settings))
    require_writable(out / study.name / "outcomes")
    if parquet and not (find_spec("pyarrow") or find_spec("fastparquet")):
        raise BeamdaeError("--parquet: it needs an engine, pip install 'beamdae[parquet]'.")
    if time_limit is not None:
        limit = positive("compare", "--time-limit", time_limit)
        study = replace(study, limits=replace(study.limits, time=limit))
    if t_end is not None:
        study = replace(study, t_end=t_end)
    if output_step is not None:
        study = replace(study, output_step=output_step)
    work = _Work(study, out / study.name)
    try:
        _do(work, _executor(workers, scheduler), parquet)
    except KeyboardInterrupt:
        if work.results is None:
            raise KeyboardInterrupt(f"before there were tables: {_GO_ON}") from None
    results = work.results
    assert results is not None
    _say(results)
    say_written(console(), work.written.paths)
    if results.interrupted or interrupts.heard():
        done = sum(outcome.status.kind != "interrupted" for outcome in results.outcomes.values())
        complain(f"stopped, {done} of {work.runs} done: {_GO_ON}")
        raise typer.Exit(interrupts.code())
    if results.failed or work.written.failed:
        raise typer.Exit(1)


@dataclass
class _Work:
    """A study and what has become of it, as far as it got."""

    study: Study
    folder: Path
    results: Results | None = None
    runs: int = 0
    written: Written = field(default_factory=Written)


def _do(work: _Work, executor: Any, parquet: bool) -> None:
    """Run a study and write its files, the page before the pictures, until an interrupt."""
    from beamdae.report.page.page import write_page
    from beamdae.studies import engine
    from beamdae.studies.page_data import page
    from beamdae.studies.pictures import plots

    if interrupts.heard():
        # One that was lost, as in a callback of other code, is made up for.
        raise KeyboardInterrupt
    with interrupts.held(through=1):
        with study_progress() as progress:

            def heard(standing: Standing) -> None:
                work.runs = standing.total
                progress(standing)

            results = work.results = engine.run(work.study, work.folder, executor, heard)
        work.written.paths += [results.folder / "cases.csv", results.folder / "summary.csv"]
        path = results.folder / "report.html"
        work.written.draw(path.name, lambda: [write_page(path, page(results))])
    if parquet:
        work.written.draw("trajectories", results.to_parquet)
    for name, plot in plots(results).items():
        work.written.draw(name, plot)


def _executor(workers: int | None, scheduler: str | None) -> Any:
    from beamdae.studies.pool import DaskPool, LocalPool

    most = _MOST_WORKERS * (os.cpu_count() or 1)
    if workers is not None and count("compare", "--workers", workers) > most:
        raise BeamdaeError(
            f"compare: --workers must be at most {most}, {_MOST_WORKERS} a core, got {workers}."
        )
    return DaskPool(scheduler) if scheduler else LocalPool(workers)


def _study(path: Path, name: str | None, settings: dict[str, str]) -> Study:
    """The study of a file, or one of its models with the default integrators."""
    from beamdae.cli.model_file import contents, load_model
    from beamdae.errors import nearest
    from beamdae.studies import Case, Study, default_integrators
    from beamdae.studies.fingerprints import digest

    models, studies = contents(path)
    if name in studies or (studies and name is None):
        if settings:
            raise BeamdaeError(f"--set {next(iter(settings))}: a study sets its own parameters.")
        if name is None and len(studies) > 1:
            raise BeamdaeError(
                f"{path}: it holds several studies, name one with --model: {', '.join(studies)}."
            )
        return studies[name or next(iter(studies))]
    if studies and name is not None and name not in models:
        raise BeamdaeError(f"{path}: no study {name!r}{nearest(name, studies)}.")
    model = load_model(path, name)
    values = {key: model.complete({key: value})[key] for key, value in settings.items()}
    cases = tuple(Case(model, values, integrator) for integrator in default_integrators())
    # A folder for each choice of parameters.
    chosen = [re.sub(r"[^A-Za-z0-9.=-]+", "-", f"{k}={v}") for k, v in values.items()]
    folder = "_".join([model.name, "compare", *chosen])
    if len(folder) > _LONGEST_NAME:
        folder = f"{folder[:_LONGEST_NAME]}_{digest(values)[:8]}"
    return Study(folder, cases)


def _say(results: Results) -> None:
    """Tables on the screen, and a sentence for each failure."""
    from beamdae.report import terminal
    from beamdae.report.letters import plain

    screen = console()
    screen.print(results.study.name, style="bold")
    alone = results.table[~results.table["group"].isin(list(results.references))]
    if len(alone):
        ended = int((alone["status"] == "ok").sum())
        screen.print(f"{len(alone)} cases, {ended} of them reached their end", style="dim")
    summaries = dict(iter(results.summary.groupby("group", sort=False)))
    for group, reference in islice(results.references.items(), _MOST_ROWS):
        screen.print(plain(f"{group}: {reference.sentence}"), style="dim", soft_wrap=True)
        rows = results.table[results.table["group"] == group]
        if len(results.table) <= _MOST_ROWS:
            screen.print(terminal.comparison_table(rows))
        if group in summaries:
            screen.print(terminal.summary_table(summaries[group]))
    if len(results.references) > _MOST_ROWS:
        more = len(results.references) - _MOST_ROWS
        screen.print(f"{more} more groups, see summary.csv and report.html", style="dim")
    tried = results.table[results.table["status"] != "interrupted"]
    reasons = [
        f"{group}: {reference.sentence}"
        for group, reference in results.references.items()
        if reference.table is None and not results.interrupted
    ]
    reasons += terminal.failures(tried)
    for reason in reasons[:_MOST_ROWS]:
        complain(f"failed: {reason}")
    if len(reasons) > _MOST_ROWS:
        complain(f"failed: {len(reasons) - _MOST_ROWS} more, see cases.csv")
