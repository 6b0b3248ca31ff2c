"""Deferred interrupts: Ctrl-C and SIGTERM are recorded while work must not be lost."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any, Self

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class DeferredInterrupts:
    """Record interrupts inside a `with` block of the main thread instead of raising them.

    Attributes
    ----------
    received
        Whether there was an interrupt.
    immediate
        Whether the next interrupt is raised at once. The block sets it while nothing can be lost;
        the first interrupt that is raised resets it.
    """

    def __init__(self) -> None:
        self.received = self.immediate = False
        self._previous_handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in _SIGNALS:
                # Signals that are ignored, or end the process, keep their behavior.
                if callable(signal.getsignal(number)):
                    self._previous_handlers[number] = signal.signal(number, self._receive)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous_handlers.items():
            signal.signal(number, handler)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True
        try:
            self._previous_handlers[number](number, frame)
        except KeyboardInterrupt:
            if self.immediate:
                self.immediate = False
                raise
