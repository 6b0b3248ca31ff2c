"""`beamdae list`: list the models and studies of a folder or a file."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.model_files.example_files import resolve_path
from beamdae.cli.model_files.listing import read_files
from beamdae.cli.model_files.outline import read_outline
from beamdae.cli.output import create_console, record_results
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
    """List models with their parameters, and studies with their number of cases.

    For a file, list the default, unit and description of each parameter, too.
    In a folder, only files that define models or studies are imported; exits with 1 if the import
    of one of these files fails or takes more than 10 s.
    """
    path = resolve_path(path)
    if path.is_dir():
        files = [file for file in sorted(path.glob("*.py")) if read_outline(file).defines]
    elif path.exists() or path.suffix == ".py":
        files = [path]
    else:
        raise BeamdaeError(f"{path}: there is no such file or folder.")
    from beamdae.report.terminal import text_tables

    models: list[dict[str, Any]] = []
    studies: list[dict[str, Any]] = []
    problems: list[dict[str, Any]] = []
    with closing(read_files(files)) as contents:
        for file, content in zip(files, contents, strict=True):
            if content.problem and not path.is_dir():
                raise BeamdaeError(content.problem)
            if content.problem:
                problems.append({"file": str(file), "problem": content.problem})
            models += content.models
            studies += content.studies
    if not (models or studies or problems):
        raise BeamdaeError(
            f"{path}: there is no model or study at this path; decorate a function with "
            "@bd.model(t_end=...)."
        )
    record_results(lambda: {"models": models, "studies": studies, "problems": problems})
    console = create_console()
    for rows, create_table in (
        (models, text_tables.models_table),
        (studies, text_tables.studies_table),
        (problems, text_tables.problems_table),
    ):
        if rows:
            console.print(create_table(rows))
    if not path.is_dir():
        for model in models:
            console.print(text_tables.parameters_table(model))
    if problems:
        raise typer.Exit(1)
