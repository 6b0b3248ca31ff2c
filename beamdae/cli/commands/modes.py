"""`beamdae modes`: natural modes of a model, as a table and pictures."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.options import About, as_bad_parameter, find_state, parse_number
from beamdae.cli.ranges import SPACED_FORMS, parse_spaced_values
from beamdae.errors import BeamdaeError, require_count, warn_user

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
    job: AccurateJob,
    about: About = None,
    number: Annotated[
        int | None, typer.Option("-n", "--number", help="Number of modes. Defaults to 10.")
    ] = None,
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
) -> None:
    """Compute natural modes of a model; write a table (CSV), a picture (PNG) and a page.

    With several speeds, picture and page show a Campbell diagram, and a second table (CSV) contains
    the resonances with multiples of the speed.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or a picture failed, and 2
    for a usage or model error.
    """
    count = 10 if number is None else number
    speeds, animated_modes = [x for group, _ in speed or [] for x in group], animate or []
    is_single = len(speeds) < _MIN_SPEEDS
    if multiple and is_single:
        raise BeamdaeError(
            "modes: --multiple requires several speeds; repeat --speed or give START:STOP:COUNT."
        )
    accuracy = job.accuracy["accuracy"]
    for option, value in (("--animate", animated_modes), ("--accuracy", accuracy)):
        if value and not is_single:
            raise BeamdaeError(
                f"modes: {option} does not support several speeds; give one --speed."
            )
    resonances = job.path("_resonances.csv")
    animations = {k: job.path(f"_mode_{k}.gif") for k in animated_modes}
    files = job.plan("_modes", *(animations.values() if is_single else [resonances]))
    mechanism = job.mechanism
    state = find_state("modes", mechanism, about, speeds[0] if speeds else None)

    def analyze() -> Any:
        from beamdae.analysis.linear_dynamics.campbell_diagram import SPEED_MULTIPLES, campbell
        from beamdae.analysis.linear_dynamics.natural_modes import compute_modes

        if is_single:
            # Its warnings are printed with the result.
            modes = compute_modes(mechanism, state, count, damping, **job.accuracy)
            if number is not None and len(modes) < number:
                warn_user(f"modes: --number is {number}, but the number of modes is {len(modes)}.")
            for k in animations:
                require_count("modes", "--animate", k, most=len(modes))
            return modes
        orders = multiple or SPEED_MULTIPLES
        diagram = campbell(mechanism, speeds, count, damping=damping, multiples=orders)
        return replace(diagram, speed_unit=speed[0][1] if speed else "rad/s")

    def animate_modes(modes: Any) -> None:
        for k, file in animations.items():
            files.write(file.name, partial(_animate, modes, k, file))

    def write_tables(diagram: Any) -> list[Path]:
        from beamdae.results.storage.files import write_escaped_table

        written = write_escaped_table(resonances, diagram.resonances())
        return [diagram.to_csv(files.table), written]

    if is_single:
        job.run(files, "natural modes", analyze, further=animate_modes)
    else:
        job.run(files, "Campbell diagram", analyze, write_tables)


def _animate(modes: Any, k: int, path: Path) -> list[Path]:
    return [modes.animate(k, path)]
