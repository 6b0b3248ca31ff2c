"""Measures that shorten the start and the end of a command."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import NoReturn

# Modules that import everything that runs of models, or models alone, need.
RUNS = "beamdae.simulation"
MODELS = "beamdae.parts.mechanism"

_is_starting = False
_exit_codes: list[int] = []


def begin_startup() -> None:
    """Disable the garbage collector: imported modules are numerous, but not garbage.

    `import_before_models` enables the garbage collector again. Searching the objects of the
    imported modules for garbage takes 0.2 s.
    """
    global _is_starting
    # Functions registered first are called last.
    atexit.register(_end_process)
    _is_starting = True
    gc.disable()


def import_before_models(module: str) -> None:
    """Import a module, `RUNS` or `MODELS`, before a model file is imported.

    A model file, or a file in its folder, may have the name of one of the modules that it imports.
    """
    global _is_starting
    import_module(module)
    if _is_starting:
        _is_starting = False
        gc.freeze()
        gc.enable()


def exit_without_teardown(code: int) -> NoReturn:
    """Exit with a code like `sys.exit`, but end the process before Python destroys all objects.

    That takes 0.03 s, and if an interrupt left an object of a compiled library incomplete, its
    destruction crashes the process. Threads and functions registered with `atexit` after
    `begin_startup` are awaited, and files that a model left open are flushed.
    """
    _exit_codes.append(code)
    sys.exit(code)


def _end_process() -> None:
    if not _exit_codes:
        return
    # Objects that were frozen, before models were imported, are not among these.
    files = [x for x in gc.get_objects() if issubclass(type(x), io.IOBase)]
    for file in (*files, sys.stdout, sys.stderr):
        with suppress(Exception):
            file.flush()
    os._exit(_exit_codes[0])
