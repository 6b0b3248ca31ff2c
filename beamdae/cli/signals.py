"""Ctrl-C and SIGTERM: they end a command where nothing computed is lost."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic
from typing import Any, NoReturn

# Signals belong to the process, and so does what is known of them.
_heard: list[int] = []
# How many come through, of each block that is to be finished.
_through: list[int] = []
# So many mean it, whatever is under way.
_INSISTENT = 4
# Those that follow one that came through so fast [s] are heard with it: it is on its way out.
_AT_ONCE = 0.5
_came_through: list[float] = []


class Interrupted(KeyboardInterrupt):
    """An interrupt that Python does not take for its own.

    One that passes through `exec`, as in a dataclass, would end the process by its signal, with
    another exit code, also where it is caught.
    """


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
    if len(_heard) < _INSISTENT:
        if _through and len(_heard) > min(_through):
            return
        if _came_through and monotonic() - _came_through[-1] < _AT_ONCE:
            return
    _come_through()


def _come_through() -> NoReturn:
    _came_through.append(monotonic())
    raise Interrupted


def heard() -> bool:
    """Whether there was one, also where other code took the exception for something else."""
    return bool(_heard)


def terminated() -> bool:
    """Whether the process is to end soon: those who send SIGTERM do not wait for long."""
    return signal.SIGTERM in _heard


def code() -> int:
    """The exit code of an interrupted command: 128 and the number of the signal, 130 or 143."""
    return 128 + (_heard[0] if _heard else signal.SIGINT)


@contextmanager
def held(through: int = 0) -> Iterator[None]:
    """Finish what is in here first: an interrupt comes after it.

    The first `through` of the process come at once; a fourth does anyway.
    """
    before = max(len(_heard), through)
    _through.append(through)
    try:
        yield
    finally:
        _through.pop()
    if len(_heard) > before and not _through:
        _come_through()
