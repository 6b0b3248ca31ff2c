"""Lock of a results folder: only one process at a time runs a study in it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from beamdae.errors import BeamdaeError
from beamdae.results.storage.files import describe_write_error

_LOCK_FILE = ".lock"


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold the lock of a results folder, which is created if needed.

    The lock is a file that the system unlocks when the process ends, even if the process is killed;
    the file remains. File systems without locks are not protected.

    Raises
    ------
    BeamdaeError
        If another process runs a study in this folder, the file cannot be created, or an operation
        in the block misses the folder, because it has been deleted.
    """
    path = folder / _LOCK_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as problem:
        raise describe_write_error(path, problem) from problem
    try:
        if not _lock_file(descriptor):
            raise BeamdaeError(
                f"{folder}: another process is running a study in this folder; wait until it ends, "
                "or choose another folder."
            )
        yield
    except FileNotFoundError as problem:
        # Any operation of the study may be the first to miss the folder.
        if folder.is_dir():
            raise
        raise describe_write_error(path, problem) from problem
    finally:
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
