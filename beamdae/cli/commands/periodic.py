"""Commands `periodic` and `response`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.option_values import parse_assignments, parse_ends
from beamdae.cli.options import (
    IntegratorName,
    PlottedColumns,
    RelativeTolerance,
    Starts,
    create_periodic_integrator,
    time_option,
)
from beamdae.cli.progress import show_curve_progress
from beamdae.errors import BeamdaeError, require_positive

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.frequency_response import FrequencyResponse

StartTime = Annotated[
    float | None,
    time_option(
        help="Time from which on loads and drivers repeat, 0 by default.",
    ),
]


def periodic_command(
    job: AccurateJob,
    period: Annotated[
        float | None,
        time_option(
            help="Period of loads and drivers in seconds, or with a unit. Without it, the period "
            "of a self-excited or free motion is found.",
        ),
    ] = None,
    period_guess: Annotated[
        float | None,
        time_option(
            help="Approximate period in seconds, to be refined.",
        ),
    ] = None,
    integrator: IntegratorName = "radau",
    rtol: RelativeTolerance = None,
    start: Starts = None,
    t_start: StartTime = None,
    settle: Annotated[
        int, typer.Option(help="Periods to run before the periodic motion is sought.")
    ] = 5,
    plot: PlottedColumns = None,
) -> None:
    """Find a periodic motion and its stability; write one period as CSV, PNG and a page.

    Exits with 0 if a motion was found, stable or not, 1 if not (the last iterate is written), if
    --accuracy was not reached or if the page or picture failed, and 2 for a usage or model error.
    """
    method = create_periodic_integrator("periodic", integrator, rtol, job.file)
    plotted, _ = job.select_columns(plot)
    files, state = job.plan("_periodic"), job.start(start)

    def analyze() -> Any:
        from beamdae.analysis.periodic.periodic_solution import periodic

        return periodic(
            job.model,
            period,
            method,
            state,
            t_start or 0.0,
            settle,
            period_guess=period_guess,
            **job.requirement,
        )

    job.run(files, "one period", analyze, names=plotted)


def response_command(
    job: AccurateJob,
    over: Annotated[
        str,
        typer.Option(
            metavar="NAME=FIRST:LAST",
            help="Parameter and the values between which it varies, ascending or descending.",
        ),
    ],
    period: Annotated[
        float | None,
        time_option(
            help="Period of the loads in seconds, if it does not depend on the parameter. By "
            "default, the parameter is a frequency in its unit, such as Hz (default) or rad/s.",
        ),
    ] = None,
    integrator: IntegratorName = "radau",
    rtol: RelativeTolerance = None,
    settle: Annotated[
        int, typer.Option(help="Periods to run before the first periodic motion is sought.")
    ] = 20,
    start: Starts = None,
    t_start: StartTime = None,
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
    info = job.model.parameter_info.get(parameter)
    unit = (info and info.unit) or ("Hz" if period is None else "")
    constant = None if period is None else require_positive("response", "--period", period)

    def analyze() -> FrequencyResponse:
        from beamdae.analysis.periodic.periodic_continuation import frequency_response

        with show_curve_progress(parameter, unit, ends) as progress:
            return frequency_response(
                job.model,
                parameter,
                ends,
                None if constant is None else lambda _: constant,
                method,
                settle=settle,
                max_points=max_points,
                start=initial_state,
                t_start=t_start or 0.0,
                progress=progress,
                partial="return",
                **job.requirement,
            )

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
