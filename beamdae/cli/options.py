"""Options and habits the commands share."""

from __future__ import annotations

import os
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli import completion
from beamdae.cli.output import record_results
from beamdae.errors import BeamdaeError, require_choice, short_repr

ModelFile = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL.py",
        help="Model file, or example:NAME.",
        autocompletion=completion.complete_model_files,
    ),
]
ModelName = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="NAME",
        help="Which one, where the file holds several.",
        autocompletion=completion.complete_models,
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Value of a model parameter; repeat.",
        autocompletion=completion.complete_parameters,
    ),
]
Starts = Annotated[
    list[str] | None,
    typer.Option(
        "--start",
        metavar="HOW",
        help="'as drawn', 'equilibrium' or PART.COORDINATE=VALUE (rates: ..._dot); repeat.",
        autocompletion=lambda: ["equilibrium"],
    ),
]
INTEGRATORS = ("auto", "ida", "radau", "generalized-alpha")
IntegratorName = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help=f"{', '.join(INTEGRATORS[:-1])} or {INTEGRATORS[-1]}.",
        autocompletion=lambda: INTEGRATORS,
    ),
]
StudyFile = Annotated[
    Path,
    typer.Argument(
        metavar="FILE.py",
        help="Study or sweep file, or model file, or example:NAME.",
        autocompletion=completion.complete_model_files,
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "--workers", help="Processes; default one a core.", metavar="N"),
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Of a Dask scheduler, such as tcp://host:8786."),
]
Parquet = Annotated[bool, typer.Option("--parquet", help="Write trajectories as Parquet as well.")]
Out = Annotated[Path, typer.Option(help="Folder to write to.")]
EndTime = Annotated[float | None, typer.Option(help="End time in seconds; default the model's.")]
OutputStep = Annotated[
    float | None,
    typer.Option(help="Seconds between rows; default a thousandth of the run (compare: a 400th)."),
]
TimeLimit = Annotated[
    float | None,
    typer.Option(help="Seconds an integration may take; what it reached by then is kept."),
]


def parse_assignments(settings: list[str] | None, option: str = "--set") -> dict[str, str]:
    """The values of --set name=value, or of another option, by name."""
    values = {}
    for setting in settings or []:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise BeamdaeError(f"{option} {setting}: it must have the form name=value.")
        values[key.strip()] = value.strip()
    return values


def parse_start(given: list[str] | None) -> str | dict[str, float] | None:
    """The start that --start asks for; None: the model's own."""
    if not given:
        return None
    if len(given) == 1 and "=" not in given[0]:
        return given[0]
    values = {}
    for name, value in parse_assignments(given, "--start").items():
        try:
            values[name] = float(value)
        except ValueError:
            raise BeamdaeError(f"--start {name}={value}: the value must be a number.") from None
    return values


def require_writable(folder: Path, files: tuple[str, ...] = (), option: str = "--out") -> None:
    """Refuse a folder that cannot be made or written, or such files in it, before the work is done.

    Folders in the place of files count as such.
    """
    if not str(folder).isprintable():
        raise BeamdaeError(
            f"{option}: no folder of results can be called {short_repr(str(folder))}."
        )
    try:
        there = folder.absolute()
        while not there.exists():
            there = there.parent
        taken = next((folder / name for name in files if (folder / name).is_dir()), None)
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise BeamdaeError(f"{option} {folder}: it cannot be written, {reason}.") from None
    if not there.is_dir():
        raise BeamdaeError(f"{option} {folder}: it cannot be written, {there} is not a folder.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise BeamdaeError(f"{option} {folder}: it cannot be written, {there} allows no files.")
    if taken is not None:
        raise BeamdaeError(f"{option} {folder}: it cannot be written, {taken} is a folder.")


if TYPE_CHECKING:
    from beamdae.model_functions import Model


def load_configured_model(path: Path, name: str | None, settings: list[str] | None) -> Model:
    """The model of a file with the values of --set as its defaults."""
    from beamdae.cli.model_files.model_file import load_model

    model = load_model(path, name)
    model = replace(model, parameters=model.complete(parse_assignments(settings)))
    record_results(lambda: {"model": {"name": model.name, "parameters": model.parameters}})
    return model


def create_integrator(command: str, name: str, options: dict[str, Any]) -> Any:
    """The integrator of a name, with those of the options that are given."""
    from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau

    kinds: dict[str, Any] = dict(
        zip(INTEGRATORS, (Auto, Ida, Radau, GeneralizedAlpha), strict=True)
    )
    kind = kinds[require_choice(command, "--integrator", name, tuple(kinds))]
    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if option not in _settings(kind):
            flag = option.replace("_", "-")
            have = [other for other, kind in kinds.items() if option in _settings(kind)]
            raise BeamdaeError(
                f"{command}: --{flag} is no option of --integrator {name}, but of "
                f"{' and '.join(have)}."
            )
    return kind(**given)


def _settings(kind: Any) -> set[str]:
    return {field.name for field in fields(kind)}
