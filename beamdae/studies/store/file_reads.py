"""Files a run reads, told by Python itself, so that results follow them.

Whatever opens files without Python (HDF5, SQLite) is not seen; a model names such files with
`@bd.model(data=)`.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from beamdae.studies.store.file_hashes import digest_file, file_signature, is_installed

_WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
# A file that is not what was read: no hash is this.
_CHANGED_WHILE_READ = "changed while it was read"

Signature = tuple[int, int, int] | None
# Files by the name they are known by, "./" for those read relative to the working directory.
FileReads = dict[str, Signature]


class _FileWatcher:
    """What Python says of files it opens; one a process, for hooks stay until its end."""

    def __init__(self) -> None:
        self.begun = False
        self.current: list[FileReads] = []
        # Read by modules that stay loaded: all later runs of a worker have it as well.
        self.lasting: FileReads = {}
        self.written: set[str] = set()
        self.folder = ""

    def begin(self) -> None:
        if not self.begun:
            self.begun = True
            sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], (str, bytes)):
            return
        try:
            self._opened(os.fsdecode(arguments[0]), *arguments[1:])
        except (OSError, ValueError):
            # What has no place cannot be opened either.
            return

    def _opened(self, path: str, mode: str | None, flags: int) -> None:
        absolute = os.path.abspath(path)
        if is_installed(absolute):
            return
        if (mode and set(mode) & set("wax+")) or (flags or 0) & _WRITE_FLAGS:
            self.written.add(absolute)
            return
        code = path.endswith((".py", ".pyc"))
        if path.endswith(".pyc"):
            absolute = path = _source_path(absolute)
        moved = os.path.isabs(path) or os.getcwd() != self.folder
        name = absolute if moved else f"./{os.path.normpath(path)}"
        for reads in [self.lasting] if code or _is_read_by_module() else self.current:
            reads.setdefault(name, file_signature(absolute))


_WATCHER = _FileWatcher()


@cache
def _source_path(compiled: str) -> str:
    try:
        return importlib.util.source_from_cache(compiled)
    except ValueError:
        return compiled


def _is_read_by_module() -> bool:
    """Whether a loaded module of the user's own reads, which may keep what it has read."""
    frame = sys._getframe(3)
    while frame is not None:
        module = sys.modules.get(frame.f_globals.get("__name__", ""))
        if (
            module is not None
            and vars(module) is frame.f_globals
            and not is_installed(frame.f_code.co_filename)
            and "__file__" in frame.f_globals
        ):
            return True
        frame = frame.f_back  # type: ignore[assignment]
    return False


def start_watching() -> None:
    """Take notice of files from now on."""
    _WATCHER.begin()


@contextmanager
def record_file_reads() -> Iterator[FileReads]:
    """Files read inside, whatever thread reads them, and those loaded modules have read before."""
    _WATCHER.begin()
    reads: FileReads = {}
    _WATCHER.folder = os.getcwd()
    _WATCHER.current.append(reads)
    try:
        yield reads
    finally:
        _WATCHER.current[:] = [x for x in _WATCHER.current if x is not reads]
        reads |= _WATCHER.lasting


def clear_module_reads() -> None:
    """Begin anew: modules this process had loaded before are no part of what is run now."""
    _WATCHER.lasting.clear()
    _WATCHER.written.clear()


def digest_reads(reads: Mapping[str, Signature], home: Path) -> dict[str, str | None]:
    """Hashes of files that were read; absolute names become relative to `home`.

    So that a model and its files may move together. Files this process has written are left out.
    """
    found: dict[str, str | None] = {}
    for name, before in sorted(reads.items()):
        absolute = os.path.abspath(name)
        if absolute in _WATCHER.written or os.path.isdir(absolute):
            continue
        now = digest_file(absolute) if file_signature(absolute) == before else _CHANGED_WHILE_READ
        found[_portable_name(name, home)] = now
    return found


def are_unchanged(reads: Mapping[str, Signature]) -> bool:
    """Whether files are still what they were when they were read."""
    return all(file_signature(os.path.abspath(name)) == before for name, before in reads.items())


def _portable_name(name: str, home: Path) -> str:
    if name.startswith("./"):
        return name
    try:
        return f"model:{Path(os.path.relpath(name, home)).as_posix()}"
    except ValueError:  # Another drive.
        return name


def changed_files(found: Mapping[str, str | None], home: Path) -> list[str]:
    """Those of the files that are not what they were."""

    def place(name: str) -> str:
        inside = name.removeprefix("model:")
        return os.path.abspath(inside if inside == name else home / inside)

    return [place(name) for name, known in found.items() if digest_file(place(name)) != known]
