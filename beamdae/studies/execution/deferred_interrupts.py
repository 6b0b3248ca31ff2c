"""Ctrl-C where it can be taken: noted while something must be finished, raised where it may."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any, Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class DeferredInterrupts:
    """Holds back interrupts inside a `with` block of the main thread, and notes them.

    Attributes
    ----------
    noted
        Whether there was one.
    raising
        Whether the first one is raised at once; the block sets it where nothing is lost by that.
    """

    def __init__(self) -> None:
        self.noted = self.raising = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in _SIGNALS:
                # Neither those that are ignored, nor those that end a process as they are.
                if callable(signal.getsignal(number)):
                    self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.noted = True
        try:
            # Whoever listened before hears of it as well.
            self._before[number](number, frame)
        except KeyboardInterrupt:
            if self.raising:
                self.raising = False
                raise
