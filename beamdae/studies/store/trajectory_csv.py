"""CSV format of trajectories, written and parsed without loss of precision."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np
import pandas as pd

from beamdae.results.storage.files import escape_cell

_DIGITS = b"0123456789"
_NOT_SEPARATORS = bytes(k for k in range(256) if k not in b",\n")
# Numbers without their digits, as `repr` writes them.
_NUMBER_PATTERNS = {
    sign + rest
    for sign in (b"", b"-")
    for rest in (b"", b".", b".e-", b".e+", b"e-", b"e+", b"inf")
}
_ZEROS = bytes.maketrans(_DIGITS, b"0" * len(_DIGITS))
# Parts of numbers that lack a digit, or have one in the wrong place, with zeros for all digits.
_WRONG_PARTS = tuple(b",. -. ,e -e .e -, +, 0- 0+ 0i f0 ,+".split())


def format_trajectory(table: pd.DataFrame) -> bytes:
    """Return a table of floats as CSV.

    Except for escaped headers (see `escape_cell`), the result equals the output of
    `DataFrame.to_csv`, which takes twice as long.
    """
    text = io.StringIO()
    text.write(_format_headers(str(table.index.name), [str(c) for c in table]))
    rows = np.column_stack([table.index, table]).astype(float).tolist()
    numbers = repr(rows)[2:-2].replace("], [", "\n").replace(", ", ",").replace("nan", "")
    text.write(f"{numbers}\n")
    return text.getvalue().encode(errors="replace")


def _format_headers(index: str, columns: Sequence[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([index, *map(escape_cell, columns)])
    return text.getvalue()


def read_times(content: bytes, index: str, columns: Sequence[str]) -> np.ndarray:
    """Return the times (k,) [s] of a trajectory after checking the format of all its cells.

    Checking takes a tenth of the time of parsing, and parsing cannot fail afterwards.

    Parameters
    ----------
    content
        Content of the file.
    index, columns
        Expected headers of the times and of the other columns.

    Raises
    ------
    ValueError
        If the headers differ, or the rows do not have one number or empty cell per column.
    """
    headers = _format_headers(index, columns).encode(errors="replace")
    if not content.startswith(headers):
        raise ValueError("does not begin with the headers of the record")
    # The newline in front of the first cell is included.
    body = content[len(headers) - 1 :]
    row = b"," * len(columns) + b"\n"
    rows = body.count(b"\n") - 1
    if body.translate(None, _NOT_SEPARATORS) != b"\n" + row * rows or not body.endswith(b"\n"):
        raise ValueError("does not have one cell per column in each row")
    cells = body.replace(b"\n", b",")
    patterns = set(cells.translate(None, _DIGITS).split(b","))
    zeros = cells.translate(_ZEROS)
    if not patterns <= _NUMBER_PATTERNS or any(x in zeros for x in _WRONG_PARTS):
        raise ValueError("contains cells that are not numbers")
    first_cells = [line.partition(b",")[0] for line in body.split(b"\n")[1:-1]]
    if not all(first_cells):
        raise ValueError("has rows without a time")
    return np.array([float(cell) for cell in first_cells])


def parse_trajectory(content: bytes, columns: Sequence[str]) -> pd.DataFrame:
    """Return the table written by `format_trajectory`; `columns` are the unescaped headers."""
    text = io.StringIO(content.decode(), newline="")
    index, *_ = next(csv.reader(text))
    # float() rounds correctly, unlike the default parser of pandas.
    lines = text.read().split()
    cells = ",".join(lines).split(",") if lines else []
    numbers = np.array([float(x or "nan") for x in cells]).reshape(-1, 1 + len(columns))
    times = pd.Index(numbers[:, 0], name=index)
    return pd.DataFrame(numbers[:, 1:], times, pd.Index(columns))
