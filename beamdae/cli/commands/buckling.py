"""`beamdae buckling`: linear buckling loads of a model, as a table and a picture."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.options import Loads, LoadTime, Starts, split_names


def buckling_command(
    job: AccurateJob,
    number: Annotated[int, typer.Option("-n", "--number", help="Number of load factors.")] = 5,
    load: Loads = None,
    t: LoadTime = 0.0,
    start: Starts = None,
) -> None:
    """Compute linear buckling loads of a model; write a table (CSV), a picture (PNG) and a page.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or picture failed, and 2
    for a usage or model error.
    """
    files = job.plan("_buckling")
    loads, initial_state = split_names(load) or None, job.start(start)

    def analyze() -> Any:
        from beamdae.analysis.statics.linear_buckling import buckling

        return buckling(job.model, number, loads, t, initial_state, **job.accuracy)

    job.run(files, "linear buckling", analyze)
