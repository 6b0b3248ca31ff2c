"""`beamdae export`: a model as a functional mock-up unit (FMU)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from beamdae.cli.job import ModelJob
from beamdae.cli.option_values import split_names
from beamdae.cli.options import (
    FixedStep,
    FurtherSettings,
    RelativeTolerance,
    Starts,
    accuracy_option,
    create_integrator,
    time_option,
)
from beamdae.cli.output import require_writable
from beamdae.cli.results import Report, ResultFiles

_KILOBYTE = 1e3
_LISTS = ("inputs", "parameters", "outputs", "platforms")


def export_command(
    job: ModelJob,
    fmu: Annotated[Path, typer.Option(metavar="FILE.fmu", help="File to write.")],
    integrator: Annotated[
        str,
        accuracy_option(
            metavar="NAME", help="radau (adaptive steps) or generalized-alpha (fixed steps)."
        ),
    ] = "radau",
    rtol: RelativeTolerance = None,
    step: FixedStep = None,
    option: FurtherSettings = None,
    communication_step: Annotated[
        float | None,
        time_option(
            help="Default communication step in seconds, or with a unit. Defaults to --step, or "
            "1 ms.",
        ),
    ] = None,
    inputs: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Inputs of the mechanism. Defaults to all."),
    ] = None,
    outputs: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Observed columns. Defaults to all."),
    ] = None,
    parameters: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Parameters of the model to be tunable."),
    ] = None,
    fmi: Annotated[int, typer.Option(help="Version of the interface: 2 or 3.")] = 2,
    start: Starts = None,
    platforms: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Platforms of the binaries, such as x86_64-linux,x86_64-windows; none for "
            "sources only. Defaults to this machine.",
        ),
    ] = None,
    real_time: Annotated[
        int | None,
        typer.Option(metavar="N", help="Take exactly N Newton iterations in every step."),
    ] = None,
) -> None:
    """Export a model as an FMU for co-simulation, which runs without Python.

    Exits with 0 if the FMU was written, and with 2 for a usage or model error, for example if the
    model cannot be exported.
    """
    model = job.model
    named = {"rtol": rtol, "step": step}
    method = create_integrator("export", integrator, named, job.file, option)
    require_writable(("--fmu", [fmu]))
    from beamdae.export.fmu import export_fmu
    from beamdae.report.descriptions import Description

    named_platforms = None
    if platforms is not None:
        named_platforms = [] if platforms == "none" else split_names(platforms)
    result = export_fmu(
        model,
        fmu,
        method,
        communication_step=communication_step,
        inputs=None if inputs is None else split_names(inputs),
        outputs=None if outputs is None else split_names(outputs),
        parameters=split_names(parameters),
        fmi=fmi,
        start=job.start(start),
        platforms=named_platforms,
        real_time=real_time,
    )
    facts = {
        "interface": f"FMI {result.fmi}.0 for co-simulation",
        "integrator": result.integrator,
        "communication step": f"{result.communication_step:g} s",
        "inputs": ", ".join(result.inputs) or "none",
        "tunable parameters": ", ".join(result.parameters) or "none",
        "outputs": ", ".join(result.outputs) or "none",
        "binaries": ", ".join(result.platforms) or "none (sources only)",
        "size": f"{result.size / _KILOBYTE:.0f} kB",
    }
    data = {
        name.replace("_", " "): getattr(result, name)
        for name in ("fmi", "integrator", "communication_step", *_LISTS, "size")
    }
    Report(model.name, Description(facts, data=lambda: data)).print()
    ResultFiles([result.path]).finish()
