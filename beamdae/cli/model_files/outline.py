"""Outlines of model files: the models and studies they define, read without executing them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import shorten

from beamdae.model_parameters import ModelParameter, format_with_unit, read_docstring

# A file that uses one of these names of beamdae defines a model or a study.
_DEFINING_NAMES = {"model", "study", "Study"}
# As a decorator, `sweep` defines a study; called in a script, it runs one.
_DECORATORS = {"model", "study", "sweep"}
_MAX_HINT_LENGTH = 60


@dataclass(frozen=True)
class Outline:
    """Models and studies defined by functions of a file.

    Attributes
    ----------
    defines
        True if the file uses a name of beamdae that defines a model or a study.
    models
        Parameters of each model, with the source text of their defaults; "" without a default.
    hints
        Default, unit and description of the parameters of each model as text.
    studies
        Names of the studies and sweeps.
    """

    defines: bool = False
    models: dict[str, dict[str, str]] = field(default_factory=dict)
    hints: dict[str, dict[str, str]] = field(default_factory=dict)
    studies: tuple[str, ...] = ()


def read_outline(file: Path) -> Outline:
    """Return the outline of a file.

    The outline of an unreadable file, and of a pipe or device, is empty. The outline of a file that
    cannot be parsed contains no names, and `defines` is True if the file mentions beamdae.
    """
    if not file.is_file():
        return Outline()
    try:
        source = file.read_bytes()
        tree = ast.parse(source)
    except OSError:
        return Outline()
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        # Importing the file reports the error.
        return Outline(b"beamdae" in source)
    packages: set[str] = set()
    names: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            packages |= {x.asname or x.name for x in node.names if x.name == "beamdae"}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "beamdae":
            names |= {
                x.asname or x.name: x.name
                for x in node.names
                if x.name in _DEFINING_NAMES | _DECORATORS
            }

    def resolve_name(node: ast.AST) -> str:
        """Return the name of the beamdae object that a node refers to, or an empty string."""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            return node.attr if node.value.id in packages else ""
        return names.get(node.id, "") if isinstance(node, ast.Name) else ""

    functions: dict[str, list[ast.FunctionDef]] = {kind: [] for kind in _DECORATORS}
    for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
        for decorator in function.decorator_list:
            kind = resolve_name(decorator.func if isinstance(decorator, ast.Call) else decorator)
            if kind in functions:
                functions[kind].append(function)
    return Outline(
        bool(functions["sweep"])
        or not _DEFINING_NAMES.isdisjoint(names.values())
        or any(resolve_name(node) in _DEFINING_NAMES for node in ast.walk(tree)),
        {x.name: {y.name: y.default for y in _parameters(x)} for x in functions["model"]},
        {x.name: {y.name: _format_hint(y) for y in _parameters(x)} for x in functions["model"]},
        tuple(function.name for kind in ("study", "sweep") for function in functions[kind]),
    )


def _parameters(function: ast.FunctionDef) -> Iterator[ModelParameter]:
    """Yield the parameters of a function, with the source text of their defaults or ""."""
    signature = function.args
    positional = [*signature.posonlyargs, *signature.args]
    n_required = len(positional) - len(signature.defaults)
    defaults = [*[None] * n_required, *signature.defaults, *signature.kw_defaults]
    names = [x.arg for x in (*positional, *signature.kwonlyargs)]
    documented = read_docstring(ast.get_docstring(function) or "", tuple(names))
    for name, default in zip(names, defaults, strict=True):
        unit, description = documented.get(name, ("", ""))
        if isinstance(default, ast.Call) and default.args and _called_name(default) == "param":
            # The arguments of bd.param(0.85, "m", "radius of the arc").
            arguments = dict(zip(("unit", "description"), default.args[1:], strict=False))
            arguments |= {x.arg: x.value for x in default.keywords if x.arg}
            texts = {k: x.value for k, x in arguments.items() if isinstance(x, ast.Constant)}
            unit = str(texts.get("unit", "-"))
            description = str(texts.get("description", description))
            default = default.args[0]
        text = "" if default is None else ast.unparse(default)
        yield ModelParameter(name, text, unit, description)


def _called_name(call: ast.Call) -> str:
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _format_hint(x: ModelParameter) -> str:
    text = f"default {format_with_unit(x.default, x.unit)}"
    return f"{text}: {shorten(x.description, _MAX_HINT_LENGTH)}" if x.description else text
