"""What commands say: results on standard output, what went wrong on standard error."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path

import typer
from rich.console import Console

from beamdae.report.letters import plain

# Where no terminal has a say, lines are as long as they are; no table is read in less than 20.
_WIDE, _NARROW = 10_000, 20


def console() -> Console:
    """Standard output, as wide as its terminal or COLUMNS: units in brackets are no markup."""
    told = sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit()
    screen = Console(width=None if told else _WIDE, markup=False, highlight=False, emoji=False)
    screen.width = max(screen.width, _NARROW)
    return screen


def progress_console() -> Console | None:
    """Standard error, where a bar can move, or None; standard output is for tables."""
    screen = Console(stderr=True, markup=False, highlight=False, emoji=False)
    return screen if screen.is_terminal and not screen.is_dumb_terminal else None


def complain(sentence: str) -> None:
    """One line on standard error."""
    typer.echo(plain(" ".join(sentence.split())), err=True)


def say_warnings(screen: Console, sentences: Iterable[str]) -> None:
    """Tell what a result has to be read with."""
    for sentence in sentences:
        screen.print(f"warning: {plain(sentence)}", style="yellow")


def say_written(screen: Console, paths: Iterable[Path]) -> None:
    """Tell which files there are now."""
    for path in paths:
        screen.print(f"written: {plain(str(path))}", style="dim", soft_wrap=True)
