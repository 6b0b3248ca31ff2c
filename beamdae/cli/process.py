"""Process of a command: signals, standard streams, and a short start and end."""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from importlib import import_module
from time import monotonic
from typing import Any, NoReturn, TextIO

from beamdae.interrupts import END_SIGNALS, SIGNALS, Interrupted

# From this number on, signals also interrupt blocks that defer interrupts.
_FORCING_COUNT = 4
# A signal within this time after an interrupt is ignored: the command is already ending.
_REPEAT_INTERVAL = 0.5  # s

# Global state, because signals are sent to the process.
_received_signals: list[int] = []
_raise_times: list[float] = []
# Argument `immediate` of each active `defer_interrupts`.
_immediate_counts: list[int] = []


# Modules that import everything that runs of models, or models alone, need.
RUNS = "beamdae.simulation"
MODELS = "beamdae.parts.mechanism"

_is_starting = False
_exit_codes: list[int] = []


# Characters that a stream cannot encode are written as escapes.
_ENCODING_ERRORS = "backslashreplace"
_STDOUT, _STDERR = 1, 2  # file descriptors
_WRITE_FAILURE = 2  # exit code


def install_handlers() -> None:
    """Make Ctrl-C, SIGTERM and SIGHUP raise `Interrupted`, unless the process ignores them."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _handle_signal)
    sys.unraisablehook = _report_unraisable


def ignore_signals() -> None:
    """Ignore Ctrl-C, SIGTERM and SIGHUP from here to the end of the process."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _handle_signal(number: int, _: Any) -> None:
    _received_signals.append(number)
    if len(_received_signals) < _FORCING_COUNT:
        if _immediate_counts and len(_received_signals) > min(_immediate_counts):
            return
        if _raise_times and monotonic() - _raise_times[-1] < _REPEAT_INTERVAL:
            return
    _raise_interrupt()


def _report_unraisable(problem: sys.UnraisableHookArgs) -> None:
    # Compiled libraries discard the exception of an interrupt, or one that follows from it.
    if not is_interrupted():
        sys.__unraisablehook__(problem)


def _raise_interrupt() -> NoReturn:
    _raise_times.append(monotonic())
    raise Interrupted


def is_interrupted() -> bool:
    """Return True after a signal, even if other code suppressed the exception."""
    return bool(_received_signals)


def is_terminated() -> bool:
    """Return True after SIGTERM or SIGHUP: the sender expects the process to end soon."""
    return not set(END_SIGNALS).isdisjoint(_received_signals)


def exit_code() -> int:
    """Return the exit code of an interrupted command: 128 plus the signal number."""
    return 128 + (_received_signals[0] if _received_signals else signal.SIGINT)


@contextmanager
def defer_interrupts(immediate: int = 0) -> Iterator[None]:
    """Defer interrupts until the end of the `with` block, or of the outermost of nested blocks.

    The first `immediate` interrupts of the process, and all from the fourth on, are not deferred.
    """
    n_before = max(len(_received_signals), immediate)
    _immediate_counts.append(immediate)
    try:
        yield
    finally:
        _immediate_counts.pop()
    if len(_received_signals) > n_before and not _immediate_counts:
        _raise_interrupt()


def begin_startup() -> None:
    """Disable the garbage collector: imported modules are numerous, but not garbage.

    `import_before_models` enables the garbage collector again. Searching the objects of the
    imported modules for garbage takes 0.2 s.
    """
    global _is_starting
    # Functions registered first are called last.
    atexit.register(_end_process)
    _is_starting = True
    gc.disable()


def import_before_models(module: str) -> None:
    """Import a module, `RUNS` or `MODELS`, before a model file is imported.

    A model file, or a file in its folder, may have the name of one of the modules that it imports.
    """
    global _is_starting
    import_module(module)
    if _is_starting:
        _is_starting = False
        gc.freeze()
        gc.enable()


def exit_without_teardown(code: int) -> NoReturn:
    """Exit with a code like `sys.exit`, but end the process before Python destroys all objects.

    That takes 0.03 s, and if an interrupt left an object of a compiled library incomplete, its
    destruction crashes the process. Threads and functions registered with `atexit` after
    `begin_startup` are awaited, and files that a model left open are flushed.
    """
    _exit_codes.append(code)
    sys.exit(code)


def _end_process() -> None:
    if not _exit_codes:
        return
    # Objects that were frozen, before models were imported, are not among these.
    files = [x for x in gc.get_objects() if issubclass(type(x), io.IOBase)]
    for file in (*files, sys.stdout, sys.stderr):
        with suppress(Exception):
            file.flush()
    os._exit(_exit_codes[0])


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
