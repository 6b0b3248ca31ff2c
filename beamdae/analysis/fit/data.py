"""Measured data of a fit: wide and long tables, CSV files, and several experiments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beamdae.csv_reader import parse_numbers, read_csv_table
from beamdae.equations import measures
from beamdae.errors import (
    BeamdaeError,
    as_real,
    as_text,
    is_valid_path,
    path_as_text,
    require_iterable,
    require_mapping,
    require_positive,
    short_repr,
    warn_user,
)
from beamdae.model_parameters import (
    conversion_factor,
    convert_text,
    parse_unit,
    split_unit,
    standardize_header,
    suggest_unit,
)
from beamdae.read_only import read_only_data
from beamdae.results.storage.files import unescape_cell

Array = np.ndarray

# Columns of long tables. Tables with the first two are long.
_OBSERVABLE, _VALUE, _EXPERIMENT, _SIGMA = "observable", "value", "experiment", "sigma"
_TIMES = ("t", "time")
_TIME_NAMES = (measures.TIME, "time [s]", "time", "t")
_LONG_COLUMNS = (_EXPERIMENT, _OBSERVABLE, *_TIME_NAMES, _VALUE, _SIGMA)
# Larger tables are probably raw records, whose fit would take hours and gigabytes.
_MAX_DATA = 1_000_000
# Squares of larger values, relative to their standard deviations, could overflow.
_MAX_MAGNITUDE = 1e75
# Data without a name of their experiment.
ONLY_EXPERIMENT = ""
_ALLOWED = (
    "a table (DataFrame or dict) of numbers by column, a dict of such tables by experiment, or "
    "the path of a CSV file"
)


@read_only_data
@dataclass(frozen=True, eq=False)
class Series:
    """Values of one column that were measured in one experiment.

    Attributes
    ----------
    experiment
        Name of the experiment; "" if the data do not name experiments.
    column
        Name of the observed column as in the data.
    times
        Times (k,) [s] in ascending order.
    values
        Measured values (k,), all finite.
    sigma
        Standard deviations (k,) of the errors of the values.
    name_in_data
        Name of the column in the data, if `convert_units` has changed it; otherwise "".
    """

    experiment: str
    column: str
    times: Array
    values: Array
    sigma: Array
    name_in_data: str = ""

    @property
    def label(self) -> str:
        """Name of the column and, if the data name experiments, of the experiment."""
        return label_series(self.column, self.experiment)


@dataclass(frozen=True, eq=False)
class FitData:
    """Measured series, and True for `is_sigma_known` if their standard deviations are known."""

    series: tuple[Series, ...]
    is_sigma_known: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(dict.fromkeys(x.experiment for x in self.series))

    @property
    def count(self) -> int:
        """Number of values."""
        return sum(len(x.values) for x in self.series)


def label_series(column: str, experiment: str) -> str:
    """Return "column" or "column in experiment"."""
    return f"{column} in {experiment}" if experiment else column


def read_data(data: Any, sigma: Any = None) -> FitData:
    """Return the data of a fit.

    Parameters
    ----------
    data
        Wide table, long table, wide tables by experiment, or path of a CSV file; see `fit`.
    sigma
        Standard deviation of all data, or standard deviations by column; None if they are unknown
        or contained in a long table.

    Raises
    ------
    BeamdaeError
        If the data are incomplete, contain text, do not ascend in time, or contradict `sigma`.
    """
    series, has_sigma, name = _read_series("fit", data)
    count = sum(len(x.values) for x in series)
    if count > _MAX_DATA:
        raise BeamdaeError(
            f"fit: {count} data are more than {_MAX_DATA}; average or omit some of them."
        )
    present = [x for x in series if len(x.values)]
    if not present:
        raise BeamdaeError(f"fit: {name} contains no values; fill in measured values.")
    if not has_sigma:
        return _with_sigma(series, present, sigma)
    if sigma is not None:
        raise BeamdaeError(
            f"fit: sigma is given twice, as an argument and as a column of {name}; omit one."
        )
    return FitData(tuple(present), True)


def read_series(part: str, data: Any, headers: Iterable[str]) -> list[Series]:
    """Return the measured series of data as in `fit`; `part` is the calling function.

    In wide tables, columns that do not belong to one of the `headers` may contain anything; their
    series are empty.

    Raises
    ------
    BeamdaeError
        If the data are incomplete, contain text or do not ascend in time.
    """
    known = {name for header in headers for name in (header, split_unit(header)[0])}
    series, _, _ = _read_series(part, data, known)
    return series


def convert_units(part: str, series: Series, headers: Iterable[str]) -> Series:
    """Return a series in the unit of the observed column of the same name.

    Series without a unit, or of other columns, are returned unchanged.

    Parameters
    ----------
    part
        The calling function, for messages.
    series
        The series. A name such as "tip.y [mm]" contains the unit.
    headers
        Headers of the observed columns.

    Raises
    ------
    BeamdaeError
        If the unit is unknown or measures another quantity than the observed column.
    """
    name = series.column
    headers = list(headers)
    column, unit = split_unit(name)
    if name in headers or not unit:
        return series
    for header in headers:
        observed, observed_unit = split_unit(header)
        if column != observed:
            continue
        factor = conversion_factor(unit, observed_unit)
        if factor is None:
            hint = suggest_unit(unit, observed_unit) if parse_unit(unit) is None else ""
            raise BeamdaeError(
                f"{part}: the column {column!r} of data is in {unit}{hint}, but the model observes "
                f"it in {observed_unit}; convert the values and name the column {header!r}."
            )
        return replace(
            series,
            column=header,
            name_in_data=name,
            values=series.values * float(factor),
            sigma=series.sigma * float(factor),
        )
    return series


def warn_of_missing_units(
    part: str, data: Any, series: Iterable[Series], headers: Iterable[str]
) -> None:
    """Warn of columns of a CSV file without a unit that belong to one of the `headers`.

    Tables that are not read from files are written in code, where values are in SI units.
    """
    path = None if isinstance(data, Mapping) else path_as_text(data)
    columns = {x.column for x in series if len(x.values)}
    units = {name: unit for name, unit in map(split_unit, headers) if name in columns}
    missing = {name: unit for name, unit in units.items() if unit not in ("", "-")}
    if path is None or not missing:
        return
    name, unit = next(iter(missing.items()))
    taken = ", ".join(f"{x!r} in {unit}" for x, unit in missing.items())
    warn_user(
        f"{part}: values of {path} without a unit are taken as in the model, {taken}; write units "
        f"in the header, such as '{name} [{unit}]'."
    )


def _read_series(
    part: str, data: Any, known: Set[str] | None = None
) -> tuple[list[Series], bool, str]:
    """Return the series, True if their standard deviations are known, and the name of the data.

    Series of wide tables are empty if neither their names nor these without units are `known`.
    """
    path = None if isinstance(data, Mapping) else path_as_text(data)
    if path is not None and not (is_valid_path(path) and path.strip()):
        raise BeamdaeError(f"{part}: data must be {_ALLOWED}, got {short_repr(data)}.")
    name = "data" if path is None else path
    texts = (_EXPERIMENT, _OBSERVABLE)
    given = data if path is None else _read_file(part, path, texts)
    table = _as_columns(part, given, name)
    if _OBSERVABLE in table and _VALUE in table:
        table = _standardize_headers(part, table, name)
        return _read_long_table(part, table, name), _SIGMA in table, name
    if table and all(_is_table(x) for x in table.values()):
        series = []
        for experiment, columns in table.items():
            if not (experiment.strip() and experiment.isprintable()):
                raise BeamdaeError(
                    f"{part}: an experiment cannot have the name {short_repr(experiment)}; use "
                    "printable characters."
                )
            place = f"the experiment {experiment!r}"
            columns = _as_columns(part, columns, place)
            series += _read_wide_table(part, columns, place, experiment, known)
        return series, False, name
    return _read_wide_table(part, table, name, ONLY_EXPERIMENT, known), False, name


def _read_file(part: str, path: str, texts: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns of a CSV file; those of numbers as arrays."""
    columns = read_csv_table(part, path, _MAX_DATA, texts)
    return {
        unescape_cell(x): cells if x in texts else parse_numbers(cells)
        for x, cells in columns.items()
    }


def _is_table(value: Any) -> bool:
    import pandas as pd

    return isinstance(value, (pd.DataFrame, Mapping))


def _as_columns(part: str, data: Any, name: str) -> dict[str, Any]:
    """Return the columns of a table by name."""
    import pandas as pd

    if isinstance(data, pd.DataFrame):
        repeated = data.columns[data.columns.duplicated()]
        if len(repeated):
            raise BeamdaeError(
                f"{part}: {name} contains the column {short_repr(repeated[0])} twice; remove one."
            )
        data = {column: data[column].to_numpy() for column in data}
    return require_mapping(part, name, data, _ALLOWED)


def _standardize_headers(part: str, table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return a table with headers of the form 'name [unit]', also for 'name (unit)'."""
    result: dict[str, Any] = {}
    for header, values in table.items():
        standard = standardize_header(header)
        if standard in result:
            raise BeamdaeError(
                f"{part}: {name} contains the column {short_repr(standard)} twice; remove one."
            )
        result[standard] = values
    return result


def _as_numbers(part: str, values: Any, column: str, name: str) -> Array:
    """Return a column (k,) as floats; missing values become NaN."""
    try:
        # Durations and dates would become counts of their own unit, such as nanoseconds.
        kind = np.asarray(values).dtype.kind
        numbers = np.asarray(values, float)
    except Exception:  # Of any kind in conversions of the user's objects.
        raise BeamdaeError(_describe_text(part, values, column, name)) from None
    if kind == "b":
        raise BeamdaeError(_describe_text(part, values, column, name))
    if kind in "mM":
        raise BeamdaeError(
            f"{part}: the column {column!r} of {name} must contain numbers, got durations or "
            "dates; convert them, for example with `Timedelta.total_seconds`."
        )
    if numbers.ndim != 1:
        raise BeamdaeError(
            f"{part}: the column {column!r} of {name} must have one finite number or NaN per time, "
            f"got {short_repr(values)}."
        )
    if np.isinf(numbers).any() or np.any(np.abs(numbers) > _MAX_MAGNITUDE):
        k = int(np.argmax(np.nan_to_num(np.abs(numbers))))
        raise BeamdaeError(
            f"{part}: the column {column!r} of {name} must have one finite number or NaN per time, "
            f"got {numbers[k]:g} in row {k + 1}."
        )
    return numbers


def _describe_text(part: str, values: Any, column: str, name: str) -> str:
    try:
        for k, value in enumerate(values):
            try:
                float("nan" if value is None else value)
            except (TypeError, ValueError):
                return (
                    f"{part}: the column {column!r} of {name} must contain numbers, got "
                    f"{short_repr(value)} in row {k + 1}; leave missing values empty."
                )
    except Exception:  # Of any kind in iterations over the user's objects.
        pass
    return (
        f"{part}: the column {column!r} of {name} must contain numbers, got {short_repr(values)}."
    )


def _require_times(part: str, times: Array, rows: Array, name: str) -> None:
    """Reject missing and negative times of the given rows."""
    rule = f"{part}: the times of {name} must be finite and ascend, from 0 s or later"
    if not times.size:
        raise BeamdaeError(f"{rule}; fill in measured values.")
    if not np.isfinite(times).all():
        k = int(np.argmax(~np.isfinite(times)))
        raise BeamdaeError(f"{rule}, but row {rows[k] + 1} has no time; fill it in, or remove it.")
    if times.min() < 0.0:
        k = int(np.argmax(times < 0.0))
        raise BeamdaeError(
            f"{rule}, got {times[k]:g} s in row {rows[k] + 1}; remove the rows before the start of "
            "the run (t < 0), or shift the times."
        )


def _find_time(part: str, table: Mapping[str, Any], names: Sequence[str]) -> str | None:
    """Return the column of times: "t" or "time" with any unit of time, or one of `names`.

    Without such a column, return one named "t" or "time" that has another unit or none, if there is
    one.
    """
    units = {x: unit for x in table for name, unit in [split_unit(x)] if _is_time(name) and unit}
    candidates = [x for x in table if x in names or (x in units and _is_time_unit(units[x]))]
    if not candidates:
        return next(iter(units), next((x for x in table if _is_time(x)), None))
    if len(candidates) > 1:
        raise BeamdaeError(
            f"{part}: the columns {candidates[0]!r} and {candidates[1]!r} of data are both times; "
            "remove one."
        )
    return candidates[0]


def _is_time(name: str) -> bool:
    # T may be a temperature.
    return name in _TIMES or name.casefold() == "time"


def _is_time_unit(unit: str) -> bool:
    parsed = parse_unit(unit)
    return parsed is not None and parsed[1] == {"s": 1}


def _read_times(part: str, table: Mapping[str, Any], time: str, name: str) -> Array:
    """Return the column of times in seconds."""
    numbers, unit = _as_numbers(part, table[time], time, name), split_unit(time)[1]
    if not unit:
        warn_user(
            f"{part}: the times {time!r} of {name} have no unit and are taken as seconds; name the "
            f"column '{time} [s]'."
        )
        return numbers
    parsed = parse_unit(unit)
    if parsed is None or not _is_time_unit(unit):
        raise BeamdaeError(
            f"{part}: the times {time!r} of {name} must be in a unit such as s or ms, got {unit}"
            f"{suggest_unit(unit, 's') if parsed is None else ''}."
        )
    return numbers if unit == "s" else numbers * float(parsed[0])


def _read_wide_table(
    part: str, table: Mapping[str, Any], name: str, experiment: str, known: Set[str] | None
) -> list[Series]:
    """Return the series of a table with a column of times and one column per observed column."""
    table = _standardize_headers(part, table, name)
    time = _find_time(part, table, (measures.TIME,))
    columns = [column for column in table if column != time]
    if time is None or not columns:
        raise BeamdaeError(
            f"{part}: {name} must contain the column {measures.TIME!r} and measured columns (or "
            f"the columns observable, {measures.TIME}, value), got columns "
            f"{', '.join(map(repr, table)) or 'none'}."
        )
    times = _read_times(part, table, time, name)
    series: list[Series] = []
    numbers: dict[str, Array] = {}
    for column in columns:
        if known is not None and not known & {column, split_unit(column)[0]}:
            numbers[column] = np.full(len(times), np.nan)
            continue
        values = _as_numbers(part, table[column], column, name)
        if values.shape != times.shape:
            raise BeamdaeError(
                f"{part}: the column {column!r} of {name} must have one finite number or NaN per "
                f"time, got {len(values)} for {len(times)} times."
            )
        numbers[column] = values
    has_values = np.any([np.isfinite(x) for x in numbers.values()], axis=0)
    # Rows without a time and values are empty lines.
    rows = np.flatnonzero(np.isfinite(times) | has_values)
    used = times[rows]
    _require_times(part, used, rows, name)
    if np.any(np.diff(used) <= 0.0):
        k = int(np.argmax(np.diff(used) <= 0.0))
        raise BeamdaeError(
            f"{part}: the times of {name} must be finite and ascend, got {used[k + 1]:g} s after "
            f"{used[k]:g} s in row {rows[k + 1] + 1}; sort the rows and average repeated ones."
        )
    for column, values in numbers.items():
        present = np.isfinite(values)
        ones = np.ones(int(present.sum()))
        series.append(Series(experiment, column, times[present], values[present], ones))
    return series


def _read_long_table(part: str, table: Mapping[str, Any], name: str) -> list[Series]:
    """Return the series of a table with one value per row; their rows may have any order."""
    time = _find_time(part, table, _TIME_NAMES)
    unknown = [x for x in table if x not in _LONG_COLUMNS and x != time]
    if time is None or unknown:
        problem = f"got {short_repr(unknown[0])}" if unknown else "got no times"
        raise BeamdaeError(
            f"{part}: the long table {name} must have the columns experiment, observable, "
            f"{measures.TIME}, value, sigma (the first and the last are optional), {problem}."
        )
    times = _read_times(part, table, time, name)
    values = _as_numbers(part, table[_VALUE], _VALUE, name)
    sigma = (
        _as_numbers(part, table[_SIGMA], _SIGMA, name) if _SIGMA in table else np.ones(len(times))
    )
    names = [standardize_header(x) for x in _as_names(part, table[_OBSERVABLE], _OBSERVABLE, name)]
    experiments = [ONLY_EXPERIMENT] * len(times)
    if _EXPERIMENT in table:
        experiments = _as_names(part, table[_EXPERIMENT], _EXPERIMENT, name)
    if not len(times) == len(values) == len(sigma) == len(names) == len(experiments):
        raise BeamdaeError(f"{part}: the columns of {name} must have equal lengths.")
    present = np.isfinite(values)
    _require_times(part, times[present], np.flatnonzero(present), name)
    if not np.all(sigma[present] > 0.0):
        k = int(np.argmax(present & ~(sigma > 0.0)))
        raise BeamdaeError(
            f"{part}: sigma of {name} must be positive, got {sigma[k]:g} in row {k + 1}; fill in "
            "all rows, or remove the column."
        )
    rows: dict[tuple[str, str], list[int]] = {}
    for k in np.flatnonzero(present).tolist():
        rows.setdefault((experiments[k], names[k]), []).append(k)
    series = []
    for (experiment, column), selected in rows.items():
        order = np.array(selected)[np.argsort(times[selected], kind="stable")]
        repeated = np.flatnonzero(np.diff(times[order]) == 0.0)
        if len(repeated):
            k = order[repeated[0] + 1]
            raise BeamdaeError(
                f"{part}: {name} contains {label_series(column, experiment)} at {times[k]:g} s "
                f"twice, again in row {k + 1}; average repeated values, or name the experiments."
            )
        series.append(Series(experiment, column, times[order], values[order], sigma[order]))
    return series


def _as_names(part: str, values: Any, column: str, name: str) -> list[str]:
    """Return a column of texts; numbers become texts."""
    what = f"the column {column!r} of {name}"
    texts = []
    for k, value in enumerate(require_iterable(part, what, values, "names")):
        number = as_real(value)
        text = as_text(value) or ("" if number is None or number != number else f"{number:g}")
        if not (text.strip() and text.isprintable()):
            raise BeamdaeError(
                f"{part}: {what} must contain names, got {short_repr(value)} in row {k + 1}."
            )
        texts.append(text.strip())
    return texts


def _with_sigma(series: list[Series], present: list[Series], sigma: Any) -> FitData:
    """Return the data with the standard deviations of the argument `sigma`; 1 if it is None."""
    columns = list(dict.fromkeys(x.column for x in series))
    if sigma is None:
        # The same column may be in different units in different experiments.
        if len({split_unit(column)[0] for column in columns}) > 1:
            raise BeamdaeError(
                "fit: sigma is required for several columns, because it determines their weights; "
                "pass sigma={name: standard deviation}, or a long table with the column sigma."
            )
        return FitData(tuple(present), False)
    if isinstance(sigma, Mapping):
        sigma = require_mapping("fit", "sigma", sigma, "a number, or numbers by column")
        given = _sigma_by_column(sigma, columns)
    else:
        given = dict.fromkeys(columns, sigma)
    values = {x: _read_sigma(x, given[x], isinstance(sigma, Mapping)) for x in columns}
    return FitData(tuple(replace(x, sigma=x.sigma * values[x.column]) for x in present), True)


def _sigma_by_column(sigma: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """Return the standard deviation of each column, which is named with or without its unit."""
    matches = {
        name: [x for x in columns if standardize_header(name) == x]
        or [x for x in columns if name == split_unit(x)[0]]
        for name in sigma
    }
    deviations = {column: sigma[name] for name, headers in matches.items() for column in headers}
    count = sum(len(x) for x in matches.values())
    if not all(matches.values()) or set(deviations) != set(columns) or count > len(columns):
        raise BeamdaeError(
            f"fit: sigma must name the columns {', '.join(columns)} of data, got "
            f"{', '.join(sigma) or 'none'}."
        )
    return deviations


def _read_sigma(column: str, value: Any, is_named: bool) -> float:
    """Return a standard deviation in the unit of its column."""
    label, unit = f"sigma of {column}" if is_named else "sigma", split_unit(column)[1]
    text = as_text(value)
    if text is not None and not unit:
        raise BeamdaeError(
            f"fit: {label} must be a number in the unit of the column, got {short_repr(value)}; "
            "for values with units, write a header such as 'tip.y [mm]'."
        )
    # In columns of accelerations, g is the standard gravity; columns of masses are not observed.
    is_gravity = unit in ("g", "mg") and text is not None and not text.strip().endswith(unit)
    unit = f"{unit}n" if is_gravity else unit
    return require_positive("fit", label, convert_text("fit", label, value, unit))
