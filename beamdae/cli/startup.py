"""Measures that shorten the start and the end of a command."""

from __future__ import annotations

import dataclasses
import gc
from typing import Any

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
    _compile_dataclass_methods_later()


def _compile_dataclass_methods_later() -> None:
    """Let data classes compile methods such as `__repr__` and `__eq__` when first called.

    Compiling them takes half of the time in which the 200 data classes of a command are created.
    Python 3.13 and later compile all methods of a class together.
    """
    compile_now = getattr(dataclasses, "_create_fn", None)
    if compile_now is None:
        return

    def compile_later(name: str, *source: Any, **options: Any) -> Any:
        if name == "__init__":  # its signature is inspected, and most are called
            return compile_now(name, *source, **options)
        method: Any = None

        def call(*arguments: Any) -> Any:
            nonlocal method
            if method is None:
                method = compile_now(name, *source, **options)
            return method(*arguments)

        call.__name__ = name
        return call

    dataclasses._create_fn = compile_later  # type: ignore[attr-defined]


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
