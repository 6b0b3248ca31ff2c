"""`beamdae modes`: natural modes of a model, as a table and pictures."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.options import (
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
    find_state,
    load_model,
    parse_number,
    required_accuracy,
)
from beamdae.cli.ranges import SPACED_FORMS, parse_spaced_values
from beamdae.cli.results import Report, ResultFiles, draw_modes, run_analysis
from beamdae.errors import BeamdaeError, require_count

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
    about: About = None,
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
    model, _ = load_model(path, model_name, settings)
    speeds, animated_modes = [x for group, _ in speed or [] for x in group], animate or []
    is_single = len(speeds) < _MIN_SPEEDS
    if multiple and is_single:
        raise BeamdaeError(
            "modes: --multiple requires several speeds; repeat --speed or give START:STOP:COUNT."
        )
    for option, value in (("--animate", animated_modes), ("--accuracy", accuracy)):
        if value and not is_single:
            raise BeamdaeError(
                f"modes: {option} does not support several speeds; give one --speed."
            )
    accurate = required_accuracy("modes", accuracy, accuracy_columns, model)
    resonances = out / f"{model.name}_resonances.csv"
    animations = {k: out / f"{model.name}_mode_{k}.gif" for k in animated_modes}
    further = animations.values() if is_single else [resonances]
    files = ResultFiles.plan(out, f"{model.name}_modes", page, picture, *further)
    mechanism = model()
    state = find_state("modes", mechanism, about, speeds[0] if speeds else None)

    def analyze() -> Any:
        from beamdae.analysis.linear_dynamics.campbell_diagram import SPEED_MULTIPLES, campbell
        from beamdae.analysis.linear_dynamics.natural_modes import compute_modes

        if is_single:
            # Its warnings are printed with the result.
            modes = compute_modes(mechanism, state, number, damping, **accurate)
            for k in animations:
                require_count("modes", "--animate", k, most=len(modes))
            return modes
        orders = multiple or SPEED_MULTIPLES
        diagram = campbell(mechanism, speeds, number, damping=damping, multiples=orders)
        return replace(diagram, speed_unit=speed[0][1] if speed else "rad/s")

    if is_single:

        def animate_modes(modes: Any) -> None:
            for k, file in animations.items():
                files.write(file.name, partial(_animate, modes, k, file))

        title = f"{model.name}, natural modes"
        describe = partial(_describe_modes, model.name)
        run_analysis(files, title, analyze, describe, draw_modes, further=animate_modes)
        return
    from beamdae.results.storage.files import write_escaped_table

    title = f"{model.name}, Campbell diagram"
    run_analysis(
        files,
        title,
        analyze,
        partial(_describe_campbell, model.name),
        _draw_campbell,
        lambda diagram: [
            diagram.to_csv(files.table),
            write_escaped_table(resonances, diagram.resonances()),
        ],
    )


def _describe_modes(name: str, modes: Any) -> Report:
    from beamdae.report.terminal import text_tables

    table = modes.table()
    return Report(
        name,
        lambda: {"about": modes.about, "modes": table.to_dict("records")},
        facts={"about": modes.about},
        tables=[text_tables.modes_table(table)],
        warnings=modes.warnings,
    )


def _describe_campbell(name: str, diagram: Any) -> Report:
    from beamdae.report.terminal import text_tables

    table, resonances = diagram.table(), diagram.resonances()
    tables = [text_tables.campbell_table(table)]
    if not resonances.empty:
        tables.append(text_tables.resonances_table(resonances))
    return Report(
        name,
        lambda: {
            "about": "rotations",
            "speeds": table.to_dict("records"),
            "resonances": resonances.to_dict("records"),
        },
        tables=tables,
        warnings=diagram.warnings,
    )


def _draw_campbell(diagram: Any, path: Path, title: str) -> Path:
    from beamdae.report.pictures.figures import save_figure
    from beamdae.report.pictures.mode_shapes import create_campbell_figure

    return save_figure(create_campbell_figure(diagram, title), path)


def _animate(modes: Any, k: int, path: Path) -> list[Path]:
    return [modes.animate(k, path)]
