"""Reading of result files: regular files of limited size, whose errors name the file.

Files may come from others: nothing in a file is executed, and sizes are compared with limits before
anything is allocated.
"""

from __future__ import annotations

import csv
import errno
import math
import os
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

from beamdae.errors import BeamdaeError, FileContentError, require_valid_path

_MAX_BYTES = 4_000_000_000
# Exceptions of NumPy, zipfile, JSON and of functions that evaluate damaged content.
_CONTENT_ERRORS = (
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, OSError),
    *(RuntimeError, SyntaxError, TypeError, ValueError, zipfile.BadZipFile, zlib.error),
    *(struct.error, csv.Error),
)


class ContentError(Exception):
    """Raised for content that is not allowed; the message names the field and what is allowed."""


@dataclass(frozen=True)
class FileKind:
    """Kind of a result file, for messages.

    Attributes
    ----------
    name
        Name of the kind, such as "saved run".
    remedy
        Advice if the file cannot be used, such as "run the model again from the start".
    """

    name: str
    remedy: str

    def error(self, path: Path, problem: str) -> FileContentError:
        """Return the error for the file at `path`."""
        return FileContentError(path, problem, self.remedy)

    @contextmanager
    def errors_of(self, path: Path) -> Iterator[None]:
        """Convert errors of reading or evaluating the content of a file to FileContentError."""
        try:
            yield
        except ContentError as problem:
            raise self.error(path, str(problem)) from None
        except BeamdaeError:
            raise
        except _CONTENT_ERRORS as problem:
            message = f"the file is not a complete {self.name}"
            raise self.error(path, message) from problem


@contextmanager
def open_regular_file(path: str | Path) -> Iterator[BufferedReader]:
    """Open a regular file for reading; links are followed.

    Raises
    ------
    OSError
        If the file cannot be opened, or is a device, a pipe, a socket or a folder.
    """
    _require_regular(os.stat(path).st_mode)
    # Opening a pipe that has no writer would wait; the file may be replaced after `stat`.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as stream:
        _require_regular(os.fstat(stream.fileno()).st_mode)
        yield stream


def _require_regular(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "not a regular file")


@contextmanager
def open_result(path: Path, kind: FileKind, most: float = math.inf) -> Iterator[BufferedReader]:
    """Open a regular file of at most `most` bytes for reading.

    Raises
    ------
    FileContentError
        If the file cannot be opened, is not a regular file, or has more than `most` bytes.
    """
    require_valid_path(path)
    with ExitStack() as files:
        try:
            stream = files.enter_context(open_regular_file(path))
        except OSError as problem:
            why = problem.strerror or problem
            raise kind.error(path, f"the {kind.name} cannot be read: {why}") from None
        size = os.fstat(stream.fileno()).st_size
        if size > most:
            raise kind.error(
                path, f"the {kind.name} has {size} bytes, but at most {most} bytes are allowed"
            )
        yield stream


def read_bytes(path: Path, kind: FileKind, most: int = _MAX_BYTES) -> bytes:
    """Return the content of a regular file, see `open_result`."""
    with open_result(path, kind, most) as stream, kind.errors_of(path):
        # Files that grow while they are read are truncated, and fail their checksum.
        return stream.read(most)
