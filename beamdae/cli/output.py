"""What commands say: results on standard output, what went wrong on standard error.

What a command found it tells twice, in tables and, for --json, by `record`: it does not ask which
of them is wanted.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from beamdae.report.text import make_printable

# Where no terminal has a say, lines are as long as they are; no table is read in less than 20.
_WIDE, _NARROW = 10_000, 20


@dataclass(frozen=True)
class Voice:
    """How a command speaks.

    Attributes
    ----------
    quiet
        Whether nothing is said but what went wrong.
    as_json
        Whether what it found is said as one JSON document and not in tables.
    found, files, warnings, errors
        What that document tells.
    """

    quiet: bool = False
    as_json: bool = False
    found: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def document(self, command: str, code: int) -> str:
        """All of it as JSON."""
        told = {"command": command, "exit_code": code, **self.found}
        told |= {"files": self.files, "warnings": self.warnings, "errors": self.errors}
        return json.dumps(_strict(told), indent=2, allow_nan=False)


_voice: ContextVar[Voice | None] = ContextVar("voice", default=None)


@contextmanager
def speaking(voice: Voice) -> Iterator[None]:
    """Speak like this in here."""
    before = _voice.set(voice)
    try:
        yield
    finally:
        _voice.reset(before)


def _now() -> Voice:
    return _voice.get() or Voice()


def record(found: Callable[[], Mapping[str, Any]]) -> None:
    """Note what a command found, by key, if a document is asked for."""
    voice = _now()
    if voice.as_json:
        voice.found.update(found())


def console() -> Console:
    """Standard output, as wide as its terminal or COLUMNS: units in brackets are no markup."""
    told = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    voice = _now()
    screen = Console(
        width=None if told else _WIDE,
        markup=False,
        highlight=False,
        emoji=False,
        quiet=voice.quiet or voice.as_json,
    )
    screen.width = max(screen.width, _NARROW)
    return screen


def hushed() -> bool:
    """Whether nothing is to be said of what is under way."""
    return _now().quiet


def progress_console() -> Console | None:
    """Standard error, where a bar can move, or None; standard output is for tables."""
    screen = Console(stderr=True, markup=False, highlight=False, emoji=False)
    return screen if screen.is_terminal and not screen.is_dumb_terminal else None


def complain(sentence: str) -> None:
    """One line on standard error."""
    line = make_printable(" ".join(sentence.split()))
    _now().errors.append(line)
    typer.echo(line, err=True)


def say_warnings(screen: Console, sentences: Iterable[str]) -> None:
    """Tell what a result has to be read with."""
    for sentence in sentences:
        screen.print(f"warning: {warned(sentence)}", style="yellow")


def warned(sentence: str) -> str:
    """The sentence of a warning as it is told, here and in the document."""
    told = make_printable(sentence)
    _now().warnings.append(told)
    return told


def say_written(screen: Console, paths: Iterable[Path]) -> None:
    """Tell which files there are now."""
    for path in paths:
        _now().files.append(make_printable(str(path)))
        screen.print(f"written: {make_printable(str(path))}", style="dim", soft_wrap=True)


def _strict(value: Any) -> Any:
    """A value as JSON has it: what is no number is null, arrays are lists, paths are texts."""
    if isinstance(value, Mapping):
        return {str(key): _strict(one) for key, one in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_strict(one) for one in value]
    if hasattr(value, "tolist"):  # Of NumPy.
        return _strict(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)
