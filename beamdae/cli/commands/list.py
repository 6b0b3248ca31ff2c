"""`beamdae list`: which models and studies there are."""

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
    from beamdae.studies import Study


def list_command(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="Folder or model file, or example:NAME.")
    ] = Path(),
) -> None:
    """List models with their parameters, and studies with their cases.

    Of a folder, files that define neither are left alone: what imports them runs them. Ends with 1
    where a file does not import.
    """
    path = resolve_path(path)
    if path.is_dir():
        files = [file for file in sorted(path.glob("*.py")) if read_outline(file).defines]
    elif path.exists() or path.suffix == ".py":
        files = [path]
    else:
        raise BeamdaeError(f"{path}: there is no such file or folder.")
    from beamdae.cli.model_files import model_file
    from beamdae.report.terminal import text_tables

    models: list[dict[str, Any]] = []
    studies: list[dict[str, Any]] = []
    problems: list[dict[str, Any]] = []
    for file in files:
        try:
            models_here, studies_here = model_file.load_contents(file)
        except BeamdaeError as problem:
            if not path.is_dir():
                raise
            problems.append({"file": str(file), "problem": str(problem)})
            continue
        models += [
            _model_row(file, x)
            for x in models_here.values()
            if _is_defined_in(x, file, studies_here)
        ]
        studies += [_study_row(file, study) for study in studies_here.values()]
    if not (models or studies or problems):
        raise BeamdaeError(f"{path}: it holds no model and no study.")
    record_results(lambda: {"models": models, "studies": studies, "problems": problems})
    screen = create_console()
    for rows, table in (
        (models, text_tables.models_table),
        (studies, text_tables.studies_table),
        (problems, text_tables.problems_table),
    ):
        if rows:
            screen.print(table(rows))
    if problems:
        raise typer.Exit(1)


def _model_row(file: Path, model: Model) -> dict[str, Any]:
    return {
        "name": model.name,
        "t_end": model.t_end,
        "file": str(file),
        "parameters": dict(model.parameters),
        "about": model.summary,
    }


def _study_row(file: Path, study: Study) -> dict[str, Any]:
    models = list(dict.fromkeys(case.model.name for case in study.cases))
    return {"name": study.name, "cases": len(study.cases), "file": str(file), "models": models}


def _is_defined_in(model: Model, file: Path, studies: dict[str, Study]) -> bool:
    """Whether a model is that of a file: a study names those of others."""
    source = inspect.unwrap(model.build).__code__.co_filename
    return not studies or Path(source).resolve() == file.resolve()
