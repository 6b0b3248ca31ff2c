"""Where machine code is kept: a folder of the user's alone, files that prove what they are.

Objects are executed once they are loaded, so nothing is loaded that anybody else could have put
there, nor anything that is not what was built. A file is named after what it was built from, and
begins with the checksum of that and of the object: the two appear by one renaming. What is checked
is what is loaded: the bytes that were read.
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
# Bytes of it, before those of the object.
_CHECKSUM_BYTES = 32
# Writing takes milliseconds; a file unfinished for longer than this [s] is of one that was killed.
_MAX_WRITE_SECONDS = 3600.0
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OTHERS_ENTER = stat.S_IXGRP | stat.S_IXOTH
# Neither links nor pipes, which would wait for somebody to write.
_OPEN_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)


class CacheError(Exception):
    """A cache that cannot be used; the message names it and says why."""


def cache_folder() -> Path:
    """Where machine code is kept, without links: beamdae/ in the user's cache folder.

    That is XDG_CACHE_HOME, or ~/.cache if that is no absolute path; both are made if need be.

    Raises
    ------
    CacheError
        If there is none, or others could change what is in it.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        root = given if given.is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        raise CacheError("the kernel cache: the user has no home folder, set HOME") from None
    with _translate_errors(root / "beamdae"):
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        (root / "beamdae").mkdir(mode=0o700, exist_ok=True)
        # What is checked is what is used: links on the way may lead elsewhere the next time.
        folder = (root / "beamdae").resolve()
        if hasattr(os, "geteuid"):
            _require_private(folder)
        return folder


def read_object(folder: Path, recipe: str, name: str) -> bytes | None:
    """The object built from this recipe, if there is one that is what was built."""
    with _translate_errors(folder):
        try:
            found = _read_private_file(folder / _object_file_name(recipe, name)) or b""
        except OSError:
            return None
    content = found[_CHECKSUM_BYTES:]
    return content if found[:_CHECKSUM_BYTES] == _checksum(recipe, content) else None


def write_object(folder: Path, recipe: str, name: str, content: bytes) -> None:
    """Put an object in its place; what is there of its recipe is replaced, never changed."""
    with _translate_errors(folder):
        descriptor, unfinished = tempfile.mkstemp(prefix=_UNFINISHED_PREFIX, dir=folder)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(_checksum(recipe, content) + content)
                file.flush()
                # A name may reach the disk before what it names.
                os.fsync(descriptor)
            _remove_abandoned_files(folder, Path(unfinished).stat().st_mtime)
            place = folder / _object_file_name(recipe, name)
            if place.is_dir():
                _remove(place)
            os.replace(unfinished, place)
        finally:
            with suppress(FileNotFoundError):
                os.unlink(unfinished)


def _remove_abandoned_files(folder: Path, now: float) -> None:
    """Of builds that were killed, by the clock of the disk, which may not be this machine's."""
    for other in folder.glob(f"{_UNFINISHED_PREFIX}*"):
        with suppress(OSError):
            if now - other.stat().st_mtime > _MAX_WRITE_SECONDS:
                _remove(other)


def _remove(place: Path) -> None:
    with suppress(OSError):
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place)
        else:
            place.unlink()


def _object_file_name(recipe: str, name: str) -> str:
    return f"{name}-{hashlib.sha256(recipe.encode()).hexdigest()[:32]}.o"


def _checksum(recipe: str, content: bytes) -> bytes:
    digest = hashlib.sha256(recipe.encode())
    digest.update(content)
    return digest.digest()


@contextmanager
def _translate_errors(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        raise CacheError(f"{folder}: kernels cannot be kept there, {problem.strerror}") from problem


def _read_private_file(file: Path) -> bytes | None:
    """What a file holds that nobody else can write to."""
    with os.fdopen(os.open(file, _OPEN_FLAGS), "rb") as opened:
        known = os.fstat(opened.fileno())
        if not stat.S_ISREG(known.st_mode):
            return None
        if hasattr(os, "geteuid") and (
            known.st_uid != os.geteuid() or known.st_mode & _OTHERS_WRITE
        ):
            return None
        return opened.read()


def _require_private(folder: Path) -> None:
    """Refuse a folder that others own or write to, and a way to it that they could change.

    Raises
    ------
    CacheError
        If that is so.
    """
    us = os.geteuid()
    if folder.stat().st_uid != us:
        raise _untrusted_folder_error(folder, "it belongs to another user")
    if stat.S_IMODE(folder.stat().st_mode) != 0o700:
        # A cache from before, or of a generous umask; its files are checked one by one.
        with suppress(OSError):
            folder.chmod(0o700)
    if folder.stat().st_mode & _OTHERS_WRITE:
        raise _untrusted_folder_error(folder, "others can write to it")
    for place in reversed(folder.parents):
        known = place.stat()
        # In containers root may have another number than 0.
        if known.st_uid not in (us, os.stat("/").st_uid):
            raise _untrusted_folder_error(folder, f"{place} belongs to another user")
        # In a sticky folder, such as /tmp, others can move nothing but what is theirs.
        if known.st_mode & _OTHERS_WRITE and not known.st_mode & stat.S_ISVTX:
            raise _untrusted_folder_error(folder, f"others can write to {place}")
        if known.st_uid == us and not known.st_mode & _OTHERS_ENTER:
            return  # Nobody else gets further than here.


def _untrusted_folder_error(folder: Path, why: str) -> CacheError:
    return CacheError(
        f"{folder}: kernels are neither kept nor loaded there, {why}; set XDG_CACHE_HOME to a "
        "folder that is yours alone"
    )
