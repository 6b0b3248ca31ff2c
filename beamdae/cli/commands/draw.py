"""`beamdae draw`: draw a model as defined, without running it."""

from __future__ import annotations

from pathlib import Path

from beamdae.cli import startup
from beamdae.cli.options import (
    ModelName,
    ModelPath,
    Out,
    Settings,
    load_model,
)
from beamdae.cli.output_paths import require_writable
from beamdae.cli.results import Report, ResultFiles
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
    model, _ = load_model(path, model_name, settings, startup.MODELS)
    picture = out / f"{model.name}_drawing.png"
    require_writable(("--out", (picture,)))
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.descriptions import Description

    mechanism = model()
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(
            f"draw: {model.name} consists of equations without a shape; only a Mechanism can be "
            "drawn."
        )
    types = {name: type(part).__name__ for name, part in mechanism.parts.items()}
    Report(model.name, Description(data=lambda: {"parts": types})).print()
    files = ResultFiles()
    files.write(model.name, lambda: [mechanism.draw().save(picture)])
    files.finish()
