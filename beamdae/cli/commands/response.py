"""`beamdae response`: periodic motions of a model over a frequency or another parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
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
    parse_assignments,
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
from beamdae.cli.progress import show_curve_progress
from beamdae.cli.ranges import parse_ends
from beamdae.errors import BeamdaeError, require_positive

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.frequency_response import FrequencyResponse


def response_command(
    path: ModelPath,
    over: Annotated[
        str,
        typer.Option(
            metavar="NAME=FIRST:LAST",
            help="Parameter and the values between which it varies, ascending or descending.",
        ),
    ],
    settings: Settings = None,
    model_name: ModelName = None,
    angular: Annotated[
        bool, typer.Option("--angular", help="The parameter is an angular frequency in rad/s.")
    ] = False,
    period: Annotated[
        float | None,
        typer.Option(
            parser=parse_seconds,
            metavar="TIME",
            help="Period of the loads in seconds, if it does not depend on the parameter. Defaults "
            "to the reciprocal of the parameter, a frequency in Hz.",
        ),
    ] = None,
    integrator: IntegratorName = "radau",
    rtol: RelativeTolerance = None,
    step: Annotated[
        float,
        typer.Option(help="First step along the curve, relative to the amplitudes and the range."),
    ] = 0.02,
    max_step: Annotated[float, typer.Option(help="Largest step along the curve.")] = 0.1,
    settle: Annotated[
        int, typer.Option(help="Periods to run before the first periodic motion is sought.")
    ] = 20,
    start: Starts = None,
    t_start: PeriodStart = 0.0,
    max_points: Annotated[int, typer.Option(help="Maximum number of points of the curve.")] = 400,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Page = True,
    picture: Picture = True,
    plot: PlottedColumns = None,
    out: Out = Path("results"),
) -> None:
    """Follow a periodic motion over a parameter, past folds; write CSV, PNG and page.

    Exits with 0 if the curve reached the end of the range (and --accuracy), 1 if it did not
    (partial results are written) or the page or picture failed, 2 for a usage or model error, and
    130 after Ctrl-C.
    """
    from beamdae.cli.model_files.model_file import ModelFile

    file = ModelFile(path)
    model = load_configured_model(file, model_name, settings)
    parameter, ends = _parse_range(over, model)
    method = create_periodic_integrator("response", integrator, rtol, file)
    plotted = select_plotted_columns("response", model, plot, picture)
    table_path, picture_path = plan_outputs(out, f"{model.name}_response", picture, page)
    page_path = table_path.with_suffix(".html")
    from beamdae.analysis.periodic.periodic_continuation import frequency_response
    from beamdae.report.analysis_pages import write_analysis_page
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.path_plots import create_response_figure
    from beamdae.results.outcome import replace_with_errors
    from beamdae.results.storage.files import escape_table, write_text

    unit = "rad/s" if angular else "Hz" if period is None else ""
    if parameter in model.parameter_info:
        unit = model.parameter_info[parameter].unit or unit
    with show_curve_progress(parameter, unit, ends) as progress:
        result = frequency_response(
            model,
            parameter,
            ends,
            _period_function(angular, period),
            method,
            step,
            max_step,
            settle,
            max_points=max_points,
            t_start=t_start,
            start=parse_start(start, model),
            progress=progress,
            partial="return",
            **required_accuracy("response", accuracy, accuracy_columns, model),
        )
    if angular and not result.unit:
        result = replace_with_errors(result, unit="rad/s")
    table = escape_table(result.table())
    files = WrittenFiles(
        [write_text(table_path, table.to_csv(index=False))], (page_path, picture_path)
    )
    _print_results(result, model.name)
    is_shown = bool(result.points) and result.status.kind != "interrupted"
    title = f"{model.name}, periodic motions"
    if page and is_shown:
        files.write(page_path.name, lambda: [write_analysis_page(result, page_path, title)])
    if picture and is_shown:
        files.write(
            picture_path.name,
            lambda: [save_figure(create_response_figure(result, title, plotted), picture_path)],
        )
    files.finish(result.status, result)


def _parse_range(over: str, model: Model) -> tuple[str, tuple[float, float]]:
    """Return the parameter and the range of --over NAME=FIRST:LAST, whose ends may have units."""
    ((name, text),) = parse_assignments([over], "--over").items()
    info = model.parameter_info.get(name)
    ends = parse_ends("--over", name, text, info.unit if info else "")
    if ends is None or not all(map(math.isfinite, ends)) or ends[0] == ends[1]:
        raise BeamdaeError(
            f"--over {over}: the range must have the form FIRST:LAST, two different finite numbers."
        )
    return name, ends


def _period_function(angular: bool, period: float | None) -> Callable[[float], float] | None:
    """Return the period of the loads as a function of the parameter; None for a frequency in Hz."""
    if angular and period is not None:
        raise BeamdaeError("response: --angular and --period are mutually exclusive; omit one.")
    if angular:
        return lambda frequency: 2.0 * math.pi / frequency
    if period is None:
        return None
    constant = require_positive("response", "--period", period)
    return lambda parameter: constant


def _print_results(result: FrequencyResponse, name: str) -> None:
    from beamdae.report.analysis_pages import response_facts
    from beamdae.report.terminal import text_tables

    peaks = result.peak_table()
    console = print_facts(name, response_facts(result), lambda: _json_results(result))
    if not peaks.empty:
        console.print(text_tables.peaks_table(result.parameter, result.label, peaks))
    print_accuracy(console, result)
    print_warnings(console, result.warnings)


def _json_results(result: FrequencyResponse) -> dict[str, Any]:
    return {
        "status": result.status.kind,
        "reason": result.status.sentence,
        "points": result.table().to_dict("records"),
        "folds": result.folds,
        "peaks": result.peak_table().to_dict("records"),
        "warnings": list(result.warnings),
    }
