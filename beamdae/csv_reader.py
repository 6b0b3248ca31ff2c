"""CSV files of measured data, as spreadsheets and data loggers write them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from beamdae.errors import BeamdaeError, InputWarning, format_message, short_repr, warn_user
from beamdae.input_files import register_input

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
_ROW_OF_NUMBERS = re.compile(r"[-+\d.,;\teE ]*\d[-+\d.,;\teE ]*")
_MISSING = {"", "nan", "na", "n/a", "#n/a", "null"}  # in lower case
_MAX_BYTES = 1_000_000_000


def read_csv_table(
    part: str, path: str, most: int, texts: tuple[str, ...] = ()
) -> dict[str, list[str]]:
    """Return the cells of a CSV file by header, without empty columns, empty lines and comments.

    Columns are separated by semicolons, tabs or commas. Decimal commas are accepted unless commas
    separate the columns, and become decimal points. Byte-order marks, all line ends, UTF-8, UTF-16
    and Windows encodings are accepted. Lines that begin with "#", "%" or "//" are comments. Before
    rows of numbers alone, the one with as many cells as the first row is the header, as
    `numpy.savetxt` writes it; of several, the only one with units. Missing cells at the end of a
    row are empty.

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
    separator = None
    if lines and (match := _SEPARATOR_LINE.fullmatch(lines[0].strip(" "))):
        separator = match[1]
        lines = lines[1:]
    lines = _omit_comments(part, path, lines, separator)
    if not lines:
        raise BeamdaeError(f"{part}: {path} is empty; write a table with a header.")
    if len(lines) > most + 1:
        raise BeamdaeError(
            f"{part}: {path} has {len(lines) - 1} rows, more than {most}; average or omit some of "
            "them."
        )
    separator = separator or next((x for x in _SEPARATORS if x in lines[0]), None)
    if separator is None:
        raise BeamdaeError(
            f"{part}: {path} has no separators of columns in its header {short_repr(lines[0])}; "
            "separate the columns by commas, semicolons or tabs."
        )
    try:
        cells, *rows = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    except csv.Error as problem:
        raise _table_error(part, path, format_message(problem)) from None
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


def _omit_comments(part: str, path: str, lines: list[str], separator: str | None) -> list[str]:
    """Return the header and the rows."""
    first = next((k for k, x in enumerate(lines) if not _is_comment(x)), len(lines))
    table = [x for x in lines[first:] if not _is_comment(x)]
    if 0 < first < len(lines) and _ROW_OF_NUMBERS.fullmatch(table[0]):
        comments = [x.lstrip(' "#%/') for x in lines[:first]]
        separator = separator or next((x for x in _SEPARATORS if x in table[0]), ",")
        count = table[0].rstrip(f" {separator}").count(separator)
        headers = [x for x in comments if x.rstrip(f" {separator}").count(separator) == count]
        if len(headers) > 1:
            headers = [x for x in headers if _UNIT_IN_HEADER.search(x)] or headers
        if len(headers) > 1:
            raise BeamdaeError(
                f"{part}: several comments of {path} may be the header: {short_repr(headers[0])} "
                f"and {short_repr(headers[1])}; write one header without '#' above the numbers."
            )
        table = [*(headers or comments[-1:]), *table]
    return table


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
