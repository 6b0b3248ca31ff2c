"""Standard streams that always exist, encode every character, and survive a closed pipe."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any, TextIO

# Characters that a stream cannot encode are written as escapes.
_ENCODING_ERRORS = "backslashreplace"
_STDOUT, _STDERR = 1, 2  # file descriptors
_WRITE_FAILURE = 2  # exit code


class _FaultTolerantFile(io.FileIO):
    """File of a stream that stores the first write error and discards all later data."""

    problem: OSError | None = None

    def write(self, data: Any) -> int:
        if self.problem is None:
            try:
                return super().write(data)
            except OSError as problem:
                self.problem = problem
        return len(data)


class _UnclosableStream(io.TextIOWrapper):
    """Stream that a model cannot close."""

    def close(self) -> None:
        self.flush()


def secure_streams() -> None:
    """Make writing to standard output and standard error safe.

    Files, pipes and terminals, which may be closed during a run, are replaced by streams that store
    the first write error instead of raising it.

    A terminal of Windows is kept, but escapes characters that it cannot encode. A closed stream is
    connected to the null device, because the next opened file would otherwise get the descriptor of
    the stream and receive its output.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _STDERR:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    sys.stdout = _secure_stream(sys.stdout, _STDOUT)
    sys.stderr = _secure_stream(sys.stderr, _STDERR)


def _secure_stream(stream: TextIO | None, descriptor: int) -> TextIO:
    is_terminal = isinstance(stream, io.TextIOWrapper) and stream.isatty()
    if isinstance(stream, io.TextIOWrapper) and is_terminal and os.name == "nt":
        stream.reconfigure(errors=_ENCODING_ERRORS)
        return stream
    is_line_buffered = is_terminal or descriptor == _STDERR
    encoding = "utf-8" if stream is None else stream.encoding
    file = io.BufferedWriter(_FaultTolerantFile(descriptor, "w", closefd=False))
    return _UnclosableStream(file, encoding, _ENCODING_ERRORS, line_buffering=is_line_buffered)


@contextmanager
def redirect_output_to_stderr() -> Iterator[None]:
    """Redirect standard output to standard error, including the output of compiled libraries."""
    saved_descriptor = None
    sys.stdout.flush()
    with suppress(OSError):  # A replaced standard output may have no descriptor.
        if sys.stdout.fileno() == _STDOUT:
            saved_descriptor = os.dup(_STDOUT)
            os.dup2(_STDERR, _STDOUT)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        if saved_descriptor is not None:
            sys.stdout.flush()
            os.dup2(saved_descriptor, _STDOUT)
            os.close(saved_descriptor)


def flush_output(code: int) -> int:
    """Flush standard output and return the exit code of a command that ends with `code`.

    A reader that closed the pipe, as `head` does, does not change the code. After any other write
    error, such as a full disk, a message is printed and a code of 0 becomes 2.
    """
    sys.stdout.flush()
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    problem = raw.problem if isinstance(raw, _FaultTolerantFile) else None
    if problem is None or problem.errno == errno.EPIPE:
        return code
    sys.stderr.write(f"error: standard output cannot be written: {problem.strerror}.\n")
    return code or _WRITE_FAILURE
