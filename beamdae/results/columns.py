"""Columns of results: headers with units, and the selection of columns by name."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME, ObservedRows
from beamdae.errors import (
    BeamdaeError,
    as_text,
    list_first,
    plain_text,
    require_choice,
    require_iterable,
    require_sequence,
    short_repr,
    suggest,
)
from beamdae.model_parameters import split_unit
from beamdae.read_only import ReadOnlyDict

if TYPE_CHECKING:
    from beamdae.equations.equations_of_motion import EquationsOfMotion

UNITS_OF_POSITIONS = ("m", "rad")  # which must be accurate by default

# Columns whose half range is at or below any of these are at rest.
_REST_TO_OTHERS_RATIO = 1e-9  # relative to the largest half range of a column with the same unit
_REST_TO_VALUES_RATIO = 1e-12  # relative to the largest value of the column: rounding errors
_UNDERFLOW = np.finfo(float).eps ** 2  # rounding errors of rounding errors, in any unit
_REST_TO_SIZE_RATIO = 1e-12  # relative to the size of the mechanism, or to 1 rad: rounding errors

# Half range of columns that vanish but for noise, relative to the largest one of their kind.
# Accelerations of symmetric frames in impacts reach 5.3e-7.
_VANISHING_TO_OTHERS_RATIO = 8e-7

# Digits of values in warnings, and after the first one that differs.
_MIN_DIGITS, _DIGITS_OF_DIFFERENCE = 5, 1
# Half range of a rate or an acceleration relative to the largest one of translations of the same
# point, below which it does not matter: 7e-4 for the rate of the angle of a flexure stage, 8e-5 for
# the angular acceleration of a frame that falls flat.
_MIN_SHARE_OF_POINT = 0.01
# The same for angles: 1.5e-4 for that of a flexure stage, which vibrates by 1.5e-7 rad.
_MIN_SHARE_OF_ANGLE = 3e-4

# Columns whose half range is at or below these are constant but for errors of the integration.
# Stresses of a rotating blade vary by up to 10 times rtol, its deflections by up to 3e-3 times.
_ERROR_TO_VALUE_RATIO = 10.0  # relative to rtol and the largest value
_MAX_ERROR_TO_VALUE_RATIO = 1e-3  # for all rtol
_ERROR_TO_SIZE_RATIO = 3e-3  # relative to rtol and the size of the mechanism, or 1 rad

# Columns of two runs differ by errors only if their half range is at most this multiple of rtol
# times the largest half range of their kind, or the drift of the constraints, and the difference is
# between a share of the half range and the range at this limit. Positions that joints hold fixed
# move by up to 0.002 rtol, their rates by 0.009 rtol; with fixed steps, both by up to the drift.
# Between steps, accelerations of fixed points of four-bar linkages reach 1.3 rtol (rtol from 1e-8
# to 1e-3) of the largest one.
_UNRESOLVED_TO_RTOL_RATIO = 0.01
_UNRESOLVED_ACCELERATION_TO_RTOL_RATIO = 3.0
_DRIFT_FACTOR = 3.0  # levers may enlarge violations of constraints
_MIN_NOISE_SHARE = 0.5

# Units of rotations: the unit of the same quantity of translations, and the power of a length [m]
# with which values are multiplied to compare them.
UNITS_OF_TRANSLATIONS = {
    "rad": ("m", 1),
    "rad/s": ("m/s", 1),
    "rad/s^2": ("m/s^2", 1),
    "N m": ("N", -1),
}

_UNITS_OF_RATES = ("m/s", "m/s^2")
_UNITS_OF_ACCELERATIONS = ("m/s^2", "rad/s^2")
_ANGULAR_ACCELERATION = "angle_ddot"
_UNITS_OF_FORCES = ("N", "N m")  # of columns whose values do not depend on an origin

NO_OTHERS: Mapping[str, float] = MappingProxyType({})

_BY = ")/d("  # between column and parameter in the header of a derivative
_MAX_NAMES = 12  # of columns in a message
# Columns that are listed first for an unknown name: a common word, such as the name of a part, or
# the unit of a quantity counts more than common letters.
_MAX_LIKE_NAMES, _MIN_LIKENESS = 6, 0.6
_WORD = re.compile(r"[^\W_]+")
_UNITS_OF_WORDS = {"torque": "N m", "moment": "N m", "m": "N m", "force": "N", "f": "N"}


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
    selected = [_select_by_name(headers, x, of, preferred, part) for x in names]
    return list(dict.fromkeys(x for some in selected for x in some))


def _select_by_name(
    headers: list[str], name: Any, of: str, preferred: set[str], part: str
) -> list[str]:
    name = plain_text(name)
    readings: tuple[Callable[[str], str], ...] = (
        str,
        remove_unit,
        lambda header: Header.of(header).name,
    )
    for reading in readings if isinstance(name, str) else ():
        matches = [header for header in headers if reading(header) == name]
        if matches:
            return [header for header in matches if header in preferred] or matches
    shown = list(map(remove_unit, _order_by_likeness(headers, name, preferred)))
    # Headers last, for names with another unit.
    known_names = list(dict.fromkeys(x(h) for x in (*readings[1:], readings[0]) for h in headers))
    raise BeamdaeError(
        f"{part or of}: there is no column {short_repr(name)}{suggest(name, known_names)}; "
        f"available columns: {list_first(shown, _MAX_NAMES) or 'none'}."
    )


def _order_by_likeness(headers: Sequence[str], name: Any, preferred: set[str]) -> list[str]:
    """Return the headers to list for an unknown name, the most similar ones first.

    They are followed by forces and moments, whose names are hard to guess, and by the others, if
    they are `preferred`; without these, all are listed.
    """
    text = (as_text(name) or "").lower()
    words = set(_WORD.findall(text))
    units = {unit for word, unit in _UNITS_OF_WORDS.items() if word in words}

    def likeness(header: str) -> float:
        known, unit = remove_unit(header).lower(), Header.of(header).unit
        ratio = difflib.SequenceMatcher(None, text, known).ratio()
        return ratio + len(words & set(_WORD.findall(known))) + (unit in units)

    scores = {x: likeness(x) for x in headers}
    near = [x for x in headers if scores[x] > _MIN_LIKENESS]
    near = sorted(near, key=lambda x: -scores[x])[:_MAX_LIKE_NAMES]
    available = [x for x in headers if x in preferred or not preferred]
    forces = [x for x in available if Header.of(x).unit in _UNITS_OF_FORCES]
    return list(dict.fromkeys([*near, *forces, *available]))


def select_column(part: str, headers: Iterable[str], name: Any) -> str:
    """Return the header selected by `name`: a header, or a header without its unit.

    Raises
    ------
    BeamdaeError
        If no column or several columns have this name; `part` is the calling function.
    """
    headers, name = list(headers), plain_text(name)
    without_unit = list(map(remove_unit, headers))
    for candidates in (headers, without_unit) if isinstance(name, str) else ():
        matches = [x for x, y in zip(headers, candidates, strict=True) if y == name]
        if len(matches) == 1:
            return matches[0]
    return require_choice(part, "column", name, headers)


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


def require_column_names(part: str, value: Any) -> tuple[str, ...]:
    """Return column names as a tuple.

    Raises
    ------
    BeamdaeError
        If `value` is a string or is not an iterable of strings.
    """
    allowed = "a list of names of observed columns"
    names = require_iterable(part, "columns", value, allowed)
    texts = tuple(text for text in map(as_text, names) if text is not None)
    if isinstance(value, (str, bytes)) or len(texts) < len(names):
        raise BeamdaeError(f"{part}: columns must be {allowed}, got {short_repr(value)}.")
    return texts


def select_observed_columns(part: str, names: Sequence[str], present: Sequence[str]) -> list[str]:
    """Return the headers in `present` that `names` select, in the order of `names`.

    Each name selects columns as in `select_columns`.

    Raises
    ------
    BeamdaeError
        If a name matches no column.
    """
    selected: dict[str, None] = {}
    for name in names:
        try:
            selected |= dict.fromkeys(select_columns(present, name))
        except BeamdaeError:
            allowed = [*present, *map(remove_unit, present)]
            raise BeamdaeError(
                f"{part}: there is no observed column "
                f"{short_repr(name)}{suggest(name, allowed)}; available "
                f"columns: {', '.join(present) or 'none'}."
            ) from None
    return list(selected)


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
    """Return the names of `columns` that must be accurate, or None for the default.

    Raises
    ------
    BeamdaeError
        If `columns` is neither None, a name nor a list of at least one name.
    """
    if columns is None:
        return None
    names = (columns,) if isinstance(columns, str) else require_column_names(part, columns)
    if not names:
        raise BeamdaeError(
            f"{part}: columns must contain at least one name, got {short_repr(columns)}; omit "
            "columns= to require all positions, angles and deflections."
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
        required = np.array([Header.of(header).unit in UNITS_OF_POSITIONS for header in headers])
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


def mark_vanishing_columns(
    headers: Sequence[str],
    half_range: np.ndarray,
    length: float,
    values: np.ndarray | None = None,
    others: Mapping[str, float] = NO_OTHERS,
) -> np.ndarray:
    """Return the mask of columns that are noise compared with others, e.g. by symmetry.

    See `largest_of_kind` for `others` and the columns with which they are compared. With the
    `values` of the columns (k, columns), forces and moments are also compared with constant ones,
    such as the centrifugal force in steady rotation.
    """
    sizes = half_range
    if values is not None:
        is_force = [Header.of(header).unit in _UNITS_OF_FORCES for header in headers]
        sizes = np.where(is_force, np.max(np.abs(values), axis=0), half_range)
    largest = largest_of_kind(headers, sizes, length, others)
    return np.asarray(half_range < _VANISHING_TO_OTHERS_RATIO * largest)


def format_apart(header: str, value: float, other: float) -> tuple[str, str]:
    """Return two different values of a column with unit and the digits that tell them apart."""
    unit = Header.of(header).unit
    largest = max(abs(value), abs(other))
    digits = math.ceil(-math.log10(abs(value - other) / largest)) + _DIGITS_OF_DIFFERENCE
    digits = max(digits, _MIN_DIGITS)
    suffix = "" if unit == "-" else f" {unit}"
    return f"{value:.{digits}g}{suffix}", f"{other:.{digits}g}{suffix}"


def mark_minor_rates(headers: Sequence[str], half_range: np.ndarray, length: float) -> np.ndarray:
    """Return the mask of rates, accelerations and angles that are small beside those of a point.

    Velocities and accelerations below 1 % of the largest translation of the point are small, and
    angles below 0.03 %. Rotations are multiplied by the `length` [m] of the mechanism. Positions
    are exempt.
    """
    pairs = [Header.of(header) for header in headers]
    kinds = [UNITS_OF_TRANSLATIONS.get(x.unit, (x.unit, 0)) for x in pairs]
    keys = [f"{x.name} [{unit}]" for x, (unit, _) in zip(pairs, kinds, strict=True)]
    sizes = half_range * np.power(length, [power for _, power in kinds])
    is_translation = np.array([power == 0 for _, power in kinds], bool)
    of_point = largest_by(keys, np.where(is_translation, np.nan_to_num(sizes), 0.0).tolist())
    largest = np.array([of_point[key] for key in keys])
    is_rate = np.array([unit in _UNITS_OF_RATES for unit, _ in kinds], bool)
    is_angle = np.array([x.unit == "rad" for x in pairs], bool)
    is_minor = is_rate & (sizes < _MIN_SHARE_OF_POINT * largest)
    return np.asarray(is_minor | (is_angle & (sizes < _MIN_SHARE_OF_ANGLE * largest)))


def mark_accompanying_rates(headers: Iterable[str]) -> np.ndarray:
    """Return the mask of columns that a point adds to those for which it is usually observed.

    These are rates beside their positions, and angular accelerations beside accelerations.
    """
    pairs = [Header.of(header) for header in headers]
    columns = {(x.name, x.suffix) for x in pairs}
    needed = [
        (x.name, "ax" if x.suffix == _ANGULAR_ACCELERATION else x.suffix.removesuffix("_dot"))
        for x in pairs
    ]
    accompanies = [x in columns and x[1] != y.suffix for x, y in zip(needed, pairs, strict=True)]
    return np.array(accompanies, bool)


def mark_resting_columns(
    headers: Sequence[str],
    rows: np.ndarray,
    half_range: np.ndarray,
    length: float,
    rate: float = 0.0,
    others: Mapping[str, float] = NO_OTHERS,
) -> np.ndarray:
    """Return the mask of the columns whose half range is at the level of rounding errors.

    Parameters
    ----------
    headers
        Headers of the columns.
    rows
        Values of the columns (k, columns).
    half_range
        Half the range of each column, (columns,).
    length
        Length of the mechanism [m].
    rate
        Angular frequency [rad/s] of vibrations, whose velocities and accelerations are at rest if
        the positions are; 0 if unknown.
    others
        See `largest_of_kind`.
    """
    rates = {"": 1.0, "/s": rate, "/s^2": rate**2}
    units = (("m", length), ("rad", 1.0))
    sizes = {unit + per: size * x for unit, size in units for per, x in rates.items()}
    size = np.array([sizes.get(Header.of(header).unit, 0.0) for header in headers])
    limits = (
        # Columns without a size of their own, such as the rate of a filter.
        np.full(len(headers), _UNDERFLOW),
        _REST_TO_OTHERS_RATIO * largest_of_kind(headers, half_range, others=others),
        _REST_TO_VALUES_RATIO * np.max(np.abs(rows), axis=0),
        _REST_TO_SIZE_RATIO * size,
    )
    return np.asarray(half_range <= np.maximum.reduce(limits))


def mark_constant_columns(
    headers: Sequence[str], values: np.ndarray, half_range: np.ndarray, length: float, rtol: float
) -> np.ndarray:
    """Return the mask of the columns that vary by no more than errors of the integration.

    Parameters
    ----------
    headers
        Headers of the columns.
    values
        Values of the columns (k, columns).
    half_range
        Half the range of each column, (columns,).
    length
        Length of the mechanism [m].
    rtol
        Tolerance of the run; 0 for fixed steps.
    """
    by_value = min(_ERROR_TO_VALUE_RATIO * rtol, _MAX_ERROR_TO_VALUE_RATIO)
    limits = by_value * np.max(np.abs(values), axis=0)
    # Values of positions and angles depend on the origin.
    sizes = {"m": length, "rad": 1.0}
    for k, header in enumerate(headers):
        size = sizes.get(Header.of(header).unit)
        if size is not None:
            limits[k] = _ERROR_TO_SIZE_RATIO * rtol * size
    return np.asarray(half_range <= limits)


def measure_amplitudes(
    equations: EquationsOfMotion, rows: np.ndarray, rtol: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the amplitude of each column, to which errors are relative, and a mask.

    The amplitude is half the range or, for columns that are constant but for errors, such as the
    stress in a steady rotation, the largest magnitude. The mask is True for these columns. The
    magnitude of positions and angles is that of the displacement from the drawing, which does not
    depend on the origin, and at most the size of the mechanism, or 1 rad. Columns that vary by more
    than a thousandth of their magnitude, such as small deflections from zero, are not constant.

    Parameters
    ----------
    equations
        The equations of motion.
    rows
        Values of the observed columns (k, columns).
    rtol
        Tolerance of the run; 0 for fixed steps.
    """
    headers, length = equations.observed_headers, equations.length
    half_range = 0.5 * np.ptp(rows, axis=0)
    sizes = {"m": length, "rad": 1.0}
    limits = np.array([sizes.get(Header.of(header).unit, np.inf) for header in headers])
    largest = np.minimum(np.max(np.abs(subtract_drawing(equations, rows)), axis=0), limits)
    is_constant = mark_constant_columns(headers, rows, half_range, length, rtol)
    is_constant &= (half_range <= _MAX_ERROR_TO_VALUE_RATIO * largest) & (largest > 0.0)
    return np.where(is_constant, largest, half_range), is_constant


def subtract_drawing(equations: EquationsOfMotion, rows: np.ndarray) -> np.ndarray:
    """Return observed columns (k, columns), with displacements for positions and angles.

    Displacements are those from the drawing. They do not depend on the origin, of which their
    rounding errors are removed.
    """
    is_placement = [Header.of(x).unit in UNITS_OF_POSITIONS for x in equations.observed_headers]
    if not any(is_placement):
        return rows
    mechanism, q, zero = equations.mechanism, equations.q0, np.zeros((1, equations.n))
    if mechanism is not None:
        q = np.concatenate([part.initial_position for part in mechanism.parts.values()])
    time, lam = np.zeros((1, 2)), np.zeros((1, equations.m))
    displacements = rows - ObservedRows(equations)(time, q[None], zero, zero, lam)[0]
    is_rounding = np.abs(displacements) <= _REST_TO_VALUES_RATIO * np.max(np.abs(rows), axis=0)
    return np.where(is_placement, np.where(is_rounding, 0.0, displacements), rows)


def mark_unresolved_columns(
    headers: Sequence[str],
    half_range: np.ndarray,
    differences: np.ndarray,
    length: float,
    rtol: float,
    drifts: Iterable[tuple[float, float]],
    others: Mapping[str, float] = NO_OTHERS,
    min_noise_share: float = _MIN_NOISE_SHARE,
) -> np.ndarray:
    """Return the mask of the columns that vary by errors only, at which two runs differ.

    Positions that joints hold fixed move by errors, and so do rotations that vanish by symmetry.

    Parameters
    ----------
    headers
        Headers of the columns.
    half_range
        Half the range of each column, (columns,).
    differences
        Largest magnitude of the difference of the two runs, (columns,).
    length
        Length of the mechanism [m].
    rtol
        Tolerance of the run with the larger errors; 0 for fixed steps.
    drifts
        Drift of the constraints in positions [m] and velocities [m/s] of each run. Later ones are
        only evaluated if columns may be larger than those before.
    others
        See `largest_of_kind`.
    min_noise_share
        Smallest difference of noise relative to half the range. Values at the same time differ by
        half the range or more; ranges and peaks of noise may be similar.
    """
    is_noise = differences > min_noise_share * half_range
    if not is_noise.any():
        return np.asarray(is_noise)
    sizes = np.maximum(half_range, 0.5 * differences)
    limits = integration_error_limits(headers, half_range, length, rtol, others)
    for drift in drifts:
        limits = np.maximum(limits, drift_limits(headers, length, *drift))
        if np.all(sizes[is_noise] <= limits[is_noise]):
            break
    return np.asarray(is_noise & (sizes <= limits))


def integration_error_limits(
    headers: Sequence[str],
    half_range: np.ndarray,
    length: float,
    rtol: float,
    others: Mapping[str, float] = NO_OTHERS,
) -> np.ndarray:
    """Return the half ranges of columns up to which they may be errors of the integration.

    They are relative to `largest_of_kind`, and zero with fixed steps, for which `rtol` is 0.
    """
    is_acceleration = [Header.of(header).unit in _UNITS_OF_ACCELERATIONS for header in headers]
    ratios = np.where(
        is_acceleration, _UNRESOLVED_ACCELERATION_TO_RTOL_RATIO, _UNRESOLVED_TO_RTOL_RATIO
    )
    return np.asarray(ratios * rtol * largest_of_kind(headers, half_range, length, others))


def drift_limits(
    headers: Iterable[str], length: float, position: float, velocity: float
) -> np.ndarray:
    """Return the half ranges of columns up to which they may be violations of constraints.

    `position` [m] and `velocity` [m/s] are the drift of the constraints of a mechanism of this
    length [m].
    """
    limits = {"m": position, "rad": position / length, "m/s": velocity, "rad/s": velocity / length}
    units = (Header.of(header).unit for header in headers)
    return _DRIFT_FACTOR * np.array([limits.get(unit, 0.0) for unit in units])
