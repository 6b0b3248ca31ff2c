"""Columns of results: headers with units, and the selection of columns by name."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.errors import (
    BeamdaeError,
    as_text,
    list_first,
    plain_text,
    require_iterable,
    require_sequence,
    short_repr,
    suggest,
)
from beamdae.model_parameters import split_unit
from beamdae.read_only import ReadOnlyDict

UNITS_OF_POSITIONS = ("m", "rad")  # which must be accurate by default

UNITS_OF_ACCELERATIONS = ("m/s^2", "rad/s^2")
UNITS_OF_FORCES = ("N", "N m")  # of columns whose values do not depend on an origin

# Errors of columns that have a sentence, and those at which recommended settings aim.
LIMIT, AIM = 0.04, 0.01
# A refinement shows a part of the error: halved elements of order 2 three quarters of it, and a
# third of the tolerance two thirds.
FACTOR = 1.15

# Digits of values in warnings, and after the first one that differs.
_MIN_DIGITS, _DIGITS_OF_DIFFERENCE = 5, 1

# Units of rotations: the unit of the same quantity of translations, and the power of a length [m]
# with which values are multiplied to compare them.
UNITS_OF_TRANSLATIONS = {
    "rad": ("m", 1),
    "rad/s": ("m/s", 1),
    "rad/s^2": ("m/s^2", 1),
    "N m": ("N", -1),
}

NO_OTHERS: Mapping[str, float] = MappingProxyType({})

_BY = ")/d("  # between column and parameter in the header of a derivative
_MAX_NAMES = 12  # of columns in a message


class Header(NamedTuple):
    """Parts of a column header 'name.suffix [unit]'; `name` itself may contain dots.

    If the header has no dot, `name` and `suffix` are equal. The name in 'd(tip.y)/d(E)' is
    'd(tip)/d(E)'.
    """

    name: str
    suffix: str
    unit: str

    @classmethod
    @lru_cache(maxsize=4096)  # each run splits its headers several times
    def of(cls, column: str) -> Header:
        """Split a header 'name.suffix [unit]' into its parts."""
        dotted, unit = split_unit(column)
        if is_derivative(column):
            quantity, _, parameter = dotted.removeprefix("d(").partition(_BY)
            name, _, suffix = quantity.rpartition(".")
            return cls(f"d({name or suffix}{_BY}{parameter}", suffix, unit)
        name, _, suffix = dotted.rpartition(".")
        return cls(name or suffix, suffix, unit)

    @property
    def kind(self) -> str:
        """Key of columns with comparable magnitudes: unit, or 'name.suffix' for the unit '-'."""
        return f"{self.name}.{self.suffix}" if self.unit == "-" else self.unit


def remove_unit(header: str) -> str:
    """Return a header without its unit."""
    return split_unit(header)[0]


def is_derivative(header: str) -> bool:
    """Return True if a column is a derivative by a parameter, see `derivative_header`."""
    return header.startswith("d(") and _BY in header


def observed_columns(table: Iterable[object]) -> list[str]:
    """Return the headers of a table, excluding time, drift and the energy ledger."""
    others = {TIME, *LEDGER_COLUMNS, *DRIFT_COLUMNS}
    return [str(column) for column in table if str(column) not in others]


def merge_columns(observed: Mapping[str, Any], coordinates: Mapping[str, Any]) -> dict[str, Any]:
    """Merge observed columns and coordinates into one dictionary by header.

    If both contain a header, the observed column takes precedence: a point of a body may be
    observed under the name of the body.
    """
    return {**observed, **coordinates, **observed}


def select_columns(
    headers: Iterable[str],
    name: Any,
    of: str = "Solution",
    observed: Iterable[str] = (),
    part: str = "",
) -> list[str]:
    """Return the headers selected by a name.

    Parameters
    ----------
    headers
        Headers 'name.column [unit]' to select from.
    name
        A header with or without its unit, or the name of an observable or a part, which selects
        all its columns; or a list of such names.
    of
        Name of the class of the result, for the error message.
    observed
        Headers that take precedence if `name` also selects other headers.
    part
        The calling function, for the error message. Defaults to `of`.

    Raises
    ------
    BeamdaeError
        If no column has this name.
    """
    headers, preferred = list(headers), set(observed)
    names = []
    if isinstance(name, (list, tuple)):
        names = require_sequence(part or of, "the column", name, "a name or a list of names")
    names = names or [name]
    readings: tuple[Callable[[str], str], ...] = (
        str,
        remove_unit,
        lambda header: Header.of(header).name,
    )
    selected: dict[str, None] = {}
    for one in map(plain_text, names):
        # Of a name that is no text, none matches.
        found = ([h for h in headers if isinstance(one, str) and x(h) == one] for x in readings)
        matches = next(filter(None, found), [])
        if not matches:
            text, shown = as_text(one) or "", list(map(remove_unit, headers))
            shown = difflib.get_close_matches(text, shown, max(len(shown), 1), cutoff=0.0)
            # Headers last, for names with another unit.
            known = dict.fromkeys(x(h) for x in (*readings[1:], readings[0]) for h in headers)
            raise BeamdaeError(
                f"{part or of}: there is no column {short_repr(one)}{suggest(one, known)}; "
                f"available columns: {list_first(shown, _MAX_NAMES) or 'none'}."
            )
        selected |= dict.fromkeys([x for x in matches if x in preferred] or matches)
    return list(selected)


def select_column(part: str, headers: Iterable[str], name: Any) -> str:
    """Return the only header that `name` selects, see `select_columns`."""
    return require_one_column(part, name, select_columns(headers, name, part=part))


def can_select(select: Callable[[Any], Any], name: object) -> bool:
    """Return True if `select(name)` does not raise BeamdaeError, for `name in results`."""
    try:
        select(name)
    except BeamdaeError:
        return False
    return True


class ColumnDict(ReadOnlyDict):
    """Values by header, which may be looked up by name: `values["spring"]` is "spring [N]".

    Names without units are accepted by `[]`, `in` and `get`; iteration yields the headers.
    """

    def __missing__(self, name: Any) -> Any:
        return self[self._select(name)]

    def __contains__(self, name: object) -> bool:
        # Headers first: a search by name takes a hundred times as long.
        is_header = isinstance(name, str) and super().__contains__(name)
        return is_header or can_select(self._select, name)

    def get(self, name: Any, default: Any = None) -> Any:
        """Return the value of a column, or `default` if no column has this name."""
        return self[name] if name in self else default  # noqa: SIM401

    def _select(self, name: Any) -> str:
        return select_column("results", self, name)


def require_column_names(part: str, value: Any, argument: str = "columns") -> tuple[str, ...]:
    """Return column names as a tuple; `argument` is their name in messages.

    Raises
    ------
    BeamdaeError
        If `value` is a string or is not an iterable of strings.
    """
    allowed = "a list of names of observed columns"
    names = require_iterable(part, argument, value, allowed)
    texts = tuple(text for text in map(as_text, names) if text is not None)
    if isinstance(value, (str, bytes)) or len(texts) < len(names):
        raise BeamdaeError(f"{part}: {argument} must be {allowed}, got {short_repr(value)}.")
    return texts


def select_observed_columns(part: str, names: Sequence[str], present: Sequence[str]) -> list[str]:
    """Return the headers in `present` that `names` select, in the order of `names`."""
    return list(
        dict.fromkeys(x for name in names for x in select_columns(present, name, part=part))
    )


def require_one_column(part: str, name: Any, selected: Sequence[str]) -> str:
    """Return the only one of the headers that a name selects.

    Raises
    ------
    BeamdaeError
        If the name selects several columns.
    """
    if len(set(selected)) > 1:
        raise BeamdaeError(
            f"{part}: {short_repr(name)} selects several columns; name one of "
            f"{', '.join(selected)}."
        )
    return selected[0]


def require_accurate_columns(part: str, columns: Any) -> tuple[str, ...] | None:
    """Return the names of `accuracy_columns`, or None for the default.

    Raises
    ------
    BeamdaeError
        If `columns` is neither None, a name nor a list of at least one name.
    """
    if columns is None:
        return None
    name = "accuracy_columns"
    names = (columns,) if isinstance(columns, str) else require_column_names(part, columns, name)
    if not names:
        raise BeamdaeError(
            f"{part}: {name} must contain at least one name, got {short_repr(columns)}; omit "
            f"{name}= to require all positions, angles and deflections."
        )
    return names


def mark_required_columns(
    part: str, names: Sequence[str] | None, headers: Sequence[str]
) -> np.ndarray:
    """Return the mask of the observed columns that must be accurate.

    If `names` is None, these are all columns in m and rad or, if there are none, all columns.

    Raises
    ------
    BeamdaeError
        If a name matches no column.
    """
    if names is None:
        required = np.array([is_position(header) for header in headers])
        return required if required.any() else np.ones(len(headers), bool)
    selected = select_observed_columns(part, names, headers)
    return np.array([header in selected for header in headers])


def require_observed(part: str, headers: Iterable[str]) -> None:
    """Reject a model without observed columns.

    Raises
    ------
    BeamdaeError
        If there are no headers.
    """
    if not list(headers):
        raise BeamdaeError(
            f"{part}: nothing is observed; observe points or quantities with mech.observe."
        )


def is_position(header: str) -> bool:
    """Return True for columns of positions, angles and deflections."""
    return Header.of(header).unit in UNITS_OF_POSITIONS


def largest_by(keys: Iterable[str], sizes: Iterable[float]) -> dict[str, float]:
    """Return the largest of the sizes, at least 0, with the same key."""
    largest: dict[str, float] = {}
    for key, size in zip(keys, sizes, strict=True):
        largest[key] = max(largest.get(key, 0.0), size)
    return largest


def largest_of_kind(
    headers: Iterable[str],
    half_range: np.ndarray,
    length: float = 0.0,
    others: Mapping[str, float] = NO_OTHERS,
) -> np.ndarray:
    """Return, for each column, the largest half range of columns of the same `Header.kind`.

    `others` are half ranges of motions and forces that are not observed, by unit.

    With a positive `length` [m] of the mechanism, rotations and moments are also compared to
    translations and forces, because symmetry may suppress all rotations. The reverse is not done:
    shafts turn far more often than they vibrate.
    """
    kinds = [Header.of(header).kind for header in headers]
    sizes = np.nan_to_num(half_range, posinf=np.inf).tolist()
    of_kind = largest_by([*kinds, *others], [*sizes, *others.values()])
    largest = dict(of_kind)
    for kind in kinds if length > 0.0 else ():
        translation, power = UNITS_OF_TRANSLATIONS.get(kind, (kind, 0))
        largest[kind] = max(of_kind[kind], of_kind.get(translation, 0.0) * length**-power)
    return np.array([largest[kind] for kind in kinds])


def format_apart(header: str, value: float, other: float) -> tuple[str, str]:
    """Return two different values of a column with unit and the digits that tell them apart."""
    unit = Header.of(header).unit
    largest = max(abs(value), abs(other))
    digits = math.ceil(-math.log10(abs(value - other) / largest)) + _DIGITS_OF_DIFFERENCE
    digits = max(digits, _MIN_DIGITS)
    suffix = "" if unit == "-" else f" {unit}"
    return f"{value:.{digits}g}{suffix}", f"{other:.{digits}g}{suffix}"
