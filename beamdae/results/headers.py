"""Headers of tables: names with their units."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME


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

    @property
    def kind(self) -> str:
        """What columns share that can be measured against each other: their unit, if they have one.

        Columns without a unit have nothing to do with each other.
        """
        return f"{self.name}.{self.suffix}" if self.unit == "-" else self.unit


def observed_columns(table: Iterable[object]) -> list[str]:
    """The observed columns of a table that may have time, energies and drift as well."""
    others = {TIME, *LEDGER_COLUMNS, *DRIFT_COLUMNS}
    return [str(column) for column in table if str(column) not in others]
