"""Deferred imports, by which methods of lower layers call functions of higher layers.

Methods such as `Mechanism.draw` and `Solution.plot` are provided for convenience; they call
functions of higher layers, which lower layers must not import. They import these functions by name
at the call, through this module only, as pandas loads its plotting backend.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

_PACKAGE = __name__.partition(".")[0]


def public(name: str) -> Any:
    """Return the public name `beamdae.<name>`."""
    return getattr(import_module(_PACKAGE), name)


def module(name: str) -> ModuleType:
    """Return the module `beamdae.<name>`."""
    return import_module(f"{_PACKAGE}.{name}")
