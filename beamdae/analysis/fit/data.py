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
    is_valid_path,
    list_first,
    path_as_text,
    require_mapping,
    require_positive,
    short_repr,
    suggest,
    warn_user,
)
from beamdae.model_parameters import (
    conversion_factor,
    parse_unit,
    parse_value,
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
ALL_COLUMNS = "*"  # name of all columns
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


@dataclass(frozen=True)
class Source:
    """Origin of the values of a column of the run in an experiment.

    Attributes
    ----------
    experiment
        Name of the experiment; "" if the data do not name experiments.
    name
        Name of the column of the run, with the unit of the data.
    name_in_data
        Name of the column in the data.
    header
        Header of the column of the run; "" before it is matched.
    factor
        Factor from the unit of the data to that of the column.
    """

    experiment: str
    name: str
    name_in_data: str
    header: str = ""
    factor: float = 1.0

    @property
    def label(self) -> str:
        """Name of the column without its unit and, if the data name experiments, of this one."""
        return label_column(remove_unit(self.header), self.experiment)


class Measurements(NamedTuple):
    """All columns of measured data: "t [s]", "value" and "sigma" by row of the data.

    Times are NaN if they are missing, and values may be no numbers. `name` is the path of the
    file, or "data".
    """

    columns: tuple[tuple[Source, pd.DataFrame], ...]
    has_sigma: bool
    name: str
    is_file: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(dict.fromkeys(source.experiment for source, _ in self.columns))


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


def find_sources(
    sources: Sequence[Source], name: str, experiment: str | None = None
) -> list[Source]:
    """Return the sources of a column, named as in the run or else as in the data.

    Units may be omitted. All experiments match if `experiment` is None.
    """
    own = [x for x in sources if experiment in (None, x.experiment)]
    header = standardize_header(name)
    in_run = [x for x in own if name in (ALL_COLUMNS, x.header, remove_unit(x.header))]
    names = ((x, (x.name, x.name_in_data, remove_unit(x.name_in_data))) for x in own)
    return in_run or [x for x, known in names if header in known]


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
        If such a column contains text, too many values, invalid times or another unit, or two
        columns of an experiment are the same one.
    UnmatchedDataError
        If the run contains none of the columns, or these have no values.
    """
    matched: dict[tuple[str, str], tuple[Source, pd.DataFrame]] = {}
    unknown: dict[str, str] = {}
    for source, table in measured.columns:
        known = headers[source.experiment]
        header = _find_header(source.name, known)
        if header is None:
            unknown[source.name] = _describe_unknown(source.name, known)
            if source.name != source.name_in_data:
                raise BeamdaeError(
                    f"{part}: data_columns maps {source.name_in_data!r} to "
                    f"{unknown[source.name]}, which is not a column of the run; name one of its "
                    "table."
                )
            continue
        key = source.experiment, header
        if key in matched:
            raise BeamdaeError(
                f"{part}: the columns {matched[key][0].name_in_data!r} and "
                f"{source.name_in_data!r} of data are the same column of the run; remove one."
            )
        factor = _convert_unit(part, source, header)
        values = _read_values(part, measured.name, source, table)
        values[[VALUE, SIGMA]] *= factor
        values = values.assign(**{EXPERIMENT: source.experiment, COLUMN: header})
        matched[key] = replace(source, header=header, factor=factor), values
    if not matched:
        listed = list_first(list(unknown.values()), _MAX_LISTED_COLUMNS)
        example = next((x for xs in headers.values() for x in xs if x != TIME), "tip.y [m]")
        raise UnmatchedDataError(
            f"{part}: {measured.name} must contain values of a column of the run, got {listed}; "
            f"name them as in the table of the run, such as {example!r}, or map them, as with "
            f"data_columns={{{next(iter(unknown))!r}: {remove_unit(example)!r}}}."
        )
    filled = [(x, values) for x, values in matched.values() if len(values)]
    if not filled:
        raise UnmatchedDataError(
            f"{part}: {measured.name} contains no values; fill in measured values."
        )
    whole = pd.concat([values for _, values in filled], ignore_index=True)
    data = MeasuredData(whole, tuple(x for x, _ in filled), measured.has_sigma)
    return data, list(unknown.values())


def _read_values(part: str, name: str, source: Source, table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows whose value is not missing, after checks of their times and `sigma`."""
    values = _as_numbers(part, table[VALUE], source.name_in_data, name)
    table = table.assign(value=values).dropna(subset=VALUE)
    times, sigma = table[TIME], table[SIGMA]
    rule = f"{part}: the times of {name} must be finite and ascend, from 0 s or later"
    checks = (
        (times.isna(), f"{rule}, but row {{row}} has no time; fill it in, or remove it."),
        (
            times < 0.0,
            f"{rule}, got {{t:g}} s in row {{row}}; remove the rows before the start of the run (t "
            "< 0), or shift the times.",
        ),
        (
            times.diff() <= 0.0,
            f"{rule}, got {{t:g}} s after {{last:g}} s in row {{row}}; sort the rows and average "
            "repeated ones.",
        ),
        (
            ~(sigma > 0.0),
            f"{part}: sigma of {name} must be positive, got {{sigma:g}} in row {{row}}; fill in "
            "all rows, or remove the column.",
        ),
    )
    for is_wrong, sentence in checks:
        for row in table.index[is_wrong]:
            facts = {"row": row + 1, "t": times[row], "sigma": sigma[row]}
            raise BeamdaeError(sentence.format(**facts, last=times.shift()[row]))
    return table


def _convert_unit(part: str, source: Source, header: str) -> float:
    """Return the factor from the unit in the name of a column to that of a header."""
    name, unit = split_unit(source.name)
    if not unit or source.name in (header, remove_unit(header)):
        return 1.0
    unit_in_run = split_unit(header)[1]
    factor = conversion_factor(unit, unit_in_run)
    if factor is None:
        hint = suggest_unit(unit, unit_in_run) if parse_unit(unit) is None else ""
        shown = name if source.name == source.name_in_data else source.name_in_data
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
    warn_of_columns("fit", measured, data, unknown, "the model does not observe")
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
        if len(data.headers) > 1:
            raise BeamdaeError(
                "fit: sigma is required for several columns, because it determines their weights; "
                "pass sigma={name: standard deviation}, or a long table with the column sigma."
            )
        return replace(data, table=data.table.assign(sigma=1.0))
    entries = {ALL_COLUMNS: sigma}
    if isinstance(sigma, Mapping):
        entries = require_mapping("fit", "sigma", sigma, "a number, or numbers by column")
    named = {key: find_sources(data.sources, key) for key in entries}
    chosen = {source: key for key, sources in named.items() for source in sources}
    count = sum(map(len, named.values()))
    if not all(named.values()) or not count == len(chosen) == len(data.sources):
        columns = dict.fromkeys(x.name for x in data.sources)
        raise BeamdaeError(
            f"fit: sigma must name the observed columns of data, {', '.join(columns)} (also "
            f"without units), got {', '.join(entries) or 'none'}."
        )
    values = [_read_sigma(x, chosen[x], entries[chosen[x]]) for x in data.sources]
    counts = [rows.stop - rows.start for _, rows in data.rows]
    table = data.table.assign(sigma=np.repeat(values, counts))
    return replace(data, table=table, is_sigma_known=True)


def _read_sigma(source: Source, key: str, value: Any) -> float:
    """Return a standard deviation in the unit of the column of the run."""
    label = "sigma" if key == ALL_COLUMNS else f"sigma of {key}"
    text = as_text(value)
    if text is not None:
        unit = split_unit(source.header)[1]
        number = parse_value("fit", label, text, unit)
        if number is not None:
            return require_positive("fit", label, number)
    number = None if text is None else as_real(text)
    return require_positive("fit", label, value if number is None else number) * source.factor


def warn_of_columns(
    part: str, measured: Measurements, data: MeasuredData, unknown: Sequence[str], reason: str
) -> None:
    """Warn of unknown columns, omitted for a reason (a clause), and of files without units.

    Tables that are not read from files are written in code, where values are in SI units.
    """
    if unknown:
        warn_user(
            f"{part}: {measured.name} contains {list_first(unknown, _MAX_LISTED_COLUMNS)}, which "
            f"{reason} and {part} omits; name columns as in the table of the run, map them with "
            "data_columns=, or remove them.",
            InputWarning,
        )
    units = {x.name_in_data: split_unit(x.header)[1] for x in data.sources if "[" not in x.name}
    missing = {name: unit for name, unit in units.items() if unit not in ("", "-")}
    if measured.is_file and missing:
        name, unit = next(iter(missing.items()))
        assumed = ", ".join(f"{x!r} in {unit}" for x, unit in missing.items())
        warn_user(
            f"{part}: values of {measured.name} without a unit are taken as in the model, "
            f"{assumed}; write units in the header, such as '{name} [{unit}]'.",
            InputWarning,
        )


class _ColumnNames:
    """Names of columns of the run, or of times, for columns of data; see `fit`."""

    def __init__(self, part: str, data_columns: Any) -> None:
        given = {} if data_columns is None else data_columns
        what = "a dict of names of columns of the run by names in data"
        self._part, self._names = part, {}
        self._known: dict[str, None] = {}
        for key, name in require_mapping(part, "data_columns", given, what).items():
            text = as_text(name)
            if not (text and text.strip()):
                raise BeamdaeError(
                    f"{part}: data_columns must be {what}, got {short_repr(name)} for "
                    f"{short_repr(key)}."
                )
            self._names[standardize_header(key)] = standardize_header(text)

    def in_run(self, header: str) -> str:
        """Return the name in the run of a column of data, by default its own.

        The unit in the header of the data precedes that of the name in the run.
        """
        name, unit = split_unit(header)
        self._known |= {header: None, name: None}
        keys = [x for x in dict.fromkeys((header, name)) if x in self._names]
        if not keys:
            return header
        if len(keys) > 1:
            raise BeamdaeError(
                f"{self._part}: data_columns names {header!r} twice, also as {name!r}; remove one."
            )
        in_run, other_unit = split_unit(self._names[keys[0]])
        unit = unit or other_unit
        return f"{in_run} [{unit}]" if unit else in_run

    def require_all_used(self, name: str) -> None:
        """Reject names that are not in the data, which are called `name`."""
        for unused in self._names.keys() - self._known:
            raise BeamdaeError(
                f"{self._part}: data_columns contains {unused!r}, which is not a column of "
                f"{name}{suggest(unused, self._known)}; correct the name."
            )


def read_measurements(part: str, data: Any, data_columns: Any = None) -> Measurements:
    """Return all columns of data as in `fit`; `part` is the calling function.

    Raises
    ------
    BeamdaeError
        If the data are no table, their times are missing, a long table is incomplete, or
        `data_columns` is invalid or names columns that the data do not contain.
    """
    names = _ColumnNames(part, data_columns)
    path = None if isinstance(data, Mapping) else path_as_text(data)
    if path is not None and not (is_valid_path(path) and path.strip()):
        raise BeamdaeError(f"{part}: data must be {_ALLOWED}, got {short_repr(data)}.")
    name = "data" if path is None else path
    table = _as_columns(part, data if path is None else _read_file(part, path), name)
    if _OBSERVABLE in table and VALUE in table:
        columns = _read_long_table(part, table, name, names)
    elif table and all(isinstance(x, (pd.DataFrame, Mapping)) for x in table.values()):
        columns = []
        labels = _as_names(part, "experiments", name, list(table))
        for experiment, inner in zip(labels, table.values(), strict=True):
            place = f"the experiment {experiment!r}"
            inner = _as_columns(part, inner, place)
            columns += _read_wide_table(part, inner, place, names, experiment)
    else:
        columns = _read_wide_table(part, table, name, names, "")
    sourced = tuple((Source(x, names.in_run(y), y), rows) for x, y, rows in columns)
    names.require_all_used(name)
    if not sourced:
        raise BeamdaeError(f"{part}: {name} contains no values; fill in measured values.")
    return Measurements(sourced, SIGMA in table, name, path is not None)


def _read_file(part: str, path: str) -> dict[str, Any]:
    """Return the columns of a CSV file; those of numbers as arrays."""
    texts = (EXPERIMENT, _OBSERVABLE)
    columns = read_csv_table(part, path, _MAX_DATA, texts)
    return {
        unescape_cell(x): cells if x in texts else parse_numbers(cells)
        for x, cells in columns.items()
    }


def _as_columns(part: str, data: Any, name: str) -> dict[str, Any]:
    """Return the columns of a table by their headers in one form, which must differ."""
    if isinstance(data, pd.DataFrame):
        pairs: list[Any] = [(x, column.to_numpy()) for x, column in data.items()]
    else:
        pairs = list(require_mapping(part, name, data, _ALLOWED).items())
    columns: dict[str, Any] = {}
    for key, values in pairs:
        is_table = isinstance(values, (pd.DataFrame, Mapping))
        header = key if is_table or not isinstance(key, str) else standardize_header(key)
        if header in columns:
            raise BeamdaeError(
                f"{part}: {name} contains the column {short_repr(header)} twice; remove one."
            )
        columns[header] = values
    return require_mapping(part, name, columns, _ALLOWED)


def _read_wide_table(
    part: str, table: dict[str, Any], name: str, names: _ColumnNames, experiment: str
) -> list[tuple[str, str, pd.DataFrame]]:
    """Return the experiment, the name and the rows of each column beside that of the times."""
    in_run = {x: names.in_run(x) for x in table}
    time = _find_time(part, in_run)
    if time is None or len(table) == 1:
        of_time = (x for x in table if conversion_factor(split_unit(x)[1], "s") is not None)
        other = next(of_time, next(iter(table), ""))
        hint = f"; map times of another name, as with data_columns={{{other!r}: 't'}}"
        raise BeamdaeError(
            f"{part}: {name} must contain the column {TIME!r} and measured columns (or the columns "
            f"observable, {TIME}, value), got columns {', '.join(map(repr, table)) or 'none'}"
            f"{hint if len(table) > 1 else ''}."
        )
    times = _read_times(part, table[time], time, in_run[time], name)
    cells = {x: _as_cells(part, y, x, name, len(times)) for x, y in table.items() if x != time}
    return [
        (experiment, x, pd.DataFrame({TIME: times, VALUE: y, SIGMA: 1.0})) for x, y in cells.items()
    ]


def _read_long_table(
    part: str, table: dict[str, Any], name: str, names: _ColumnNames
) -> list[tuple[str, str, pd.DataFrame]]:
    """Return the columns of a table with one value per row; its rows may have any order."""
    own = (EXPERIMENT, _OBSERVABLE, VALUE, SIGMA)
    in_run = {x: names.in_run(x) for x in table if x not in own}
    time = _find_time(part, in_run)
    unknown = [x for x in in_run if x != time]
    if time is None or unknown:
        problem = f"got {short_repr(unknown[0])}" if unknown else "got no times"
        raise BeamdaeError(
            f"{part}: the long table {name} must have the columns experiment, observable, {TIME}, "
            f"value, sigma (the first and the last are optional), {problem}."
        )
    times = _read_times(part, table[time], time, in_run[time], name)
    cells = {x: _as_cells(part, table[x], x, name, len(times)) for x in own if x in table}
    frame = pd.DataFrame({EXPERIMENT: "", SIGMA: 1.0, TIME: times, **cells})
    frame[SIGMA] = _as_numbers(part, frame[SIGMA], SIGMA, name)
    for key in {EXPERIMENT, _OBSERVABLE} & set(table):
        frame[key] = _as_names(part, key, name, cells[key])
    frame[_OBSERVABLE] = frame[_OBSERVABLE].map(standardize_header)
    groups = frame.groupby([EXPERIMENT, _OBSERVABLE], sort=False)[[TIME, VALUE, SIGMA]]
    return [
        (str(experiment), str(column), rows.sort_values(TIME, kind="stable"))
        for (experiment, column), rows in groups
    ]


def _find_time(part: str, in_run: Mapping[str, str]) -> str | None:
    """Return the column of times: "t" or "time", with a unit of time if there are several.

    `in_run` contains the names in the run by those in the data.
    """
    # T may be a temperature.
    names = {x: split_unit(y) for x, y in in_run.items()}
    times = [x for x, (name, _) in names.items() if name == "t" or name.casefold() == "time"]
    with_unit = [x for x in times if conversion_factor(names[x][1], "s") is not None]
    if len(with_unit) > 1:
        raise BeamdaeError(
            f"{part}: the columns {with_unit[0]!r} and {with_unit[1]!r} of data are both times; "
            "remove one."
        )
    return next(iter([*with_unit, *times]), None)


def _read_times(part: str, values: Any, time: str, in_run: str, name: str) -> pd.Series:
    """Return the times [s], from the first one if they are time stamps."""
    unit = split_unit(time)[1] or split_unit(in_run)[1]
    cells = _as_cells(part, values, time, name)
    if cells.dtype.kind in "MOUS":
        stamps = read_time_stamps(part, f"{time!r} of {name}", map(str, cells))
        if stamps is not None:
            return pd.Series(stamps)
    factor: Any = conversion_factor(unit, "s") if unit else 1.0
    if factor is None:
        raise BeamdaeError(
            f"{part}: the times {time!r} of {name} must be in a unit such as s or ms, got {unit}"
            f"{suggest_unit(unit, 's') if parse_unit(unit) is None else ''}."
        )
    numbers = _as_numbers(part, pd.Series(cells), time, name)
    if not unit:
        warn_user(
            f"{part}: the times {time!r} of {name} have no unit and are taken as seconds; name the "
            f"column '{time} [s]'.",
            InputWarning,
        )
    return numbers * float(factor)


def _as_cells(part: str, values: Any, column: str, name: str, count: int | None = None) -> Array:
    """Return a column of a table as an array (n,) of any type, with a given length."""
    try:
        cells = np.asarray(values)
    except Exception:  # Of any kind in conversions of the user's objects.
        cells = np.asarray(None)
    if cells.ndim != 1 or count not in (None, len(cells)):
        got = f"{len(cells)} for {count} times" if cells.ndim == 1 else short_repr(values)
        raise BeamdaeError(
            f"{part}: the column {column!r} of {name} must have one entry per time, got {got}."
        )
    return cells


def _as_numbers(part: str, cells: pd.Series, column: str, name: str) -> pd.Series:
    """Return a column (n,) as floats; missing values become NaN."""
    numbers = pd.to_numeric(cells, errors="coerce").astype(float)
    is_wrong = (numbers.isna() & cells.notna()) | (numbers.abs() > _MAX_MAGNITUDE)
    # Durations and dates would become counts of their own unit, such as nanoseconds.
    is_wrong |= cells.dtype.kind in "bmM"
    for row in cells.index[is_wrong]:
        got = short_repr(cells.astype(object)[row])
        raise BeamdaeError(
            f"{part}: the column {column!r} of {name} must contain finite numbers or NaN, got "
            f"{got} in row {row + 1}; leave missing values empty."
        )
    return numbers


def _as_names(part: str, column: str, name: str, values: Any) -> list[str]:
    """Return texts; numbers become texts."""
    texts = []
    for k, value in enumerate(values):
        number = as_real(value)
        text = as_text(value) or ("" if number is None or number != number else f"{number:g}")
        if not (text.strip() and text.isprintable()):
            raise BeamdaeError(
                f"{part}: the column {column!r} of {name} must contain names of printable "
                f"characters, got {short_repr(value)} in row {k + 1}."
            )
        texts.append(text.strip())
    return texts
