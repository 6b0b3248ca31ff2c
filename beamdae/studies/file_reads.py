"""Files that runs read, and their hashes: stored results depend on them."""

from __future__ import annotations

import hashlib
import os
import site
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path

from beamdae.errors import working_folder
from beamdae.input_files import find_source, register_input, watch_files
from beamdae.results.storage.documents import open_regular_file

# Replaces the hash of a file that changed after it was read; differs from every hash.
_CHANGED_WHILE_READ = "changed while it was read"
_HOOK_FRAMES = 3  # frames between `_is_read_by_module` and the code that opens the file

PACKAGE_FOLDER = Path(__file__).parents[1]
_PACKAGES_WITHOUT_EFFECT = frozenset({"cli", "report"})  # results do not depend on them
_SYSTEM_FOLDERS = ("/proc", "/sys", "/dev", "/etc", "/usr/share")

# Modification time [ns], size [bytes] and inode; None if the file is missing or inaccessible.
FileSignature = tuple[int, int, int] | None
# Signatures by absolute name, or by name relative to the working directory with a leading "./".
FileReads = dict[str, FileSignature]


class _FileWatcher:
    """Recorder of opened files."""

    def __init__(self) -> None:
        self.recordings: list[FileReads] = []
        # Files read by modules. Modules stay loaded, so all later runs depend on these files.
        self.module_reads: FileReads = {}
        self.written: set[str] = set()
        self.folder = Path()

    def record(self, path: str, is_written: bool) -> None:
        absolute = _absolute(path)
        if is_installed(absolute):
            return
        if is_written:
            self.written.add(absolute)
            return
        is_code = path.endswith((".py", ".pyc"))
        if path.endswith(".pyc"):
            absolute = path = find_source(absolute)
        is_relative = not os.path.isabs(path) and working_folder() == self.folder
        name = f"./{os.path.normpath(path)}" if is_relative else absolute
        for reads in [self.module_reads] if is_code or _is_read_by_module() else self.recordings:
            reads.setdefault(name, file_signature(absolute))


_WATCHER = _FileWatcher()


def _absolute(path: str | Path) -> str:
    return os.path.normpath(working_folder() / path)


def _is_read_by_module() -> bool:
    """Return True if an imported user module opens the file; modules may cache the content."""
    frame = sys._getframe(_HOOK_FRAMES)
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


@contextmanager
def record_file_reads() -> Iterator[FileReads]:
    """Record user files read in this block by any thread, or by imported modules at any time.

    The yielded dict maps names to signatures; it is complete at the end of the block.
    """
    watch_files(_WATCHER.record)
    reads: FileReads = {}
    _WATCHER.folder = working_folder()
    _WATCHER.recordings.append(reads)
    try:
        yield reads
    finally:
        _WATCHER.recordings[:] = [x for x in _WATCHER.recordings if x is not reads]
        reads |= _WATCHER.module_reads


def clear_module_reads() -> None:
    """Forget the files that modules have read and that this process has written so far."""
    _WATCHER.module_reads.clear()
    _WATCHER.written.clear()


def digest_reads(reads: Mapping[str, FileSignature], home: Path) -> dict[str, str | None]:
    """Return the hashes of files by name; absolute names become relative to `home`.

    Relative names stay valid if a model is moved together with its files. Folders, and files that
    this process has written, are omitted. If a file has changed since it was read, a text that
    differs from every hash takes the place of the hash. None takes the place of the hash of a
    missing file.
    """
    digests: dict[str, str | None] = {}
    for name, signature in sorted(reads.items()):
        absolute = _absolute(name)
        if absolute in _WATCHER.written or os.path.isdir(absolute):
            continue
        is_same = file_signature(absolute) == signature
        digests[_portable_name(name, home)] = (
            digest_file(absolute) if is_same else _CHANGED_WHILE_READ
        )
    return digests


def are_unchanged(reads: Mapping[str, FileSignature]) -> bool:
    """Return True if the files have not changed since they were read."""
    return all(file_signature(_absolute(name)) == x for name, x in reads.items())


def _portable_name(name: str, home: Path) -> str:
    if name.startswith("./"):
        return name
    try:
        return f"model:{Path(os.path.relpath(name, home)).as_posix()}"
    except ValueError:  # The file is on another drive.
        return name


def changed_files(digests: Mapping[str, str | None], home: Path) -> list[str]:
    """Return the paths of files whose hash now differs from `digests`; see `digest_reads`."""
    paths = _resolve_all(digests, home)
    return [paths[name] for name, digest in digests.items() if digest_file(paths[name]) != digest]


def register_reads(digests: Mapping[str, str | None], home: Path) -> None:
    """Protect the files of `digest_reads`, which another process has read, from outputs."""
    for path in _resolve_all(digests, home).values():
        register_input(path)


def _resolve_all(names: Iterable[str], home: Path) -> dict[str, str]:
    folder = str(working_folder())
    return {name: _resolve(name, str(home), folder) for name in names}


@lru_cache(maxsize=1024)
def _resolve(name: str, home: str, folder: str) -> str:
    relative = name.removeprefix("model:")
    return os.path.normpath(os.path.join(folder, "" if relative == name else home, relative))


@cache
def _installed_folders() -> tuple[str, ...]:
    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    folders += [*_SYSTEM_FOLDERS, str(PACKAGE_FOLDER)]
    folders.append(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    with_targets = {x for folder in folders if folder for x in (folder, os.path.realpath(folder))}
    return tuple(f"{folder.rstrip(os.sep)}{os.sep}" for folder in with_targets)


@cache
def is_installed(file: str) -> bool:
    """Return True if a file belongs to Python, an installed package, the system or a cache."""
    return file.startswith("<frozen ") or file.startswith(_installed_folders())


@cache
def digest_package() -> str:
    """Return the hash of the source code of beamdae without `cli` and `report`, cached."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE_FOLDER.rglob("*.py")):
        relative = path.relative_to(PACKAGE_FOLDER)
        if relative.parts[0] not in _PACKAGES_WITHOUT_EFFECT:
            digest.update(f"{relative.as_posix()}\0".encode())
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


def file_signature(path: str) -> FileSignature:
    """Return the signature of a file; None if it is missing or inaccessible."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def digest_file(path: str) -> str | None:
    """Return the hash of the content of a file; None if it is missing or unreadable."""
    return _digest_signed_file(path, file_signature(path))


@cache
def _digest_signed_file(path: str, signature: FileSignature) -> str | None:
    if signature is None:
        return None
    try:
        # Reading a pipe or a device, which a record may name, would not end.
        with open_regular_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
