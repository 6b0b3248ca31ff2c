"""`beamdae draw`: a model as it is stated, before anything is run."""

from __future__ import annotations

from pathlib import Path

import typer

from beamdae.cli.model_options import configured
from beamdae.cli.options import ModelFile, ModelName, Out, Settings, require_writable
from beamdae.cli.output import console, record, say_written
from beamdae.cli.output_files import Written
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
    model = configured(path, model_name, settings)
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.pictures.drawing import draw
    from beamdae.report.terminal import text_tables as terminal

    mechanism = model()
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(f"draw: {model.name} states equations, which have no shape.")
    file = out / f"{model.name}_drawing.png"
    require_writable(out, (file.name,))
    kinds = {name: type(part).__name__ for name, part in mechanism.parts.items()}
    record(lambda: {"parts": kinds})
    screen = console()
    screen.print(model.name, style="bold")
    screen.print(terminal.parts_table(kinds))
    written = Written()
    written.draw(model.name, lambda: [draw(mechanism).save(file)])
    say_written(screen, written.paths)
    if written.failed:
        raise typer.Exit(1)
