"""Input files of this process, which no output replaces.

Inputs are the files that commands, tables, fits and model functions read: every reader calls
`register_input`, and `reading_inputs` registers the files that the code of a model opens. All
outputs are written by `beamdae.results.storage.files.atomic_write`, which calls `require_output`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import source_from_cache
from typing import Any

from beamdae.errors import BeamdaeError

CHECKPOINT = "checkpoint"
_WRITE_MODES = frozenset("wax+")
_WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND

# Global state, because other code of the process may write the files. Absolute paths of inputs with
# their kinds, and of outputs, which may be read and then written again.
_inputs: dict[str, str] = {}
_outputs: set[str] = set()
_active_folders: list[str] = []


def register_input(path: str | os.PathLike[str], kind: str = "") -> None:
    """Protect a file from outputs, unless this process wrote it.

    A `CHECKPOINT` may be replaced by another one, so that runs in turn resume from one file.
    """
    with suppress(OSError, ValueError):  # The reader reports invalid paths.
        absolute = os.path.abspath(path)
        if _inputs.get(absolute) != kind and os.path.realpath(absolute) not in _outputs:
            _inputs[absolute] = kind


def register_output(path: str | os.PathLike[str]) -> None:
    """Record a file that this process has written."""
    _outputs.add(os.path.realpath(path))


def require_output(path: str | os.PathLike[str], option: str = "", kind: str = "") -> None:
    """Raise an error if a file is an input, also under another name or through a link.

    The message begins with `option`. Only an output of a certain `kind` replaces such inputs.
    """
    if _is_input(path, kind):
        part = f"{option} {path}".strip()
        raise BeamdaeError(
            f"{part}: the file is an input and is not overwritten; choose another file."
        )


def _is_input(path: str | os.PathLike[str], kind: str) -> bool:
    """Return True if a file is an input of another kind than `kind`."""
    try:
        output = os.stat(path)
    except (OSError, ValueError):
        return False
    for name, kind_of_input in _inputs.items():
        with suppress(OSError):
            if os.path.samestat(output, os.stat(name)) and not (kind and kind == kind_of_input):
                return True
    return False


@contextmanager
def reading_inputs(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Register the files, and the modules of a folder, that are opened in this block."""
    watch_files(_register_opened_file)
    _active_folders.append(os.path.join(folder, ""))
    try:
        yield
    finally:
        _active_folders.pop()


def _register_opened_file(path: str, is_written: bool) -> None:
    if not _active_folders or is_written:
        return
    if not path.endswith(".pyc"):
        register_input(path)
    elif path.startswith(tuple(_active_folders)):
        register_input(find_source(path))


# Functions of the path of each file that Python opens, and of True if it is opened for writing.
Listener = Callable[[str, bool], None]
_listeners: list[Listener] = []


def watch_files(listener: Listener) -> None:
    """Call a function for each file that Python opens from now on."""
    if not _listeners:
        sys.addaudithook(_handle_event)  # It cannot be removed.
    if listener not in _listeners:
        _listeners.append(listener)


def _handle_event(event: str, arguments: tuple[Any, ...]) -> None:
    if event != "open" or not isinstance(arguments[0], (str, bytes)):
        return
    path, mode, flags = arguments
    is_written = bool(set(mode or "") & _WRITE_MODES or (flags or 0) & _WRITE_FLAGS)
    for listener in _listeners:
        # Paths that cannot be resolved cannot be opened either.
        with suppress(OSError, ValueError):
            listener(os.fsdecode(path), is_written)


@cache
def find_source(compiled: str) -> str:
    """Return the path of the source of a compiled module."""
    try:
        return source_from_cache(compiled)
    except (ValueError, NotImplementedError):
        return compiled
