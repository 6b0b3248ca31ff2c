"""Shell completion of files, models and parameters, without executing model files."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from io import StringIO
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

from beamdae.cli.model_files.example_files import PREFIX, example_names, resolve_path
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    from beamdae.cli.model_files.outline import Outline
    from beamdae.model_parameters import ModelParameter

# Bash splits words at these characters.
_BASH_WORD_BREAKS = (":", "=")
_MAX_HINT_LENGTH = 60


def complete_model_files(incomplete: str) -> list[str]:
    """Return the Python files and folders whose paths begin with `incomplete`.

    If `incomplete` begins with "example:" or a part of this prefix, return all examples. Without a
    matching Python file, the list is empty and the shell uses its default completion.
    """
    if incomplete and PREFIX.startswith(incomplete[: len(PREFIX)]):
        return [f"{PREFIX}{name}" for name in example_names()]
    folder, start = os.path.split(incomplete)
    try:
        entries = sorted(os.scandir(os.path.expanduser(folder) or "."), key=lambda x: x.name)
    except OSError:
        return []
    entries = [x for x in entries if x.name.startswith(start) and x.name[0] not in "._"]
    files = [os.path.join(folder, x.name) for x in entries if x.name.endswith(".py")]
    folders = [os.path.join(folder, x.name, "") for x in entries if x.is_dir()]
    return [*files, *folders] if files else []


def complete_parameters() -> list[tuple[str, str]]:
    """Return NAME=DEFAULT and a help text with the unit for each parameter.

    The parameters are those of the models on the command line or, without a model, of all models of
    the file. Defaults that require quotes in a shell are omitted: NAME=.
    """
    words = _command_line_words()
    outline = _outline_of_model_file(words)
    models = outline.models if outline else {}
    selected = [name for name in models if name in words] or list(models)
    parameters = [x for name in selected for x in models[name].parameters.values()]
    return [(f"{x.name}={_as_typed(x.default)}", _format_hint(x)) for x in parameters]


def complete_models() -> list[str]:
    """Return the names of the models, studies and sweeps of the file on the command line."""
    outline = _outline_of_model_file(_command_line_words())
    return [*outline.models, *outline.studies] if outline else []


def _command_line_words() -> list[str]:
    """Return the words typed so far from the environment.

    The arguments of typer lack the words after an option without a value.
    """
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    try:
        return shlex.split(line)
    except ValueError:  # an unmatched quotation mark
        return line.split()


def _outline_of_model_file(words: list[str]) -> Outline | None:
    # Commands start faster without this import.
    from beamdae.cli.model_files.outline import read_outline

    files = [word for word in words if word.endswith(".py") or word.startswith(PREFIX)]
    try:
        return read_outline(resolve_path(Path(files[0]).expanduser())) if files else None
    except BeamdaeError:
        return None


def _format_hint(x: ModelParameter) -> str:
    from beamdae.model_parameters import format_with_unit

    text = f"default {format_with_unit(x.default, x.unit)}"
    return f"{text}: {shorten(x.description, _MAX_HINT_LENGTH)}" if x.description else text


def _as_typed(default: Any) -> str:
    """Return a default as typed in a shell, or an empty string if it requires quotes."""
    text = str(default)
    return text if all(x.isalnum() or x in "._-+" for x in text) else ""


@contextmanager
def rejoin_bash_words() -> Iterator[None]:
    """Complete words such as `example:four_bar` and `length=2`, which bash splits.

    Bash replaces only the part after the last ":" or "=", so the part before is removed from the
    completions.
    """
    if os.environ.get("_BEAMDAE_COMPLETE") != "complete_bash":
        yield
        return
    index = int(os.environ["COMP_CWORD"])
    parts = [*os.environ["COMP_WORDS"].split("\n"), ""][: index + 1]
    words = [""]
    for part in parts:
        if part in _BASH_WORD_BREAKS or words[-1].endswith(_BASH_WORD_BREAKS):
            words[-1] += part
        else:
            words.append(part)
    os.environ["COMP_WORDS"] = "\n".join(words[1:])
    os.environ["COMP_CWORD"] = str(len(words) - 2)
    replaced = "" if parts[-1] in _BASH_WORD_BREAKS else parts[-1]
    prefix = words[-1][: len(words[-1]) - len(replaced)]
    output = StringIO()
    try:
        with redirect_stdout(output):
            yield
    finally:
        sys.stdout.writelines(
            line.removeprefix(prefix) for line in output.getvalue().splitlines(keepends=True)
        )
