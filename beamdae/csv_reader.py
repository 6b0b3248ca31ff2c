"""CSV files of measured data, as spreadsheets and data loggers write them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path

import numpy as np

from beamdae.errors import BeamdaeError, InputWarning, format_message, short_repr, warn_user
from beamdae.input_files import register_input
from beamdae.model_parameters import parse_unit, split_unit, standardize_header

_COMMENTS = ("#", "%", "//")
# Spreadsheets name the separator of columns in a first line such as "sep=;".
_SEPARATOR_LINE = re.compile(r'"?sep=(.)"?')
_SEPARATORS = (";", "\t", ",")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
# Spreadsheets write errors, such as #N/A and #DIV/0!, into cells.
_ERROR_IN_CELL = re.compile(r"#(?:N/?[ADV]|[^\W\d_]+(?:/0)?[!?])\"?\s*(?:[;,\t]|$)")
_UNIT_IN_HEADER = re.compile(r"\[[^\]]+\]|\([^)]+\)")
_MAX_LINES_BEFORE_TABLE = 200  # of data loggers
_TIME_STAMP = re.compile(
    r"""(?:(?:(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})
        |(?P<first>\d{1,2})[-/.](?P<second>\d{1,2}|[A-Za-z]{3})[-/.](?P<last>\d{4}|\d{2}))
        (?:[T\s]+|,\s+|$))?
    (?:(?P<clock>\d{1,3}(?::\d{2}){1,2})(?:[.,:](?P<fraction>\d{1,9})\d*)?
        (?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[-+]\d{2}:?\d{2})?)?""",
    re.VERBOSE,
)
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_NANOSECONDS = 10**9
_DAY = 86400 * _NANOSECONDS
_DAYS_OF_FIRST_YEAR = 366  # Times of day without dates count as its first day.
_MISSING = {"", "nan", "na", "n/a", "#n/a", "nat", "none", "null"}  # in lower case
_MAX_BYTES = 1_000_000_000


def read_csv_table(
    part: str, path: str, most: int, texts: tuple[str, ...] = ()
) -> dict[str, list[str]]:
    """Return the cells of a CSV file by header, without empty columns, empty lines and comments.

    Columns are separated by semicolons, tabs or commas. Decimal commas are accepted unless commas
    separate the columns, and become decimal points. Byte-order marks, all line ends, UTF-8, UTF-16
    and Windows encodings are accepted. Lines that begin with "#", "%" or "//" are comments.

    The table begins where a row of numbers or time stamps follows a header with as many cells;
    lines before the header are omitted. A row of units between them completes the header. Without
    such a place, the first line is the header. If only comments precede the first row, the header
    is the one with as many cells, as `numpy.savetxt` writes it; of several, the only one with
    units. Missing cells at the end of a row are empty.

    Parameters
    ----------
    part
        The calling function, for messages.
    path
        Path of the file.
    most
        Maximum number of rows.
    texts
        Headers of columns that contain texts, even if they look like numbers.

    Raises
    ------
    BeamdaeError
        If the file cannot be read, is larger than 1 GB, has more rows, or is not such a table.

    Warns
    -----
    BeamdaeWarning
        If all decimal commas may be separators of thousands, as in 1,200.
    """
    lines = [x for x in _read_text(part, path).splitlines() if x.strip(" \t")]
    separators: Sequence[str] = _SEPARATORS
    if lines and (match := _SEPARATOR_LINE.fullmatch(lines[0].strip(" "))):
        separators = (match[1],)
        lines = lines[1:]
    separator, lines = _find_table(part, path, lines, separators)
    if len(lines) > most + 1:
        raise BeamdaeError(
            f"{part}: {path} has {len(lines) - 1} rows, more than {most}; average or omit some of "
            "them."
        )
    try:
        cells, *rows = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    except csv.Error as problem:
        raise _table_error(part, path, format_message(problem)) from None
    if rows and _is_row_of_units(rows[0]):
        cells = _add_units(cells, rows.pop(0))
    headers = _require_headers(part, path, cells)
    columns = _transpose(part, path, rows, headers)
    numbers = [x for x in columns if x not in texts]
    if separator != "," and _has_decimal_commas(part, path, [columns[x] for x in numbers]):
        for name in numbers:
            columns[name] = [
                x.replace(",", ".") if _DECIMAL_COMMA.fullmatch(x) else x for x in columns[name]
            ]
    return columns


def parse_numbers(cells: Sequence[str]) -> np.ndarray | Sequence[str]:
    """Return the cells of a column as floats, NaN if missing; unchanged if one is not a number."""
    try:
        if any("_" in x for x in cells):  # Python reads 1_000 as a number.
            return cells
        return np.array([float("nan" if x.casefold() in _MISSING else x) for x in cells])
    except ValueError:
        return cells


def read_time_stamps(part: str, name: str, cells: Iterable[str]) -> np.ndarray | None:
    """Return the times [s] after the first of a column of time stamps, NaN if missing.

    None if a cell is not a time stamp, or all are missing. Stamps have a date, a time of day with
    up to nine decimals, or both.

    Raises
    ------
    BeamdaeError
        If the times depend on the order of day and month.

    Warns
    -----
    BeamdaeWarning
        The first time stamp is taken as 0 s.
    """
    texts = [x.strip() for x in cells]
    present = [k for k, x in enumerate(texts) if x.casefold() not in _MISSING]
    stamps = [texts[k] for k in present]
    readings = []
    for is_day_first in (True, False):
        instants = []
        for stamp in stamps:
            instant = _read_time_stamp(stamp, is_day_first)
            if instant is None:
                break
            instants.append(instant)
        else:
            readings.append(_elapsed(instants))
    if not stamps or not readings:
        return None
    if readings[0] != readings[-1]:
        raise BeamdaeError(
            f"{part}: the order of day and month in the time stamps of {name}, such as "
            f"{stamps[0]}, is ambiguous; write dates as 2024-05-31."
        )
    warn_user(
        f"{part}: the first time stamp of {name}, {stamps[0]}, is taken as 0 s; if the run starts "
        "at another time, write times in seconds.",
        InputWarning,
    )
    times = np.full(len(texts), np.nan)
    times[present] = [x / _NANOSECONDS for x in readings[0]]
    return times


def _elapsed(instants: Sequence[int]) -> list[int]:
    """Return the times after the first; times of day without dates may pass midnight."""
    has_dates = instants[0] >= _DAYS_OF_FIRST_YEAR * _DAY if instants else True
    elapsed, days = [], 0
    for before, instant in zip([instants[0], *instants], instants, strict=False):
        days += not has_dates and before - instant > _DAY // 2
        elapsed.append(instant - instants[0] + days * _DAY)
    return elapsed


def _read_time_stamp(text: str, is_day_first: bool) -> int | None:
    """Return a time stamp in nanoseconds; None if the text is not one."""
    match = _TIME_STAMP.fullmatch(text) if ":" in text or text[-1:].isdigit() else None
    if match is None or not text:
        return None
    year, month, day, first, second, last, clock, fraction, half, zone = match.groups()
    try:
        if first is not None:
            year = last if len(last) > 2 else f"20{last}"
            day, month = (first, second) if is_day_first else (second, first)
            if second.isalpha():
                day, month = first, str(_MONTHS.index(second.casefold()) + 1)
        days = date(int(year), int(month), int(day)).toordinal() if year else 0
    except ValueError:
        return None
    numbers = [int(x) for x in clock.split(":")] if clock else [0, 0, 0]
    if len(numbers) < 3:
        # Spreadsheets write 25:10.5 for minutes and seconds.
        numbers = [0, *numbers] if fraction else [*numbers, 0]
    hours, minutes, seconds = numbers
    if half:
        hours = hours % 12 + 12 * (half in "pP")
    if zone and zone[0] in "+-":
        minutes -= int(f"{zone[0]}1") * (60 * int(zone[1:3]) + int(zone[-2:]))
    total = ((days * 24 + hours) * 60 + minutes) * 60 + seconds
    return total * _NANOSECONDS + int((fraction or "").ljust(9, "0"))


def _find_table(
    part: str, path: str, lines: list[str], separators: Sequence[str]
) -> tuple[str, list[str]]:
    """Return the separator of columns, and the lines of the table from its header on."""
    first = next((k for k, x in enumerate(lines) if not _is_comment(x)), len(lines))
    comments = [x.lstrip(' "#%/') for x in lines[:first]]
    table = [x for x in lines[first:] if not _is_comment(x)]
    if not table:
        raise BeamdaeError(f"{part}: {path} is empty; write a table with a header.")
    for separator in separators:
        before: list[list[str]] = []
        for k, line in enumerate(table[:_MAX_LINES_BEFORE_TABLE]):
            cells = _split_line(line, separator)
            if _is_row_of_values(cells):
                if not before and comments:
                    return separator, [
                        *_find_comment(part, path, comments, separator, cells),
                        *table,
                    ]
                header = k - 1 - (len(before) > 1 and _is_row_of_units(before[-1]))
                names = before[header] if header >= 0 else []
                # Names of at least as many columns.
                if len(names) >= len(cells) and not any(map(_is_value, filter(None, names[:1]))):
                    return separator, table[header:]
            before.append(cells)
    chosen = next((x for x in separators if x in table[0]), None)
    if chosen is None:
        raise BeamdaeError(
            f"{part}: {path} has no separators of columns in its header {short_repr(table[0])}; "
            "separate the columns by commas, semicolons or tabs."
        )
    return chosen, table


def _find_comment(
    part: str, path: str, comments: list[str], separator: str, row: Sequence[str]
) -> list[str]:
    """Return the comment that is the header of a row, and the one with its units if there is."""
    headers = [x for x in comments if len(_split_line(x, separator)) == len(row)]
    if len(headers) > 1 and _is_row_of_units(_split_line(headers[-1], separator)):
        return headers[-2:]
    if len(headers) > 1:
        headers = [x for x in headers if _UNIT_IN_HEADER.search(x)] or headers
    if len(headers) > 1:
        raise BeamdaeError(
            f"{part}: several comments of {path} may be the header: {short_repr(headers[0])} "
            f"and {short_repr(headers[1])}; write one header without '#' above the numbers."
        )
    return headers or comments[-1:]


def _split_line(line: str, separator: str) -> list[str]:
    """Return the cells of a line, without empty ones at its end."""
    cells = [
        x.strip() for x in next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    ]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _is_row_of_values(cells: Sequence[str]) -> bool:
    """Return True if the first two cells are numbers or time stamps; the second may be missing."""
    return (
        len(cells) > 1
        and _is_value(cells[0])
        and (cells[1].casefold() in _MISSING or _is_value(cells[1]))
    )


def _is_value(cell: str) -> bool:
    number = cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell
    if cell and isinstance(parse_numbers([number]), np.ndarray):
        return True
    return any(_read_time_stamp(cell, x) is not None for x in (True, False))


def _is_row_of_units(cells: Sequence[str]) -> bool:
    """Return True if the first cell and at least half of all are units, or in brackets."""
    units = [_read_unit(x) is not None for x in cells if x.strip()]
    return bool(units) and units[0] and 2 * sum(units) >= len(units)


def _read_unit(cell: str) -> str | None:
    text = cell.strip()
    unit = text.strip("[]() ")
    is_unit = parse_unit(unit) is not None or (unit and text[0] in "[(")
    return unit if is_unit and not _is_value(unit) else None


def _add_units(headers: Sequence[str], units: Sequence[str]) -> list[str]:
    """Return headers with the units of a row below them, unless they have their own."""
    units = [*units, *[""] * len(headers)]
    return [
        f"{header.strip()} [{unit.strip().strip('[]() ')}]"
        if header.strip() and unit.strip() and not split_unit(standardize_header(header))[1]
        else header
        for header, unit in zip(headers, units, strict=False)
    ]


def _is_comment(line: str) -> bool:
    text = line.lstrip(' "')
    return text.startswith(_COMMENTS) and not _ERROR_IN_CELL.match(text)


def _require_headers(part: str, path: str, cells: Sequence[str]) -> list[str]:
    """Return the headers; "" for columns without one."""
    # Spreadsheets write no-break spaces.
    headers = [x.replace("\xa0", " ").strip() for x in cells]
    if all(isinstance(parse_numbers([x]), np.ndarray) for x in headers):
        raise BeamdaeError(
            f"{part}: {path} has no header; write a first line such as 't [s],force [kN]'."
        )
    for header in headers:
        if not header.isprintable():
            raise BeamdaeError(
                f"{part}: the header {short_repr(header)} of {path} contains unprintable "
                "characters; rename the column."
            )
        if header and headers.count(header) > 1:
            raise BeamdaeError(
                f"{part}: {path} contains the column {short_repr(header)} twice; rename one."
            )
    return headers


def _transpose(
    part: str, path: str, rows: list[list[str]], headers: list[str]
) -> dict[str, list[str]]:
    """Return the cells of each column with a header; reject values without a header."""
    size = len(headers)
    for number, row in enumerate(rows, 1):
        # One empty cell is a separator at the end; more may come from decimal commas.
        if len(row) > size + 1 or (len(row) > size and row[size].strip()):
            raise _table_error(part, path, f"row {number} has more cells than the header")
        row.extend("" for _ in range(size - len(row)))
    columns = {}
    for k, header in enumerate(headers):
        column = [row[k].strip() for row in rows]
        if header:
            columns[header] = column
        elif any(x.casefold() not in _MISSING for x in column):
            raise _table_error(part, path, f"column {k + 1} has values but no header")
    return columns


def _has_decimal_commas(part: str, path: str, columns: list[list[str]]) -> bool:
    """Return True if numbers have decimal commas; reject files that also have decimal points."""
    cells = (x for column in columns for x in column if "," in x)
    commas = [x for x in cells if _DECIMAL_COMMA.fullmatch(x)]
    if not commas:
        return False
    comma = commas[0]
    points = (x for column in columns for x in column if "." in x)
    point = next((x for x in points if _DECIMAL_POINT.fullmatch(x)), None)
    if point is not None:
        raise _table_error(part, path, f"it contains the numbers {comma} and {point}")
    if all(_THOUSANDS.fullmatch(x) for x in commas):
        warn_user(
            f"{part}: numbers of {path} such as {comma} are read with decimal commas, as "
            f"{comma.replace(',', '.')}; omit separators of thousands.",
            InputWarning,
        )
    return True


def _table_error(part: str, path: str, problem: str) -> BeamdaeError:
    return BeamdaeError(
        f"{part}: {path} is not a CSV table: {problem}; write a header for each column, and the "
        "same decimal sign, other than the separator of the columns, in all numbers."
    )


def _read_text(part: str, path: str) -> str:
    """Return the text of a file, whose encoding is found from its bytes."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        register_input(path)
    except OSError as problem:
        reason = problem.strerror or format_message(problem)
        raise BeamdaeError(
            f"{part}: {short_repr(path)} cannot be read: {reason}; check the path."
        ) from None
    if len(content) > _MAX_BYTES:
        raise BeamdaeError(f"{part}: {path} is larger than 1 GB; average or omit some of its rows.")
    encodings = ["utf-16"] if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeError:
            continue
        if "\0" not in text:
            return text
    raise _table_error(part, path, "it is not a text file")
