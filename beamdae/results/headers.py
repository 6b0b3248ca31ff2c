"""Headers of tables: names with their units."""

from __future__ import annotations

from typing import NamedTuple


class Header(NamedTuple):
    """What a header 'name.suffix [unit]' says; without a suffix, `suffix` repeats the name."""

    name: str
    suffix: str
    unit: str

    @classmethod
    def of(cls, column: str) -> Header:
        """Read a header."""
        dotted, _, unit = column.removesuffix("]").rpartition(" [")
        name, _, suffix = dotted.rpartition(".")
        return cls(name or suffix, suffix, unit)
