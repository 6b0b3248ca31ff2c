"""`beamdae modes`: natural modes of a model, as a table and pictures."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.options import (
    ModelFile,
    ModelName,
    Out,
    Settings,
    load_configured_model,
    require_writable,
)
from beamdae.cli.output import (
    WrittenFiles,
    create_console,
    print_warnings,
    print_written_files,
    record_results,
)
from beamdae.errors import BeamdaeError, require_choice, require_count

# What modes are about.
_STATES = ("reference", "equilibrium")


def modes_command(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    about: Annotated[
        str,
        typer.Option(
            metavar="STATE", help="reference or equilibrium.", autocompletion=lambda: _STATES
        ),
    ] = "reference",
    number: Annotated[int, typer.Option("-n", "--number", help="How many modes.")] = 10,
    damping: Annotated[bool, typer.Option(help="Damped modes, or undamped ones.")] = True,
    speed: Annotated[
        list[float] | None,
        typer.Option(
            "--speed",
            metavar="RAD/S",
            help="About a steady rotation; several, by repeating it, make a Campbell diagram.",
        ),
    ] = None,
    animate: Annotated[
        list[int] | None,
        typer.Option("--animate", metavar="MODE", help="Write a mode as a GIF; repeat."),
    ] = None,
    out: Out = Path("results"),
) -> None:
    """Find the natural modes of a model and write a table (CSV) and their shapes (PNG).

    Ends with 0, with 1 where a picture failed, and with 2 after a mistake.
    """
    model = load_configured_model(path, model_name, settings)
    require_choice("modes", "--about", about, _STATES)
    speeds, animated = speed or [], animate or []
    if speeds and about != "reference":
        raise BeamdaeError(f"modes: --about {about} and --speed each say what about, give one.")
    if len(speeds) > 1 and animated:
        raise BeamdaeError("modes: --animate needs modes at one --speed, not several.")
    files = {kind: out / f"{model.name}_modes.{kind}" for kind in ("csv", "png")}
    files |= {f"{k}": out / f"{model.name}_mode_{k}.gif" for k in animated}
    require_writable(out, tuple(file.name for file in files.values()))
    from beamdae.analysis.linear_dynamics.campbell_diagram import campbell
    from beamdae.analysis.linear_dynamics.natural_modes import modes
    from beamdae.analysis.linear_dynamics.steady_rotation import rotation

    built = model()
    found: Any
    if len(speeds) > 1:
        found = campbell(built, speeds, number, damping=damping)
    else:
        found = modes(built, rotation(speeds[0]) if speeds else about, number, damping)
        for k in animated:
            require_count("modes", "--animate", k, most=len(found))
    _write_and_print(found, model.name, files, animated)


def _write_and_print(found: Any, name: str, files: dict[str, Path], animated: list[int]) -> None:
    """The table on the disk and on the screen, then the pictures."""
    from beamdae.analysis.linear_dynamics.natural_modes import Modes
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.mode_shapes import create_campbell_figure, create_modes_figure
    from beamdae.report.terminal import text_tables
    from beamdae.results.storage.files import escape_table, write_text

    table = found.table()
    written = WrittenFiles([write_text(files["csv"], escape_table(table).to_csv(index=False))])
    one_state = isinstance(found, Modes)
    rows = "modes" if one_state else "speeds"
    about = found.about if one_state else "rotations"
    record_results(lambda: {"about": about, rows: table.to_dict("records")})
    screen = create_console()
    screen.print(name, style="bold")
    screen.print(text_tables.modes_table(table) if one_state else text_tables.campbell_table(table))
    print_warnings(screen, found.warnings)
    if not one_state:
        title = f"{name}, Campbell diagram"
        written.draw(
            name, lambda: [save_figure(create_campbell_figure(found, title), files["png"])]
        )
    elif found.mechanism is not None and len(found):
        title = f"{name}, modes about {found.about}"
        written.draw(name, lambda: [save_figure(create_modes_figure(found, title), files["png"])])
        for k in animated:
            written.draw(name, partial(_write_animation, found, k, files[f"{k}"]))
    print_written_files(screen, written.paths)
    if written.failed:
        raise typer.Exit(1)


def _write_animation(found: Any, mode: int, file: Path) -> list[Path]:
    from beamdae.report.pictures.mode_shapes import animate_mode

    animate_mode(found, mode, file)
    return [file]
