"""`beamdae run`: simulate one model."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import interrupts
from beamdae.cli.asked import configured, integrator_of
from beamdae.cli.options import (
    EndTime,
    ModelFile,
    ModelName,
    Out,
    OutputStep,
    Settings,
    Starts,
    TimeLimit,
    require_writable,
    start_of,
)
from beamdae.cli.progress import run_progress
from beamdae.cli.saying import complain, console, drawn, say_warnings, say_written
from beamdae.errors import BeamdaeError, BeamdaeWarning

# Whatever imports NumPy or CasADi is imported inside the commands: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.continued import Parts
    from beamdae.results.outcome import Status
    from beamdae.results.solution import Solution


def run_command(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    integrator: Annotated[
        str, typer.Option(help="auto, ida, radau or generalized-alpha.")
    ] = "auto",
    rtol: Annotated[
        float | None,
        typer.Option(help="Relative tolerance (generalized-alpha: adaptive steps)."),
    ] = None,
    step: Annotated[float | None, typer.Option(help="Step in seconds (generalized-alpha).")] = None,
    rho_inf: Annotated[
        float | None, typer.Option(help="Spectral radius at infinity (generalized-alpha).")
    ] = None,
    formulation: Annotated[
        str | None, typer.Option(help="Form of the equations, such as ggl or index3.")
    ] = None,
    error_control: Annotated[
        str | None, typer.Option(help="What the error test sees (ida): positions, ...")
    ] = None,
    max_order: Annotated[str | None, typer.Option(help="1 to 5, or auto (ida).")] = None,
    time_limit: TimeLimit = None,
    t_end: EndTime = None,
    start: Starts = None,
    output_step: OutputStep = None,
    out: Out = Path("results"),
    estimate: Annotated[
        bool, typer.Option(metavar="", help="Estimate the error of every column by a second run.")
    ] = True,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify", metavar="", help="Compare with another method at a tighter tolerance."
        ),
    ] = False,
    checkpoint: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write where the run ended to this file.")
    ] = None,
    go_on: Annotated[
        Path | None,
        typer.Option(
            "--continue",
            metavar="FILE",
            help="Go on from the end told by this file; tables in --out then hold all of the run.",
        ),
    ] = None,
    accept_changes: Annotated[
        bool,
        typer.Option(
            "--accept-changes", metavar="", help="Go on also if the model is another than before."
        ),
    ] = False,
) -> None:
    """Simulate one model and write its CSV, JSON and PNG.

    A run that goes on (--continue) has a table of its own, NAME_part2.csv and so on; NAME.csv is
    that of all parts, if they are in the same folder. One that is ended early tells by which file
    it can go on.

    Ends with 0 where the run reached its end, with 1 where it did not (what it reached is written),
    with 2 after a mistake, with 130 after Ctrl-C, and with 143 after SIGTERM, which leaves no PNG.
    """
    model = configured(path, model_name, settings)
    method = integrator_of(
        integrator,
        {
            "rtol": rtol,
            "step": step,
            "rho_inf": rho_inf,
            "formulation": formulation,
            "error_control": error_control,
            "max_order": int(max_order) if max_order and max_order.isdecimal() else max_order,
            "time_limit": time_limit,
        },
    )
    if start and go_on is not None:
        raise BeamdaeError(
            f"run: --start {start[0]} and --continue {go_on} each say where it begins, give one."
        )
    files = _Files(out, model.name)
    require_writable(out, (files.table.name, files.beside.name, files.picture.name))
    parts = _parts(files.table, go_on)
    if checkpoint is not None:
        require_writable(checkpoint.parent, (checkpoint.name,), "--checkpoint")
    # The table is on the disk before anything is told; the picture takes longer than most runs.
    told = _Told([])
    with _to_the_end(told), interrupts.held(through=1):
        begin = start_of(start) if go_on is None else go_on
        solution = _integrated(model, method, t_end, output_step, begin, accept_changes)
        with interrupts.held():
            columns, written = parts.write(solution)
            told.written += written
            if checkpoint is not None or _goes_on(solution.status):
                told.end = solution.checkpoint(checkpoint or files.end)
                told.written.append(told.end)
        told.cut_short = interrupts.heard()
    if not told.cut_short and solution.status.kind != "interrupted" and (estimate or verify):
        with _to_the_end(told):
            _estimate(solution, verify, parts.latest, told)
    _say(solution, model.name, told)
    with _to_the_end(told):
        if not interrupts.terminated():
            _draw(columns, solution.status, f"{model.name}, {method.label}", files, told)
    say_written(console(), told.written)
    if told.end is not None and _goes_on(solution.status):
        console().print(f"to go on: --continue {told.end}", style="dim", soft_wrap=True)
    if solution.status.kind == "interrupted" or told.cut_short or interrupts.heard():
        reason = "interrupted after the run"
        if solution.status.kind == "interrupted":
            reason = solution.status.sentence
        complain(f"{reason}; what was computed is in {files.table}")
        raise typer.Exit(interrupts.code())
    if not solution.status.success:
        complain(f"failed: {solution.status.sentence}")
    if not (solution.status.success and told.complete):
        raise typer.Exit(1)


@dataclass(frozen=True)
class _Files:
    """What a run writes."""

    folder: Path
    name: str

    @property
    def table(self) -> Path:
        return self.folder / f"{self.name}.csv"

    @property
    def beside(self) -> Path:
        return self.folder / f"{self.name}.json"

    @property
    def end(self) -> Path:
        return self.folder / f"{self.name}_end.json"

    @property
    def picture(self) -> Path:
        return self.folder / f"{self.name}.png"


@dataclass
class _Told:
    """What there is to tell of a run besides its solution, as far as it got."""

    written: list[Path]
    end: Path | None = None
    errors: Any = None
    beyond: str = ""
    complete: bool = False
    cut_short: bool = False


def _goes_on(status: Status) -> bool:
    """Whether there is more of the run to come; where it had not begun yet, it begins again."""
    from beamdae.results.outcome import OF_SCOUT

    return not status.success and OF_SCOUT not in status.sentence


def _parts(table: Path, go_on: Path | None) -> Parts:
    """The runs before the one that goes on, if it does, as far as their tables are there."""
    from beamdae.results.checkpoint import Checkpoint
    from beamdae.results.continued import Parts

    return Parts(table) if go_on is None else Parts.ending_at(table, Checkpoint.read(go_on))


def _integrated(
    model: Model,
    method: Any,
    t_end: float | None,
    output_step: float | None,
    start: Any,
    accept_changes: bool,
) -> Any:
    """The solution, also one that an interrupt ended."""
    from beamdae.simulation import simulate

    with run_progress(t_end or model.t_end) as progress, warnings.catch_warnings():
        # They are told with the result.
        warnings.simplefilter("ignore", BeamdaeWarning)

        def reached(label: str, t: float) -> None:
            progress(label, t)
            # One that was lost, as in a callback of other code, is made up for.
            if interrupts.heard():
                raise KeyboardInterrupt

        try:
            told = partial(reached, method.label)
            return simulate(model, method, t_end, output_step, told, start, accept_changes)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("before the run had begun; nothing was written") from None


@contextmanager
def _to_the_end(told: _Told) -> Iterator[None]:
    """Go on after this, also where an interrupt ends it."""
    try:
        yield
    except KeyboardInterrupt:
        if not told.written:
            raise
        told.cut_short = True


def _estimate(solution: Solution, verify: bool, table: Path, told: _Told) -> None:
    """Find how far the observed columns are off, and write that beside the table."""
    import numpy as np

    from beamdae import verification
    from beamdae.results.files import write_beside

    if not solution.columns:
        return
    errors = (verification.verified if verify else verification.estimated)(solution)
    # The second run takes an interrupt for its own.
    if interrupts.heard():
        return
    told.errors, told.beyond = errors, verification.exceeded(solution, errors)
    rows = zip(*(np.asarray(values).tolist() for values in errors.values()), strict=True)
    known = {
        column: {name: None if x != x else x for name, x in zip(errors, row, strict=True)}
        for column, row in zip(solution.columns, rows, strict=True)
    }
    with interrupts.held():
        write_beside(table, solution.beside(errors=known))


def _draw(columns: dict[str, Any], status: Status, title: str, files: _Files, told: _Told) -> None:
    """Draw the run; the title says if it ended early."""
    from beamdae.report.pictures import picture_of_run

    early = "" if status.success else f", ended early ({status.kind})"
    picture = drawn(
        files.picture.name,
        lambda: [picture_of_run(files.picture, columns, title + early)],
    )
    told.written += picture or []
    told.complete = picture is not None


def _say(solution: Solution, name: str, told: _Told) -> None:
    """Tables and sentences of a run on the screen."""
    from beamdae.report import terminal
    from beamdae.results.occurrences import counted

    screen = console()
    rows = terminal.run_facts(solution.summary(), solution.integrator)
    if solution.equations.events:
        rows["events"] = counted(one.name for one in solution.occurred)
    screen.print(terminal.facts(name, rows))
    if solution.columns:
        screen.print(terminal.ranges(solution.columns, told.errors))
    if solution.validity:
        screen.print(terminal.validity(solution.validity))
    say_warnings(screen, [*filter(None, [told.beyond]), *solution.warnings])
    # Whoever reads a pipe has it now as well.
    sys.stdout.flush()
