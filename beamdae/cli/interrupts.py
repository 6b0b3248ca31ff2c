"""Ctrl-C and SIGTERM: they end a command where nothing computed is lost."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# Signals belong to the process, and so does what is known of them.
_heard: list[int] = []
_holds: list[None] = []


def listen() -> None:
    """Take Ctrl-C and SIGTERM as interrupts, unless the process was started to ignore them."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _hear)


def deaf() -> None:
    """Let nothing come between the end of a command and that of its process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


def _hear(number: int, _: Any) -> None:
    _heard.append(number)
    if not _holds:
        raise KeyboardInterrupt


def heard() -> bool:
    """Whether there was one, also where other code took the exception for something else."""
    return bool(_heard)


def code() -> int:
    """The exit code of an interrupted command: 128 and the number of the signal, 130 or 143."""
    return 128 + (_heard[0] if _heard else signal.SIGINT)


@contextmanager
def held() -> Iterator[None]:
    """Finish what is in here first: an interrupt comes after it."""
    before = len(_heard)
    _holds.append(None)
    try:
        yield
    finally:
        _holds.pop()
    if len(_heard) > before and not _holds:
        raise KeyboardInterrupt
