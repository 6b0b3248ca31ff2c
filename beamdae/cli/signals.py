"""Ctrl-C and SIGTERM: they end a command where nothing computed is lost."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, NoReturn

# Signals belong to the process, and so does what is known of them.
_received_signals: list[int] = []
# How many come through, of each block that is to be finished.
_immediate_counts: list[int] = []
# So many mean it, whatever is under way.
_FORCING_COUNT = 4
# Those that follow one that came through so fast [s] are heard with it: it is on its way out.
_REPEAT_INTERVAL = 0.5
_raise_times: list[float] = []


class Interrupted(KeyboardInterrupt):
    """An interrupt that Python does not take for its own.

    One that passes through `exec`, as in a dataclass, would end the process by its signal, with
    another exit code, also where it is caught.
    """


def install_handlers() -> None:
    """Take Ctrl-C and SIGTERM as interrupts, unless the process was started to ignore them."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _handle_signal)


def ignore_signals() -> None:
    """Let nothing come between the end of a command and that of its process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _handle_signal(number: int, _: Any) -> None:
    _received_signals.append(number)
    if len(_received_signals) < _FORCING_COUNT:
        if _immediate_counts and len(_received_signals) > min(_immediate_counts):
            return
        if _raise_times and monotonic() - _raise_times[-1] < _REPEAT_INTERVAL:
            return
    _raise_interrupt()


def _raise_interrupt() -> NoReturn:
    _raise_times.append(monotonic())
    raise Interrupted


def is_interrupted() -> bool:
    """Whether there was one, also where other code took the exception for something else."""
    return bool(_received_signals)


def is_terminated() -> bool:
    """Whether the process is to end soon: those who send SIGTERM do not wait for long."""
    return signal.SIGTERM in _received_signals


def exit_code() -> int:
    """The exit code of an interrupted command: 128 and the number of the signal, 130 or 143."""
    return 128 + (_received_signals[0] if _received_signals else signal.SIGINT)


@contextmanager
def defer_interrupts(through: int = 0) -> Iterator[None]:
    """Finish what is in here first: an interrupt comes after it.

    The first `through` of the process come at once; a fourth does anyway.
    """
    before = max(len(_received_signals), through)
    _immediate_counts.append(through)
    try:
        yield
    finally:
        _immediate_counts.pop()
    if len(_received_signals) > before and not _immediate_counts:
        _raise_interrupt()
