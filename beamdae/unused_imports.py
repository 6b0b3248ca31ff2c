"""Deferred import of modules of NumPy that SciPy imports, but beamdae does not use."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

# Half of the processor time that the imports of SciPy take.
_UNUSED_MODULES = ("char", "core", "ctypeslib", "f2py", "testing")


@contextmanager
def unused_imports_deferred() -> Iterator[None]:
    """Defer the import of unused modules of NumPy in a `with` block that imports SciPy.

    SciPy copies all attributes of NumPy, and NumPy imports a module when its attribute is read.
    SciPy therefore receives modules that import the actual ones when they are used. After the
    block, NumPy and `sys.modules` contain nothing else than without it.
    """
    if "scipy" in sys.modules:
        yield
        return
    import numpy as np

    attributes: dict[str, Any] = vars(np)
    stand_ins = {x: _create_stand_in(f"numpy.{x}") for x in _UNUSED_MODULES if x not in attributes}
    attributes.update(stand_ins)
    try:
        yield
    finally:
        for name, module in stand_ins.items():
            # The import of the actual module has replaced the attribute.
            if attributes.get(name) is module:
                del attributes[name]


def _create_stand_in(name: str) -> ModuleType:
    """Return a module that reads its attributes from the module `name`, imported on first use."""
    module: Any = ModuleType(name)
    module.__getattr__ = lambda attribute: getattr(import_module(name), attribute)
    return module
