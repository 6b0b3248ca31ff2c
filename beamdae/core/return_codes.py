"""Return codes and tasks of the functions of the core, by their names in `core.h`."""

from __future__ import annotations

import re

from beamdae.core.tables import read_header


def _read_enumerations() -> dict[str, int]:
    values = {}
    for body in re.findall(r"enum \{(.*?)\}", read_header(), re.DOTALL):
        value = -1
        for name, number in re.findall(r"(\w+)(?: = (-?\d+))?", body):
            value = values[name] = int(number) if number else value + 1
    return values


_VALUES = _read_enumerations()


def __getattr__(name: str) -> int:
    """Return a code, negative for failures, or a task."""
    if name in _VALUES:
        return _VALUES[name]
    raise AttributeError(f"core.h defines no {name}")
