"""`beamdae modes`: natural modes of a model, as a table and pictures."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.options import (
    STATES,
    About,
    AccurateColumns,
    ModelName,
    ModelPath,
    Out,
    Page,
    Picture,
    RequiredAccuracy,
    Settings,
    as_bad_parameter,
    load_configured_model,
    parse_number,
    required_accuracy,
)
from beamdae.cli.output import (
    WrittenFiles,
    create_console,
    print_accuracy,
    print_warnings,
    record_results,
)
from beamdae.cli.output_paths import require_writable
from beamdae.cli.ranges import SPACED_FORMS, parse_spaced_values
from beamdae.errors import BeamdaeError, require_choice, require_count

_MIN_SPEEDS = 2  # of a Campbell diagram
_RANGE_COUNTS = (_MIN_SPEEDS, 1000)


def parse_speeds(text: str) -> tuple[list[float], str]:
    """Return the speeds [rad/s] of --speed, a number or a range, and their unit.

    Raises
    ------
    typer.BadParameter
        If a number or its unit is invalid, or a range does not have one of the forms.
    """
    from beamdae.model_parameters import parse_quantity

    quantities = [parse_quantity(end) for end in text.split(":")[:2]]
    unit = next((x[1] for x in quantities if x is not None and x[1]), "rad/s")
    if ":" not in text:
        return [parse_number(text, "rad/s")], unit
    try:
        return (
            parse_spaced_values("--speed", "", text, "rad/s", _RANGE_COUNTS, SPACED_FORMS),
            unit,
        )
    except BeamdaeError as problem:
        raise as_bad_parameter(text, problem) from None


def modes_command(
    path: ModelPath,
    settings: Settings = None,
    model_name: ModelName = None,
    about: About = "reference",
    number: Annotated[int, typer.Option("-n", "--number", help="Number of modes.")] = 10,
    damping: Annotated[bool, typer.Option(help="Compute damped or undamped modes.")] = True,
    speed: Annotated[
        list[Any] | None,
        typer.Option(
            "--speed",
            parser=parse_speeds,
            metavar="SPEED",
            help="Linearize about a steady rotation at this speed in rad/s, or with a unit "
            "(3000rpm); several speeds, repeated or as START:STOP:COUNT (0:3000rpm:16), are a "
            "Campbell diagram.",
        ),
    ] = None,
    multiple: Annotated[
        list[int] | None,
        typer.Option(
            "--multiple",
            metavar="N",
            help="Excitations per revolution (engine order) in the Campbell diagram; repeatable. "
            "Defaults to 1, 2, 3 and 4.",
        ),
    ] = None,
    animate: Annotated[
        list[int] | None,
        typer.Option(
            "--animate", metavar="MODE", help="Write an animation (GIF) of this mode; repeatable."
        ),
    ] = None,
    accuracy: RequiredAccuracy = None,
    accuracy_columns: AccurateColumns = None,
    page: Page = True,
    picture: Picture = True,
    out: Out = Path("results"),
) -> None:
    """Compute natural modes of a model; write a table (CSV), a picture (PNG) and a page.

    With several speeds, picture and page show a Campbell diagram, and a second table (CSV) contains
    the resonances with multiples of the speed.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or a picture failed, and 2
    for a usage or model error.
    """
    from beamdae.cli.model_files.model_file import ModelFile

    model = load_configured_model(ModelFile(path), model_name, settings)
    require_choice("modes", "--about", about, STATES)
    speeds, animated_modes = [x for group, _ in speed or [] for x in group], animate or []
    if speeds and about != "reference":
        raise BeamdaeError(f"modes: --about {about} and --speed are mutually exclusive; omit one.")
    if multiple and len(speeds) < _MIN_SPEEDS:
        raise BeamdaeError(
            "modes: --multiple requires several speeds; repeat --speed or give START:STOP:COUNT."
        )
    if len(speeds) > 1 and animated_modes:
        raise BeamdaeError("modes: --animate does not support several speeds; give one --speed.")
    if len(speeds) > 1 and accuracy is not None:
        raise BeamdaeError("modes: --accuracy does not support several speeds; give one --speed.")
    accurate = required_accuracy("modes", accuracy, accuracy_columns, model)
    kinds = ("csv", *["html"] * page, *["png"] * picture)
    files = {kind: out / f"{model.name}_modes.{kind}" for kind in kinds}
    if len(speeds) >= _MIN_SPEEDS:
        files["resonances"] = out / f"{model.name}_resonances.csv"
    files |= {f"{k}": out / f"{model.name}_mode_{k}.gif" for k in animated_modes}
    require_writable(("--out", files.values()))
    from beamdae.analysis.linear_dynamics.natural_modes import compute_modes
    from beamdae.parts.rotation import rotation

    mechanism = model()
    result: Any
    if len(speeds) >= _MIN_SPEEDS:
        from beamdae.analysis.linear_dynamics.campbell_diagram import SPEED_MULTIPLES, campbell

        orders = multiple or SPEED_MULTIPLES
        result = campbell(mechanism, speeds, number, damping=damping, multiples=orders)
        result = replace(result, speed_unit=speed[0][1] if speed else "rad/s")
    else:
        state = rotation(speeds[0]) if speeds else about
        # Its warnings are printed with the result.
        result = compute_modes(mechanism, state, number, damping, **accurate)
        for k in animated_modes:
            require_count("modes", "--animate", k, most=len(result))
    _write_and_print(result, model.name, files, animated_modes)


def _write_and_print(
    result: Any, name: str, paths: dict[str, Path], animated_modes: list[int]
) -> None:
    from beamdae.analysis.linear_dynamics.natural_modes import Modes
    from beamdae.report.analysis_pages import write_analysis_page
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.mode_shapes import (
        animate_mode,
        create_campbell_figure,
        create_modes_figure,
    )
    from beamdae.report.terminal import text_tables
    from beamdae.results.storage.files import escape_table, write_text

    table = result.table()
    tables = {"csv": table}
    if not isinstance(result, Modes):
        tables["resonances"] = result.resonances()
    texts = {kind: escape_table(x).to_csv(index=False) for kind, x in tables.items()}
    views = tuple(paths["csv"].with_suffix(suffix) for suffix in (".html", ".png"))
    files = WrittenFiles([write_text(paths[kind], text) for kind, text in texts.items()], views)
    console = create_console()
    if isinstance(result, Modes):
        record_results(lambda: {"about": result.about, "modes": table.to_dict("records")})
        console.print(name, style="bold")
        console.print(text_tables.modes_table(table))
    else:
        resonances = tables["resonances"]
        record_results(
            lambda: {
                "about": "rotations",
                "speeds": table.to_dict("records"),
                "resonances": resonances.to_dict("records"),
            }
        )
        console.print(name, style="bold")
        console.print(text_tables.campbell_table(table))
        if not resonances.empty:
            console.print(text_tables.resonances_table(resonances))
    print_accuracy(console, result)
    print_warnings(console, result.warnings)

    def write_animation(mode: int) -> list[Path]:
        animate_mode(result, mode, paths[f"{mode}"])
        return [paths[f"{mode}"]]

    is_single = isinstance(result, Modes)
    title = f"{name}, modes about {result.about}" if is_single else f"{name}, Campbell diagram"

    def write_picture() -> list[Path]:
        create_figure = create_modes_figure if is_single else create_campbell_figure
        return [save_figure(create_figure(result, title), paths["png"])]

    if "html" in paths:
        path = paths["html"]
        files.write(path.name, lambda: [write_analysis_page(result, path, title)])
    is_drawable = not is_single or (result.mechanism is not None and len(result) > 0)
    if is_drawable:
        if "png" in paths:
            files.write(name, write_picture)
        for k in animated_modes:
            files.write(name, partial(write_animation, k))
    files.finish(result=result)
