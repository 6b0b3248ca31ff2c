"""Unknown properties of sensors: scales and offsets of columns, and shifts of their times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.analysis.fit.data import VALUE, MeasuredData, Source, label_column
from beamdae.equations.measures import TIME
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
from beamdae.model_parameters import convert_text, split_unit
from beamdae.read_only import read_only_data
from beamdae.results.columns import remove_unit

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
        True (N,) for the data that it affects.
    size
        Typical size, by which changes are measured: half the range of the data for offsets, half
        the width of the bounds for shifts [s], 1 for scales.
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

    def __iter__(self) -> Any:
        return iter((*self.shifts, *self.scales, *self.offsets))

    def of_rows(self, rows: Array) -> Sensors:
        """Return the sensors of some of the data, given by True (N,)."""
        kinds = (self.scales, self.offsets, self.shifts)
        return Sensors(*(tuple(replace(x, rows=x.rows[rows]) for x in kind) for kind in kinds))


def read_sensors(data: MeasuredData, scale: Any, offset: Any, shift: Any) -> Sensors:
    """Return the sensors from the arguments of `fit`.

    Raises
    ------
    BeamdaeError
        If an argument names no column of the data, names one twice, or bounds of a shift are
        invalid.

    Warns
    -----
    InputWarning
        If an upper bound of a shift is later than the first time of its data.
    """
    scales = [Sensor(f"scale of {x}", rows, 1.0, "") for x, rows in _select(data, "scale", scale)]
    offsets = []
    for label, rows in _select(data, "offset", offset):
        half_range = float(0.5 * np.ptp(data.table[VALUE].to_numpy()[rows])) or 1.0
        header = next(x.header for x, at in data.rows if rows[at.start])
        offsets.append(Sensor(f"offset of {label}", rows, half_range, split_unit(header)[1]))
    bounds = require_entries("fit", "shift", shift, _NAMES) if isinstance(shift, Mapping) else {}
    names = _as_list("shift", list(bounds) if bounds else shift)
    shifts = []
    for name, (label, rows) in zip(names, _select(data, "shift", names), strict=True):
        first = float(data.table[TIME].to_numpy()[rows].min())
        low, high = _read_shift_bounds(label, bounds.get(name), first)
        size = 0.5 * (high - low)
        shifts.append(Sensor(f"shift of {label}", rows, size, "s", (low, high), high == first))
    return Sensors(tuple(scales), tuple(offsets), tuple(shifts))


def _read_shift_bounds(label: str, bounds: Any, first: float) -> tuple[float, float]:
    """Return the bounds of a shift, by default the first time of its data in both directions."""
    low, high = -first, first
    if bounds is not None:
        pair = require_pair("fit", f"shift of {label}", bounds, "(lower, upper) in seconds")
        ends = [as_real(convert_text("fit", f"shift of {label}", x, "s")) for x in pair]
        low, high = (np.nan if x is None else x for x in ends)
        if not (low < high and np.isfinite([low, high]).all()):
            raise BeamdaeError(
                f"fit: shift of {label} must be (lower, upper) in seconds, got "
                f"{short_repr(bounds)}."
            )
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
    return low, min(high, first)


def _as_list(argument: str, names: Any) -> list[Any]:
    return require_iterable("fit", argument, [names] if isinstance(names, str) else names, _NAMES)


def _select(data: MeasuredData, argument: str, names: Any) -> list[tuple[str, Array]]:
    """Return the label of each entry of an argument, and True (N,) for its rows."""
    selected: dict[str, Array] = {}
    used = np.zeros(len(data.table), bool)
    for name in _as_list(argument, names):
        experiment, column = _split(data, argument, name)
        chosen, is_in_run = _find(data, column, experiment)
        if not chosen:
            columns = ", ".join(dict.fromkeys(map(_describe, data.sources)))
            experiments = ", ".join(filter(None, data.experiments))
            raise BeamdaeError(
                f"fit: {argument} contains {short_repr(name)}, which is not in the data (columns "
                f"{columns}{experiments and f'; experiments {experiments}'}); correct the name."
            )
        # The unit of the estimate is that of the model, not that of the data.
        label = column if is_in_run else chosen[0].header
        label = "all columns" if column == _ALL_COLUMNS else label
        # Scales and shifts do not have the unit of the column.
        label = label if argument == "offset" else remove_unit(label)
        label = label_column(label, experiment or "")
        rows = np.zeros(len(used), bool)
        for source, at in data.rows:
            rows[at] = source in chosen
        if np.any(used & rows) or label in selected:
            raise BeamdaeError(
                f"fit: {argument} contains {label} twice; remove one, or name the experiments of "
                "both."
            )
        used |= rows
        selected[label] = rows
    return list(selected.items())


def _describe(source: Source) -> str:
    is_renamed = remove_unit(source.name) != remove_unit(source.name_in_data)
    name = source.header if is_renamed else source.name
    return f"{name}, called {source.name_in_data} in the data" if is_renamed else name


def _find(data: MeasuredData, column: str, experiment: str | None) -> tuple[list[Source], bool]:
    """Return the sources of a name in the run or else in the data, and True if it is the former.

    All experiments match if `experiment` is None.
    """
    of_experiment = [x for x in data.sources if experiment in (None, x.experiment)]
    in_run = [x for x in of_experiment if column in (_ALL_COLUMNS, x.header, remove_unit(x.header))]
    if in_run:
        return in_run, True
    names = ((x, (x.name, x.name_in_data, remove_unit(x.name_in_data))) for x in of_experiment)
    return [x for x, known in names if column in known], False


def _split(data: MeasuredData, argument: str, name: Any) -> tuple[str | None, str]:
    """Return the experiment and the column of "column", "experiment:column" or a pair."""
    if isinstance(name, str):
        if not _find(data, name, None)[0]:
            for experiment in filter(None, data.experiments):
                if name.startswith(f"{experiment}:"):
                    return experiment, name.removeprefix(f"{experiment}:")
        return None, name
    pair = require_sequence("fit", argument, name, _NAMES)
    if len(pair) != 2 or not all(isinstance(x, str) for x in pair):
        raise BeamdaeError(f"fit: {argument} must be {_NAMES}, got {short_repr(name)}.")
    return pair[0], pair[1]
