"""`beamdae list`: which models and studies there are."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beamdae.cli.saying import console
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.studies import Study

# What a file takes from beamdae to define a model or a study.
_DEFINING = {"model", "study", "Study", "sweep", "load_model"}


def list_command(
    path: Annotated[Path, typer.Argument(metavar="PATH", help="Folder or model file.")],
) -> None:
    """List models with their parameters, and studies with their cases.

    Of a folder, files that define neither are left alone: what imports them runs them. Ends with 1
    where a file does not import.
    """
    if path.is_dir():
        files = [file for file in sorted(path.glob("*.py")) if _defines(file)]
    elif path.exists() or path.suffix == ".py":
        files = [path]
    else:
        raise BeamdaeError(f"{path}: there is no such file or folder.")
    from beamdae.cli import model_file
    from beamdae.report import terminal

    models: list[tuple[str, ...]] = []
    studies: list[tuple[str, ...]] = []
    problems: list[tuple[str, str]] = []
    for file in files:
        try:
            models_here, studies_here = model_file.contents(file)
        except BeamdaeError as problem:
            if not path.is_dir():
                raise
            problems.append((file.name, str(problem)))
            continue
        models += [_model_row(file, x) for x in models_here.values() if _own(x, file, studies_here)]
        studies += [_study_row(file, study) for study in studies_here.values()]
    if not (models or studies or problems):
        raise BeamdaeError(f"{path}: it holds no model and no study.")
    screen = console()
    for rows, table in (
        (models, terminal.models),
        (studies, terminal.studies),
        (problems, terminal.problems),
    ):
        if rows:
            screen.print(table(rows))
    if problems:
        raise typer.Exit(1)


def _model_row(file: Path, model: Model) -> tuple[str, ...]:
    values = ", ".join(f"{name}={value}" for name, value in model.parameters.items())
    return (model.name, f"{model.t_end:g}", file.name, values, model.summary)


def _study_row(file: Path, study: Study) -> tuple[str, ...]:
    about = ", ".join(dict.fromkeys(case.model.name for case in study.cases))
    return (study.name, str(len(study.cases)), file.name, about)


def _own(model: Model, file: Path, studies: dict[str, Study]) -> bool:
    """Whether a model is that of a file: a study names those of others."""
    source = inspect.unwrap(model.build).__code__.co_filename
    return not studies or Path(source).resolve() == file.resolve()


def _defines(file: Path) -> bool:
    """Whether a file takes from beamdae what defines a model or a study; it is not run."""
    try:
        source = file.read_bytes()
        tree = ast.parse(source)
    except OSError:
        return False
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        # Importing it says what is wrong.
        return b"beamdae" in source
    packages, names = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            packages |= {x.asname or x.name for x in node.names if x.name == "beamdae"}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "beamdae":
            names |= {x.asname or x.name for x in node.names if x.name in _DEFINING}
    return any(
        isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in packages
        and node.attr in _DEFINING
        for node in ast.walk(tree)
    ) or bool(names)
