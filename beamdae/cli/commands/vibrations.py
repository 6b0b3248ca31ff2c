"""Commands `modes` and `bode`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.job import AccurateJob
from beamdae.cli.option_values import (
    SPACED_FORMS,
    as_bad_parameter,
    parse_ends,
    parse_number,
    parse_spaced_values,
    split_names,
)
from beamdae.cli.options import About, LoadTime, Repeated, find_state
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError, require_count, short_repr, warn_user

if TYPE_CHECKING:
    from beamdae.analysis.linear_dynamics.bode_diagram import Bode
    from beamdae.analysis.linear_dynamics.stability_margins import StabilityMargins


_MIN_SPEEDS = 2  # of a Campbell diagram
_SPEED_COUNTS = (_MIN_SPEEDS, 1000)

_FREQUENCY_COUNTS = (1, 100_000)  # of frequencies
_FREQUENCY_FORMS = f"FIRST:LAST, {SPACED_FORMS}"


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
            parse_spaced_values("--speed", "", text, "rad/s", _SPEED_COUNTS, SPACED_FORMS),
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
    accuracy = job.accuracy
    for option, value in (("--animate", animated_modes), ("--accuracy", accuracy)):
        if value and not is_single:
            raise BeamdaeError(
                f"modes: {option} does not support several speeds; give one --speed."
            )
    resonances = job.output("_resonances.csv")
    animations = {k: job.output(f"_mode_{k}.gif") for k in animated_modes}
    files = job.plan("_modes", *(animations.values() if is_single else [resonances]))
    mechanism = job.mechanism
    state = find_state("modes", mechanism, about, speeds[0] if speeds else None)

    def analyze() -> Any:
        from beamdae.analysis.linear_dynamics.campbell_diagram import SPEED_MULTIPLES, campbell
        from beamdae.analysis.linear_dynamics.natural_modes import compute_modes

        if is_single:
            # Its warnings are printed with the result.
            modes = compute_modes(mechanism, state, count, damping, **job.requirement)
            if number is not None and len(modes) < number:
                warn_user(f"modes: --number is {number}, but the number of modes is {len(modes)}.")
            for k in animations:
                require_count("modes", "--animate", k, most=len(modes))
            return modes
        orders = multiple or SPEED_MULTIPLES
        diagram = campbell(mechanism, speeds, count, damping=damping, multiples=orders)
        return replace(diagram, speed_unit=speed[0][1] if speed else "rad/s")

    def animate_modes(modes: Any) -> None:
        def animate(k: int, file: Path) -> list[Path]:
            return [modes.animate(k, file)]

        for k, file in animations.items():
            files.write(file.name, partial(animate, k, file))

    def write_tables(diagram: Any) -> list[Path]:
        from beamdae.results.storage.files import write_escaped_table

        written = write_escaped_table(resonances, diagram.resonances())
        return [diagram.to_csv(files.table), written]

    if is_single:
        job.run(files, "natural modes", analyze, further=animate_modes)
    else:
        job.run(files, "Campbell diagram", analyze, write_tables)


def parse_frequencies(text: str) -> tuple[list[float] | None, tuple[float, float] | None]:
    """Return the frequencies [Hz] of --frequencies, or the ends of the default ones.

    Raises
    ------
    typer.BadParameter
        If a number or its unit is invalid, the text does not have one of the forms, or frequencies
        are not positive and ascending.
    """
    values: list[float] | None = None
    try:
        if text.count(":") > 1:
            values = parse_spaced_values(
                "--frequencies", "", text, "Hz", _FREQUENCY_COUNTS, _FREQUENCY_FORMS
            )
            ends = values[0], values[-1]
        else:
            ends = parse_ends("--frequencies", "", text, "Hz", _FREQUENCY_FORMS)
    except BeamdaeError as problem:
        raise as_bad_parameter(text, problem) from None
    if not 0.0 < ends[0] <= ends[1] < math.inf or (values is None and ends[0] == ends[1]):
        raise typer.BadParameter(f"{short_repr(text)}: frequencies must be positive and ascend.")
    return values, None if values else ends


def bode_command(
    job: AccurateJob,
    inputs: Annotated[
        Repeated,
        typer.Option(
            "--input",
            metavar="NAME",
            help="Input, force, moment or driver that excites the model, or a column such as "
            "push.Fy, or several separated by commas; repeatable. Defaults to all of them.",
        ),
    ] = None,
    outputs: Annotated[
        Repeated,
        typer.Option(
            "--output",
            metavar="NAME",
            help="Column or observable, or several separated by commas; repeatable. Defaults to "
            "all observables.",
        ),
    ] = None,
    frequencies: Annotated[
        Any,
        typer.Option(
            parser=parse_frequencies,
            metavar="FIRST:LAST",
            help="Range in Hz, or with a unit (0.1:1kHz), in which all resonances have their own "
            "frequencies, or START:STOP:COUNT with :log or without it for these frequencies only. "
            "Defaults to the range of the resonances, for which elements are short enough.",
        ),
    ] = None,
    about: About = None,
    t: LoadTime = 0.0,
) -> None:
    """Compute the linear frequency response (transfer functions); write CSV, PNG and page.

    Amplitudes are small; `response` computes nonlinear periodic motions. The input of a driver is
    its acceleration. The margins of the loop of each `pid` are printed, too.

    Exits with 0 on success, 1 if --accuracy was not reached or the page or the picture failed, and
    2 for a usage or model error.
    """
    grid, ends = frequencies or (None, None)
    files, mechanism = job.plan("_bode"), job.mechanism
    state = find_state("bode", mechanism, about)
    selected = [split_names(x) or None for x in (inputs, outputs)]

    def analyze() -> Bode:
        from beamdae.analysis.linear_dynamics.bode_diagram import bode
        from beamdae.analysis.linear_dynamics.linear_model import linearize

        linear = linearize(mechanism, state, selected[0], selected[1], t)
        if not linear.inputs or not linear.outputs:
            kind = (
                "inputs, such as a force" if not linear.inputs else "outputs, such as an observable"
            )
            raise BeamdaeError(f"bode: the model has no {kind}; add one.")
        return bode(linear, grid, ends, **job.requirement)

    job.run(files, "linear response", analyze, complete=partial(_add_margins, mechanism.outputs))


def _add_margins(controllers: Iterable[str], diagram: Bode, report: Report) -> Report:
    """Add the margins of the loop of each `pid`, and the reasons why loops have none."""
    from beamdae.analysis.linear_dynamics.stability_margins import margins

    loops: dict[str, StabilityMargins] = {}
    notes = []
    for name in controllers:
        try:
            loops[name] = margins(diagram.model, name)
        except BeamdaeError as problem:
            notes.append(str(problem))
        else:
            notes.extend(loops[name].warnings)
    x = report.description
    tables = {loop: margin.table() for loop, margin in loops.items()}
    description = replace(
        x,
        facts={**x.facts, **{f"loop of {loop}": str(margin) for loop, margin in loops.items()}},
        data=lambda: {**x.data(), "margins": tables},
    )
    warnings = [*report.warnings, *notes]
    return replace(report, description=description, warnings=warnings, source="--json")
