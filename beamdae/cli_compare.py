"""`beamdae compare`: run a study, or one model with several integrators."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from beamdae.cli_options import (
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
    from beamdae.studies.engine import Progress, Results

_INTERRUPTED = 130
# More rows than these are for the page, not for the screen.
_MOST_ROWS = 16


def compare(
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
    require_writable(out)
    study = _study(path, model_name, assignments(settings))
    if t_end is not None or output_step is not None:
        study = replace(
            study, t_end=t_end or study.t_end, output_step=output_step or study.output_step
        )
    from beamdae.page import write_page
    from beamdae.studies import engine
    from beamdae.studies.page_data import page
    from beamdae.studies.pictures import draw
    from beamdae.studies.pool import DaskPool, LocalPool

    if workers is not None:
        count("compare", "--workers", workers)
    executor = DaskPool(scheduler) if scheduler else LocalPool(workers)
    with _progress() as progress:
        results = engine.run(study, out / study.name, executor, progress)
    written = [results.folder / "cases.csv", results.folder / "summary.csv", *draw(results)]
    written.append(write_page(results.folder / "report.html", page(results)))
    if parquet:
        written += results.to_parquet()
    _say(results)
    say_written(console(), written)
    if results.interrupted:
        typer.echo("interrupted: start the same command again and it goes on", err=True)
        raise typer.Exit(_INTERRUPTED)
    if results.failed:
        raise typer.Exit(1)


def _study(path: Path, name: str | None, settings: dict[str, str]) -> Study:
    """The study of a file, or one of its models with the default integrators."""
    from beamdae.errors import nearest
    from beamdae.model_file import contents, load_model
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
    return Study(f"{model.name}_compare", cases)


def _say(results: Results) -> None:
    """Tables on the screen, and a sentence for each failure."""
    from beamdae import report

    screen = console()
    screen.print(results.study.name, style="bold")
    for group, reference in results.references.items():
        screen.print(f"{group}: {reference.sentence}", style="dim", soft_wrap=True)
    if len(results.table) <= _MOST_ROWS:
        screen.print(report.comparison_table(results.table))
    if len(results.summary):
        rows = [[report.number(x) for x in row] for row in results.summary.to_numpy()]
        screen.print(report.listing([str(c) for c in results.summary], rows))
    for reason in report.failures(results.table):
        typer.echo(f"failed: {reason}", err=True)


@contextmanager
def _progress() -> Iterator[Callable[[Progress], None]]:
    """A bar of the runs done on stderr; lines now and then where that is no terminal."""
    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield _Lines()
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns: tuple[Any, ...] = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[failed]} failed, {task.fields[kept]} kept from before"),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Bar(*columns, console=screen, transient=True) as bar:
        task = bar.add_task("", total=None, failed=0, kept=0)
        yield lambda p: bar.update(
            task,
            total=p.total,
            completed=p.done,
            failed=p.failed,
            kept=p.kept,
            description=p.last,
        )


class _Lines:
    """A line at every tenth of the runs."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, progress: Progress) -> None:
        if progress.done >= self._next or progress.done == progress.total:
            typer.echo(
                f"{progress.done} of {progress.total} runs, {progress.failed} failed, "
                f"{progress.kept} kept from before",
                err=True,
            )
            self._next = progress.done + 0.1 * progress.total
