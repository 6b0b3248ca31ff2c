"""Public functions of higher layers, for methods of lower ones such as `Mechanism.draw`."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def public(name: str) -> Any:
    """Return `beamdae.<name>`, imported at the call: lower layers never import higher ones."""
    return getattr(import_module("beamdae"), name)
