"""Outlines of model files: the models and studies they define, read without executing them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

# A file that uses one of these names of beamdae defines a model or a study.
_DEFINING_NAMES = {"model", "study", "Study"}
# As a decorator, `sweep` defines a study; called in a script, it runs one.
_DECORATORS = {"model", "study", "sweep"}


@dataclass(frozen=True)
class Outline:
    """Models and studies defined by functions of a file.

    Attributes
    ----------
    defines
        True if the file uses a name of beamdae that defines a model or a study.
    models
        Parameters of each model, with the source text of their defaults; "" without a default.
    studies
        Names of the studies and sweeps.
    """

    defines: bool = False
    models: dict[str, dict[str, str]] = field(default_factory=dict)
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
        {function.name: dict(_parameters(function)) for function in functions["model"]},
        tuple(function.name for kind in ("study", "sweep") for function in functions[kind]),
    )


def _parameters(function: ast.FunctionDef) -> Iterator[tuple[str, str]]:
    """Yield the name of each parameter and the source text of its default, or ""."""
    signature = function.args
    positional = [*signature.posonlyargs, *signature.args]
    n_required = len(positional) - len(signature.defaults)
    defaults = [*[None] * n_required, *signature.defaults, *signature.kw_defaults]
    for parameter, default in zip([*positional, *signature.kwonlyargs], defaults, strict=True):
        yield parameter.arg, "" if default is None else ast.unparse(default)
