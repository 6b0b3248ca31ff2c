"""Tables from columns of CSV files, whose units are converted to SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.csv_reader import parse_numbers, read_csv_table, read_time_stamps
from beamdae.errors import (
    BeamdaeError,
    as_text,
    is_valid_path,
    path_as_text,
    require_name,
    require_sequence,
    short_repr,
    suggest,
    warn_user,
)
from beamdae.model_parameters import (
    parse_unit,
    split_unit,
    standardize_header,
    suggest_unit,
)
from beamdae.parts.tables import MAX_AXES, Table, create_table, warn_about_overshoot

Array = np.ndarray

# Units with two usual meanings, whose columns would be wrong by many powers of ten, or by 9810.
_GRAM_OR_GRAVITY = "kg or m/s^2 (gn, the standard gravity)"
_AMBIGUOUS_UNITS = {"g": _GRAM_OR_GRAVITY, "mg": _GRAM_OR_GRAVITY, "nm": "m or N m"}
_MAX_ROWS = 1_000_000


def table_from_csv(
    path: Any,
    x: Any = None,
    y: str | None = None,
    kind: str = "spline",
    outside: str = "hold",
    name: str | None = None,
) -> Table:
    r"""Return a table from columns of a CSV file; units in the header are converted to SI units.

    The file has a header. Its columns are separated by semicolons, tabs or commas; unless these are
    commas, decimal commas are accepted. Headers such as "force [kN]" or "force (kN)" contain the
    unit; columns without a unit are taken in SI units, with a warning, and "[-]" marks numbers
    without dimension. Lines that begin with "#", "%" or "//" are comments.

    Parameters
    ----------
    path
        Path of the file.
    x
        Header of the column of the argument, with or without its unit, or a pair of headers for two
        arguments, whose rows form a complete grid in any order. Defaults to the first column of a
        file with two columns, or to the other one than `y`.
    y
        Header of the column of the values. Defaults to the only column that is not an argument.
    kind, outside
        As in `table`.
    name
        Name of the table in messages and warnings. Defaults to the name of the file.

    Returns
    -------
    Table
        The table, in m, rad, s, N, kg and units derived from them. Its arguments have the names of
        their columns.

    Raises
    ------
    BeamdaeError
        If the file cannot be read, a column is missing or contains a cell that is not a number, a
        unit is unknown, the rows of two arguments do not form a grid, or as in `table`.

    Warns
    -----
    BeamdaeWarning
        As in `table`, with values in SI units; also if a column has no unit, or all decimal commas
        may be separators of thousands, as in 1,200.

    Examples
    --------
    >>> import beamdae as bd
    >>> from pathlib import Path
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "pad.csv"
    >>> _ = file.write_text("travel [mm],force [kN]\n0,0\n5,1\n10,4\n", "utf-8")
    >>> pad = bd.table_from_csv(file, kind="linear")
    >>> pad(0.0075)
    2500.0
    """
    text = path_as_text(path)
    if text is None:
        raise BeamdaeError(f"table_from_csv: path must be a path, got {short_repr(path)}.")
    if not is_valid_path(text):
        raise BeamdaeError(
            f"table_from_csv: the path {short_repr(text)} is too long or contains unprintable "
            "characters; rename the file."
        )
    label = f"table {Path(text).name}" if name is None else require_name("table_from_csv", name)
    columns = read_csv_table("table_from_csv", text, _MAX_ROWS)
    rows = [k for k, row in enumerate(zip(*columns.values(), strict=True)) if any(row)]
    headers = list(columns)
    if x is None and y is not None and len(headers) == MAX_AXES:
        value = _find_header(text, headers, y, "y")
        x = next(header for header in headers if header != value)
    if x is None and len(headers) > MAX_AXES:
        raise BeamdaeError(
            f"{label}: the file has {len(headers)} columns: {', '.join(headers)}; pass x= and y= "
            "with the headers of the argument and of the values."
        )
    if x is None or as_text(x) is not None:
        arguments: list[Any] = [x]
    else:
        arguments = require_sequence("table_from_csv", "x", x, "a header or a pair of headers")
    if len(arguments) not in (1, MAX_AXES):
        raise BeamdaeError(
            f"table_from_csv: x must be a header or a pair of headers, got {short_repr(x)}."
        )
    argument_headers = [
        headers[0] if header is None else _find_header(text, headers, header, "x")
        for header in arguments
    ]
    if y is None:
        others = [header for header in headers if header not in argument_headers]
        if len(others) != 1:
            raise BeamdaeError(
                f"{label}: the file has {len(others)} columns besides {', '.join(argument_headers)}"
                f"{': ' if others else ''}{', '.join(others)}; pass y= with the header of the "
                "values."
            )
        value_header = others[0]
    else:
        value_header = _find_header(text, headers, y, "y")
    *arrays, values = (
        _convert_column(label, header, {k + 1: columns[header][k] for k in rows})
        for header in (*argument_headers, value_header)
    )
    result = create_table(label, *_as_grid(label, arrays, values), kind, outside)
    _warn_about_missing_units(label, [*argument_headers, value_header])
    names = tuple(_split_header(header)[0] for header in argument_headers)
    result = Table(label, result.axes, result.values, kind, outside, names)
    warn_about_overshoot(result)
    return result


def _warn_about_missing_units(label: str, headers: Sequence[str]) -> None:
    missing = [header for header in headers if not _split_header(header)[1]]
    if missing:
        are = "has no unit and is" if len(missing) == 1 else "have no units and are"
        warn_user(
            f"{label}: {', '.join(map(repr, missing))} {are} taken in SI units; write units in the "
            "header, such as 'travel [mm]', or [-] for numbers without dimension."
        )


def _as_grid(label: str, arrays: list[Array], values: Array) -> tuple[Any, Any]:
    if len(arrays) == 1:
        return arrays[0], values
    axes = [np.unique(array) for array in arrays]
    grid = np.full([len(axis) for axis in axes], np.nan)
    grid[tuple(np.searchsorted(a, x) for a, x in zip(axes, arrays, strict=True))] = values
    if np.isnan(grid).any() or len(values) != grid.size:
        raise BeamdaeError(
            f"{label}: the rows must form a grid of {len(axes[0])} by {len(axes[1])} arguments, "
            f"each once, got {len(values)} rows."
        )
    return tuple(axes), grid


def _find_header(path: str, headers: Sequence[str], header: Any, name: str) -> str:
    text = as_text(header)
    matches = [x for x in headers if x == text]
    if text is not None and not matches:
        standard = standardize_header(text)
        matches = [x for x in headers if standardize_header(x) == standard]
        matches = matches or [x for x in headers if _split_header(x)[0] == standard]
    if not matches:
        raise BeamdaeError(
            f"table_from_csv: {name}={short_repr(header)} is not a column of {path}"
            f"{suggest(header, headers)}; its columns are {', '.join(headers)}."
        )
    if len(matches) > 1:
        raise BeamdaeError(
            f"table_from_csv: {name}={short_repr(header)} is the name of several columns of "
            f"{path}: {', '.join(matches)}; pass the header with its unit."
        )
    return matches[0]


def _split_header(header: str) -> tuple[str, str]:
    """Return name and unit of a header 'name [unit]' or 'name (unit)'; '' without a unit."""
    return split_unit(standardize_header(header))


def _convert_column(label: str, header: str, cells: Mapping[int, str]) -> Array:
    """Return the numbers of a column, which is given by rows, in SI units."""
    stamps = read_time_stamps(label, repr(header), cells.values())
    if stamps is not None:
        return stamps
    _, unit = _split_header(header)
    if unit in _AMBIGUOUS_UNITS:
        raise BeamdaeError(
            f"{label}: the unit {unit} of {header!r} is ambiguous; write the values in "
            f"{_AMBIGUOUS_UNITS[unit]}."
        )
    parsed = parse_unit(unit) if unit else (1.0, {})
    if parsed is None:
        raise BeamdaeError(
            f"{label}: the unit of {header!r} is unknown{suggest_unit(unit)}; write a unit such as "
            "mm, deg, ms, rpm, kN or N m, or omit it for values in SI units."
        )
    for row, cell in cells.items():
        number = parse_numbers([cell])
        if not (isinstance(number, np.ndarray) and np.isfinite(number[0])):
            raise BeamdaeError(
                f"{label}: row {row} of {header!r} must be a finite number, got {short_repr(cell)}."
            )
    return np.asarray(parse_numbers([*cells.values()]), float) * float(parsed[0])
