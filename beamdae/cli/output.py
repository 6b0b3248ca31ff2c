"""What commands say: results on standard output, what went wrong on standard error.

What a command found it tells twice, in tables and, for --json, by `record_results`: it does not ask
which of them is wanted.
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

from beamdae.errors import BeamdaeError, format_exception
from beamdae.report.text import make_printable

# Where no terminal has a say, lines are as long as they are; no table is read in less than 20.
_UNLIMITED_WIDTH, _MIN_WIDTH = 10_000, 20


@dataclass(frozen=True)
class CommandOutput:
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
        return json.dumps(_to_json_value(told), indent=2, allow_nan=False)


_current_output: ContextVar[CommandOutput | None] = ContextVar("voice", default=None)


@contextmanager
def use_output(voice: CommandOutput) -> Iterator[None]:
    """Speak like this in here."""
    before = _current_output.set(voice)
    try:
        yield
    finally:
        _current_output.reset(before)


def current_output() -> CommandOutput:
    return _current_output.get() or CommandOutput()


def record_results(found: Callable[[], Mapping[str, Any]]) -> None:
    """Note what a command found, by key, if a document is asked for."""
    voice = current_output()
    if voice.as_json:
        voice.found.update(found())


def create_console() -> Console:
    """Standard output, as wide as its terminal or COLUMNS: units in brackets are no markup."""
    told = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    voice = current_output()
    screen = Console(
        width=None if told else _UNLIMITED_WIDTH,
        markup=False,
        highlight=False,
        emoji=False,
        quiet=voice.quiet or voice.as_json,
    )
    screen.width = max(screen.width, _MIN_WIDTH)
    return screen


def is_quiet() -> bool:
    """Whether nothing is to be said of what is under way."""
    return current_output().quiet


def create_progress_console() -> Console | None:
    """Standard error, where a bar can move, or None; standard output is for tables."""
    screen = Console(stderr=True, markup=False, highlight=False, emoji=False)
    return screen if screen.is_terminal and not screen.is_dumb_terminal else None


def print_error(sentence: str) -> None:
    """One line on standard error."""
    line = make_printable(" ".join(sentence.split()))
    current_output().errors.append(line)
    typer.echo(line, err=True)


def print_warnings(screen: Console, sentences: Iterable[str]) -> None:
    """Tell what a result has to be read with."""
    for sentence in sentences:
        screen.print(f"warning: {record_warning(sentence)}", style="yellow")


def record_warning(sentence: str) -> str:
    """The sentence of a warning as it is told, here and in the document."""
    told = make_printable(sentence)
    current_output().warnings.append(told)
    return told


def print_written_files(screen: Console, paths: Iterable[Path]) -> None:
    """Tell which files there are now."""
    for path in paths:
        current_output().files.append(make_printable(str(path)))
        screen.print(f"written: {make_printable(str(path))}", style="dim", soft_wrap=True)


def _to_json_value(value: Any) -> Any:
    """A value as JSON has it: what is no number is null, arrays are lists, paths are texts."""
    if isinstance(value, Mapping):
        return {str(key): _to_json_value(one) for key, one in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_to_json_value(one) for one in value]
    if hasattr(value, "tolist"):  # Of NumPy.
        return _to_json_value(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


@dataclass
class WrittenFiles:
    """Files that are there, in the order they were written in, and whether one failed."""

    paths: list[Path] = field(default_factory=list)
    failed: bool = False

    def draw(self, what: str, draw: Callable[[], list[Path]]) -> None:
        """Write pictures or a page; those that fail are told of, and cost nothing else."""
        try:
            self.paths += draw()
            return
        except BeamdaeError as problem:
            print_error(f"failed: {problem}")
        except Exception as problem:  # Whatever a table holds that a picture has no answer to.
            print_error(f"failed: {what}: it cannot be drawn, {format_exception(problem)}.")
        self.failed = True
