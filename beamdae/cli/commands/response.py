"""`beamdae response`: periodic motions of a model over a frequency or another parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.options import (
    IntegratorName,
    PeriodStart,
    PlottedColumns,
    RelativeTolerance,
    Starts,
    create_periodic_integrator,
    parse_assignments,
    parse_seconds,
)
from beamdae.cli.progress import show_curve_progress
from beamdae.cli.ranges import parse_ends
from beamdae.errors import BeamdaeError, require_positive

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.frequency_response import FrequencyResponse


def response_command(
    job: AccurateJob,
    over: Annotated[
        str,
        typer.Option(
            metavar="NAME=FIRST:LAST",
            help="Parameter and the values between which it varies, ascending or descending.",
        ),
    ],
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
    plot: PlottedColumns = None,
) -> None:
    """Follow a periodic motion over a parameter, past folds; write CSV, PNG and page.

    Exits with 0 if the curve reached the end of the range (and --accuracy), 1 if it did not
    (partial results are written) or the page or picture failed, 2 for a usage or model error, and
    130 after Ctrl-C.
    """
    parameter, ends = _parse_range(over, job.model)
    method = create_periodic_integrator("response", integrator, rtol, job.file)
    plotted, _ = job.select_columns(plot)
    files, initial_state = job.plan("_response"), job.start(start)
    unit = "rad/s" if angular else "Hz" if period is None else ""
    if parameter in job.model.parameter_info:
        unit = job.model.parameter_info[parameter].unit or unit

    def analyze() -> FrequencyResponse:
        from beamdae.analysis.periodic.periodic_continuation import frequency_response
        from beamdae.results.outcome import replace_with_errors

        with show_curve_progress(parameter, unit, ends) as progress:
            result = frequency_response(
                job.model,
                parameter,
                ends,
                _period_function(angular, period),
                method,
                step,
                max_step,
                settle,
                max_points=max_points,
                t_start=t_start,
                start=initial_state,
                progress=progress,
                partial="return",
                **job.accuracy,
            )
        has_unit = result.unit or not angular
        return result if has_unit else replace_with_errors(result, unit="rad/s")

    job.run(files, "periodic motions", analyze, names=plotted)


def _parse_range(over: str, model: Model) -> tuple[str, tuple[float, float]]:
    """Return the parameter and the range of --over NAME=FIRST:LAST, whose ends may have units."""
    ((name, text),) = parse_assignments([over], "--over").items()
    info = model.parameter_info.get(name)
    ends = parse_ends("--over", name, text, info.unit if info else "")
    if not all(map(math.isfinite, ends)) or ends[0] == ends[1]:
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
