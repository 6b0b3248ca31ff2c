"""Unknown properties of sensors: scales and offsets of columns, and timing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.fit.data import (
    ALL_COLUMNS,
    VALUE,
    MeasuredData,
    label_column,
)
from beamdae.equations.measures import TIME
from beamdae.errors import (
    BeamdaeError,
    InputWarning,
    as_real,
    require_entries,
    require_iterable,
    require_pair,
    short_repr,
    warn_user,
)
from beamdae.model_parameters import convert_text, split_unit
from beamdae.read_only import read_only_data
from beamdae.results.columns import remove_unit

Array = np.ndarray

SHIFT, CLOCK, SCALE, OFFSET = "shift", "clock", "scale", "offset"
TIMING = SHIFT, CLOCK
_BOUNDS = "(lower, upper) in seconds"
# Default bounds of clocks.
_CLOCK_BOUNDS = 0.9, 1.1
_NAMES = "a list of names of columns, or of pairs (experiment, column)"


@read_only_data
@dataclass(frozen=True, eq=False)
class Sensor:
    """An unknown property of the sensor of a column.

    The recorded value at time t is scale * y((t - shift) / clock) + offset + error, where y is the
    observed column of the model: a positive shift is a delay of the recorded times.

    Attributes
    ----------
    kind
        "shift", "clock", "scale" or "offset".
    name
        Name in results, such as "offset of gauge 1" or "shift of gauge 1 in run 2".
    rows
        True (N,) for the data that it affects.
    size
        Typical size, by which changes are measured: half the range of the data for offsets, half
        the width of the bounds for shifts [s] and clocks, 1 for scales.
    unit
        Unit: that of the column for offsets, "s" for shifts, "" for clocks and scales.
    bounds
        Bounds; infinite for scales and offsets.
    """

    kind: str
    name: str
    rows: Array
    size: float = 1.0
    unit: str = ""
    bounds: tuple[float, float] = (-np.inf, np.inf)

    @property
    def perfect(self) -> float:
        """Value of a perfect sensor."""
        return float(self.kind in (CLOCK, SCALE))


def read_sensors(data: MeasuredData, arguments: Mapping[str, Any]) -> tuple[Sensor, ...]:
    """Return the properties of sensors from the arguments of `fit`, by kind.

    Raises
    ------
    BeamdaeError
        If an argument names no column of the data, names one twice, or bounds are invalid.

    Warns
    -----
    InputWarning
        If an upper bound of a shift is later than the first time of its data.
    """
    sensors = []
    for kind in (SHIFT, CLOCK, SCALE, OFFSET):
        entries, bounds = arguments.get(kind, ()), dict[Any, Any]()
        if kind in TIMING and isinstance(entries, Mapping):
            bounds = require_entries("fit", kind, entries, _NAMES)
        for entry, name, rows, header in _select(data, kind, list(bounds) or entries):
            if kind == SHIFT:
                first = float(data.table[TIME][rows].min())
                ends = _read_shift_bounds(name, first, bounds.get(entry))
                sensors.append(Sensor(kind, name, rows, 0.5 * float(np.ptp(ends)), "s", ends))
            elif kind == CLOCK:
                ends = _read_clock_bounds(name, bounds.get(entry))
                sensors.append(Sensor(kind, name, rows, 0.5 * float(np.ptp(ends)), bounds=ends))
            elif kind == SCALE:
                sensors.append(Sensor(kind, name, rows))
            else:
                half_range = 0.5 * float(np.ptp(data.table[VALUE][rows])) or 1.0
                sensors.append(Sensor(kind, name, rows, half_range, split_unit(header)[1]))
    return tuple(sensors)


def _read_shift_bounds(name: str, first: float, given: Any) -> tuple[float, float]:
    """Return bounds [s], by default the first time of the data in both directions."""
    pair = require_pair("fit", name, (-first, first) if given is None else given, _BOUNDS)
    low, high = (as_real(convert_text("fit", name, x, "s")) for x in pair)
    if low is None or high is None or not -np.inf < low < min(high, first):
        raise BeamdaeError(
            f"fit: {name} must be {_BOUNDS}, at most the first time of its data, {first:g} s, "
            f"because the run starts at 0 s, got {short_repr(pair)}; change the bounds, or "
            "omit earlier data."
        )
    if high > first:
        warn_user(
            f"fit: {name} can be at most the first time of its data, {first:g} s, because the "
            f"run starts at 0 s; omit data before {high:g} s for the bound {high:g} s.",
            InputWarning,
            merges=False,
        )
    return low, min(high, first)


def _read_clock_bounds(name: str, given: Any) -> tuple[float, float]:
    pair = require_pair("fit", name, _CLOCK_BOUNDS if given is None else given, "(lower, upper)")
    low, high = map(as_real, pair)
    if low is None or high is None or not 0.0 < low < high < np.inf:
        raise BeamdaeError(
            f"fit: {name} must be (lower, upper), positive and ascending ratios of recorded to "
            f"true times, got {short_repr(pair)}."
        )
    return low, high


def _select(data: MeasuredData, kind: str, entries: Any) -> Iterator[tuple[Any, str, Array, str]]:
    """Yield each entry of an argument, the name of the sensor, True (N,) for its rows, a header."""
    used, names = np.zeros(len(data.table), bool), set[str]()
    for entry in require_iterable(
        "fit", kind, [entries] if isinstance(entries, str) else entries, _NAMES
    ):
        experiment: Any = None
        if isinstance(entry, str):
            # "column" or "experiment:column"
            found = [x for x in data.experiments if x and entry.startswith(f"{x}:")]
            column: Any = entry
            if found and not data.find(entry):
                experiment, column = found[0], entry.removeprefix(f"{found[0]}:")
        else:
            experiment, column = require_pair("fit", kind, entry, _NAMES)
            if not (isinstance(experiment, str) and isinstance(column, str)):
                raise BeamdaeError(f"fit: {kind} must be {_NAMES}, got {short_repr(entry)}.")
        chosen = data.find(column, experiment)
        if not chosen:
            columns = dict.fromkeys(f"{x.header} ({x.name_in_data})" for x in data.sources)
            experiments = ", ".join(filter(None, data.experiments)) or "none"
            raise BeamdaeError(
                f"fit: {kind} contains {short_repr(entry)}, which is not in the data (columns, "
                f"with their names in the data: {', '.join(columns)}; experiments: {experiments}); "
                "correct the name."
            )
        # The unit of an offset is that of the model. Scales and shifts have another one.
        header = chosen[0].header
        label = header if kind == OFFSET else remove_unit(header)
        label = "all columns" if column == ALL_COLUMNS else label
        label = label_column(label, experiment or "")
        rows = np.zeros(len(used), bool)
        for source, at in data.rows:
            rows[at] = source in chosen
        if np.any(used & rows) or label in names:
            raise BeamdaeError(
                f"fit: {kind} contains {label} twice; remove one, or name the experiments of both."
            )
        used, names = used | rows, names | {label}
        yield entry, f"{kind} of {label}", rows, header
