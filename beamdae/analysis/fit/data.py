"""Measured data of a fit: wide and long tables, CSV files, and several experiments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from beamdae.csv_reader import parse_numbers, read_csv_table, read_time_stamps
from beamdae.equations import measures
from beamdae.errors import (
    BeamdaeError,
    InputWarning,
    as_real,
    as_text,
    format_distinct,
    is_valid_path,
    list_first,
    path_as_text,
    require_iterable,
    require_mapping,
    require_positive,
    short_repr,
    suggest,
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
from beamdae.results.columns import Header, remove_unit
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
_MAX_LISTED_COLUMNS = 5  # in a message
# Data without a name of their experiment.
ONLY_EXPERIMENT = ""
_TIME_RULE = "{part}: the times of {name} must be finite and ascend, from 0 s or later"
_ALLOWED = (
    "a table (DataFrame or dict) of numbers by column, a dict of such tables by experiment, or "
    "the path of a CSV file"
)


class UnmatchedDataError(BeamdaeError):
    """Error of measured data that contain none of the needed columns."""


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
        Name of the column in the data, if `data_columns` or `convert_units` has changed it;
        otherwise "".
    problem
        Error message if the column cannot be read, for example because it contains text; its series
        is empty then. "" otherwise.
    time_header
        Header of the times in the data, such as "t [ms]".
    """

    experiment: str
    column: str
    times: Array
    values: Array
    sigma: Array
    name_in_data: str = ""
    problem: str = ""
    time_header: str = ""

    def first(self, share: float) -> Series:
        """Return the values of the first `share` of the time, at least two of them."""
        count = max(int(np.searchsorted(self.times, share * self.times[-1], side="right")), 2)
        first = slice(count)
        return replace(
            self, times=self.times[first], values=self.values[first], sigma=self.sigma[first]
        )

    @property
    def label(self) -> str:
        """Name of the column and, if the data name experiments, of the experiment."""
        return label_series(self.column, self.experiment)


class Measurements(NamedTuple):
    """All columns of measured data.

    Attributes
    ----------
    series
        The series, in the units of the data.
    has_sigma
        True if the data contain the standard deviations of the values.
    name
        The path of the file, or "data".
    is_file
        True if the data were read from a file.
    """

    series: tuple[Series, ...]
    has_sigma: bool
    name: str
    is_file: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(dict.fromkeys(x.experiment for x in self.series))


class MeasuredColumn(NamedTuple):
    """A series of measured values in the units of the data, and the header of its column."""

    series: Series
    header: str


@dataclass(frozen=True, eq=False)
class FitData:
    """Measured series of a fit in the units of the observed columns.

    Attributes
    ----------
    series
        The series; each has at least one value.
    headers
        Header of the observed column of each series.
    is_sigma_known
        True if the standard deviations of the values are known.
    """

    series: tuple[Series, ...]
    headers: tuple[str, ...]
    is_sigma_known: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(dict.fromkeys(x.experiment for x in self.series))

    @property
    def count(self) -> int:
        """Number of values."""
        return sum(len(x.values) for x in self.series)

    @cached_property
    def variation(self) -> float:
        """Sum of the squared deviations from the mean of each series, in standard deviations."""
        series = self.series
        return sum(float(np.sum(((x.values - x.values.mean()) / x.sigma) ** 2)) for x in series)

    def first(self, share: float) -> FitData:
        """Return the data of the first `share` of the time of each series."""
        return replace(self, series=tuple(x.first(share) for x in self.series))


def label_series(column: str, experiment: str) -> str:
    """Return "column" or "column in experiment"."""
    return f"{column} in {experiment}" if experiment else column


def match_columns(
    part: str, measured: Measurements, headers: Mapping[str, Sequence[str]]
) -> tuple[list[MeasuredColumn], list[str]]:
    """Return the measured columns that a run contains, and the names of the others.

    Parameters
    ----------
    part
        The calling function, for messages.
    measured
        The measured data. Their columns may be named with any unit, without one, or by an
        observable with a single column.
    headers
        Headers of the columns of the run, by experiment.

    Raises
    ------
    BeamdaeError
        If such a column cannot be read, or two columns of an experiment are the same one.
    UnmatchedDataError
        If the run contains none of the columns, or these have no values.
    """
    matched, unknown = [], {}
    names: dict[tuple[str, str], str] = {}
    for series in measured.series:
        known = headers[series.experiment]
        header = _find_header(series.column, known)
        if header is None:
            description = _describe_unknown(series.column, known)
            if series.name_in_data:
                raise BeamdaeError(
                    f"{part}: data_columns maps {series.name_in_data!r} to {description}, which is "
                    "not a column of the run; name one of its table."
                )
            unknown[series.column] = description
            continue
        if series.problem:
            raise BeamdaeError(series.problem)
        name = series.name_in_data or series.column
        other = names.setdefault((series.experiment, header), name)
        if other != name:
            raise BeamdaeError(
                f"{part}: the columns {other!r} and {name!r} of data are the same column of the "
                "run; remove one."
            )
        matched.append(MeasuredColumn(series, header))
    if matched and not any(len(x.series.values) for x in matched):
        raise UnmatchedDataError(
            f"{part}: {measured.name} contains no values; fill in measured values."
        )
    if not matched:
        listed = list_first(list(unknown.values()), _MAX_LISTED_COLUMNS)
        given = next(iter(unknown))
        example = _find_example(given, [x for xs in headers.values() for x in xs])
        raise UnmatchedDataError(
            f"{part}: {measured.name} must contain values of a column of the run, got {listed}; "
            f"name them as in the table of the run, such as {example!r}, or map them, as with "
            f"data_columns={{{given!r}: {remove_unit(example)!r}}}."
        )
    return matched, list(unknown.values())


def warn_of_unknown_columns(
    part: str, measured: Measurements, unknown: Sequence[str], reason: str
) -> None:
    """Warn of unknown columns, see `match_columns`, which are omitted for a reason (a clause)."""
    if unknown:
        warn_user(
            f"{part}: {measured.name} contains {list_first(unknown, _MAX_LISTED_COLUMNS)}, which "
            f"{reason} and {part} omits; name columns as in the table of the run, map them with "
            "data_columns=, or remove them.",
            InputWarning,
        )


def _find_header(column: str, headers: Sequence[str]) -> str | None:
    """Return the header that a column of data names, or None."""
    if column in headers:
        return column
    names = (column, split_unit(column)[0])
    matches = [x for x in headers if remove_unit(x) in names]
    of_observable = [x for x in headers if Header.of(x).name in names]
    if not matches and len(of_observable) > 1:
        return None
    # Coordinates follow the observed columns.
    return next(iter(matches or of_observable), None)


def _find_example(column: str, headers: Sequence[str]) -> str:
    """Return a header that an unknown column may mean: a similar name, or the same quantity."""
    headers = [x for x in headers if x != measures.TIME] or ["tip.y [m]"]
    name, unit = split_unit(column)
    hint = suggest(name, map(remove_unit, headers))
    similar = [x for x in headers if hint == suggest(remove_unit(x), [remove_unit(x)])]
    units = [(x, split_unit(x)[1]) for x in headers]
    of_unit = [x for x, y in units if unit and y and conversion_factor(unit, y) is not None]
    return next(iter(similar or of_unit or headers))


def _describe_unknown(column: str, headers: Sequence[str]) -> str:
    """Return the name of a column that is not in `headers`, with a hint if possible."""
    name = remove_unit(column)
    several = [x for x in headers if Header.of(x).name == name]
    if several:
        return f"{column!r} (name one of {list_first(several, _MAX_LISTED_COLUMNS)})"
    return f"{column!r}{suggest(name, map(remove_unit, headers))}"


def read_fit_data(
    measured: Measurements, headers: Mapping[str, Sequence[str]], sigma: Any = None
) -> FitData:
    """Return the data of a fit.

    Parameters
    ----------
    measured
        The measured data. Columns that are not observed are omitted with a warning.
    headers
        Headers of the observed columns by experiment.
    sigma
        Standard deviation of all data, or standard deviations by column; None if they are unknown
        or contained in a long table.

    Raises
    ------
    BeamdaeError
        If no column is observed, observed columns contain text, too many or no values, or the
        wrong units, or the data contradict `sigma`.

    Warns
    -----
    BeamdaeWarning
        If columns are omitted.
    """
    columns, unknown = match_columns("fit", measured, headers)
    count = sum(len(x.series.values) for x in columns)
    if count > _MAX_DATA:
        raise BeamdaeError(
            f"fit: {count} data are more than {_MAX_DATA}; average or omit some of them."
        )
    if measured.has_sigma and sigma is not None:
        raise BeamdaeError(
            f"fit: sigma is given twice, as an argument and as a column of {measured.name}; omit "
            "one."
        )
    if not measured.has_sigma:
        columns = _with_sigma(columns, sigma)
    is_sigma_known = measured.has_sigma or sigma is not None
    # The energies, which a table of the run contains, are not observed.
    warn_of_unknown_columns("fit", measured, unknown, "the model does not observe")
    columns = [x for x in columns if len(x.series.values)]
    experiments = {x.series.experiment for x in columns}
    empty = next((x for x in measured.experiments if x not in experiments), None)
    if empty is not None:
        raise BeamdaeError(
            f"fit: the experiment {empty!r} contains no values of observed columns; fill in "
            "measured values, or remove it from the data."
        )
    series = []
    for given, header in columns:
        converted = convert_units("fit", given, header)
        # Unknown standard deviations are 1, whatever the units of the data.
        series.append(converted if is_sigma_known else replace(converted, sigma=given.sigma))
    return FitData(tuple(series), tuple(x.header for x in columns), is_sigma_known)


def convert_units(part: str, series: Series, header: str) -> Series:
    """Return a series in the unit of the column `header`.

    Series without a unit are returned unchanged.

    Parameters
    ----------
    part
        The calling function, for messages.
    series
        The series. A name such as "tip.y [mm]" contains the unit.
    header
        Header of the column.

    Raises
    ------
    BeamdaeError
        If the unit is unknown or measures another quantity than the column.
    """
    name = series.column
    if name in (header, remove_unit(header)):
        return series
    column, unit = split_unit(name)
    if not unit:
        return series
    observed_unit = split_unit(header)[1]
    factor = conversion_factor(unit, observed_unit)
    if factor is None:
        hint = suggest_unit(unit, observed_unit) if parse_unit(unit) is None else ""
        raise BeamdaeError(
            f"{part}: the column {series.name_in_data or column!r} of data is in {unit}{hint}, but "
            f"the model observes it in {observed_unit}; convert the values and name the column "
            f"{header!r}."
        )
    return replace(
        series,
        column=header,
        name_in_data=series.name_in_data or name,
        values=series.values * float(factor),
        sigma=series.sigma * float(factor),
    )


def warn_of_missing_units(
    part: str, measured: Measurements, columns: Iterable[MeasuredColumn]
) -> None:
    """Warn of columns of a CSV file that are named without their units.

    Tables that are not read from files are written in code, where values are in SI units.
    """
    missing = {
        series.name_in_data or series.column: unit
        for series, header in columns
        if len(series.values) and series.column != header
        for name, unit in [split_unit(header)]
        if series.column == name and unit not in ("", "-")
    }
    if not (measured.is_file and missing):
        return
    name, unit = next(iter(missing.items()))
    taken = ", ".join(f"{x!r} in {unit}" for x, unit in missing.items())
    warn_user(
        f"{part}: values of {measured.name} without a unit are taken as in the model, {taken}; "
        f"write units in the header, such as '{name} [{unit}]'.",
        InputWarning,
    )


class _ColumnNames:
    """Names of columns of the run, or of times, for columns of data with other names.

    Parameters
    ----------
    part
        The calling function, for messages.
    data_columns
        See `fit`.
    """

    def __init__(self, part: str, data_columns: Any) -> None:
        given = {} if data_columns is None else data_columns
        what = "a dict of names of columns of the run by names in data"
        self._part = part
        self._names: dict[str, str] = {}
        for key, name in require_mapping(part, "data_columns", given, what).items():
            text = as_text(name)
            if not (text and text.strip()):
                raise BeamdaeError(
                    f"{part}: data_columns must be {what}, got {short_repr(name)} for "
                    f"{short_repr(key)}."
                )
            self._names[standardize_header(key)] = standardize_header(text)
        self._used: dict[str, str] = {}
        self._known: list[str] = []

    def in_run(self, header: str) -> str:
        """Return the name in the run of a column of data, by default its own.

        The unit in the header of the data precedes that of the name in the run.
        """
        self._known.append(header)
        name, unit = split_unit(header)
        keys = [x for x in dict.fromkeys((header, name)) if x in self._names]
        if not keys:
            return header
        if len(keys) > 1:
            raise BeamdaeError(
                f"{self._part}: data_columns names {header!r} twice, also as {name!r}; remove one."
            )
        self._used[keys[0]] = header
        in_run, other_unit = split_unit(self._names[keys[0]])
        unit = unit or other_unit
        return f"{in_run} [{unit}]" if unit else in_run

    def require_all_used(self, name: str) -> None:
        """Reject names that are not in the data, whose own name is `name`."""
        unused = next((x for x in self._names if x not in self._used), None)
        if unused is not None:
            known = list(dict.fromkeys(self._known))
            hint = suggest(unused, known) or f" ({list_first(known, _MAX_LISTED_COLUMNS)})"
            raise BeamdaeError(
                f"{self._part}: data_columns contains {unused!r}, which is not a column of "
                f"{name}{hint}; correct the name."
            )


def read_measurements(part: str, data: Any, data_columns: Any = None) -> Measurements:
    """Return all columns of data as in `fit`; `part` is the calling function.

    Series of columns that contain text or no finite numbers are empty and state the problem.

    Raises
    ------
    BeamdaeError
        If the data are no table, their times are missing or do not ascend, a long table is
        incomplete, or `data_columns` is invalid or names columns that the data do not contain.
    """
    names = _ColumnNames(part, data_columns)
    path = None if isinstance(data, Mapping) else path_as_text(data)
    if path is not None and not (is_valid_path(path) and path.strip()):
        raise BeamdaeError(f"{part}: data must be {_ALLOWED}, got {short_repr(data)}.")
    name, is_file = ("data", False) if path is None else (path, True)
    texts = (_EXPERIMENT, _OBSERVABLE)
    given = data if path is None else _read_file(part, path, texts)
    table = _as_columns(part, given, name)
    series: list[Series] = []
    has_sigma = False
    if _OBSERVABLE in table and _VALUE in table:
        table = _standardize_headers(part, table, name)
        series, has_sigma = _read_long_table(part, table, name, names), _SIGMA in table
    elif table and all(_is_table(x) for x in table.values()):
        for experiment, columns in table.items():
            if not (experiment.strip() and experiment.isprintable()):
                raise BeamdaeError(
                    f"{part}: an experiment cannot have the name {short_repr(experiment)}; use "
                    "printable characters."
                )
            place = f"the experiment {experiment!r}"
            columns = _as_columns(part, columns, place)
            series += _read_wide_table(part, columns, place, names, experiment)
    else:
        series = _read_wide_table(part, table, name, names, ONLY_EXPERIMENT)
    names.require_all_used(name)
    if not series:
        raise BeamdaeError(f"{part}: {name} contains no values; fill in measured values.")
    return Measurements(tuple(series), has_sigma, name, is_file)


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
    rule = _TIME_RULE.format(part=part, name=name)
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


def _find_time(part: str, table: Mapping[str, str], names: Sequence[str]) -> str | None:
    """Return the column of times: "t" or "time" with any unit of time, or one of `names`.

    Without such a column, return one named "t" or "time" that has another unit or none, if there is
    one. `table` contains the names in the run by those in the data.
    """
    units = {
        x: unit for x in table for name, unit in [split_unit(table[x])] if _is_time(name) and unit
    }
    candidates = [x for x in table if table[x] in names or (x in units and _is_time_unit(units[x]))]
    if not candidates:
        return next(iter(units), next((x for x in table if _is_time(table[x])), None))
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
    return conversion_factor(unit, "s") is not None


def _read_times(part: str, values: Any, time: str, unit: str, name: str) -> Array:
    """Return the column of times in seconds, from the first one if they are time stamps."""
    if np.asarray(values).dtype.kind in "MOUS":
        stamps = read_time_stamps(part, f"{time!r} of {name}", map(str, values))
        if stamps is not None:
            return stamps
    numbers = _as_numbers(part, values, time, name)
    if not unit:
        warn_user(
            f"{part}: the times {time!r} of {name} have no unit and are taken as seconds; name the "
            f"column '{time} [s]'.",
            InputWarning,
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
    part: str, table: Mapping[str, Any], name: str, names: _ColumnNames, experiment: str
) -> list[Series]:
    """Return the series of a table with a column of times and one column per observed column."""
    table = _standardize_headers(part, table, name)
    in_run = {header: names.in_run(header) for header in table}
    time = _find_time(part, in_run, (measures.TIME,))
    columns = [column for column in table if column != time]
    if time is None or not columns:
        names.require_all_used(name)
        raise BeamdaeError(
            f"{part}: {name} must contain the column {measures.TIME!r} and measured columns (or "
            f"the columns observable, {measures.TIME}, value), got columns "
            f"{', '.join(map(repr, table)) or 'none'}{_suggest_time(table) if columns else ''}."
        )
    time_header = time if split_unit(time)[1] else in_run[time]
    times = _read_times(part, table[time], time, split_unit(time_header)[1], name)
    # Rows without a time are empty, unless a column has a value there.
    rows = np.flatnonzero(np.isfinite(times))
    used = times[rows]
    _require_times(part, used, rows, name)
    if np.any(np.diff(used) <= 0.0):
        k = int(np.argmax(np.diff(used) <= 0.0))
        later, before = format_distinct(used[k + 1], used[k])
        raise BeamdaeError(
            f"{part}: the times of {name} must be finite and ascend, got {later} s after "
            f"{before} s in row {rows[k + 1] + 1}; sort the rows and average repeated ones."
        )
    series: list[Series] = []
    for column in columns:
        try:
            values = _as_numbers(part, table[column], column, name)
            if values.shape != times.shape:
                raise BeamdaeError(
                    f"{part}: the column {column!r} of {name} must have one finite number or NaN "
                    f"per time, got {len(values)} for {len(times)} times."
                )
            present = np.flatnonzero(np.isfinite(values))
            if present.size:
                _require_times(part, times[present], present, name)
        except BeamdaeError as problem:
            # Columns that a run does not have may contain anything.
            present, failure = np.arange(0), str(problem)
            values = np.empty(0)
        else:
            failure = ""
        series.append(
            Series(
                experiment,
                in_run[column],
                times[present],
                values[present],
                np.ones(len(present)),
                name_in_data="" if in_run[column] == column else column,
                problem=failure,
                time_header=time_header,
            )
        )
    if not any(x.problem for x in series):
        # Columns of sensors with different rates may have few values each.
        filled = np.unique(np.concatenate([x.times for x in series]))
        _warn_of_empty_rows(part, len(used) - len(filled), len(used), name)
    return series


def _warn_of_empty_rows(part: str, count: int, total: int, name: str) -> None:
    """Warn if most of the rows with a time have no value, but not all, as after a failed export."""
    if 0.5 * total < count < total:
        warn_user(
            f"{part}: {count} of {total} rows of {name} have a time but no value; fill them in, or "
            "remove them.",
            InputWarning,
        )


def _suggest_time(table: Mapping[str, Any]) -> str:
    """Return advice on a column of times with another name."""
    of_unit = (x for x in table if _is_time_unit(split_unit(x)[1]))
    name = next(of_unit, next(iter(table)))
    return f"; map times of another name, as with data_columns={{{name!r}: 't'}}"


def _read_long_table(
    part: str, table: Mapping[str, Any], name: str, column_names: _ColumnNames
) -> list[Series]:
    """Return the series of a table with one value per row; their rows may have any order."""
    in_run = {x: x if x in _LONG_COLUMNS else column_names.in_run(x) for x in table}
    time = _find_time(part, in_run, _TIME_NAMES)
    unknown = [x for x in table if x not in _LONG_COLUMNS and x != time]
    if time is None or unknown:
        problem = f"got {short_repr(unknown[0])}" if unknown else "got no times"
        raise BeamdaeError(
            f"{part}: the long table {name} must have the columns experiment, observable, "
            f"{measures.TIME}, value, sigma (the first and the last are optional), {problem}."
        )
    time_header = time if split_unit(time)[1] else in_run[time]
    times = _read_times(part, table[time], time, split_unit(time_header)[1], name)
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
    timed = np.isfinite(times)
    _warn_of_empty_rows(part, int(np.sum(timed & ~present)), int(np.sum(timed)), name)
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
        name_in_run = column_names.in_run(column)
        series.append(
            Series(
                experiment,
                name_in_run,
                times[order],
                values[order],
                sigma[order],
                name_in_data="" if name_in_run == column else column,
                time_header=time_header,
            )
        )
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


def _with_sigma(columns: list[MeasuredColumn], sigma: Any) -> list[MeasuredColumn]:
    """Return columns with the standard deviations of the argument `sigma`; 1 if it is None."""
    in_data: dict[str, set[str]] = {}
    for x in columns:
        in_data.setdefault(x.series.column, set()).add(x.series.name_in_data)
    names = list(in_data)
    if sigma is None:
        # The same column may be in different units in different experiments.
        if len({split_unit(name)[0] for name in names}) > 1:
            raise BeamdaeError(
                "fit: sigma is required for several columns, because it determines their weights; "
                "pass sigma={name: standard deviation}, or a long table with the column sigma."
            )
        return columns
    if isinstance(sigma, Mapping):
        sigma = require_mapping("fit", "sigma", sigma, "a number, or numbers by column")
        given = _sigma_by_column(sigma, in_data)
    else:
        given = dict.fromkeys(names, sigma)
    values = {x: _read_sigma(x, given[x], isinstance(sigma, Mapping)) for x in names}
    return [
        x._replace(series=replace(x.series, sigma=x.series.sigma * values[x.series.column]))
        for x in columns
    ]


def _sigma_by_column(sigma: Mapping[str, Any], in_data: Mapping[str, set[str]]) -> dict[str, Any]:
    """Return the standard deviation of each column by its name in the run.

    Columns are named with or without their units, by their names in the run or in the data. The
    latter are the values of `in_data`, in which each experiment may have another name.
    """
    columns = list(in_data)
    matches = {
        name: [x for x in columns if standardize_header(name) == x]
        or [x for x in columns if name == split_unit(x)[0]]
        or [x for x in columns if in_data[x] == {standardize_header(name)}]
        or [x for x in columns if {split_unit(y)[0] for y in in_data[x]} == {name}]
        for name in sigma
    }
    deviations = {column: sigma[name] for name, headers in matches.items() for column in headers}
    count = sum(len(x) for x in matches.values())
    if not all(matches.values()) or set(deviations) != set(columns) or count > len(columns):
        raise BeamdaeError(
            f"fit: sigma must name the observed columns of data, {', '.join(columns)} (also "
            f"without units), got {', '.join(sigma) or 'none'}."
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
