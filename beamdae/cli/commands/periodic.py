"""`beamdae periodic`: a periodic motion of a model and its stability."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.options import (
    IntegratorName,
    PlottedColumns,
    RelativeTolerance,
    Starts,
    create_periodic_integrator,
    parse_seconds,
)


def periodic_command(
    job: AccurateJob,
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
            settle=settle,
            period_guess=period_guess,
            **job.accuracy,
        )

    job.run(files, "one period", analyze, names=plotted)
