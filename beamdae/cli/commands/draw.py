"""`beamdae draw`: draw a model as defined, without running it."""

from __future__ import annotations

from pathlib import Path

import typer

from beamdae.cli import startup
from beamdae.cli.options import (
    ModelName,
    ModelPath,
    Out,
    Settings,
    load_configured_model,
)
from beamdae.cli.output import (
    WrittenFiles,
    create_console,
    print_written_files,
    record_results,
)
from beamdae.cli.output_paths import require_writable
from beamdae.errors import BeamdaeError


def draw_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    out: Out = Path("results"),
) -> None:
    """Draw a model with its joints, supports, loads and part names (PNG).

    Exits with 0 on success, 1 if drawing failed, and 2 for a usage or model error.
    """
    from beamdae.cli.model_files.model_file import ModelFile

    model = load_configured_model(ModelFile(path, startup.MODELS), model_name, settings)
    picture = out / f"{model.name}_drawing.png"
    require_writable(("--out", (picture,)))
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.pictures.drawing import draw
    from beamdae.report.terminal import text_tables

    mechanism = model()
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(
            f"draw: {model.name} consists of equations without a shape; only a Mechanism can be "
            "drawn."
        )
    types = {name: type(part).__name__ for name, part in mechanism.parts.items()}
    record_results(lambda: {"parts": types})
    console = create_console()
    console.print(model.name, style="bold")
    console.print(text_tables.parts_table(types))
    files = WrittenFiles()
    files.write(model.name, lambda: [draw(mechanism).save(picture)])
    print_written_files(console, files.paths)
    if files.failed:
        raise typer.Exit(1)
