"""Columns of results: headers with units, and the selection of columns by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.errors import BeamdaeError, short_repr, suggest


class Header(NamedTuple):
    """Parts of a column header 'name.suffix [unit]'; `name` itself may contain dots.

    If the header has no dot, `name` and `suffix` are equal.
    """

    name: str
    suffix: str
    unit: str

    @classmethod
    def of(cls, column: str) -> Header:
        """Split a header 'name.suffix [unit]' into its parts."""
        dotted, _, unit = column.removesuffix("]").rpartition(" [")
        name, _, suffix = dotted.rpartition(".")
        return cls(name or suffix, suffix, unit)

    @property
    def kind(self) -> str:
        """Key of columns with comparable magnitudes: unit, or 'name.suffix' for the unit '-'."""
        return f"{self.name}.{self.suffix}" if self.unit == "-" else self.unit


def observed_columns(table: Iterable[object]) -> list[str]:
    """Return the headers of a table, excluding time, drift, energies and works."""
    others = {TIME, *LEDGER_COLUMNS, *DRIFT_COLUMNS}
    return [str(column) for column in table if str(column) not in others]


def merge_columns(observed: Mapping[str, Any], coordinates: Any) -> dict[str, Any]:
    """Merge observed columns and coordinates into one dictionary by header.

    If both contain a header, the observed column takes precedence: a point of a body may be
    observed under the name of the body.
    """
    return {**observed, **dict(coordinates), **observed}


def select_columns(
    headers: Iterable[str], name: Any, of: str = "Solution", observed: Iterable[str] = ()
) -> list[str]:
    """Return the headers selected by a name.

    Parameters
    ----------
    headers
        Headers 'name.column [unit]' to select from.
    name
        A header with or without its unit, or the name of an observable or a part, which selects
        all its columns.
    of
        Name of the class of the result, for the error message.
    observed
        Headers that take precedence if `name` also selects other headers.

    Raises
    ------
    BeamdaeError
        If no column has this name.
    """
    headers, preferred = list(headers), set(observed)
    without_unit = [header.rpartition(" [")[0] for header in headers]
    observables = [Header.of(header).name for header in headers]
    for names in (headers, without_unit, observables) if isinstance(name, str) else ():
        matches = [
            header
            for header, column_name in zip(headers, names, strict=True)
            if column_name == name
        ]
        if matches:
            return [header for header in matches if header in preferred] or matches
    known_names = list(dict.fromkeys([*without_unit, *observables]))
    raise BeamdaeError(
        f"{of}: there is no column {short_repr(name)}{suggest(name, known_names)}; see "
        f"`{of.lower()}.table()` and `{of.lower()}.coordinates()` for all columns."
    )
