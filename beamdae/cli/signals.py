"""Handling of Ctrl-C, SIGTERM and SIGHUP, which end a command without loss of results."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, NoReturn

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
