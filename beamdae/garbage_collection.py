"""Garbage collection while objects are created that are numerous, but not garbage."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

# The last import that a script needs before it has results.
_LAST_MODULE = "beamdae.simulation"

_are_modules_exempt = False


@contextmanager
def paused_collection() -> Iterator[None]:
    """Disable the garbage collector in a `with` block, which creates many objects."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def exempt_modules_of_script() -> None:
    """Exempt all objects from garbage collection, if a script has just imported a part of beamdae.

    Almost all of them belong to modules, which are used until the process ends. Searching them
    takes a tenth to a fifth of the processor time of a short script, most of it in the last
    collections at the end. After the import of `beamdae.simulation`, nothing is exempted any more.
    Interactive sessions are left alone: they last, and may have large objects before the import,
    which would not be collected when they become garbage and refer to each other.
    """
    global _are_modules_exempt
    if not _are_modules_exempt and hasattr(sys.modules.get("__main__"), "__file__"):
        _are_modules_exempt = _LAST_MODULE in sys.modules
        gc.freeze()
