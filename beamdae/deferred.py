"""Access of methods in lower layers to functions of higher ones, imported at the call.

Methods such as `Mechanism.draw` and `Solution.plot` are conveniences for users: the functions
behind them belong to higher layers, which the lower ones never import. This module is the only way
up. It imports by name on first use, as pandas loads its plotting backend.
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
