"""`beamdae periodic`: a periodic motion of a model and its stability."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    load_model,
    parse_number,
    parse_seconds,
    parse_start,
    required_accuracy,
    select_plotted_columns,
)
from beamdae.cli.results import Report, ResultFiles, run_analysis, without_status
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
    if start and speed is not None:
        raise BeamdaeError("periodic: --start and --speed are mutually exclusive; omit one.")
    model, file = load_model(path, model_name, settings)
    method = create_periodic_integrator("periodic", integrator, rtol, file)
    plotted = select_plotted_columns("periodic", model, plot, picture)
    files = ResultFiles.plan(out, f"{model.name}_periodic", page, picture)
    accurate = required_accuracy("periodic", accuracy, accuracy_columns, model)
    state = parse_start(start, model)

    def analyze() -> PeriodicMotion:
        from beamdae.analysis.periodic.periodic_solution import periodic
        from beamdae.parts.rotation import rotation

        initial_state = state if speed is None else rotation(speed)
        return periodic(
            model,
            period,
            method,
            initial_state,
            settle=settle,
            t_start=t_start,
            period_guess=period_guess,
            **accurate,
        )

    def draw(motion: PeriodicMotion, path: Path, title: str) -> Path | None:
        from beamdae.report.pictures.time_plots import save_run_figure, save_selected_columns

        columns = motion.solution.all_columns()
        if plotted:
            return save_selected_columns(path, columns, plotted, None, None, title)
        return save_run_figure(path, columns, title) if motion.solution.columns else None

    run_analysis(files, f"{model.name}, one period", analyze, partial(_describe, model.name), draw)


def _describe(name: str, motion: PeriodicMotion) -> Report:
    from beamdae.report.analysis_pages import periodic_facts
    from beamdae.report.terminal import text_tables

    amplitudes = motion.amplitudes()
    return Report(
        name,
        lambda: {
            "status": motion.status.kind,
            "reason": motion.status.sentence,
            "period": motion.period,
            "stable": motion.stable,
            "stability": motion.stability,
            "multipliers": [[x.real, x.imag] for x in motion.multipliers.tolist()],
            "observed": amplitudes.to_dict("index"),
        },
        motion.status,
        without_status(periodic_facts(motion)),
        [text_tables.amplitudes_table(amplitudes)] if len(amplitudes) else [],
        warnings=motion.warnings,
    )
