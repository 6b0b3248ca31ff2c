"""Standard streams that are there, take every letter, and end quietly where nobody reads them."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any, TextIO

# What cannot be written in the encoding of a stream is told by its code.
_ENCODING_ERRORS = "backslashreplace"


class _FaultTolerantFile(io.FileIO):
    """The file of a stream: what cannot be written is dropped, and why is kept."""

    problem: OSError | None = None

    def write(self, data: Any) -> int:
        if self.problem is None:
            try:
                return super().write(data)
            except OSError as problem:
                self.problem = problem
        return len(data)


class _UnclosableStream(io.TextIOWrapper):
    """A stream that a model cannot close."""

    def close(self) -> None:
        self.flush()


def secure_streams() -> None:
    """Make standard output and error such that writing to them never fails.

    A stream that is closed goes nowhere: else the next file that is opened would take its number,
    and get what is meant for it.
    """
    while (free := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(free, True)
    os.close(free)
    sys.stdout, sys.stderr = _wrap_stream(sys.stdout, 1), _wrap_stream(sys.stderr, 2)


@contextmanager
def redirect_output_to_stderr() -> Iterator[None]:
    """Keep standard output for what is said after this: what is said in here is not part of it.

    It goes to standard error, also what other code writes past Python.
    """
    apart = None
    sys.stdout.flush()
    with suppress(OSError):  # What stands in for it has no number.
        if sys.stdout.fileno() == 1:
            apart = os.dup(1)
            os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        if apart is not None:
            sys.stdout.flush()
            os.dup2(apart, 1)
            os.close(apart)


def _wrap_stream(stream: TextIO | None, number: int) -> TextIO:
    if isinstance(stream, io.TextIOWrapper) and stream.isatty():
        stream.reconfigure(errors=_ENCODING_ERRORS)
        return stream
    encoding = "utf-8" if stream is None else stream.encoding
    file = io.BufferedWriter(_FaultTolerantFile(number, "w", closefd=False))
    return _UnclosableStream(file, encoding, _ENCODING_ERRORS, line_buffering=number == 2)


def flush_output(code: int) -> int:
    """The exit code of a command that ends with `code`, with all it said written.

    A reader that has gone away, as `head` does, changes nothing. Output that cannot be written for
    another reason, such as a full disk, is told, and is a mistake (2).
    """
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    problem = raw.problem if isinstance(raw, _FaultTolerantFile) else None
    if problem is None or problem.errno == errno.EPIPE:
        return code
    sys.stderr.write(f"error: standard output cannot be written, {problem.strerror}.\n")
    return code or 2
