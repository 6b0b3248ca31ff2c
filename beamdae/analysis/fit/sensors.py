"""Unknown properties of sensors: scales and offsets of columns, and shifts of their times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.fit.data import Series, label_series
from beamdae.errors import (
    BeamdaeError,
    InputWarning,
    as_real,
    require_entries,
    require_iterable,
    require_pair,
    require_sequence,
    short_repr,
    warn_user,
)
from beamdae.model_parameters import convert_text
from beamdae.read_only import read_only_data
from beamdae.results.columns import Header, remove_unit

Array = np.ndarray

_NAMES = "a list of names of columns, or of pairs (experiment, column)"
# Name of all columns, whose sensors have the property in common.
_ALL_COLUMNS = "*"


@read_only_data
@dataclass(frozen=True, eq=False)
class Sensor:
    """An unknown property of the sensor of a column.

    Attributes
    ----------
    name
        Name in results, such as "offset of gauge 1" or "shift of gauge 1 in run 2".
    rows
        Indices of the data that it affects.
    size
        Typical size, by which changes are measured: half the range of the data for offsets, and
        half the width of the bounds for shifts [s]; 0 for scales, whose size is their value.
    unit
        Unit: that of the column for offsets, "s" for shifts, "" for scales.
    bounds
        Bounds; infinite for scales and offsets.
    is_at_first_time
        True for a shift whose upper bound is the first time of the data; a run has no earlier ones.
    """

    name: str
    rows: Array
    size: float
    unit: str
    bounds: tuple[float, float] = (-np.inf, np.inf)
    is_at_first_time: bool = False


@dataclass(frozen=True, eq=False)
class Sensors:
    """All unknown properties of sensors.

    The recorded value at time t is scale * y(t - shift) + offset + error, where y is the observed
    column of the model: a positive shift is a delay of the recorded times.
    """

    scales: tuple[Sensor, ...]
    offsets: tuple[Sensor, ...]
    shifts: tuple[Sensor, ...]

    def of_rows(self, rows: Array) -> Sensors:
        """Return the sensors of some of the data, given by their ascending rows."""
        kinds = (
            tuple(replace(x, rows=np.flatnonzero(np.isin(rows, x.rows))) for x in kind)
            for kind in (self.scales, self.offsets, self.shifts)
        )
        return Sensors(*kinds)


def read_sensors(
    series: Sequence[Series], headers: Sequence[str], scale: Any, offset: Any, shift: Any
) -> Sensors:
    """Return the sensors from the arguments of `fit`.

    Parameters
    ----------
    series
        The data.
    headers
        Header of the observed column of each series.
    scale, offset, shift
        See `fit`.

    Raises
    ------
    BeamdaeError
        If an argument names no series, names one twice, or bounds of a shift are invalid.

    Warns
    -----
    InputWarning
        If an upper bound of a shift is later than the first time of its data.
    """
    selection = _Selection(series, headers)
    scales = [
        Sensor(f"scale of {label}", rows, 0.0, "")
        for label, rows in selection.by_label("scale", scale).items()
    ]
    offsets = [
        Sensor(f"offset of {label}", rows, selection.half_range(rows), selection.unit(rows))
        for label, rows in selection.by_label("offset", offset).items()
    ]
    bounds = require_entries("fit", "shift", shift, _NAMES) if isinstance(shift, Mapping) else {}
    names = list(bounds) if bounds else shift
    shifts = []
    for (label, rows), name in zip(
        selection.by_label("shift", names).items(), _as_list("shift", names), strict=True
    ):
        first = selection.first_time(rows)
        low, high = _read_shift_bounds(label, bounds.get(name), first)
        size, is_at_first_time = 0.5 * (high - low), high == first
        shifts.append(Sensor(f"shift of {label}", rows, size, "s", (low, high), is_at_first_time))
    return Sensors(tuple(scales), tuple(offsets), tuple(shifts))


def _as_list(argument: str, names: Any) -> list[Any]:
    return require_iterable("fit", argument, [names] if isinstance(names, str) else names, _NAMES)


def _read_shift_bounds(label: str, bounds: Any, first: float) -> tuple[float, float]:
    """Return the bounds of a shift, by default the first time of its data in both directions."""
    if bounds is None:
        low, high = -first, first
    else:
        pair = require_pair("fit", f"shift of {label}", bounds, "(lower, upper) in seconds")
        ends = [as_real(convert_text("fit", f"shift of {label}", x, "s")) for x in pair]
        low, high = (np.nan if x is None else x for x in ends)
        if not (low < high and np.isfinite([low, high]).all()):
            raise BeamdaeError(
                f"fit: shift of {label} must be (lower, upper) in seconds, got "
                f"{short_repr(bounds)}."
            )
    # The run starts at 0 s, and a shift moves times back.
    limit = (
        f"shift of {label} can be at most the first time of its data, {first:g} s, because the run "
        "starts at 0 s"
    )
    if not low < min(high, first):
        raise BeamdaeError(
            f"fit: {limit}; omit earlier data, or set bounds with shift={{name: (lower, upper)}}."
        )
    if high > first:
        warn_user(
            f"fit: {limit}; it replaces the bound {high:g} s. For larger shifts, omit data before "
            f"{high:g} s.",
            InputWarning,
            merges=False,
        )
        high = first
    return low, high


def _names_in_run(series: Series, header: str) -> tuple[str, ...]:
    return (_ALL_COLUMNS, series.column, header, remove_unit(header))


def _names_in_data(series: Series, header: str) -> tuple[str, ...]:
    return (series.name_in_data, remove_unit(series.name_in_data)) if series.name_in_data else ()


def _describe_column(series: Series) -> str:
    in_run, in_data = series.column, series.name_in_data
    is_renamed = in_data and remove_unit(in_data) != remove_unit(in_run)
    return f"{in_run}, called {in_data} in the data" if is_renamed else in_run


class _Selection:
    """Rows of the data by column, and by experiment and column."""

    def __init__(self, series: Sequence[Series], headers: Sequence[str]) -> None:
        self._series, self._headers = series, headers
        ends = np.cumsum([0, *(len(x.values) for x in series)])
        self._rows = [np.arange(ends[k], ends[k + 1]) for k in range(len(series))]

    def by_label(self, argument: str, names: Any) -> dict[str, Array]:
        """Return the rows of each entry of an argument by label."""
        result: dict[str, Array] = {}
        used_numbers: set[int] = set()
        for name in _as_list(argument, names):
            experiment, column = self._split(argument, name)
            numbers, is_in_run = self._find(column, experiment)
            if not numbers:
                labels = dict.fromkeys(map(_describe_column, self._series))
                experiments = dict.fromkeys(filter(None, (x.experiment for x in self._series)))
                known = f"columns {', '.join(labels)}"
                known += f"; experiments {', '.join(experiments)}" if experiments else ""
                raise BeamdaeError(
                    f"fit: {argument} contains {short_repr(name)}, which is not in the data "
                    f"({known}); correct the name."
                )
            named = "all columns" if column == _ALL_COLUMNS else column
            if not is_in_run:
                # The unit of the estimate is that of the model, not that of the data.
                named = self._headers[numbers[0]]
            if argument != "offset":
                # Scales and shifts do not have the unit of the column.
                named = remove_unit(named)
            label = label_series(named, experiment or "")
            if used_numbers & set(numbers) or label in result:
                raise BeamdaeError(
                    f"fit: {argument} contains {label} twice; remove one, or name the experiments "
                    "of both."
                )
            used_numbers |= set(numbers)
            result[label] = np.concatenate([self._rows[k] for k in numbers])
        return result

    def _find(self, column: str, experiment: str | None = None) -> tuple[list[int], bool]:
        """Return the series of a name in the run or else in the data, and True if it is the former.

        All experiments match if `experiment` is None.
        """
        numbers: list[int] = []
        for names_of in (_names_in_run, _names_in_data):
            numbers = [
                k
                for k, (x, header) in enumerate(zip(self._series, self._headers, strict=True))
                if column in names_of(x, header) and experiment in (None, x.experiment)
            ]
            if numbers:
                return numbers, names_of is _names_in_run
        return numbers, False

    def _split(self, argument: str, name: Any) -> tuple[str | None, str]:
        if isinstance(name, str):
            return self._split_text(name)
        pair = require_sequence("fit", argument, name, _NAMES)
        if len(pair) != 2 or not all(isinstance(x, str) for x in pair):
            raise BeamdaeError(f"fit: {argument} must be {_NAMES}, got {short_repr(name)}.")
        return pair[0], pair[1]

    def _split_text(self, name: str) -> tuple[str | None, str]:
        """Return the experiment and the column of "column" or "experiment:column"."""
        if not self._find(name)[0]:
            for experiment in dict.fromkeys(x.experiment for x in self._series):
                if experiment and name.startswith(f"{experiment}:"):
                    return experiment, name[len(experiment) + 1 :]
        return None, name

    def half_range(self, rows: Array) -> float:
        """Return half the range of the data in these rows, or 1 if they are constant."""
        values = np.concatenate([x.values for x in self._series])[rows]
        return float(0.5 * np.ptp(values)) or 1.0

    def unit(self, rows: Array) -> str:
        """Return the unit of the column of these rows."""
        for own, header in zip(self._rows, self._headers, strict=True):
            if rows[0] in own:
                return Header.of(header).unit
        return ""

    def first_time(self, rows: Array) -> float:
        """Return the first time of the data in these rows [s]."""
        return float(np.concatenate([x.times for x in self._series])[rows].min())
