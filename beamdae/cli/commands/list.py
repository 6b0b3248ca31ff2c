"""`beamdae list`: list the models and studies of a folder or a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.model_files.example_files import resolve_path
from beamdae.cli.model_files.outline import read_outline
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError


def list_command(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="PATH",
            help="Folder or model file, or example:NAME. Defaults to the current folder.",
            show_default=False,
        ),
    ] = Path(),
) -> None:
    """List models with their parameters, and studies, without executing the files.

    For a file, list the default, unit and description of each parameter, too. Exits with 1 if a
    file of a folder cannot be parsed.
    """
    path = resolve_path(path)
    if not path.is_dir() and not path.is_file():
        raise BeamdaeError(f"{path}: there is no such file or folder.")
    from beamdae.report.descriptions import Description

    models: list[dict[str, Any]] = []
    studies: list[dict[str, Any]] = []
    problems: list[dict[str, Any]] = []
    for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
        try:
            outline = read_outline(file)
        except BeamdaeError as problem:
            if not path.is_dir():
                raise
            problems.append({"file": str(file), "problem": str(problem)})
            continue
        for name, model in outline.models.items():
            parameters = model.parameters.values()
            models.append(
                {
                    "name": name,
                    "t_end": model.t_end,
                    "file": str(file),
                    "parameters": {x.name: x.default for x in parameters},
                    "units": {x.name: x.unit for x in parameters if x.unit},
                    "descriptions": {x.name: x.description for x in parameters if x.description},
                    "about": model.about,
                }
            )
        studies += [{"name": name, "file": str(file)} for name in outline.studies]
    if not (models or studies or problems):
        raise BeamdaeError(
            f"{path}: there is no model or study at this path; decorate a function with "
            "@bd.model(t_end=...)."
        )
    tables = {
        "models": _tabulate_models(models),
        "studies": [{"study": x["name"], "file": Path(x["file"]).name} for x in studies],
        "problems": [
            {"file": Path(x["file"]).name, "cannot be listed": x["problem"]} for x in problems
        ],
    }
    for each in () if path.is_dir() else models:
        tables[f"parameters of {each['name']}"] = _tabulate_parameters(each)
    data = {"models": models, "studies": studies, "problems": problems}
    Report("", Description({}, tables, lambda: data), source="--json", max_rows=sys.maxsize).print()
    if problems:
        raise typer.Exit(1)


def _tabulate_models(models: list[dict[str, Any]]) -> list[dict[str, Any]]:
    from beamdae.model_parameters import format_with_unit

    return [
        {
            "model": x["name"],
            "file": Path(x["file"]).name,
            "t_end [s]": x["t_end"],
            "parameters": ", ".join(
                f"{name}={format_with_unit(value, x['units'].get(name, ''))}"
                for name, value in x["parameters"].items()
            ),
            "about": x["about"],
        }
        for x in models
    ]


def _tabulate_parameters(model: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            str(model["name"]): name,
            "default": str(value),
            "unit": model["units"].get(name, ""),
            "description": model["descriptions"].get(name, ""),
        }
        for name, value in model["parameters"].items()
    ]
