"""Measured data of a fit: one long table from wide and long tables, files and experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
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
    format_message,
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
_OBSERVABLE, _ROW = "observable", "row"
ALL_COLUMNS = "*"  # name of all columns
# Larger tables are probably raw records, whose fit would take hours and gigabytes.
_MAX_DATA = 1_000_000
_TABLES = pd.DataFrame, Mapping
_ALLOWED = (
    "a table (DataFrame or dict) of numbers by column, a dict of such tables by experiment, or "
    "the path of a CSV file"
)


class Measurements(NamedTuple):
    """All measured data, not yet compared with a run.

    `table` has one value per row: "experiment" ("" without experiments), "observable" (its name in
    the data), "t [s]", "value" of any type, "sigma", and "row" in the data from 1 on. `names`
    contains the names of columns in the run by those in the data, `name` the path or "data".
    """

    table: pd.DataFrame
    names: Mapping[str, str]
    has_sigma: bool
    name: str
    is_file: bool

    @property
    def experiments(self) -> tuple[str, ...]:
        """Names of the experiments, in the order of the data."""
        return tuple(map(str, self.table[EXPERIMENT].unique()))


class Source(NamedTuple):
    """Origin of the values of a column (`header`) of the run in an experiment.

    `name` is the name of the column of the run with the unit of the data, `name_in_data` that in
    the data, and `factor` converts the unit of the data to that of the column.
    """

    experiment: str
    header: str
    name: str
    name_in_data: str
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
        ends = self.table.groupby([EXPERIMENT, COLUMN], sort=False).size().cumsum().tolist()
        pairs = zip(self.sources, [0, *ends], ends, strict=False)
        return tuple((source, slice(begin, end)) for source, begin, end in pairs)

    @cached_property
    def variation(self) -> float:
        """Sum of the squared deviations from the mean of each source, in standard deviations."""
        means = self.table.groupby([EXPERIMENT, COLUMN])[VALUE].transform("mean")
        return float((((self.table[VALUE] - means) / self.table[SIGMA]) ** 2).sum())

    def within(self, begin: float, end: float) -> tuple[MeasuredData, Array]:
        """Return the data between two shares of the time, and their rows.

        One of the shares is 0 or 1; at least two values a source remain.
        """
        groups = self.table.groupby([EXPERIMENT, COLUMN])
        last = groups[TIME].transform("max")
        is_within = self.table[TIME].between(begin * last, end * last)
        rows = (is_within | (groups.cumcount(ascending=begin == 0.0) < 2)).to_numpy()
        return replace(self, table=self.table[rows]), rows

    def find(self, name: str, experiment: str | None = None) -> list[Source]:
        """Return the sources of a column, named as in the run or else as in the data.

        Units may be omitted. All experiments match if `experiment` is None.
        """
        own = [x for x in self.sources if experiment in (None, x.experiment)]
        in_run = [x for x in own if name in (ALL_COLUMNS, x.header, remove_unit(x.header))]
        header = standardize_header(name)
        names = ((x, (x.name, x.name_in_data, remove_unit(x.name_in_data))) for x in own)
        return in_run or [x for x, known in names if header in known]


def label_column(column: str, experiment: str) -> str:
    """Return "column" or "column in experiment"."""
    return f"{column} in {experiment}" if experiment else column


def read_measurements(part: str, data: Any, data_columns: Any = None) -> Measurements:
    """Return all columns of data as in `fit`; `part` is the calling function.

    Raises
    ------
    BeamdaeError
        If the data are no table, their times are missing, a long table is incomplete, or
        `data_columns` is invalid or names columns that the data do not contain.
    """
    what = "a dict of names of columns of the run by names in data"
    given = require_mapping(
        part, "data_columns", {} if data_columns is None else data_columns, what
    )
    if not all(isinstance(x, str) and x.strip() for x in given.values()):
        raise BeamdaeError(f"{part}: data_columns must be {what}, got {short_repr(given)}.")
    renamed = {standardize_header(x): standardize_header(y) for x, y in given.items()}
    path = None if isinstance(data, Mapping) else path_as_text(data)
    if path is not None and not (is_valid_path(path) and path.strip()):
        raise BeamdaeError(f"{part}: data must be {_ALLOWED}, got {short_repr(data)}.")
    name = "data" if path is None else path
    if path is not None:
        texts = EXPERIMENT, _OBSERVABLE
        cells = read_csv_table(part, path, _MAX_DATA, texts).items()
        data = {unescape_cell(x): y if x in texts else parse_numbers(y) for x, y in cells}
    tables = {"": (name, data)}
    if isinstance(data, Mapping):
        experiments = require_mapping(part, name, data, _ALLOWED)
        if experiments and all(isinstance(x, _TABLES) for x in experiments.values()):
            tables = {x: (f"the experiment {x!r}", y) for x, y in experiments.items()}
    frames = {x: (place, _as_frame(part, y, place)) for x, (place, y) in tables.items()}
    whole = pd.concat([_read_table(part, x, *y, renamed) for x, y in frames.items()])
    if not len(whole):
        raise BeamdaeError(f"{part}: {name} contains no values; fill in measured values.")
    headers = {*whole[_OBSERVABLE], *(x for _, y in frames.values() for x in y)}
    known = headers | {remove_unit(x) for x in headers}
    for unused in renamed.keys() - known:
        raise BeamdaeError(
            f"{part}: data_columns contains {unused!r}, which is not a column of {name}"
            f"{suggest(unused, known)}; correct the name."
        )
    names = {x: _name_in_run(x, renamed) for x in whole[_OBSERVABLE].unique()}
    has_sigma = any({SIGMA, VALUE, _OBSERVABLE} <= set(x) for _, x in frames.values())
    return Measurements(whole, names, has_sigma, name, path is not None)


def _as_frame(part: str, data: Any, name: str) -> pd.DataFrame:
    """Return a table whose headers have one form."""
    if not isinstance(data, _TABLES):
        raise BeamdaeError(f"{part}: {name} must be {_ALLOWED}, got {short_repr(data)}.")
    try:
        columns = data if isinstance(data, pd.DataFrame) else dict(data)
        frame = pd.DataFrame(columns).reset_index(drop=True)
        frame = frame.rename(columns=lambda x: standardize_header(str(x)))
    except Exception as problem:  # Of any kind in conversions of the user's objects.
        raise BeamdaeError(
            f"{part}: {name} must be {_ALLOWED}, got {short_repr(data)}: {format_message(problem)}."
        ) from None
    for header in frame.columns[frame.columns.duplicated()]:
        raise BeamdaeError(
            f"{part}: {name} contains the column {short_repr(header)} twice; remove one."
        )
    return frame


def _name_in_run(header: str, renamed: Mapping[str, str]) -> str:
    """Return the name in the run of a column of data; the unit in the header precedes others."""
    name, unit = split_unit(header)
    in_run, other_unit = split_unit(renamed.get(header, renamed.get(name, header)))
    unit = unit or other_unit
    return f"{in_run} [{unit}]" if unit else in_run


def _read_table(
    part: str, experiment: str, place: str, table: pd.DataFrame, renamed: Mapping[str, str]
) -> pd.DataFrame:
    """Return a wide or a long table as in `Measurements`, by time; `place` is its name."""
    is_long = _OBSERVABLE in table and VALUE in table
    own = (EXPERIMENT, _OBSERVABLE, VALUE, SIGMA) if is_long else ()
    headers = [str(x) for x in table]
    others = {x: _name_in_run(x, renamed) for x in headers if x not in own}
    # "t" or "time", with a unit of time if there are several; T may be a temperature.
    names = {x: split_unit(y) for x, y in others.items()}
    clocks = [x for x, (name, _) in names.items() if name == "t" or name.casefold() == "time"]
    with_unit = [x for x in clocks if conversion_factor(names[x][1], "s") is not None]
    if len(with_unit) > 1:
        raise BeamdaeError(
            f"{part}: the columns {with_unit[0]!r} and {with_unit[1]!r} of data are both times; "
            "remove one."
        )
    time = next(iter([*with_unit, *clocks]), None)
    if time is None or len(table.columns) == 1 or (is_long and len(others) > 1):
        of_time = (x for x in others if conversion_factor(split_unit(x)[1], "s") is not None)
        other = next(of_time, next(iter(others), "time"))
        raise BeamdaeError(
            f"{part}: {place} must contain the column {TIME!r} and measured columns, or the "
            f"columns observable, {TIME}, value (and experiment, sigma) alone, got columns "
            f"{', '.join(map(repr, headers)) or 'none'}; map times of another name, as with "
            f"data_columns={{{other!r}: 't'}}."
        )
    times = _read_times(part, table[time], time, others[time], place)
    rows = pd.DataFrame({EXPERIMENT: experiment, TIME: times, SIGMA: 1.0})
    rows[_ROW] = np.arange(1, 1 + len(times))
    if not is_long:
        # Truth values, durations and dates are no numbers.
        types = {x: str if table[x].dtype.kind in "bmM" else object for x in headers}
        columns = [
            rows.assign(observable=x, value=table[x].astype(types[x])) for x in headers if x != time
        ]
        return pd.concat(columns).sort_values(TIME, kind="stable")
    rows = rows.assign(**{x: table[x] for x in headers if x != time})
    rows[SIGMA] = _as_numbers(part, rows[SIGMA], SIGMA, rows[_ROW], place)
    for key in {EXPERIMENT, _OBSERVABLE} & set(table):
        rows[key] = [_as_name(x) for x in table[key]]
        for row in rows[_ROW][rows[key] == ""]:
            raise BeamdaeError(
                f"{part}: the column {key!r} of {place} must contain names of printable "
                f"characters, got {short_repr(table[key][row - 1])} in row {row}."
            )
    rows[_OBSERVABLE] = rows[_OBSERVABLE].map(standardize_header)
    return rows.sort_values(TIME, kind="stable")


def _read_times(part: str, cells: pd.Series, time: str, in_run: str, place: str) -> Array:
    """Return the times [s], from the first one if they are time stamps."""
    unit = split_unit(time)[1] or split_unit(in_run)[1]
    if cells.dtype.kind in "MOUS":
        stamps = read_time_stamps(part, f"{time!r} of {place}", map(str, cells))
        if stamps is not None:
            return stamps
    factor: Any = conversion_factor(unit, "s") if unit else 1.0
    if factor is None:
        raise BeamdaeError(
            f"{part}: the times {time!r} of {place} must be in a unit such as s or ms, got {unit}"
            f"{suggest_unit(unit, 's') if parse_unit(unit) is None else ''}."
        )
    rows = pd.Series(cells.index) + 1
    numbers = _as_numbers(part, cells, time, rows, place)
    if not unit:
        warn_user(
            f"{part}: the times {time!r} of {place} have no unit and are taken as seconds; name "
            f"the column '{time} [s]'.",
            InputWarning,
        )
    return numbers.to_numpy() * float(factor)


def _as_numbers(part: str, cells: pd.Series, column: str, rows: pd.Series, place: str) -> pd.Series:
    """Return cells (n,) in some rows of a column as floats; missing values become NaN."""
    numbers = pd.to_numeric(cells, errors="coerce").astype(float)
    is_wrong = (numbers.isna() & cells.notna()) | np.isinf(numbers)
    # Durations and dates would become counts of their own unit, such as nanoseconds.
    is_wrong |= cells.dtype.kind in "bmM"
    for cell, row in zip(cells[is_wrong].astype(object), rows[is_wrong], strict=True):
        raise BeamdaeError(
            f"{part}: the column {column!r} of {place} must contain finite numbers or NaN, got "
            f"{short_repr(cell)} in row {row}; leave missing values empty."
        )
    return numbers


def _as_name(value: Any) -> str:
    """Return a name, or a number as one; "" for others."""
    number = as_real(value)
    text = as_text(value) or ("" if number is None or number != number else f"{number:g}")
    return text.strip() if text.isprintable() else ""


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
        If such a column contains text, too many values, invalid times or another unit, two columns
        of an experiment are the same one, or the run contains no column with values.
    """
    matched: dict[tuple[str, str], tuple[Source, pd.DataFrame]] = {}
    unknown: dict[str, str] = {}
    groups = measured.table.groupby([EXPERIMENT, _OBSERVABLE], sort=False)
    for key, rows in groups:
        experiment, name_in_data = map(str, key)
        name, known = measured.names[name_in_data], headers[experiment]
        # One header, or all of an observable.
        names = name, split_unit(name)[0]
        exact = [x for x in known if x == name] or [x for x in known if remove_unit(x) in names]
        # Coordinates follow the observed columns.
        found = exact[:1] or [x for x in known if Header.of(x).name in names]
        if len(found) != 1:
            hint = f" (name one of {list_first(found)})"
            hint = hint if found else suggest(remove_unit(name), map(remove_unit, known))
            unknown[name_in_data] = f"{name!r}{hint}"
            if name != name_in_data:
                raise BeamdaeError(
                    f"{part}: data_columns maps {name_in_data!r} to {unknown[name_in_data]}, which "
                    "is not a column of the run; name one of its table."
                )
            continue
        header = found[0]
        if other := matched.get((experiment, header)):
            raise BeamdaeError(
                f"{part}: the columns {other[0].name_in_data!r} and {name_in_data!r} of data are "
                "the same column of the run; remove one."
            )
        unit, unit_in_run = split_unit(name)[1], split_unit(header)[1]
        factor: Any = 1.0
        if unit and name not in (header, remove_unit(header)):
            factor = conversion_factor(unit, unit_in_run)
        if factor is None:
            hint = suggest_unit(unit, unit_in_run) if parse_unit(unit) is None else ""
            raise BeamdaeError(
                f"{part}: the column {name_in_data!r} of data is in {unit}{hint}, but the model "
                f"observes it in {unit_in_run}; convert the values and name the column {header!r}."
            )
        source = Source(experiment, header, name, name_in_data, float(factor))
        matched[experiment, header] = source, _read_values(part, measured.name, source, rows)
    if not matched:
        listed = list_first(list(unknown.values()))
        example = next((x for xs in headers.values() for x in xs if x != TIME), "tip.y [m]")
        raise BeamdaeError(
            f"{part}: {measured.name} must contain values of a column of the run, got {listed}; "
            f"name them as in the table of the run, such as {example!r}, or map them, as with "
            f"data_columns={{{next(iter(unknown))!r}: {remove_unit(example)!r}}}."
        )
    filled = [(source, rows) for source, rows in matched.values() if len(rows)]
    if not filled:
        raise BeamdaeError(f"{part}: {measured.name} contains no values; fill in measured values.")
    whole = pd.concat([rows for _, rows in filled], ignore_index=True)
    data = MeasuredData(whole, tuple(x for x, _ in filled), measured.has_sigma)
    return data, list(unknown.values())


def _read_values(part: str, name: str, source: Source, rows: pd.DataFrame) -> pd.DataFrame:
    """Return the values of a source in the units of the run, after checks of times and `sigma`."""
    values = _as_numbers(part, rows[VALUE], source.name_in_data, rows[_ROW], name)
    rows = rows.assign(value=values, column=source.header).dropna(subset=VALUE)
    times, sigma = rows[TIME], rows[SIGMA]
    rule = "the times of {name} must be finite, not negative and different"
    checks = [
        (times.isna(), f"{rule}, but row {{row}} has no time; fill it in, or remove the row"),
        (
            times < 0.0,
            f"{rule}, got {{t:g}} s in row {{row}}; remove the rows before the start of the run (t "
            "< 0), or shift the times",
        ),
        (times.diff() <= 0.0, f"{rule}, got {{t:g}} s again in row {{row}}; average such rows"),
        (
            ~(sigma > 0.0),
            "sigma of {name} must be positive, got {sigma:g} in row {row}; fill in all rows, or "
            "remove the column",
        ),
    ]
    for is_wrong, sentence in checks:
        for t, deviation, row in rows[is_wrong][[TIME, SIGMA, _ROW]].itertuples(index=False):
            facts = sentence.format(name=name, row=row, t=t, sigma=deviation)
            raise BeamdaeError(f"{part}: {facts}.")
    rows[[VALUE, SIGMA]] *= source.factor
    return rows[[EXPERIMENT, COLUMN, TIME, VALUE, SIGMA]]


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
    if sigma is not None:
        entries = {ALL_COLUMNS: sigma}
        if isinstance(sigma, Mapping):
            entries = require_mapping("fit", "sigma", sigma, "a number, or numbers by column")
        named = [(source, key) for key in entries for source in data.find(key)]
        keys = dict(named)
        is_complete = set(keys.values()) == set(entries)
        if not (is_complete and len(named) == len(keys) == len(data.sources)):
            columns = dict.fromkeys(x.name for x in data.sources)
            raise BeamdaeError(
                f"fit: sigma must name the observed columns of data, {', '.join(columns)} (also "
                f"without units), got {', '.join(entries) or 'none'}."
            )
        deviations = np.ones(len(data.table))
        for source, rows in data.rows:
            key, value = keys[source], entries[keys[source]]
            label = "sigma" if key == ALL_COLUMNS else f"sigma of {key}"
            with suppress(ValueError):
                value = float(value) if isinstance(value, str) else value
            # Plain numbers are in the unit of the data, texts with a unit in their own.
            factor = 1.0 if isinstance(value, str) else source.factor
            number = convert_text("fit", label, value, split_unit(source.header)[1])
            deviations[rows] = require_positive("fit", label, number) * factor
        data = replace(data, table=data.table.assign(sigma=deviations), is_sigma_known=True)
    elif not measured.has_sigma and len(data.headers) > 1:
        raise BeamdaeError(
            "fit: sigma is required for several columns, because it determines their weights; "
            "pass sigma={name: standard deviation}, or a long table with the column sigma."
        )
    elif not measured.has_sigma:
        # The same column may be in different units in different experiments.
        data = replace(data, table=data.table.assign(sigma=1.0))
    # The energies, which a table of the run contains, are not observed.
    warn_of_columns("fit", measured, data, unknown, "the model does not observe")
    for empty in set(measured.experiments) - set(data.experiments):
        raise BeamdaeError(
            f"fit: the experiment {empty!r} contains no values of observed columns; fill in "
            "measured values, or remove it from the data."
        )
    return data


def warn_of_columns(
    part: str, measured: Measurements, data: MeasuredData, unknown: Sequence[str], reason: str
) -> None:
    """Warn of unknown columns, omitted for a reason (a clause), and of files without units.

    Tables that are not read from files are written in code, where values are in SI units.
    """
    if unknown:
        warn_user(
            f"{part}: {measured.name} contains {list_first(unknown)}, which "
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
