"""What a file defines, as its text says: it is read and not run."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

# What a file takes from beamdae to define a model or a study.
_DEFINING = {"model", "study", "Study"}
# As a decorator it defines one, called by a script it runs one.
_DECORATED = {"model", "study", "sweep"}


@dataclass(frozen=True)
class Outline:
    """Models and studies that are functions of a file.

    Attributes
    ----------
    defines
        Whether it takes from beamdae what defines either; it may do so in other ways as well.
    models
        By name, their parameters with the default of each as it is written.
    studies
        Their names, and those of sweeps.
    """

    defines: bool = False
    models: dict[str, dict[str, str]] = field(default_factory=dict)
    studies: tuple[str, ...] = ()


def read_outline(file: Path) -> Outline:
    """The outline of a file; that of one with mistakes only says whether it names beamdae."""
    try:
        source = file.read_bytes()
        tree = ast.parse(source)
    except OSError:
        return Outline()
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        # Importing it says what is wrong.
        return Outline(b"beamdae" in source)
    packages: set[str] = set()
    names: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            packages |= {x.asname or x.name for x in node.names if x.name == "beamdae"}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "beamdae":
            names |= {
                x.asname or x.name: x.name for x in node.names if x.name in _DEFINING | _DECORATED
            }

    def meant(node: ast.AST) -> str:
        """What a name of the file is called in beamdae, if it is of there."""
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            return node.attr if node.value.id in packages else ""
        return names.get(node.id, "") if isinstance(node, ast.Name) else ""

    found: dict[str, list[ast.FunctionDef]] = {kind: [] for kind in _DECORATED}
    for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
        for decorator in function.decorator_list:
            kind = meant(decorator.func if isinstance(decorator, ast.Call) else decorator)
            if kind in found:
                found[kind].append(function)
    return Outline(
        bool(found["sweep"])
        or not _DEFINING.isdisjoint(names.values())
        or any(meant(node) in _DEFINING for node in ast.walk(tree)),
        {function.name: dict(_parameters(function)) for function in found["model"]},
        tuple(function.name for kind in ("study", "sweep") for function in found[kind]),
    )


def _parameters(function: ast.FunctionDef) -> Iterator[tuple[str, str]]:
    taken = function.args
    by_place = [*taken.posonlyargs, *taken.args]
    defaults = [None] * (len(by_place) - len(taken.defaults)) + list(taken.defaults)
    for one, default in zip(
        [*by_place, *taken.kwonlyargs], [*defaults, *taken.kw_defaults], strict=True
    ):
        yield one.arg, "" if default is None else ast.unparse(default)
