"""Pauses of the garbage collector while many objects are created that stay in use."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_MANY_OBJECTS = 5_000  # fewer young objects are searched in less than 1 ms


@contextmanager
def paused_collection() -> Iterator[None]:
    """Disable the garbage collector in a `with` block, which creates many objects that persist.

    The objects then belong to the oldest generation. Otherwise, the next two collections of young
    objects would search them in vain, which takes 40 ms after an import of everything for a run.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            # Objects that the caller has frozen remain so. Counting those of a command takes 8 ms.
            if gc.get_count()[0] > _MANY_OBJECTS and gc.get_freeze_count() == 0:
                gc.freeze()
                gc.unfreeze()
            gc.enable()
