"""`beamdae view`: a page with sliders for the parameters of a model, served locally."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Annotated

import typer

from beamdae.cli.options import (
    EndTime,
    ModelName,
    ModelPath,
    Settings,
    load_model,
    parse_assignments,
    parse_seconds,
)
from beamdae.cli.output import create_console, record_results
from beamdae.cli.ranges import parse_ends
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.model_functions import Model


def view_command(
    path: ModelPath,
    settings: Settings = None,
    ranges: Annotated[
        list[str] | None,
        typer.Option(
            "--range",
            metavar="NAME=FIRST:LAST",
            help="Ends of the slider of a parameter, for example radius=50cm:2m; repeatable.",
        ),
    ] = None,
    model_name: ModelName = None,
    t_end: EndTime = None,
    time_limit: Annotated[
        float,
        typer.Option(
            parser=parse_seconds, metavar="TIME", help="Maximum wall time of a run in seconds."
        ),
    ] = 10.0,
    port: Annotated[int, typer.Option(help="Port of the server; 0 chooses a free port.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", metavar="", help="Open the web browser.")
    ] = True,
) -> None:
    """Show a model with sliders for its parameters; the drawing follows, and runs are animated.

    The page is served on this computer only, at the printed address, until Ctrl-C. Exits with 130
    after Ctrl-C, and with 2 and a message for a usage or model error.
    """
    model, _ = load_model(path, model_name, settings)
    from beamdae.live.server import LiveView, create_session

    texts = parse_assignments(ranges, "--range")
    ends = {name: _parse_range(model, name, text) for name, text in texts.items()}
    live = LiveView(create_session(model, ends, t_end, time_limit), port, is_embedded=False)
    try:
        if problem := live.session.draw({}).get("error"):
            raise BeamdaeError(problem)
        record_results(lambda: {"address": live.url})
        create_console().print(
            f"{model.name}: {live.url}\nCtrl-C ends the view.", soft_wrap=True, highlight=False
        )
        if browser:
            live.open()
        with warnings.catch_warnings():
            # The page shows the warnings of runs.
            warnings.simplefilter("ignore", UserWarning)
            live.wait()
    finally:
        live.close()


def _parse_range(model: Model, name: str, text: str) -> tuple[float, float]:
    info = model.parameter_info.get(name)
    return parse_ends("--range", name, text, info.unit if info else "")
