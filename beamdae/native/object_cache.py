"""Cache of compiled objects: files with checksums in a private folder of the user.

Loaded objects are executed. Therefore a file is loaded only if no other user could have written it
and its checksum is correct; on Windows, only the checksum is checked. The file name contains a hash
of the recipe from which the object was built. The file begins with the checksum of recipe and
object, and is renamed atomically to its name when it is complete. It is read only once, so that the
checked bytes are the loaded bytes.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_UNFINISHED_PREFIX = "build-"
# SHA-256, in front of the object.
_CHECKSUM_BYTES = 32
# Leading hexadecimal digits of the checksum of a recipe in the name of its file.
_NAME_DIGITS = 32
_PRIVATE_MODE = 0o700
# Writing takes milliseconds: a file that is unfinished for longer [s] was left by a killed process.
_MAX_WRITE_SECONDS = 3600.0
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OTHERS_ENTER = stat.S_IXGRP | stat.S_IXOTH
# Reject links, and do not wait for writers of pipes.
_OPEN_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)


class CacheError(Exception):
    """Raised if the cache cannot be used; the message gives the reason."""


def cache_folder() -> Path:
    """Return the resolved path of beamdae/ in the user's cache folder, created if necessary.

    The cache folder is XDG_CACHE_HOME, or ~/.cache if XDG_CACHE_HOME is not an absolute path.

    Raises
    ------
    CacheError
        If the user has no home folder, beamdae/ cannot be created, or others could change its
        contents.
    """
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        root = configured if configured.is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        raise CacheError("kernel cache: the user has no home folder; set HOME") from None
    with _translate_errors(root / "beamdae"):
        root.mkdir(mode=_PRIVATE_MODE, parents=True, exist_ok=True)
        (root / "beamdae").mkdir(mode=_PRIVATE_MODE, exist_ok=True)
        # Use the path that is checked: links in it may point elsewhere the next time.
        folder = (root / "beamdae").resolve()
        if hasattr(os, "geteuid"):
            _require_private(folder)
        return folder


def read_object(folder: Path, recipe: str, name: str) -> bytes | None:
    """Return the object built from this recipe; None if missing, damaged or not trusted."""
    with _translate_errors(folder):
        try:
            data = _read_private_file(folder / object_file_name(recipe, name)) or b""
        except OSError:
            return None
    content = data[_CHECKSUM_BYTES:]
    return content if data[:_CHECKSUM_BYTES] == _checksum(recipe, content) else None


def write_object(folder: Path, recipe: str, name: str, content: bytes) -> None:
    """Store an object atomically; an existing file is replaced, not modified in place.

    Raises
    ------
    CacheError
        If the file cannot be written.
    """
    with _translate_errors(folder):
        descriptor, unfinished = tempfile.mkstemp(prefix=_UNFINISHED_PREFIX, dir=folder)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(_checksum(recipe, content) + content)
                file.flush()
                # Otherwise the name may reach the disk before the content.
                os.fsync(descriptor)
            _remove_abandoned_files(folder, Path(unfinished).stat().st_mtime)
            path = folder / object_file_name(recipe, name)
            if path.is_dir():
                _remove(path)
            os.replace(unfinished, path)
        finally:
            with suppress(FileNotFoundError):
                os.unlink(unfinished)


def object_file_name(recipe: str, name: str) -> str:
    """Return the name of the file of an object: its name, and a hash of its recipe."""
    return f"{name}-{hashlib.sha256(recipe.encode()).hexdigest()[:_NAME_DIGITS]}.o"


def _remove_abandoned_files(folder: Path, now: float) -> None:
    """Remove unfinished files of killed processes; `now` is the current file system time [s]."""
    for other in folder.glob(f"{_UNFINISHED_PREFIX}*"):
        with suppress(OSError):
            if now - other.stat().st_mtime > _MAX_WRITE_SECONDS:
                _remove(other)


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _checksum(recipe: str, content: bytes) -> bytes:
    digest = hashlib.sha256(recipe.encode())
    digest.update(content)
    return digest.digest()


@contextmanager
def _translate_errors(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        raise CacheError(
            f"{folder}: machine code cannot be cached: {problem.strerror}"
        ) from problem


def _read_private_file(file: Path) -> bytes | None:
    """Return the content of a regular file that only this user can write to, else None."""
    with os.fdopen(os.open(file, _OPEN_FLAGS), "rb") as stream:
        status = os.fstat(stream.fileno())
        if not stat.S_ISREG(status.st_mode):
            return None
        if hasattr(os, "geteuid") and (
            status.st_uid != os.geteuid() or status.st_mode & _OTHERS_WRITE
        ):
            return None
        return stream.read()


def _require_private(folder: Path) -> None:
    """Require that this user owns a folder and that others can neither write to it nor move it.

    Raises
    ------
    CacheError
        If another user owns the folder, or others could change or replace it.
    """
    user = os.geteuid()
    if folder.stat().st_uid != user:
        raise _untrusted_folder_error(folder, "the folder belongs to another user")
    if stat.S_IMODE(folder.stat().st_mode) != _PRIVATE_MODE:
        # Created by an earlier version or under a permissive umask; each file is checked anyway.
        with suppress(OSError):
            folder.chmod(_PRIVATE_MODE)
    if folder.stat().st_mode & _OTHERS_WRITE:
        raise _untrusted_folder_error(folder, "others can write to the folder")
    for path in reversed(folder.parents):
        status = path.stat()
        # In containers the user id of root may differ from 0.
        if status.st_uid not in (user, os.stat("/").st_uid):
            raise _untrusted_folder_error(folder, f"{path} belongs to another user")
        # In a sticky folder, such as /tmp, users can move only what they own.
        if status.st_mode & _OTHERS_WRITE and not status.st_mode & stat.S_ISVTX:
            raise _untrusted_folder_error(folder, f"others can write to {path}")
        if status.st_uid == user and not status.st_mode & _OTHERS_ENTER:
            return  # Other users cannot enter: the folders below are protected.


def _untrusted_folder_error(folder: Path, reason: str) -> CacheError:
    return CacheError(
        f"{folder}: machine code is neither stored nor loaded because {reason}; set "
        "XDG_CACHE_HOME to a private folder"
    )
