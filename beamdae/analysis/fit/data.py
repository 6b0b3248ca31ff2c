"""Measured data of a fit: one long table from wide and long tables, files and experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from beamdae.csv_reader import parse_numbers, read_csv_table, read_time_stamps
from beamdae.equations.measures import TIME
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
from beamdae.results.columns import Header, remove_unit
from beamdae.results.storage.files import unescape_cell

Array = np.ndarray

# Columns of the long table of measured data, and of long tables of users.
EXPERIMENT, COLUMN, VALUE, SIGMA = "experiment", "column", "value", "sigma"
_OBSERVABLE = "observable"
_TIME_NAMES = (TIME, "time [s]", "time", "t")
# Larger tables are probably raw records, whose fit would take hours and gigabytes.
_MAX_DATA = 1_000_000
# Squares of larger values, relative to their standard deviations, could overflow.
_MAX_MAGNITUDE = 1e75
_MAX_LISTED_COLUMNS = 5  # in a message
_ALLOWED = (
    "a table (DataFrame or dict) of numbers by column, a dict of such tables by experiment, or "
    "the path of a CSV file"
)


class UnmatchedDataError(BeamdaeError):
    """Error of measured data that contain none of the needed columns."""


class MeasuredColumn(NamedTuple):
    """A column of measured data.

    Attributes
    ----------
    experiment
        Name of the experiment; "" if the data do not name experiments.
    name
        Name of the column of the run, with the unit of the data.
    name_in_data
        Name of the column in the data.
    table
        "t [s]" (NaN if missing), "value" (may be no number) and "sigma" by row of the data.
    place
        Name of the table, for messages.
    time_header
        Header of the times in the data.
    """

    experiment: str
    name: str
    name_in_data: str
    table: pd.DataFrame
    place: str
    time_header: str


class Measurements(NamedTuple):
    """All columns of measured data; `name` is the path of the file, or "data"."""

    columns: tuple[MeasuredColumn, ...]
    has_sigma: bool
    name: str
    is_file: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(dict.fromkeys(x.experiment for x in self.columns))


@dataclass(frozen=True)
class Source:
    """Origin of the values of a column of the run in an experiment.

    Attributes
    ----------
    experiment, header
        Name of the experiment, and header of the column of the run.
    name, name_in_data, time_header
        See `MeasuredColumn`.
    factor
        Factor from the unit of the data to that of the column.
    """

    experiment: str
    header: str
    name: str
    name_in_data: str
    time_header: str
    factor: float

    @property
    def label(self) -> str:
        """Name of the column without its unit and, if the data name experiments, of this one."""
        return label_column(remove_unit(self.header), self.experiment)


@dataclass(frozen=True, eq=False)
class MeasuredData:
    """Measured values of columns of runs.

    Attributes
    ----------
    table
        One value per row, in the units of the run: "experiment", "column" (header of the run), "t
        [s]", "value", "sigma". Rows of a source are consecutive, with ascending times.
    sources
        The origins, in the order of the table.
    is_sigma_known
        True if the standard deviations are known; otherwise, "sigma" is 1.
    """

    table: pd.DataFrame
    sources: tuple[Source, ...]
    is_sigma_known: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(dict.fromkeys(x.experiment for x in self.sources))

    @property
    def headers(self) -> list[str]:
        """Headers of the columns of runs, each one once."""
        return list(dict.fromkeys(x.header for x in self.sources))

    @cached_property
    def rows(self) -> tuple[tuple[Source, slice], ...]:
        """The sources with their rows."""
        counts = self.table.groupby([EXPERIMENT, COLUMN], sort=False).size()
        ends = counts.cumsum().tolist()
        pairs = zip(self.sources, [0, *ends], ends, strict=False)
        return tuple((source, slice(begin, end)) for source, begin, end in pairs)

    @cached_property
    def variation(self) -> float:
        """Sum of the squared deviations from the mean of each source, in standard deviations."""
        means = self.table.groupby([EXPERIMENT, COLUMN])[VALUE].transform("mean")
        return float((((self.table[VALUE] - means) / self.table[SIGMA]) ** 2).sum())

    def first(self, share: float) -> tuple[MeasuredData, Array]:
        """Return the first `share` of the time, at least two values a source, and their rows."""
        groups = self.table.groupby([EXPERIMENT, COLUMN])
        is_early = self.table[TIME] <= share * groups[TIME].transform("max")
        rows = (is_early | (groups.cumcount() < 2)).to_numpy()
        return replace(self, table=self.table[rows]), rows


def label_column(column: str, experiment: str) -> str:
    """Return "column" or "column in experiment"."""
    return f"{column} in {experiment}" if experiment else column


def match_columns(
    part: str, measured: Measurements, headers: Mapping[str, Sequence[str]]
) -> tuple[MeasuredData, list[str]]:
    """Return the values of columns that a run contains, and the names of the others.

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
        If such a column contains text, too many values or another unit, or two columns of an
        experiment are the same one.
    UnmatchedDataError
        If the run contains none of the columns, or these have no values.
    """
    tables: list[pd.DataFrame] = []
    sources: dict[tuple[str, str], Source] = {}
    unknown: dict[str, str] = {}
    for x in measured.columns:
        known = headers[x.experiment]
        header = _find_header(x.name, known)
        if header is None:
            unknown[x.name] = _describe_unknown(x.name, known)
            if x.name != x.name_in_data:
                raise BeamdaeError(
                    f"{part}: data_columns maps {x.name_in_data!r} to {unknown[x.name]}, which is "
                    "not a column of the run; name one of its table."
                )
            continue
        if (other := sources.get((x.experiment, header))) is not None:
            raise BeamdaeError(
                f"{part}: the columns {other.name_in_data!r} and {x.name_in_data!r} of data are "
                "the same column of the run; remove one."
            )
        factor = _convert_unit(part, x, header)
        names = x.name, x.name_in_data, x.time_header
        sources[x.experiment, header] = Source(x.experiment, header, *names, factor)
        table = _read_values(part, x)
        table[[VALUE, SIGMA]] *= factor
        tables.append(table.assign(**{EXPERIMENT: x.experiment, COLUMN: header}))
    if not sources:
        listed = list_first(list(unknown.values()), _MAX_LISTED_COLUMNS)
        given = next(iter(unknown))
        example = _find_example(given, [x for xs in headers.values() for x in xs])
        raise UnmatchedDataError(
            f"{part}: {measured.name} must contain values of a column of the run, got {listed}; "
            f"name them as in the table of the run, such as {example!r}, or map them, as with "
            f"data_columns={{{given!r}: {remove_unit(example)!r}}}."
        )
    filled = [(x, y) for x, y in zip(tables, sources.values(), strict=True) if len(x)]
    if not filled:
        raise UnmatchedDataError(
            f"{part}: {measured.name} contains no values; fill in measured values."
        )
    whole = pd.concat([x for x, _ in filled], ignore_index=True)
    if len(whole) > _MAX_DATA:
        raise BeamdaeError(
            f"{part}: {len(whole)} data are more than {_MAX_DATA}; average or omit some of them."
        )
    data = MeasuredData(whole, tuple(x for _, x in filled), measured.has_sigma)
    return data, list(unknown.values())


def _read_values(part: str, column: MeasuredColumn) -> pd.DataFrame:
    """Return times, values and standard deviations of the values that are not missing."""
    values = _as_numbers(part, column.table[VALUE].to_numpy(), column.name_in_data, column.place)
    table = column.table.assign(value=values).dropna(subset=VALUE)
    _require_times(part, table[TIME], column.place)
    return table.sort_values(TIME, kind="stable")


def _convert_unit(part: str, column: MeasuredColumn, header: str) -> float:
    """Return the factor from the unit in the name of a column to that of a header."""
    name, unit = split_unit(column.name)
    if not unit or column.name in (header, remove_unit(header)):
        return 1.0
    unit_in_run = split_unit(header)[1]
    factor = conversion_factor(unit, unit_in_run)
    if factor is None:
        hint = suggest_unit(unit, unit_in_run) if parse_unit(unit) is None else ""
        shown = name if column.name == column.name_in_data else column.name_in_data
        raise BeamdaeError(
            f"{part}: the column {shown!r} of data is in {unit}{hint}, but the model observes it "
            f"in {unit_in_run}; convert the values and name the column {header!r}."
        )
    return float(factor)


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
    headers = [x for x in headers if x != TIME] or ["tip.y [m]"]
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
) -> MeasuredData:
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
        If the columns cannot be matched, see `match_columns`, an experiment has no values, or the
        data contradict `sigma`.
    """
    data, unknown = match_columns("fit", measured, headers)
    if measured.has_sigma and sigma is not None:
        raise BeamdaeError(
            f"fit: sigma is given twice, as an argument and as a column of {measured.name}; omit "
            "one."
        )
    if not measured.has_sigma:
        data = _with_sigma(data, sigma)
    # The energies, which a table of the run contains, are not observed.
    warn_of_unknown_columns("fit", measured, unknown, "the model does not observe")
    empty = next((x for x in measured.experiments if x not in data.experiments), None)
    if empty is not None:
        raise BeamdaeError(
            f"fit: the experiment {empty!r} contains no values of observed columns; fill in "
            "measured values, or remove it from the data."
        )
    return data


def _with_sigma(data: MeasuredData, sigma: Any) -> MeasuredData:
    """Return data with the standard deviations of the argument `sigma`; 1 if it is None."""
    if sigma is None:
        # The same column may be in different units in different experiments.
        if len({x.header for x in data.sources}) > 1:
            raise BeamdaeError(
                "fit: sigma is required for several columns, because it determines their weights; "
                "pass sigma={name: standard deviation}, or a long table with the column sigma."
            )
        return replace(data, table=data.table.assign(sigma=1.0))
    if isinstance(sigma, Mapping):
        sigma = require_mapping("fit", "sigma", sigma, "a number, or numbers by column")
        given = _sigma_by_name(sigma, data.sources)
    else:
        given = {x.name: ("sigma", sigma) for x in data.sources}
    values = {x: _read_sigma(x, *labeled) for x, labeled in given.items()}
    factors = [np.full(x.stop - x.start, values[y.name] * y.factor) for y, x in data.rows]
    return replace(
        data, table=data.table.assign(sigma=np.concatenate(factors)), is_sigma_known=True
    )


def _sigma_by_name(
    sigma: Mapping[str, Any], sources: Sequence[Source]
) -> dict[str, tuple[str, Any]]:
    """Return the label and the standard deviation of each column by its name.

    Columns are named with or without the units of the data, as in the run or as in the data.
    """
    given: dict[str, tuple[str, Any]] = {}
    is_valid = True
    for key, value in sigma.items():
        header = standardize_header(key)
        names = [{x.name for x in sources if x.name == header}]
        names += [{x.name for x in sources if split_unit(x.name)[0] == key}]
        names += [{x.name for x in sources if x.name_in_data == header}]
        names += [{x.name for x in sources if split_unit(x.name_in_data)[0] == key}]
        named: set[str] = next(filter(None, names), set())
        is_valid &= bool(named) and not named & set(given)
        given |= {x: (f"sigma of {x}", value) for x in named}
    columns = dict.fromkeys(x.name for x in sources)
    if not is_valid or set(given) != set(columns):
        raise BeamdaeError(
            f"fit: sigma must name the observed columns of data, {', '.join(columns)} (also "
            f"without units), got {', '.join(sigma) or 'none'}."
        )
    return given


def _read_sigma(column: str, label: str, value: Any) -> float:
    """Return a standard deviation in the unit of its column."""
    unit, text = split_unit(column)[1], as_text(value)
    if text is not None and not unit:
        raise BeamdaeError(
            f"fit: {label} must be a number in the unit of the column, got {short_repr(value)}; "
            "for values with units, write a header such as 'tip.y [mm]'."
        )
    # In columns of accelerations, g is the standard gravity; columns of masses are not observed.
    is_gravity = unit in ("g", "mg") and text is not None and not text.strip().endswith(unit)
    unit = f"{unit}n" if is_gravity else unit
    return require_positive("fit", label, convert_text("fit", label, value, unit))


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


def warn_of_missing_units(part: str, measured: Measurements, data: MeasuredData) -> None:
    """Warn of columns of a CSV file that are named without their units.

    Tables that are not read from files are written in code, where values are in SI units.
    """
    missing = {
        source.name_in_data: unit
        for source in data.sources
        for unit in [split_unit(source.header)[1]]
        if not split_unit(source.name)[1] and unit not in ("", "-")
    }
    if not (measured.is_file and missing):
        return
    name, unit = next(iter(missing.items()))
    assumed = ", ".join(f"{x!r} in {unit}" for x, unit in missing.items())
    warn_user(
        f"{part}: values of {measured.name} without a unit are taken as in the model, {assumed}; "
        f"write units in the header, such as '{name} [{unit}]'.",
        InputWarning,
    )


class _ColumnNames:
    """Names of columns of the run, or of times, for columns of data; see `fit`."""

    def __init__(self, part: str, data_columns: Any) -> None:
        given = {} if data_columns is None else data_columns
        what = "a dict of names of columns of the run by names in data"
        self._part, self._names = part, {}
        for key, name in require_mapping(part, "data_columns", given, what).items():
            text = as_text(name)
            if not (text and text.strip()):
                raise BeamdaeError(
                    f"{part}: data_columns must be {what}, got {short_repr(name)} for "
                    f"{short_repr(key)}."
                )
            self._names[standardize_header(key)] = standardize_header(text)
        self._unused, self._known = dict(self._names), dict[str, None]()

    def in_run(self, header: str) -> str:
        """Return the name in the run of a column of data, by default its own.

        The unit in the header of the data precedes that of the name in the run.
        """
        self._known[header] = None
        name, unit = split_unit(header)
        keys = [x for x in dict.fromkeys((header, name)) if x in self._names]
        if not keys:
            return header
        if len(keys) > 1:
            raise BeamdaeError(
                f"{self._part}: data_columns names {header!r} twice, also as {name!r}; remove one."
            )
        self._unused.pop(keys[0], None)
        in_run, other_unit = split_unit(self._names[keys[0]])
        unit = unit or other_unit
        return f"{in_run} [{unit}]" if unit else in_run

    def require_all_used(self, name: str) -> None:
        """Reject names that are not in the data, which are called `name`."""
        for unused in self._unused:
            known = list(self._known)
            hint = suggest(unused, known) or f" ({list_first(known, _MAX_LISTED_COLUMNS)})"
            raise BeamdaeError(
                f"{self._part}: data_columns contains {unused!r}, which is not a column of "
                f"{name}{hint}; correct the name."
            )


def read_measurements(part: str, data: Any, data_columns: Any = None) -> Measurements:
    """Return all columns of data as in `fit`; `part` is the calling function.

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
    name = "data" if path is None else path
    table = _as_columns(part, data if path is None else _read_file(part, path), name)
    columns: list[MeasuredColumn] = []
    has_sigma = False
    if _OBSERVABLE in table and VALUE in table:
        columns, has_sigma = _read_long_table(part, table, name, names), SIGMA in table
    elif table and all(isinstance(x, (pd.DataFrame, Mapping)) for x in table.values()):
        for experiment, inner in table.items():
            if not (experiment.strip() and experiment.isprintable()):
                raise BeamdaeError(
                    f"{part}: an experiment cannot have the name {short_repr(experiment)}; use "
                    "printable characters."
                )
            place = f"the experiment {experiment!r}"
            inner = _as_columns(part, inner, place)
            columns += _read_wide_table(part, inner, place, names, experiment)
    else:
        columns = _read_wide_table(part, table, name, names, "")
    names.require_all_used(name)
    if not columns:
        raise BeamdaeError(f"{part}: {name} contains no values; fill in measured values.")
    return Measurements(tuple(columns), has_sigma, name, path is not None)


def _read_file(part: str, path: str) -> dict[str, Any]:
    """Return the columns of a CSV file; those of numbers as arrays."""
    texts = (EXPERIMENT, _OBSERVABLE)
    columns = read_csv_table(part, path, _MAX_DATA, texts)
    return {
        unescape_cell(x): cells if x in texts else parse_numbers(cells)
        for x, cells in columns.items()
    }


def _as_columns(part: str, data: Any, name: str) -> dict[str, Any]:
    """Return the columns of a table by name."""
    if isinstance(data, pd.DataFrame):
        _require_different(part, list(data.columns), name)
        data = {column: data[column].to_numpy() for column in data}
    return require_mapping(part, name, data, _ALLOWED)


def _require_different(part: str, names: Sequence[Any], name: str) -> None:
    repeated = next((x for k, x in enumerate(names) if x in names[:k]), None)
    if repeated is not None:
        raise BeamdaeError(
            f"{part}: {name} contains the column {short_repr(repeated)} twice; remove one."
        )


def _read_wide_table(
    part: str, table: Mapping[str, Any], name: str, names: _ColumnNames, experiment: str
) -> list[MeasuredColumn]:
    """Return the columns of a table with a column of times and one column per observed column."""
    table = _standardize(part, table, name)
    in_run = {x: names.in_run(x) for x in table}
    time = _find_time(part, in_run, (TIME,))
    if time is None or len(table) == 1:
        names.require_all_used(name)
        of_time = (x for x in table if _is_time_unit(split_unit(x)[1]))
        other = next(of_time, next(iter(table), ""))
        hint = f"; map times of another name, as with data_columns={{{other!r}: 't'}}"
        raise BeamdaeError(
            f"{part}: {name} must contain the column {TIME!r} and measured columns (or the columns "
            f"observable, {TIME}, value), got columns {', '.join(map(repr, table)) or 'none'}"
            f"{hint if len(table) > 1 else ''}."
        )
    times, time_header = _read_times(part, table.pop(time), time, in_run[time], name)
    # Rows without a time are empty, unless a column has a value there.
    timed = times.dropna()
    _require_times(part, timed, name)
    unsorted = timed.index[timed.diff() <= 0.0]
    if len(unsorted):
        later, before = format_distinct(*timed.loc[: unsorted[0]].iloc[[-1, -2]])
        raise BeamdaeError(
            f"{part}: the times of {name} must be finite and ascend, got {later} s after "
            f"{before} s in row {unsorted[0] + 1}; sort the rows and average repeated ones."
        )
    cells = {x: _as_cells(part, values, x, name, len(times)) for x, values in table.items()}
    _warn_of_empty_rows(part, times, pd.DataFrame(cells).notna().any(axis=1), name)
    return [
        MeasuredColumn(
            experiment,
            in_run[x],
            x,
            pd.DataFrame({TIME: times, VALUE: cells[x], SIGMA: 1.0}),
            name,
            time_header,
        )
        for x in cells
    ]


def _read_long_table(
    part: str, table: Mapping[str, Any], name: str, names: _ColumnNames
) -> list[MeasuredColumn]:
    """Return the columns of a table with one value per row; its rows may have any order."""
    table = _standardize(part, table, name)
    own = (EXPERIMENT, _OBSERVABLE, *_TIME_NAMES, VALUE, SIGMA)
    in_run = {x: x if x in own else names.in_run(x) for x in table}
    time = _find_time(part, in_run, _TIME_NAMES)
    unknown = [x for x in table if x not in own and x != time]
    if time is None or unknown:
        problem = f"got {short_repr(unknown[0])}" if unknown else "got no times"
        raise BeamdaeError(
            f"{part}: the long table {name} must have the columns experiment, observable, {TIME}, "
            f"value, sigma (the first and the last are optional), {problem}."
        )
    times, time_header = _read_times(part, table[time], time, in_run[time], name)
    columns: dict[str, Any] = {TIME: times, VALUE: _as_numbers(part, table[VALUE], VALUE, name)}
    columns[_OBSERVABLE] = _as_names(part, table[_OBSERVABLE], _OBSERVABLE, name)
    if EXPERIMENT in table:
        columns[EXPERIMENT] = _as_names(part, table[EXPERIMENT], EXPERIMENT, name)
    if SIGMA in table:
        columns[SIGMA] = _as_numbers(part, table[SIGMA], SIGMA, name)
    if len({len(x) for x in columns.values()}) > 1:
        raise BeamdaeError(f"{part}: the columns of {name} must have equal lengths.")
    frame = pd.DataFrame({EXPERIMENT: "", SIGMA: 1.0, **columns})
    _warn_of_empty_rows(part, times, frame[VALUE].notna(), name)
    frame = frame.dropna(subset=VALUE)
    _require_times(part, frame[TIME], name)
    if (wrong := frame[~(frame[SIGMA] > 0.0)]).size:
        raise BeamdaeError(
            f"{part}: sigma of {name} must be positive, got {wrong[SIGMA].iloc[0]:g} in row "
            f"{wrong.index[0] + 1}; fill in all rows, or remove the column."
        )
    frame[_OBSERVABLE] = frame[_OBSERVABLE].map(standardize_header)
    keys = [EXPERIMENT, _OBSERVABLE]
    repeated = frame[frame.duplicated([*keys, TIME])]
    if len(repeated):
        row = repeated.iloc[0]
        raise BeamdaeError(
            f"{part}: {name} contains {label_column(row[_OBSERVABLE], row[EXPERIMENT])} at "
            f"{row[TIME]:g} s twice, again in row {repeated.index[0] + 1}; average repeated "
            "values, or name the experiments."
        )
    return [
        MeasuredColumn(
            experiment, names.in_run(column), column, rows[[TIME, VALUE, SIGMA]], name, time_header
        )
        for key, rows in frame.groupby(keys, sort=False)
        for experiment, column in [map(str, key)]
    ]


def _warn_of_empty_rows(part: str, times: pd.Series, is_filled: pd.Series, name: str) -> None:
    """Warn if most of the rows with a time have no value, but not all, as after a failed export."""
    is_timed = times.notna()
    count, total = int((is_timed & ~is_filled).sum()), int(is_timed.sum())
    if 0.5 * total < count < total:
        warn_user(
            f"{part}: {count} of {total} rows of {name} have a time but no value; fill them in, or "
            "remove them.",
            InputWarning,
        )


def _require_times(part: str, times: pd.Series, name: str) -> None:
    """Reject missing and negative times of rows."""
    rule = f"{part}: the times of {name} must be finite and ascend, from 0 s or later"
    for row in times.index[times.isna()]:
        raise BeamdaeError(f"{rule}, but row {row + 1} has no time; fill it in, or remove it.")
    for row in times.index[times < 0.0]:
        raise BeamdaeError(
            f"{rule}, got {times[row]:g} s in row {row + 1}; remove the rows before the start of "
            "the run (t < 0), or shift the times."
        )


def _standardize(part: str, table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return columns by their headers in one form; two cannot be the same."""
    headers = list(map(standardize_header, table))
    _require_different(part, headers, name)
    return dict(zip(headers, table.values(), strict=True))


def _find_time(part: str, in_run: Mapping[str, str], names: Sequence[str]) -> str | None:
    """Return the column of times: "t" or "time" with any unit of time, or one of `names`.

    Without such a column, return one named "t" or "time" that has another unit or none. `in_run`
    contains the names in the run by those in the data.
    """
    # T may be a temperature.
    times = [x for x, y in in_run.items() if y.startswith("t") or y.casefold().startswith("time")]
    times = [x for x in times if split_unit(in_run[x])[0].casefold() in ("t", "time")]
    candidates = [x for x in times if _is_time_unit(split_unit(in_run[x])[1]) or in_run[x] in names]
    if len(candidates) > 1:
        raise BeamdaeError(
            f"{part}: the columns {candidates[0]!r} and {candidates[1]!r} of data are both times; "
            "remove one."
        )
    return next(iter([*candidates, *times]), None)


def _is_time_unit(unit: str) -> bool:
    return conversion_factor(unit, "s") is not None


def _read_times(part: str, values: Any, time: str, in_run: str, name: str) -> tuple[pd.Series, str]:
    """Return the times [s], from the first one if they are time stamps, and their header."""
    header = time if split_unit(time)[1] else in_run
    unit = split_unit(header)[1]
    if np.asarray(values).dtype.kind in "MOUS":
        stamps = read_time_stamps(part, f"{time!r} of {name}", map(str, values))
        if stamps is not None:
            return pd.Series(stamps), header
    numbers = pd.Series(_as_numbers(part, values, time, name))
    if not unit:
        warn_user(
            f"{part}: the times {time!r} of {name} have no unit and are taken as seconds; name the "
            f"column '{time} [s]'.",
            InputWarning,
        )
        return numbers, header
    factor = conversion_factor(unit, "s")
    if factor is None:
        raise BeamdaeError(
            f"{part}: the times {time!r} of {name} must be in a unit such as s or ms, got {unit}"
            f"{suggest_unit(unit, 's') if parse_unit(unit) is None else ''}."
        )
    return numbers * float(factor), header


def _as_cells(part: str, values: Any, column: str, name: str, count: int) -> Array:
    """Return a column of a wide table as an array (count,) of any type."""
    try:
        cells = np.asarray(values)
    except Exception:  # Of any kind in conversions of the user's objects.
        cells = np.asarray(None)
    if cells.shape != (count,):
        got = f"{len(cells)} for {count} times" if cells.ndim == 1 else short_repr(values)
        raise BeamdaeError(
            f"{part}: the column {column!r} of {name} must have one finite number or NaN per time, "
            f"got {got}."
        )
    return cells


def _as_numbers(part: str, values: Any, column: str, name: str) -> Array:
    """Return a column (n,) as floats; missing values become NaN."""
    what = f"{part}: the column {column!r} of {name} must contain"
    try:
        cells = np.asarray(values)
        # Durations and dates would become counts of their own unit, such as nanoseconds.
        numbers = cells.astype(float) if cells.dtype.kind not in "bmM" else None
    except Exception:  # Of any kind in conversions of the user's objects.
        numbers = None
    if numbers is None or numbers.ndim != 1:
        raise BeamdaeError(f"{what} numbers, got {_find_text(values)}.")
    is_large = ~(np.abs(np.nan_to_num(numbers, posinf=np.inf)) <= _MAX_MAGNITUDE)
    if is_large.any():
        k = int(np.argmax(is_large))
        raise BeamdaeError(f"{what} finite numbers or NaN, got {numbers[k]:g} in row {k + 1}.")
    return np.asarray(numbers)


def _find_text(values: Any) -> str:
    """Return the first value that is no number, with its row."""
    try:
        for k, value in enumerate(values):
            try:
                float("nan" if value is None else value)
            except (TypeError, ValueError):
                return f"{short_repr(value)} in row {k + 1}; leave missing values empty"
    except Exception:  # Of any kind in iterations over the user's objects.
        pass
    return short_repr(values)


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
