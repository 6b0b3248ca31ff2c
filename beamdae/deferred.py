"""Deferred imports, by which methods of lower layers call functions of higher layers.

Methods such as `Mechanism.draw` and `Solution.plot` are provided for convenience and call functions
of higher layers, which lower layers must not import at the top of a module. When called, such a
method imports its function by name through this module.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

_PACKAGE = __name__.partition(".")[0]


def public(name: str) -> Any:
    """Return the public object `beamdae.<name>`."""
    return getattr(import_module(_PACKAGE), name)


def module(name: str) -> ModuleType:
    """Return the module `beamdae.<name>`."""
    return import_module(f"{_PACKAGE}.{name}")
