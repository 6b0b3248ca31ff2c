"""`beamdae run`: simulate one model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beamdae.cli import run_outputs, signals
from beamdae.cli.options import (
    EndTime,
    IntegratorName,
    ModelFile,
    ModelName,
    Out,
    OutputStep,
    Settings,
    Starts,
    TimeLimit,
    create_integrator,
    load_configured_model,
    parse_start,
    require_writable,
)
from beamdae.cli.output import create_console, print_error, print_written_files, record_results
from beamdae.cli.run_outputs import Run
from beamdae.errors import BeamdaeError

# Whatever imports NumPy or CasADi is imported inside the commands: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.results.outcome import Status
    from beamdae.results.storage.continued_runs import RunParts


def run_command(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    integrator: IntegratorName = "auto",
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
        bool, typer.Option(help="Estimate the error of every column by a second run.")
    ] = True,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Compare with another method at a tighter tolerance."),
    ] = False,
    page: Annotated[
        bool, typer.Option(metavar="", help="Write a page (HTML) with charts and the motion.")
    ] = True,
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
        typer.Option("--accept-changes", help="Go on also if the model is another than before."),
    ] = False,
) -> None:
    """Simulate one model and write its CSV, JSON, PNG, and a page for the browser.

    A run that goes on (--continue) has a table of its own, NAME_part2.csv and so on; NAME.csv is
    that of all parts, if they are in the same folder. One that is ended early tells by which file
    it can go on.

    Ends with 0 where the run reached its end, with 1 where it did not (what it reached is written),
    with 2 after a mistake, with 130 after Ctrl-C, and with 143 after SIGTERM, which leaves no PNG
    and no page.
    """
    model = load_configured_model(path, model_name, settings)
    method = create_integrator(
        "run",
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
    run = Run(model, method, out / f"{model.name}.csv")
    beside = (run.table.with_suffix(".json"), run.picture, run.page)
    require_writable(out, (run.table.name, *(path.name for path in beside)))
    parts = _parts(run.table, go_on)
    if checkpoint is not None:
        require_writable(checkpoint.parent, (checkpoint.name,), "--checkpoint")
    begin = parse_start(start) if go_on is None else go_on
    # The table is on the disk before anything is told; the picture takes longer than most runs.
    with run.goes_on(), signals.defer_interrupts(through=1):
        solution = run_outputs.integrate_run(run, t_end, output_step, begin, accept_changes)
        run_outputs.write_tables(run, parts, solution, checkpoint)
    if not run.cut_short and solution.status.kind != "interrupted" and (estimate or verify):
        with run.goes_on():
            run_outputs.estimate_errors(run, solution, verify, parts.latest)
    run_outputs.print_results(run, solution)
    with run.goes_on():
        if not signals.is_terminated():
            if page:
                run_outputs.write_page(run, solution)
            run_outputs.draw_run(run, solution)
    _end(run, solution.status)


def _parts(table: Path, go_on: Path | None) -> RunParts:
    """The runs before the one that goes on, if it does, as far as their tables are there."""
    from beamdae.results.storage.checkpoint import Checkpoint
    from beamdae.results.storage.continued_runs import RunParts

    return RunParts(table) if go_on is None else RunParts.ending_at(table, Checkpoint.read(go_on))


def _end(run: Run, status: Status) -> None:
    """Tell of the files, and end with the code of what became of the run."""
    print_written_files(create_console(), run.written.paths)
    if run.end is not None and run_outputs.can_resume(status):
        record_results(lambda: {"continue": run.end})
        create_console().print(f"to go on: --continue {run.end}", style="dim", soft_wrap=True)
    if status.kind == "interrupted" or run.cut_short or signals.is_interrupted():
        reason = status.sentence if status.kind == "interrupted" else "interrupted after the run"
        print_error(f"{reason}; what was computed is in {run.table}")
        raise typer.Exit(signals.exit_code())
    if not status.success:
        print_error(f"failed: {status.sentence}")
    if run.written.failed or not status.success:
        raise typer.Exit(1)
