"""Which files of the user's own the results of a case depend on."""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_INSTALLED = tuple(Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))
_PACKAGE = Path(__file__).parents[1]


def own_texts(file: str) -> list[str]:
    """Texts of a file and of all it imports, and what that imports, that are not installed.

    Modules of installed packages are known by their versions. Imports are those written in the
    files, wherever in them; modules are looked for beside the file and on sys.path.
    """
    found: set[Path] = set()
    waiting = [Path(file).absolute()]
    while waiting:
        path = waiting.pop()
        if path not in found and path.is_file() and not _is_installed(path):
            found.add(path)
            waiting += _imported(path, path.stat().st_mtime_ns, tuple(sys.path))
    return [_text(path, path.stat().st_mtime_ns) for path in sorted(found)]


def _is_installed(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in (*_INSTALLED, _PACKAGE))


@cache
def _text(path: Path, changed: int) -> str:
    # One letter a byte: whatever the encoding, a change is a change.
    return path.read_text("latin-1")


@cache
def _imported(path: Path, changed: int, folders: tuple[str, ...]) -> tuple[Path, ...]:
    """The user's own files among those a file imports, or may import."""
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return ()
    names = {name for node in ast.walk(tree) for name in _named(node)}
    places = (path.parent, *map(Path, folders))
    files = {file.absolute() for name in names for file in _located(name, places)}
    return tuple(file for file in files if not _is_installed(file))


def _named(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        # Of a relative import the name beside the file.
        base = node.module or ""
        yield base
        yield from (f"{base}.{alias.name}".lstrip(".") for alias in node.names)


def _located(name: str, folders: tuple[Path, ...]) -> list[Path]:
    """The files of a module and of the packages it is in, where they are found first."""
    parts = [part for part in name.split(".") if part]
    for folder in folders:
        stems = [folder.joinpath(*parts[: k + 1]) for k in range(len(parts))]
        files = [f for stem in stems for f in (stem.with_suffix(".py"), stem / "__init__.py")]
        there = [file for file in files if file.is_file()]
        if there:
            return there
    return []
