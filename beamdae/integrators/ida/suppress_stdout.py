"""Silence for libraries that print, thread by thread."""

from __future__ import annotations

import contextlib
import sys
import threading
from types import TracebackType
from typing import Any, TextIO


class _Deaf:
    """A stream that drops what its silenced threads write, and passes on everything else."""

    def __init__(self, stream: TextIO, silenced: dict[int, int]) -> None:
        self._stream, self._silenced = stream, silenced

    def write(self, text: str) -> int:
        if threading.get_ident() in self._silenced:
            return len(text)
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class _Silence(contextlib.AbstractContextManager[None]):
    """Nothing the entering thread prints is seen.

    `contextlib.redirect_stdout` would replace sys.stdout for all threads, and two that overlap
    would leave it replaced.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._silenced: dict[int, int] = {}
        self._before: TextIO | None = None

    def __enter__(self) -> None:
        thread = threading.get_ident()
        with self._lock:
            if not self._silenced:
                self._before = sys.stdout
                sys.stdout = _Deaf(sys.stdout, self._silenced)
            self._silenced[thread] = self._silenced.get(thread, 0) + 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        thread = threading.get_ident()
        with self._lock:
            self._silenced[thread] -= 1
            if not self._silenced[thread]:
                del self._silenced[thread]
            if not self._silenced and self._before is not None:
                if isinstance(sys.stdout, _Deaf):
                    sys.stdout = self._before
                self._before = None


silent = _Silence()
