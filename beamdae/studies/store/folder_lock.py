"""Lock of a results folder: only one process at a time runs a study in it."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from beamdae.errors import BeamdaeError
from beamdae.results.storage.files import describe_write_error

_LOCK_FILE = ".lock"
_OPEN_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0)
_MAX_OWNER_BYTES = 300


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold the lock of a results folder, which is created if needed.

    The lock is a file that the system unlocks when the process ends, even if the process is killed,
    so the file of a killed process can be reused. File systems without locks are not protected.

    Raises
    ------
    BeamdaeError
        If another process runs a study in this folder, the file cannot be created, or an operation
        in the block misses the folder, because it has been deleted.
    """
    path = folder / _LOCK_FILE
    try:
        descriptor = _acquire_lock(path)
    except OSError as problem:
        raise describe_write_error(path, problem) from problem
    try:
        with suppress(OSError):  # Only messages need the name of the owner; the disk may be full.
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()} on {platform.node()}".encode())
        yield
    except FileNotFoundError as problem:
        # Any operation of the study may be the first to miss the folder.
        if folder.is_dir():
            raise
        raise describe_write_error(path, problem) from problem
    finally:
        if os.name == "nt":  # Windows cannot remove open files.
            os.close(descriptor)
        with suppress(OSError):
            path.unlink()
        if os.name != "nt":
            os.close(descriptor)


def _acquire_lock(path: Path) -> int:
    """Return the descriptor of the locked file at `path`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        descriptor = os.open(path, _OPEN_FLAGS, 0o666)
        try:
            if not _lock_file(descriptor):
                raise BeamdaeError(
                    f"{path.parent}: {_read_owner(descriptor)} is running a study in this folder; "
                    "wait until it ends, or choose another folder."
                )
            if os.fstat(descriptor).st_nlink > 1:
                raise BeamdaeError(
                    f"{path}: the lock is also a file of another name (hard link); remove the link."
                )
            # The previous owner may have removed the file in the meantime.
            if path.exists() and os.path.samestat(path.stat(), os.fstat(descriptor)):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _lock_file(descriptor: int) -> bool:
    """Lock an open file; return False if another process holds the lock.

    If the file system has no locks, return True.
    """
    try:
        import fcntl
    except ImportError:
        return _lock_file_on_windows(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # The file system has no locks.
        return True
    return True


def _lock_file_on_windows(descriptor: int) -> bool:
    try:
        import msvcrt
    except ImportError:  # A browser has neither locks nor other processes.
        return True
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except OSError:
        return False
    return True


def _read_owner(descriptor: int) -> str:
    try:
        owner = os.read(descriptor, _MAX_OWNER_BYTES).decode(errors="replace")
    except OSError:  # Windows locks the content, too.
        owner = ""
    return owner if owner.isprintable() and owner else "another process"
