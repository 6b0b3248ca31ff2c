"""`beamdae list`: list the models and studies of a folder or a file."""

from __future__ import annotations

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
    from beamdae.report.terminal import text_tables

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
    tables = [text_tables.models_table(models)] if models else []
    tables += [text_tables.studies_table(studies)] if studies else []
    tables += [text_tables.problems_table(problems)] if problems else []
    tables += [] if path.is_dir() else map(text_tables.parameters_table, models)
    data = {"models": models, "studies": studies, "problems": problems}
    Report("", lambda: data, tables=tables).print()
    if problems:
        raise typer.Exit(1)
