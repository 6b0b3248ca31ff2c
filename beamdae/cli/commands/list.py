"""`beamdae list`: list the models and studies of a folder or a file."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from beamdae.cli.model_files.example_files import resolve_path
from beamdae.cli.model_files.outline import read_outline
from beamdae.cli.output import create_console, record_results
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.model_functions import Model


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

    In a folder, only files that define models or studies are imported; exits with 1 if the import
    of one of these files fails.
    """
    path = resolve_path(path)
    if path.is_dir():
        files = [file for file in sorted(path.glob("*.py")) if read_outline(file).defines]
    elif path.exists() or path.suffix == ".py":
        files = [path]
    else:
        raise BeamdaeError(f"{path}: there is no such file or folder.")
    from beamdae.cli.model_files.model_file import ModelFile
    from beamdae.report.terminal import text_tables

    models: list[dict[str, Any]] = []
    studies: list[dict[str, Any]] = []
    problems: list[dict[str, Any]] = []
    for file in files:
        try:
            model_file = ModelFile(file)
        except BeamdaeError as problem:
            if not path.is_dir():
                raise
            problems.append({"file": str(file), "problem": str(problem)})
            continue
        file_studies = model_file.studies
        # A study file imports the models of other files.
        models += [
            {
                "name": model.name,
                "t_end": model.t_end,
                "file": str(file),
                "parameters": dict(model.parameters),
                "about": model.summary,
            }
            for model in model_file.models.values()
            if not file_studies or _is_defined_in(model, file)
        ]
        studies += [
            {
                "name": study.name,
                "cases": len(study.cases),
                "file": str(file),
                "models": list(dict.fromkeys(case.model.name for case in study.cases)),
            }
            for study in file_studies.values()
        ]
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
    if problems:
        raise typer.Exit(1)


def _is_defined_in(model: Model, file: Path) -> bool:
    source = inspect.unwrap(model.build).__code__.co_filename
    return Path(source).resolve() == file.resolve()
