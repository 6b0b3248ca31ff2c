"""`beamdae compare`: run a study, or one model with several integrators."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from beamdae.cli.options import (
    EndTime,
    ModelName,
    Out,
    OutputStep,
    Settings,
    assignments,
    console,
    require_writable,
    say_written,
)
from beamdae.errors import BeamdaeError, count

# Whatever imports NumPy or CasADi is imported inside the command: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.studies import Study
    from beamdae.studies.engine import Results, Standing

_INTERRUPTED = 130
# More rows than these are for the page, not for the screen.
_MOST_ROWS = 16


def compare_command(
    path: Annotated[Path, typer.Argument(metavar="FILE.py", help="Study file or model file.")],
    settings: Settings = None,
    model_name: ModelName = None,
    t_end: EndTime = None,
    output_step: OutputStep = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes; default one a core.", metavar="N")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
    ] = None,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="Write trajectories as Parquet as well.")
    ] = False,
    out: Out = Path("results"),
) -> None:
    """Run a study, or one model with several integrators, against a reference.

    Finished cases are kept in the results folder: a second start goes on where the first one
    stopped.
    """
    study = _study(path, model_name, assignments(settings))
    require_writable(out / study.name / "outcomes")
    if parquet and not (find_spec("pyarrow") or find_spec("fastparquet")):
        raise BeamdaeError("--parquet: it needs an engine, pip install 'beamdae[parquet]'.")
    if t_end is not None:
        study = replace(study, t_end=t_end)
    if output_step is not None:
        study = replace(study, output_step=output_step)
    from beamdae.report.page.page import write_page
    from beamdae.studies import engine
    from beamdae.studies.page_data import page
    from beamdae.studies.pictures import draw
    from beamdae.studies.pool import DaskPool, LocalPool

    if workers is not None:
        count("compare", "--workers", workers)
    executor = DaskPool(scheduler) if scheduler else LocalPool(workers)
    with _progress() as progress:
        results = engine.run(study, out / study.name, executor, progress)
    _say(results)
    written = [results.folder / "cases.csv", results.folder / "summary.csv", *draw(results)]
    written.append(write_page(results.folder / "report.html", page(results)))
    if parquet:
        written += results.to_parquet()
    say_written(console(), written)
    if results.interrupted:
        typer.echo("interrupted: start the same command again and it goes on", err=True)
        raise typer.Exit(_INTERRUPTED)
    if results.failed:
        raise typer.Exit(1)


def _study(path: Path, name: str | None, settings: dict[str, str]) -> Study:
    """The study of a file, or one of its models with the default integrators."""
    from beamdae.cli.model_file import contents, load_model
    from beamdae.errors import nearest
    from beamdae.studies import Case, Study, default_integrators

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
    return Study("_".join([model.name, "compare", *chosen]), cases)


def _say(results: Results) -> None:
    """Tables on the screen, and a sentence for each failure."""
    from beamdae.report import terminal

    screen = console()
    screen.print(results.study.name, style="bold")
    for group, reference in results.references.items():
        screen.print(f"{group}: {reference.sentence}", style="dim", soft_wrap=True)
        rows = results.table[results.table["group"] == group]
        if len(results.table) <= _MOST_ROWS:
            screen.print(terminal.comparison_table(rows))
        if reference.table is None and not results.interrupted:
            typer.echo(f"failed: {group}: {reference.sentence}", err=True)
    if len(results.summary):
        cells = [[terminal.number(x) for x in row] for row in results.summary.to_numpy()]
        screen.print(terminal.listing([str(c) for c in results.summary], cells))
    tried = results.table[results.table["status"] != "interrupted"]
    reasons = terminal.failures(tried)
    for reason in reasons[:_MOST_ROWS]:
        typer.echo(f"failed: {reason}", err=True)
    if len(reasons) > _MOST_ROWS:
        typer.echo(f"failed: {len(reasons) - _MOST_ROWS} more, see cases.csv", err=True)


@contextmanager
def _progress() -> Iterator[Callable[[Standing], None]]:
    """A bar of the runs done on stderr; lines now and then where that is no terminal."""
    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield _Lines()
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns: tuple[Any, ...] = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(
            "{task.fields[running]} running, {task.fields[failed]} failed, "
            "{task.fields[kept]} kept from before"
        ),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=screen, transient=True) as bar:
        task = bar.add_task("", total=None, failed=0, kept=0, running=0)
        yield lambda p: bar.update(
            task,
            total=p.total,
            completed=p.done,
            failed=p.failed,
            kept=p.kept,
            running=p.running,
            description=p.last,
        )


class _Lines:
    """A line at every tenth of the runs."""

    def __init__(self) -> None:
        self._next = 0.0
        self._begin = time.perf_counter()

    def __call__(self, standing: Standing) -> None:
        if standing.done >= self._next or standing.done == standing.total:
            fresh, left = standing.done - standing.kept, standing.total - standing.done
            elapsed = time.perf_counter() - self._begin
            rest = f", about {elapsed / fresh * left:.0f} s left" if fresh and left else ""
            typer.echo(
                f"{standing.done} of {standing.total} runs, {standing.running} running, "
                f"{standing.failed} failed, {standing.kept} kept from before{rest}",
                err=True,
            )
            self._next = standing.done + 0.1 * standing.total
