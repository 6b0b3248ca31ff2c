"""Columns of a result by the names a user has for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.errors import BeamdaeError, short_repr, suggest


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


def merge_columns(observed: Mapping[str, Any], coordinates: Any) -> dict[str, Any]:
    """Columns of a table and coordinates by header; the column where both have one of the name.

    A point of a body may be observed under the name of the body.
    """
    return {**observed, **dict(coordinates), **observed}


def select_columns(
    headers: Iterable[str], name: Any, of: str = "Solution", observed: Iterable[str] = ()
) -> list[str]:
    """The headers a name stands for.

    Parameters
    ----------
    headers
        'name.column [unit]', as tables have them.
    name
        A header, a header without its unit, or the name of an observable for all its columns.
    of
        What has them.
    observed
        Those among them that are meant where others bear the same name.

    Raises
    ------
    BeamdaeError
        If there is none of the name.
    """
    every, meant = list(headers), set(observed)
    bare = [header.rpartition(" [")[0] for header in every]
    whole = [Header.of(header).name for header in every]
    for names in (every, bare, whole) if isinstance(name, str) else ():
        found = [header for header, own in zip(every, names, strict=True) if own == name]
        if found:
            return [header for header in found if header in meant] or found
    known = list(dict.fromkeys([*bare, *whole]))
    raise BeamdaeError(
        f"{of}: no column has the name {short_repr(name)}{suggest(name, known)}; "
        f"`{of.lower()}.table()` and `{of.lower()}.coordinates()` have all there are."
    )
