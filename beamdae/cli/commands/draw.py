"""`beamdae draw`: a model as it is stated, before anything is run."""

from __future__ import annotations

from pathlib import Path

import typer

from beamdae.cli.options import (
    ModelFile,
    ModelName,
    Out,
    Settings,
    load_configured_model,
    require_writable,
)
from beamdae.cli.output import WrittenFiles, create_console, print_written_files, record_results
from beamdae.errors import BeamdaeError


def draw_command(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    out: Out = Path("results"),
) -> None:
    """Draw a model with the names of its parts, its joints, supports and loads (PNG).

    Ends with 0, with 1 where the picture failed, and with 2 after a mistake.
    """
    model = load_configured_model(path, model_name, settings)
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.pictures.drawing import draw
    from beamdae.report.terminal import text_tables

    mechanism = model()
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(f"draw: {model.name} states equations, which have no shape.")
    file = out / f"{model.name}_drawing.png"
    require_writable(out, (file.name,))
    kinds = {name: type(part).__name__ for name, part in mechanism.parts.items()}
    record_results(lambda: {"parts": kinds})
    screen = create_console()
    screen.print(model.name, style="bold")
    screen.print(text_tables.parts_table(kinds))
    written = WrittenFiles()
    written.draw(model.name, lambda: [draw(mechanism).save(file)])
    print_written_files(screen, written.paths)
    if written.failed:
        raise typer.Exit(1)
