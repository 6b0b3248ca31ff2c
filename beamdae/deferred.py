"""Imports that are deferred or avoided, and versions of packages that are not imported.

Methods such as `Mechanism.draw` and `Solution.plot` are provided for convenience and call functions
of higher layers, which lower layers must not import at the top of a module. When called, such a
method imports its function by name through this module.
"""

from __future__ import annotations

from functools import cache
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


@cache
def installed_version(name: str) -> str | None:
    """Return the version of an installed package, such as "1.2.0"; None if it is not installed."""
    # Imported here, because the import takes longer than most calls of this module.
    from importlib import metadata

    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
