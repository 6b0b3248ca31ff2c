"""Measures that shorten the start and the end of a command."""

from __future__ import annotations

import gc

from beamdae.unused_imports import defer_unused_imports

_is_starting = False


def begin_startup() -> None:
    """Disable the garbage collector: imported modules are numerous, but not garbage.

    `import_equations` enables the garbage collector again. Searching the objects of the imported
    modules for garbage takes 0.2 s.
    """
    global _is_starting
    _is_starting = True
    gc.disable()


def import_equations() -> None:
    """Import the modules that build and run models, before a model file is imported.

    A model file, or a file in its folder, may have the name of one of these modules.
    """
    global _is_starting
    defer_unused_imports()
    import beamdae.simulation  # noqa: F401

    if _is_starting:
        _is_starting = False
        gc.freeze()
        gc.enable()


def skip_final_collection() -> None:
    """Exempt all objects from the collections at the end of the process, which take 0.2 s."""
    gc.disable()
    gc.freeze()
