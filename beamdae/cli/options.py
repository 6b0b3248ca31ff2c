"""Options and habits the commands share."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from beamdae.errors import BeamdaeError

_WIDTH = 140

ModelFile = Annotated[Path, typer.Argument(metavar="MODEL.py", help="Model file.")]
ModelName = Annotated[
    str | None, typer.Option("--model", help="Which one, where the file holds several.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Value of a model parameter; repeat."),
]
Out = Annotated[Path, typer.Option(help="Folder to write to.")]
EndTime = Annotated[float | None, typer.Option(help="End time in seconds; default the model's.")]
OutputStep = Annotated[
    float | None,
    typer.Option(help="Seconds between rows; default a thousandth of the run (compare: a 400th)."),
]


def assignments(settings: list[str] | None) -> dict[str, str]:
    """The values of --set name=value, by name."""
    values = {}
    for setting in settings or []:
        key, equals, value = setting.partition("=")
        if not equals or not key.strip():
            raise BeamdaeError(f"--set {setting}: it must have the form name=value.")
        values[key.strip()] = value.strip()
    return values


def require_writable(folder: Path) -> None:
    """Refuse a folder that cannot be made or written, before the work is done."""
    there = folder.absolute()
    while not there.exists():
        there = there.parent
    if not there.is_dir():
        raise BeamdaeError(f"--out {folder}: it cannot be written, {there} is not a folder.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise BeamdaeError(f"--out {folder}: it cannot be written, {there} allows no files.")


def console() -> Console:
    """Standard output as it is: units in brackets are no markup."""
    width = None if sys.stdout.isatty() else _WIDTH
    return Console(width=width, markup=False, highlight=False, emoji=False)


def say_warning(console: Console, sentence: str) -> None:
    """Tell what a result has to be read with."""
    console.print(f"warning: {sentence}", style="yellow", markup=False, highlight=False)


def say_written(console: Console, paths: list[Path]) -> None:
    """Tell which files there are now."""
    for path in paths:
        console.print(f"written: {path}", style="dim", soft_wrap=True)
