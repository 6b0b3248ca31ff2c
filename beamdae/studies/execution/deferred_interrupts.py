"""Context manager that defers Ctrl-C and SIGTERM while results must not be lost."""

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
        True once an interrupt has arrived.
    immediate
        If True, the next interrupt is raised immediately and resets this flag. Set the flag
        while no results can be lost.
    """

    def __init__(self) -> None:
        self.received = self.immediate = False
        self._previous_handlers: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in _SIGNALS:
                # Signals that are ignored, or that end the process by default, are left unchanged.
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
