"""Outlines of model files: the models and studies they define, read without executing them."""

from __future__ import annotations

import ast
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from beamdae.cli.model_file import resolve_path
from beamdae.cli.results import Report
from beamdae.errors import BeamdaeError
from beamdae.model_parameters import ModelParameter, format_with_unit, read_docstring

# Decorators of beamdae that define a model, or a study or sweep.
_MODEL, _STUDIES = "model", ("study", "sweep")


@dataclass(frozen=True)
class OutlinedModel:
    """Model defined by a function.

    Attributes
    ----------
    t_end
        End time [s], or its source text.
    parameters
        Parameters by name; defaults that are no plain values are source texts.
    about
        First line of the docstring of the function or, if missing, of the file.
    """

    t_end: Any
    parameters: dict[str, ModelParameter]
    about: str


@dataclass(frozen=True)
class Outline:
    """Models by name, and names of studies and sweeps, that functions of a file define."""

    models: dict[str, OutlinedModel]
    studies: tuple[str, ...] = ()


def read_outline(file: Path) -> Outline:
    """Return the outline of a file; that of a pipe or device, and without beamdae, is empty.

    Raises
    ------
    BeamdaeError
        If a file that mentions beamdae cannot be read or parsed.
    """
    try:
        source = file.read_bytes() if file.is_file() else b""
        tree = ast.parse(source if b"beamdae" in source else b"")
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError) as problem:
        line = getattr(problem, "lineno", None)
        reason = getattr(problem, "msg", None) or problem
        place = f"line {line}: " if line else ""
        raise BeamdaeError(f"{file}: {place}{reason}; correct the file.") from None
    imports = [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]
    # Public names by their names in the file; "" is the package.
    names = {
        alias.asname or alias.name: alias.name if isinstance(node, ast.ImportFrom) else ""
        for node in imports
        for alias in node.names
        if (getattr(node, "module", None) or alias.name) == "beamdae"
    }
    models, studies = {}, []
    for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
        for decorator in function.decorator_list:
            call = decorator if isinstance(decorator, ast.Call) else None
            kind = _public_name(decorator if call is None else call.func, names)
            if kind == _MODEL:
                t_end = {x.arg: x.value for x in (call.keywords if call else ())}.get("t_end")
                about = ast.get_docstring(function) or ast.get_docstring(tree) or ""
                about = about.partition("\n")[0]
                models[function.name] = OutlinedModel(_plain(t_end), _parameters(function), about)
            elif kind in _STUDIES:
                studies.append(function.name)
    return Outline(models, tuple(studies))


def _public_name(node: ast.AST, names: dict[str, str]) -> str:
    """Return the name in beamdae of the object that a node refers to, or an empty string."""
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        return node.attr if names.get(node.value.id) == "" else ""
    return names.get(node.id, "") if isinstance(node, ast.Name) else ""


def _plain(node: ast.AST | None) -> Any:
    """Return the value of a literal, otherwise the source text; "" for a missing expression."""
    if node is None:
        return ""
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return ast.unparse(node)
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def _parameters(function: ast.FunctionDef) -> dict[str, ModelParameter]:
    signature = function.args
    positional = [*signature.posonlyargs, *signature.args]
    missing = [None] * (len(positional) - len(signature.defaults))
    defaults = [*missing, *signature.defaults, *signature.kw_defaults]
    names = [x.arg for x in (*positional, *signature.kwonlyargs)]
    documented = read_docstring(ast.get_docstring(function) or "", tuple(names))
    parameters = {}
    for name, default in zip(names, defaults, strict=True):
        unit, description = documented.get(name, ("", ""))
        if isinstance(default, ast.Call) and ast.unparse(default.func).endswith("param"):
            # The arguments of bd.param(0.85, "m", "radius of the arc").
            values = dict(zip(("value", "unit", "description"), default.args, strict=False))
            values |= {x.arg or "": x.value for x in default.keywords}
            unit = str(_plain(values.get("unit"))) or "-"
            description = str(_plain(values.get("description"))) or description
            default = values.get("value")
        parameters[name] = ModelParameter(name, _plain(default), unit, description)
    return parameters


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
        "models": [
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
        ],
        "studies": [{"study": x["name"], "file": Path(x["file"]).name} for x in studies],
        "problems": [
            {"file": Path(x["file"]).name, "cannot be listed": x["problem"]} for x in problems
        ],
    }
    for each in () if path.is_dir() else models:
        tables[f"parameters of {each['name']}"] = [
            {
                str(each["name"]): name,
                "default": str(value),
                "unit": each["units"].get(name, ""),
                "description": each["descriptions"].get(name, ""),
            }
            for name, value in each["parameters"].items()
        ]
    data = {"models": models, "studies": studies, "problems": problems}
    Report("", Description({}, tables, lambda: data), source="--json", max_rows=sys.maxsize).print()
    if problems:
        raise typer.Exit(1)
