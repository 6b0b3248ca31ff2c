"""`beamdae periodic`: a periodic motion of a model and its stability."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.options import (
    AccurateColumns,
    IntegratorName,
    ModelName,
    ModelPath,
    Out,
    Page,
    PeriodStart,
    Picture,
    PlottedColumns,
    RelativeTolerance,
    RequiredAccuracy,
    Settings,
    Starts,
    create_periodic_integrator,
    load_configured_model,
    parse_number,
    parse_seconds,
    parse_start,
    required_accuracy,
    select_plotted_columns,
)
from beamdae.cli.output import (
    WrittenFiles,
    print_accuracy,
    print_facts,
    print_warnings,
)
from beamdae.cli.output_paths import plan_outputs
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.results.periodic_motion import PeriodicMotion


def periodic_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    period: Annotated[
        float | None,
        typer.Option(
            parser=parse_seconds,
            metavar="TIME",
            help="Period of loads and drivers in seconds, or with a unit. Without it, the period "
            "of a self-excited or free motion is found.",
        ),
    ] = None,
    period_guess: Annotated[
        float | None,
        typer.Option(
            parser=parse_seconds,
            metavar="TIME",
            help="Approximate period in seconds, to be refined.",
        ),
    ] = None,
    integrator: IntegratorName = "radau",
    rtol: RelativeTolerance = None,
    start: Starts = None,
    speed: Annotated[
        float | None,
        typer.Option(
            parser=partial(parse_number, unit="rad/s"),
            metavar="SPEED",
            help="Start in steady rotation about the origin at this speed in rad/s, or with a unit "
            "(3000rpm).",
        ),
    ] = None,
    t_start: PeriodStart = 0.0,
    settle: Annotated[
        int, typer.Option(help="Periods to run before the periodic motion is sought.")
    ] = 5,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Page = True,
    picture: Picture = True,
    plot: PlottedColumns = None,
    out: Out = Path("results"),
) -> None:
    """Find a periodic motion and its stability; write one period as CSV, PNG and a page.

    Exits with 0 if a motion was found, stable or not, 1 if not (the last iterate is written), if
    --accuracy was not reached or if the page or picture failed, and 2 for a usage or model error.
    """
    from beamdae.cli.model_files.model_file import ModelFile

    if start and speed is not None:
        raise BeamdaeError("periodic: --start and --speed are mutually exclusive; omit one.")
    file = ModelFile(path)
    model = load_configured_model(file, model_name, settings)
    method = create_periodic_integrator("periodic", integrator, rtol, file)
    plotted = select_plotted_columns("periodic", model, plot, picture)
    table_path, picture_path = plan_outputs(out, f"{model.name}_periodic", picture, page)
    page_path = table_path.with_suffix(".html")
    from beamdae.analysis.periodic.periodic_solution import periodic
    from beamdae.parts.rotation import rotation
    from beamdae.report.analysis_pages import write_analysis_page
    from beamdae.report.pictures.time_plots import save_run_figure, save_selected_columns
    from beamdae.results.storage.files import escape_table, write_text

    motion = periodic(
        model,
        period,
        method,
        parse_start(start, model) if speed is None else rotation(speed),
        settle=settle,
        t_start=t_start,
        period_guess=period_guess,
        **required_accuracy("periodic", accuracy, accuracy_columns, model),
    )
    table = escape_table(motion.solution.table())
    files = WrittenFiles(
        [write_text(table_path, table.to_csv(index=False))], (page_path, picture_path)
    )
    _print_results(motion, model.name)
    title = f"{model.name}, one period"
    if page:
        files.write(page_path.name, lambda: [write_analysis_page(motion, page_path, title)])
    if picture and motion.solution.columns:

        def write_picture() -> list[Path]:
            columns = motion.solution.table()
            if plotted:
                return [
                    save_selected_columns(picture_path, dict(columns), plotted, None, None, title)
                ]
            return [save_run_figure(picture_path, columns, title)]

        files.write(picture_path.name, write_picture)
    files.finish(motion.status, motion)


def _print_results(motion: PeriodicMotion, name: str) -> None:
    from beamdae.report.analysis_pages import periodic_facts
    from beamdae.report.terminal import text_tables

    console = print_facts(name, periodic_facts(motion), lambda: _json_results(motion))
    if motion.solution.columns:
        console.print(text_tables.amplitudes_table(motion.amplitudes()))
    print_accuracy(console, motion)
    print_warnings(console, motion.warnings)


def _json_results(motion: PeriodicMotion) -> dict[str, Any]:
    return {
        "status": motion.status.kind,
        "reason": motion.status.sentence,
        "period": motion.period,
        "stable": motion.stable,
        "stability": motion.stability,
        "multipliers": [[x.real, x.imag] for x in motion.multipliers.tolist()],
        "warnings": list(motion.warnings),
        "observed": motion.amplitudes().to_dict("index"),
    }
