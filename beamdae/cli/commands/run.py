"""`beamdae run`: simulate one model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import run_outputs, signals
from beamdae.cli.options import (
    AccurateColumns,
    DataColumns,
    EndTime,
    FixedStep,
    HorizontalColumn,
    IntegratorName,
    ModelName,
    ModelPath,
    Out,
    OutputStep,
    Picture,
    PlottedColumns,
    RelativeTolerance,
    RequiredAccuracy,
    Settings,
    Starts,
    TimeLimit,
    create_integrator,
    load_configured_model,
    parse_assignments,
    parse_start,
    required_accuracy,
    split_names,
)
from beamdae.cli.output import create_console, print_error, record_results
from beamdae.cli.output_paths import require_writable
from beamdae.cli.run_outputs import Run, RunPlot
from beamdae.errors import BeamdaeError

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.results.solution import Solution
    from beamdae.results.storage.continued_runs import RunParts


def run_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    integrator: IntegratorName = "auto",
    rtol: RelativeTolerance = None,
    step: FixedStep = None,
    rho_inf: Annotated[
        float | None,
        typer.Option(
            help="Spectral radius at infinite frequency, 0 to 1; smaller values damp more "
            "(generalized-alpha)."
        ),
    ] = None,
    formulation: Annotated[
        str | None,
        typer.Option(help="Formulation of the equations, for example ggl or index3."),
    ] = None,
    error_control: Annotated[
        str | None,
        typer.Option(
            help="Variables in the error test: positions, velocities, all or auto (ida, radau)."
        ),
    ] = None,
    max_order: Annotated[
        str | None, typer.Option(help="Maximum order, 1 to 5 or auto (ida).")
    ] = None,
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
        typer.Option(
            "--verify", help="Compare with another integrator at a tighter tolerance instead."
        ),
    ] = False,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Annotated[
        bool,
        typer.Option(
            metavar="", help="Write a page (HTML) with charts and an animation of the motion."
        ),
    ] = True,
    picture: Picture = True,
    plot: PlottedColumns = None,
    x: HorizontalColumn = None,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DATA.csv",
            help="Measured values, shown as markers in the picture and on the page: a column of "
            "times, such as 't [ms]', and columns of the model, such as 'tip.y [mm]'.",
        ),
    ] = None,
    data_columns: DataColumns = None,
    checkpoint: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the final state to this file.")
    ] = None,
    sensitivities: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Add the derivatives of the columns with respect to these parameters, separated "
            "by commas, to the table and the page (radau, generalized-alpha; auto: radau).",
        ),
    ] = None,
    resume_from: Annotated[
        Path | None,
        typer.Option(
            "--continue",
            metavar="FILE",
            help="Resume from this checkpoint; the table in --out then covers the whole run.",
        ),
    ] = None,
    accept_changes: Annotated[
        bool,
        typer.Option(
            "--accept-changes", help="Resume even if the model or its parameters have changed."
        ),
    ] = False,
) -> None:
    """Simulate one model and write its results as CSV, JSON, PNG and a page for the browser.

    A resumed run (--continue) writes a separate table (NAME_part2.csv and so on). If the tables of
    the earlier parts are in the same folder, NAME.csv covers all parts. If a run ends early, the
    output names the checkpoint to resume from.

    Exits with 0 if the run was completed (and its --accuracy reached), 1 if it was not (partial
    results are written) or a file could not be written, 2 for a usage or model error, 130 after
    Ctrl-C, and 143 after SIGTERM, which skips the PNG and the page.
    """
    from beamdae.cli.model_files.model_file import ModelFile

    file = ModelFile(path)
    model = load_configured_model(file, model_name, settings)
    options = {
        "rtol": rtol,
        "step": step,
        "rho_inf": rho_inf,
        "formulation": formulation,
        "error_control": error_control,
        "max_order": int(max_order) if max_order and max_order.isdecimal() else max_order,
        "time_limit": time_limit,
    }
    accurate = required_accuracy("run", accuracy, accuracy_columns, model)
    conflicts: dict[str, Any] = {
        "--verify": verify or None,
        "--checkpoint": checkpoint,
        "--continue": resume_from,
    }
    _reject_combinations("--accuracy", accuracy, conflicts)
    method = create_integrator("run", integrator, options, file)
    if start and resume_from is not None:
        raise BeamdaeError(
            f"run: --start {start[0]} and --continue {resume_from} are mutually "
            "exclusive; omit one."
        )
    names = None if sensitivities is None else split_names(sensitivities)
    conflicts = {"--accuracy": accuracy, "--continue": resume_from}
    _reject_combinations("--sensitivities", names, conflicts)
    if data_columns and data is None:
        raise BeamdaeError("run: --data-column requires --data; use both options or neither.")
    chart = RunPlot(
        split_names(plot, model), x, data, parse_assignments(data_columns, "--data-column")
    )
    table = out / f"{model.name}.csv"
    run = Run(model, method, table, accuracy=accuracy, plot=chart)
    run_outputs.select_charts(run, picture, page, resume_from is not None)
    run.files.views = (run.page, run.picture)
    files = [run.table, run.table.with_suffix(".json")]
    files += [path for path, is_written in ((run.page, page), (run.picture, picture)) if is_written]
    checkpoints = () if checkpoint is None else (checkpoint,)
    require_writable(("--out", files), ("--checkpoint", checkpoints))
    if resume_from is not None:
        run.parts = _find_parts(run.table, resume_from)
    initial_state = parse_start(start, model) if resume_from is None else resume_from
    # The tables are written before anything is printed; the page and the picture are last, because
    # they take longer than most runs.
    with run.continue_after_interrupt(), signals.defer_interrupts(immediate=1):
        solution = run_outputs.integrate_run(
            run,
            t_end,
            output_step,
            initial_state,
            accept_changes,
            sensitivities=names,
            **accurate,
        )
        run_outputs.write_tables(run, solution, checkpoint)
    has_estimate = estimate or verify or accuracy is not None
    if not run.interrupted and solution.status.kind != "interrupted" and has_estimate:
        with run.continue_after_interrupt():
            run_outputs.estimate_errors(run, solution, verify)
    run_outputs.print_results(run, solution)
    with run.continue_after_interrupt():
        if not signals.is_terminated():
            if page:
                run_outputs.write_page(run, solution)
            if picture:
                run_outputs.draw_run(run, solution)
    _report_end(run, solution)


def _find_parts(table: Path, checkpoint: Path) -> RunParts:
    from beamdae.results.storage.checkpoint import Checkpoint
    from beamdae.results.storage.continued_runs import RunParts

    return RunParts.ending_at(table, Checkpoint.read(checkpoint))


def _reject_combinations(option: str, value: Any, others: Mapping[str, Any]) -> None:
    """Reject other options that cannot be combined with one, if it has a value."""
    for other in (x for x, given in others.items() if value is not None and given is not None):
        raise BeamdaeError(
            f"run: {option} is not supported with {other}; omit one of these options."
        )


def _report_end(run: Run, solution: Solution) -> None:
    """Print the written files and, if the run is incomplete, the reason; set the exit code."""
    status = solution.status
    run.files.print_paths()
    if run.checkpoint is not None and run_outputs.can_resume(solution):
        record_results(lambda: {"continue": run.checkpoint})
        create_console().print(
            f"to resume: --continue {run.checkpoint}", style="dim", soft_wrap=True
        )
    if status.kind == "interrupted" or run.interrupted or signals.is_interrupted():
        reason = status.sentence if status.kind == "interrupted" else "interrupted after the run"
        print_error(f"{reason}; the results so far are in {run.table}")
        raise typer.Exit(signals.exit_code())
    if not status.success:
        print_error(f"failed: {status.sentence}")
    if run.reached is not None and not run.reached.success:
        print_error(f"accuracy {run.accuracy:g} is not reached; {run.reached.sentence}")
    if run.files.failed or run.is_inaccurate or not status.success:
        raise typer.Exit(1)
