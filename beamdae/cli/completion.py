"""What a shell offers after Tab: from the text of files, which are not run for it."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path

from beamdae.cli.model_files.example_files import PREFIX, example_names, resolve_path
from beamdae.cli.model_files.outline import Outline, read_outline
from beamdae.errors import BeamdaeError

# Bash takes words apart at these signs.
_BASH_WORD_BREAKS = (":", "=")


def complete_model_files(incomplete: str) -> list[str]:
    """Model files, folders and examples; nothing where there is none, as the shell has the rest."""
    if incomplete and PREFIX.startswith(incomplete[: len(PREFIX)]):
        return [f"{PREFIX}{name}" for name in example_names()]
    head, tail = os.path.split(incomplete)
    try:
        inside = sorted(os.scandir(os.path.expanduser(head) or "."), key=lambda one: one.name)
    except OSError:
        return []
    shown = [x for x in inside if x.name.startswith(tail) and not x.name.startswith((".", "_"))]
    files = [os.path.join(head, x.name) for x in shown if x.name.endswith(".py")]
    return [*files, *(os.path.join(head, x.name, "") for x in shown if x.is_dir())] if files else []


def complete_parameters() -> list[tuple[str, str]]:
    """NAME=DEFAULT of each parameter of the model that is given."""
    words = _command_line_words()
    found = _outline_of_model_file(words).models
    return [
        (f"{name}={_as_typed(default)}", f"default {default}")
        for model in [model for model in found if model in words] or found
        for name, default in found[model].items()
    ]


def complete_models() -> list[str]:
    """Models and studies of the file that is given."""
    given = _outline_of_model_file(_command_line_words())
    return [*given.models, *given.studies]


def _command_line_words() -> list[str]:
    """The command line so far; parsers lose it where an option has no value yet."""
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    try:
        return shlex.split(line)
    except ValueError:  # A quotation is still open.
        return line.split()


def _outline_of_model_file(words: list[str]) -> Outline:
    """The outline of the first model file of a command line."""
    files = [word for word in words if word.endswith(".py") or word.startswith(PREFIX)]
    try:
        return read_outline(resolve_path(Path(files[0]).expanduser())) if files else Outline()
    except BeamdaeError:
        return Outline()


def _as_typed(default: str) -> str:
    """A default as it is typed, or nothing where shells would take it apart."""
    text = default.strip("'\"")
    return text if all(x.isalnum() or x in "._-+" for x in text) else ""


@contextmanager
def rejoin_bash_words() -> Iterator[None]:
    """Complete for bash what it takes for several words, `example:four_bar` or `length=2`.

    Of such a word it replaces what follows the last sign.
    """
    if os.environ.get("_BEAMDAE_COMPLETE") != "complete_bash":
        yield
        return
    place = int(os.environ["COMP_CWORD"])
    taken_apart = [*os.environ["COMP_WORDS"].split("\n"), ""][: place + 1]
    typed = [""]
    for word in taken_apart:
        if word in _BASH_WORD_BREAKS or typed[-1].endswith(_BASH_WORD_BREAKS):
            typed[-1] += word
        else:
            typed.append(word)
    os.environ["COMP_WORDS"] = "\n".join(typed[1:])
    os.environ["COMP_CWORD"] = str(len(typed) - 2)
    last, under_way = typed[-1], taken_apart[-1]
    kept = "" if under_way in _BASH_WORD_BREAKS else under_way
    before = last[: len(last) - len(kept)]
    offered = StringIO()
    try:
        with redirect_stdout(offered):
            yield
    finally:
        sys.stdout.writelines(
            line.removeprefix(before) for line in offered.getvalue().splitlines(keepends=True)
        )
