"""Measures that shorten the start and the end of a command."""

from __future__ import annotations

import gc
from importlib import import_module

from beamdae.scipy_import import fast_scipy_import

# Modules that import everything that runs of models, or models alone, need.
RUNS = "beamdae.simulation"
MODELS = "beamdae.parts.mechanism"

_is_starting = False


def begin_startup() -> None:
    """Disable the garbage collector: imported modules are numerous, but not garbage.

    `import_before_models` enables the garbage collector again. Searching the objects of the
    imported modules for garbage takes 0.2 s.
    """
    global _is_starting
    _is_starting = True
    gc.disable()


def import_before_models(module: str) -> None:
    """Import a module, `RUNS` or `MODELS`, before a model file is imported.

    A model file, or a file in its folder, may have the name of one of the modules that it imports.
    """
    global _is_starting
    with fast_scipy_import():
        import_module(module)

    if _is_starting:
        _is_starting = False
        gc.freeze()
        gc.enable()


def skip_final_collection() -> None:
    """Exempt all objects from the collections at the end of the process, which take 0.2 s."""
    gc.disable()
    gc.freeze()
