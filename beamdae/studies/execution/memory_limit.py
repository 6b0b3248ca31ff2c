"""Memory of this process: how much it takes, and no more than it may."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_GIGABYTE = 1e9
_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
# Room beyond a limit of memory: the watch is to end a run, with what it has, before this does.
_ROOM = 0.5


@contextmanager
def bounded(memory: float | None) -> Iterator[None]:
    """No more than `memory` [GB] beyond what this process has now, where the system can say so.

    What asks for more gets a MemoryError; nobody is asked while a model is built.
    """
    now = _stated("VmData")
    if memory is None or now is None:
        yield
        return
    import resource

    before = resource.getrlimit(resource.RLIMIT_DATA)
    most = int((now + max(memory, _ROOM)) * _GIGABYTE)
    allowed = [most, *(limit for limit in before if limit != resource.RLIM_INFINITY)]
    resource.setrlimit(resource.RLIMIT_DATA, (min(allowed), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)


def forget_peak() -> None:
    """Begin a new peak of memory, where the system can."""
    try:
        _CLEAR.write_text("5")
    except OSError:
        return


def _stated(name: str) -> float | None:
    """What Linux says of this process by that name [GB]."""
    try:
        lines = [x for x in _STATUS.read_text().splitlines() if x.startswith(f"{name}:")]
        return float(lines[0].split()[1]) * 1024.0 / _GIGABYTE
    except (OSError, IndexError):
        return None


def peak_memory() -> float:
    """Largest memory of this process since `forget_peak`, or its beginning [GB]; NaN: unknown."""
    stated = _stated("VmHWM")
    if stated is not None:
        return stated
    try:
        from resource import RUSAGE_SELF, getrusage
    except ImportError:
        return float("nan")
    # Bytes on macOS, kilobytes elsewhere.
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return getrusage(RUSAGE_SELF).ru_maxrss * unit / _GIGABYTE
