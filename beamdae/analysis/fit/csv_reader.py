"""CSV files of measured data, as spreadsheets and data loggers write them."""

from __future__ import annotations

import csv
import re
import warnings
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from beamdae.errors import BeamdaeError, format_message, short_repr
from beamdae.results.storage.files import unescape_cell

if TYPE_CHECKING:
    import pandas as pd

_COMMENTS = ("#", "%", "//")
# Spreadsheets name the separator of columns in a first line such as "sep=;".
_SEPARATOR_LINE = re.compile(r'"?sep=(.)"?')
_SEPARATORS = (";", "\t", ",")
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?")
_ROW_OF_NUMBERS = re.compile(r"[-+\d.,;\teE ]*\d[-+\d.,;\teE ]*")
_MAX_BYTES = 1_000_000_000
# Column for cells beyond those of the header, such as a separator at the end of each row.
_EXCESS = "\0excess"


def read_csv_table(part: str, path: str, texts: tuple[str, ...], most: int) -> pd.DataFrame:
    """Return the columns of a CSV file by header, without empty columns and comments.

    Columns are separated by semicolons, tabs or commas. Decimal commas are accepted unless commas
    separate the columns. Byte-order marks, all line ends, UTF-8, UTF-16 and Windows encodings are
    accepted. Lines that begin with "#", "%" or "//" are comments; the last one before rows of
    numbers alone is the header, as `numpy.savetxt` writes it.

    Parameters
    ----------
    part
        The calling function, for messages.
    path
        Path of the file.
    texts
        Headers of columns that contain texts, even if they look like numbers.
    most
        Maximum number of rows.

    Raises
    ------
    BeamdaeError
        If the file cannot be read, is larger than 1 GB, has more rows, or is not such a table.
    """
    import pandas as pd

    lines = [x for x in _read_text(part, path).splitlines() if x.strip(" \t")]
    separator = None
    if lines and (match := _SEPARATOR_LINE.fullmatch(lines[0].strip(" "))):
        separator = match[1]
        lines = lines[1:]
    lines = _omit_comments(lines)
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
        cells, *rows = csv.reader(lines, delimiter=separator, skipinitialspace=True)
        headers = [unescape_cell(x.strip()) for x in cells]
        names = [x or f"\0{k}" for k, x in enumerate(headers)]
        if repeated := next((x for x in names if names.count(x) > 1), None):
            raise BeamdaeError(
                f"{part}: {path} contains the column {short_repr(repeated)} twice; rename one."
            )
        # One empty cell is a separator at the end; more may come from decimal commas.
        long = next((k for k, x in enumerate(rows, 1) if len(x) > len(headers) + 1), None)
        if long is not None:
            raise _table_error(part, path, f"row {long} has more cells than the header")
        numbers = [k for k, x in enumerate(headers) if x not in texts]
        has_commas = separator != "," and _has_decimal_commas(part, path, rows, numbers)
        with warnings.catch_warnings():
            # Cells beyond those of the header are not dropped.
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                StringIO("\n".join(lines[1:])),
                sep=separator,
                decimal="," if has_commas else ".",
                header=None,
                names=[*names, _EXCESS],
                index_col=False,
                skipinitialspace=True,
                # Names of experiments are texts, even if they are numbers.
                dtype={x: str for x in names if x in texts},
                keep_default_na=True,
                low_memory=False,
            )
    except BeamdaeError:
        raise
    except pd.errors.ParserWarning:
        raise _table_error(part, path, "a row has more cells than the header") from None
    except Exception as problem:  # Of several kinds in pandas: ragged rows, damaged quotes.
        raise _table_error(part, path, format_message(problem)) from None
    return _drop_empty_columns(part, path, table)


def _omit_comments(lines: list[str]) -> list[str]:
    """Return the header and the rows."""
    first = next((k for k, x in enumerate(lines) if not _is_comment(x)), len(lines))
    table = [x for x in lines[first:] if not _is_comment(x)]
    if 0 < first < len(lines) and _ROW_OF_NUMBERS.fullmatch(table[0]):
        table = [lines[first - 1].lstrip(' "#%/'), *table]
    return table


def _is_comment(line: str) -> bool:
    return line.lstrip(' "').startswith(_COMMENTS)


def _has_decimal_commas(part: str, path: str, rows: list[list[str]], columns: list[int]) -> bool:
    """Return True if numbers have decimal commas; reject files that also have decimal points."""
    cells = [row[k].strip() for row in rows for k in columns if k < len(row)]
    comma = next((x for x in cells if _DECIMAL_COMMA.fullmatch(x)), None)
    point = None if comma is None else next((x for x in cells if _DECIMAL_POINT.fullmatch(x)), None)
    if point is not None:
        raise _table_error(part, path, f"it contains the numbers {comma} and {point}")
    return comma is not None


def _drop_empty_columns(part: str, path: str, table: pd.DataFrame) -> pd.DataFrame:
    """Drop columns without header and values; reject columns with values only."""
    for k, name in enumerate(map(str, table)):
        if name.startswith("\0") and table[name].notna().any():
            row = int(table[name].notna().to_numpy().argmax()) + 1
            problem = (
                f"row {row} has more cells than the header"
                if name == _EXCESS
                else f"column {k + 1} has values but no header"
            )
            raise _table_error(part, path, problem)
    return table[[x for x in table if not str(x).startswith("\0")]]


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
