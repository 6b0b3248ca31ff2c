"""Where compiled kernels are kept: a folder nobody else can write to, files that prove whole.

A library is executed, so nothing is loaded that another user could have put there, and nothing
that is not what was written.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_SUFFIX = ".so"
_SCRATCH = "build-"
# Scratch folders older than this [s] are left over from a process that was killed.
_LEFT_OVER = 3600.0
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


class CacheError(Exception):
    """A cache that cannot be used; the message says why."""


def cache_folder() -> Path:
    """Where compiled kernels are kept: beamdae/ in the user's cache folder.

    That is XDG_CACHE_HOME where it is absolute, which its specification demands, else ~/.cache.

    Raises
    ------
    CacheError
        If there is no home folder.
    """
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        root = given if given.is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        raise CacheError("no home folder is known to keep kernels in, set HOME") from None
    return root / "beamdae"


@contextmanager
def _usable(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        why = problem.strerror or problem
        raise CacheError(f"{folder}: kernels cannot be kept there, {why}") from problem


def require_private(folder: Path) -> None:
    """Make the folder if need be, and see that no other user can put anything there.

    Raises
    ------
    CacheError
        If others own it or may write to it, or to a folder it is in; or if it cannot be made.
    """
    with _usable(folder):
        for place in reversed((folder, *folder.parents)):
            if not place.exists():
                place.mkdir(mode=0o700, exist_ok=True)
        if not hasattr(os, "getuid"):
            return  # Of a system where a user's folders are private.
        real = folder.resolve()
        for place in (real, *real.parents):
            found = place.stat()
            if found.st_uid not in ((os.getuid(),) if place == real else (os.getuid(), 0)):
                raise CacheError(
                    f"{folder}: kernels are not kept there, {place} belongs to another user; set "
                    "XDG_CACHE_HOME to a folder of your own"
                )
            # Of a sticky folder such as /tmp users can move but what is theirs.
            sticky = place != real and found.st_mode & stat.S_ISVTX
            if found.st_mode & _OTHERS_WRITE and not sticky:
                raise CacheError(
                    f"{folder}: kernels are not kept there, others may write to {place}; "
                    f"chmod go-w {place}"
                )


def kept(folder: Path, name: str) -> Path | None:
    """The library of this name, if there is one that is whole; what is damaged is removed.

    Raises
    ------
    CacheError
        If the folder cannot be read.
    """
    with _usable(folder):
        for library in sorted(folder.glob(f"{name}-*{_SUFFIX}")):
            # Another process may remove it as well.
            with suppress(FileNotFoundError):
                if _is_ours(library) and library.name == _named(name, library.read_bytes()):
                    return library
            discard(library)
    return None


def keep(folder: Path, name: str, build: Callable[[Path], None]) -> Path:
    """Build a library in a scratch folder and keep it by this name; returns its path.

    It appears whole or not at all, whoever else builds the same. Its name tells the checksum of
    what is in it, so that neither can be there without the other.

    Raises
    ------
    CacheError
        If it cannot be written.
    """
    with _usable(folder):
        for leftover in folder.glob(f"{_SCRATCH}*"):
            with suppress(FileNotFoundError):
                if time.time() - leftover.stat().st_mtime > _LEFT_OVER:
                    discard(leftover)
        with tempfile.TemporaryDirectory(dir=folder, prefix=_SCRATCH) as scratch:
            built = Path(scratch) / f"kernel{_SUFFIX}"
            build(built)
            built.chmod(0o700)
            content = built.read_bytes()
            library = folder / _named(name, content)
            # A name may reach the disk before what it names.
            with built.open("rb+") as file:
                os.fsync(file.fileno())
            os.replace(built, library)
            return library


def discard(path: Path) -> None:
    """Remove a file or folder of the cache; one that is mapped elsewhere stays whole there."""
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _named(name: str, content: bytes) -> str:
    checksum = hashlib.sha256(name.encode() + content).hexdigest()
    return f"{name}-{checksum[:32]}{_SUFFIX}"


def _is_ours(library: Path) -> bool:
    """Whether it is a file that only we could have written."""
    found = library.lstat()
    ours = not hasattr(os, "getuid") or found.st_uid == os.getuid()
    readable = bool(found.st_mode & stat.S_IRUSR)
    private = not hasattr(os, "getuid") or not found.st_mode & _OTHERS_WRITE
    return stat.S_ISREG(found.st_mode) and ours and readable and private
