"""Options shared by several commands, and the objects they specify."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.catalog import INTEGRATORS
from beamdae.cli.option_values import (
    parse_accuracy,
    parse_assignments,
    parse_named_number,
    parse_seconds,
)
from beamdae.errors import BeamdaeError, require_choice, short_repr, suggest

if TYPE_CHECKING:
    from beamdae.cli.model_file import ModelFile
    from beamdae.model_functions import Model
    from beamdae.parts.rotation import Rotation

Repeated = list[str] | None  # type of options that may be repeated
time_option = partial(typer.Option, parser=parse_seconds, metavar="TIME")
# Options in panels of the help of their own.
output_option = partial(typer.Option, rich_help_panel="Outputs")
accuracy_option = partial(typer.Option, rich_help_panel="Integrator and accuracy")
expert_option = partial(typer.Option, rich_help_panel="Expert options")
_STATES = ("as drawn", "equilibrium")
_ROTATION = "rotation="  # start in steady rotation at the speed that follows

ModelPath = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL.py",
        help="Model file, or example:NAME.",
    ),
]
StudyPath = Annotated[
    Path,
    typer.Argument(
        metavar="FILE.py",
        help="Study, sweep or model file, or example:NAME.",
    ),
]
ModelName = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="NAME",
        help="Model, study or sweep to use if the file contains several.",
    ),
]
Settings = Annotated[
    Repeated,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Set a model parameter; repeatable.",
    ),
]
Starts = Annotated[
    Repeated,
    typer.Option(
        "--start",
        metavar="START",
        help="Initial state: 'as drawn', 'equilibrium', a steady rotation about the origin as "
        "rotation=SPEED in rad/s or with a unit (rotation=3000rpm), or PART.COORDINATE=VALUE with "
        "or without a unit (rates end in _dot); values are repeatable. Defaults to the model's "
        "initial state.",
        autocompletion=lambda: ["equilibrium"],
    ),
]
StartCount = Annotated[
    int, expert_option(help="Number of searches; all but the first begin at random points.")
]
StartSeed = Annotated[int, expert_option(help="Seed of the random points.")]
Bounds = Annotated[
    Repeated,
    typer.Option(
        metavar="NAME=LOW:HIGH",
        help="Bounds of a parameter, with or without units, or one of them, as in LOW:; "
        "repeatable.",
    ),
]
Loads = Annotated[
    Repeated,
    typer.Option(
        "--load",
        metavar="NAME",
        help="Load to scale, or 'gravity', or several separated by commas; repeatable. Defaults to "
        "all loads.",
    ),
]
_LINEARIZED_STATES = ("reference", "equilibrium")
About = Annotated[
    str | None,
    typer.Option(
        "--about",
        metavar="STATE",
        help="State to linearize about: reference (the drawing), equilibrium, or rotation=SPEED in "
        "rad/s or with a unit (rotation=3000rpm). Defaults to the start of the model.",
        autocompletion=lambda: _LINEARIZED_STATES,
    ),
]
LoadTime = Annotated[
    float,
    time_option(
        "--t",
        help="Time in seconds, or with a unit, at which laws are evaluated.",
    ),
]
IntegratorName = Annotated[
    str,
    accuracy_option(
        metavar="NAME",
        help=f"Integrator: {', '.join(INTEGRATORS)}, or an Integrator class or instance of the "
        "model file.",
        autocompletion=lambda: list(INTEGRATORS),
    ),
]
RelativeTolerance = Annotated[
    float | None,
    accuracy_option(
        help="Relative tolerance. Selects adaptive steps for generalized-alpha. Defaults "
        "to the value of the integrator."
    ),
]
FixedStep = Annotated[
    float | None,
    accuracy_option(
        parser=parse_seconds,
        metavar="TIME",
        help="Step in seconds, or with a unit (1ms), of fixed-step integrators. Defaults to the "
        "default of the integrator.",
    ),
]
EndTime = Annotated[
    float | None,
    time_option(
        help="End time in seconds, or with a unit (500ms). Defaults to the model's end time.",
    ),
]
OutputStep = Annotated[
    float | None,
    time_option(
        help="Time between output rows in seconds, or with a unit. Defaults to 1/1000 of the run "
        "(compare and sweep: 1/400).",
    ),
]
FurtherSettings = Annotated[
    Repeated,
    expert_option(
        "--option",
        metavar="NAME=VALUE",
        help="Further setting of the integrator, such as max_order=2, rho_inf=0.5 or "
        "formulation=ggl; repeatable.",
    ),
]
TimeLimit = Annotated[
    float | None,
    expert_option(
        parser=parse_seconds,
        metavar="TIME",
        help="Maximum wall time of a run in seconds; partial results are kept.",
    ),
]
RequiredAccuracy = Annotated[
    float | None,
    accuracy_option(
        "--accuracy",
        parser=parse_accuracy,
        metavar="ERROR",
        help="Refine steps, elements and strains until the measured errors of positions, angles, "
        "deflections, frequencies and load factors are below this part, for example 1%.",
    ),
]
AccurateColumns = Annotated[
    Repeated,
    accuracy_option(
        "--columns",
        metavar="NAME",
        help="Column or observable that must reach --accuracy, such as a stress, or several "
        "separated by commas; repeatable. Defaults to positions, angles, deflections, frequencies "
        "and load factors.",
    ),
]
ComparedColumns = Annotated[
    Repeated,
    accuracy_option(
        "--columns",
        metavar="NAME",
        help="Column or observable whose errors are compared, or several separated by commas; "
        "repeatable. Defaults to the columns in m or rad that vary.",
    ),
]
Jobs = Annotated[
    int | None,
    expert_option(
        "--jobs", "--workers", help="Number of processes. Defaults to one per core.", metavar="N"
    ),
]
Scheduler = Annotated[
    str | None,
    expert_option(
        metavar="ADDRESS", help="Run on this Dask scheduler, for example tcp://host:8786."
    ),
]
Page = Annotated[
    bool, output_option(metavar="", help="Write a page (HTML) with charts and tables.")
]
Picture = Annotated[bool, output_option(metavar="", help="Write the picture (PNG).")]
PlottedColumns = Annotated[
    Repeated,
    output_option(
        "--plot",
        metavar="NAME",
        help="Column or observable in the picture, or several separated by commas; repeatable. "
        "The page opens on them. Defaults to characteristic columns.",
    ),
]
DataColumns = Annotated[
    Repeated,
    output_option(
        "--data-column",
        metavar="NAME=COLUMN",
        help="Column of the model, or t, for a column of the data with another name, such as "
        "'Laser [mm]=tip.y'; repeatable.",
    ),
]
HorizontalColumn = Annotated[
    str | None,
    output_option(
        "--x",
        metavar="NAME",
        help="Column on the horizontal axis of the picture, for example tip.x for the path of tip.",
    ),
]
Pictures = Annotated[
    bool, output_option("--picture/--no-picture", metavar="", help="Write pictures (PNG).")
]
Out = Annotated[Path, output_option(help="Output folder.")]


def find_state(command: str, mechanism: Any, about: str | None, speed: float | None = None) -> Any:
    """Return the state of --about or --speed, by default the start of a mechanism."""
    from beamdae.parts.rotation import rotation

    if about is not None and speed is not None:
        raise BeamdaeError(
            f"{command}: --about {about} and --speed are mutually exclusive; omit one."
        )
    if about is not None and about.startswith(_ROTATION):
        speed = _parse_speed("--about", about)
    if speed is not None:
        return rotation(speed)
    if about is not None:
        states = *_LINEARIZED_STATES, f"{_ROTATION}SPEED"
        return require_choice(command, "--about", about, states)
    return getattr(mechanism, "start", "reference")


def _parse_speed(option: str, text: str) -> float:
    """Return the speed [rad/s] of an option rotation=SPEED."""
    name, _, speed = text.partition("=")
    return parse_named_number(option, name, speed, lambda: {name: "rad/s"})


def create_periodic_integrator(command: str, name: str, rtol: float | None, file: ModelFile) -> Any:
    """Return an integrator; the tolerance of Radau defaults to that of `periodic`.

    See `create_integrator` for errors.
    """
    from beamdae.analysis.periodic.shooting import DEFAULT_RTOL

    if rtol is None and name == "radau":
        rtol = DEFAULT_RTOL
    return create_integrator(command, name, {"rtol": rtol}, file)


def create_integrator(
    command: str,
    name: str,
    options: Mapping[str, Any],
    file: ModelFile,
    further: list[str] | None = None,
) -> Any:
    """Return an integrator by its name on the command line.

    Parameters
    ----------
    command
        Name of the command, for messages.
    name
        Name of a built-in integrator, or of a class or an instance in the model file.
    options
        Settings by field name; None for an absent option. A class is constructed with these
        settings; in an instance, they replace the fields.
    file
        The model file.
    further
        Settings NAME=VALUE of --option, which `options` precede.

    Raises
    ------
    BeamdaeError
        If the name is unknown, or the integrator does not have a setting or rejects its value.
    """
    import beamdae
    from beamdae.cli.model_file import translate_errors

    names = list(dict.fromkeys([*INTEGRATORS, *file.integrators]))
    if name not in names:
        raise BeamdaeError(
            f"{command}: --integrator must be one of {', '.join(map(repr, names))}, got "
            f"{short_repr(name)}{suggest(name, names)}."
        )

    def find_integrator(key: str) -> Any:
        public = INTEGRATORS.get(key)
        return file.integrators[key] if public is None else getattr(beamdae, public.name)

    integrator = find_integrator(name)
    values: dict[str, Any] = {**parse_assignments(further, "--option")}
    values |= {option: value for option, value in options.items() if value is not None}
    for option in values:
        if option not in _field_names(integrator):
            supporting = [x for x in names if option in _field_names(find_integrator(x))]
            remedy = f"; its settings are {', '.join(_field_names(integrator))}."
            if supporting:
                remedy = f" (only of {', '.join(supporting)})."
            raise BeamdaeError(f"{command}: {option}= is not a setting of {name}{remedy}")
    values = {x: _parse_setting(y) if isinstance(y, str) else y for x, y in values.items()}
    with translate_errors(f"{command}: --integrator {name}: the constructor", file.path):
        if isinstance(integrator, type):
            return integrator(**values)
        return replace(integrator, **values) if values else integrator


def _parse_setting(text: str) -> Any:
    """Return the number of a setting of an integrator, or its text."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _field_names(integrator: Any) -> list[str]:
    return [field.name for field in fields(integrator)] if is_dataclass(integrator) else []


def parse_start(
    options: list[str] | None, model: Model
) -> str | Rotation | dict[str, float] | None:
    """Return the start described by --start, or None without --start.

    The start is the name of a state, the path of a file, a steady rotation or a dict of values by
    coordinate.

    Raises
    ------
    BeamdaeError
        If a value is not a number in the unit of its coordinate, an entry has another form, or a
        state or rotation is combined with further entries.
    """
    if not options:
        return None
    states = [x for x in options if x in _STATES or x.startswith(_ROTATION)]
    if states and len(options) > 1:
        raise BeamdaeError(
            f"--start {states[0]}: this state determines all positions and velocities; omit it or "
            "the other values of --start."
        )
    for text in options:
        if "=" not in text:
            if len(options) == 1 and (states or os.path.isfile(text)):
                return text
            raise BeamdaeError(
                f"--start {text}: the start must be {', '.join(map(repr, _STATES))}, "
                "rotation=SPEED, PART.COORDINATE=VALUE or the path of a saved run"
                f"{suggest(text, _STATES)}."
            )
    if states:
        from beamdae.parts.rotation import rotation

        return rotation(_parse_speed("--start", states[0]))

    @cache
    def find_units() -> Mapping[str, str]:
        from beamdae.simulation import as_equations

        coordinates = as_equations("start", model, "as drawn", sampled=True).coordinates
        return {y.name: y.unit for x in coordinates for y in (x.rate, x)}

    return {
        name: parse_named_number("--start", name, value, find_units)
        for name, value in parse_assignments(options, "--start").items()
    }
