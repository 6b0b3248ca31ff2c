"""Results on disk: files that appear whole or not at all, and tables as CSV."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import platform
import re
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, is_valid_path, short_repr
from beamdae.results.outcome import Status

if TYPE_CHECKING:
    import pandas as pd

# Scratch files tell whose they are.
_SCRATCH = re.compile(r"\.(?P<process>\d+)@(?P<node>[^@]*)@[0-9a-f]+\.scratch")
# What spreadsheets take for the beginning of a formula, in the widths they know.
_FORMULA = re.compile("'*[=+\\-@\t\r＝＋－＠]")  # noqa: RUF001
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)")


def write_table(path: Path, columns: Mapping[str, Any], beside: Mapping[str, Any]) -> Path:
    """Write a table as CSV and what it is the table of, with versions, as JSON beside it.

    Headers and texts go through `escape_cell`; what is no number is left empty. Returns the path of
    the CSV file.

    Raises
    ------
    BeamdaeError
        If a file cannot be written.
    """
    if path.suffix == ".json":
        raise BeamdaeError(f"{path}: the table is CSV, .json is for what is written beside it.")
    text = _json(beside)
    # The two change places one right after the other, once both are on the disk.
    with atomic_write(path.with_suffix(".json")) as sidecar:
        sidecar.write_text(text, encoding="utf-8")
        with atomic_write(path) as scratch:
            _write_columns(scratch, columns)
    return path


def write_result(
    path: Any, columns: Mapping[str, Any], status: Status, beside: Mapping[str, Any]
) -> Path:
    """Write what `to_csv` of a result does: `write_table`, with a column more where it did not succeed.

    Raises
    ------
    BeamdaeError
        If `path` is none of a file, or a file cannot be written.
    """
    file = require_file_path("to_csv", path)
    if not status.success:
        rows = len(next(iter(columns.values())))
        columns = {**columns, "status": np.full(rows, status.kind)}
    return write_table(file, columns, beside)


def require_file_path(name: str, path: Any) -> Path:
    """The path of a file, as an argument of `name`."""
    text = str(path) if isinstance(path, (str, Path)) else ""
    if not (is_valid_path(text) and Path(text).name):
        raise BeamdaeError(f"{name}: path must be that of a file, got {short_repr(path)}.")
    return Path(text)


def write_metadata(path: Path, beside: Mapping[str, Any]) -> None:
    """Write anew what `write_table` wrote as JSON beside the table at `path`; likewise."""
    write_text(path.with_suffix(".json"), _json(beside))


def _json(beside: Mapping[str, Any]) -> str:
    told = {"versions": versions(), "written": datetime.now(UTC).isoformat(timespec="seconds")}
    return json.dumps({**beside, **told}, indent=2) + "\n"


def _write_columns(path: Path, columns: Mapping[str, Any]) -> None:
    """As pandas writes a table, without the time it takes to import."""
    with open(path, "w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        csv.writer(file, lineterminator=os.linesep).writerow(map(escape_cell, columns))
        # Its writer takes twice as long over numbers as these take to be told.
        rows = zip(*(_cells(columns[name]) for name in columns), strict=True)
        file.writelines(",".join(row) + os.linesep for row in rows)


def _cells(values: Any) -> list[str]:
    column = np.asarray(values)
    if column.dtype.kind != "f":
        return [_quoted(escape_cell(value)) for value in column.tolist()]
    return ["" if value != value else repr(value) for value in column.tolist()]


def _quoted(value: Any) -> str:
    cell = io.StringIO()
    # What ends a line is quoted: the writer has to know it.
    csv.writer(cell, lineterminator=os.linesep).writerow([value])
    return cell.getvalue().removesuffix(os.linesep)


def write_text(path: Path, text: str) -> Path:
    """Write a text as UTF-8, as it is, so that the file appears whole or not at all.

    As `atomic_write`, which see; what UTF-8 cannot say (lone surrogates) is written as its escape.
    Returns the path.

    Raises
    ------
    BeamdaeError
        If the file cannot be written.
    """
    return write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def write_bytes(path: Path, content: bytes) -> Path:
    """Write bytes so that the file appears whole or not at all; see `write_text`."""
    with atomic_write(path) as scratch:
        scratch.write_bytes(content)
    return path


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A scratch file beside `path` that takes its place when the block ends.

    The folder is made if need be. A block that ends by an exception, an interrupt included, leaves
    `path` as it was and no scratch file. A file that was there keeps its permissions, a link the
    file it leads to; what is no file, such as a pipe, is written as it is.

    Raises
    ------
    BeamdaeError
        Where the block or what follows it raises an OSError: "<path>: it cannot be written, why."
    """
    target = Path(os.path.realpath(path))
    whose = f"{os.getpid()}@{platform.node()}"
    scratch = target.with_name(f".{whose}@{secrets.token_hex(8)}.scratch")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not (target.is_file() or target.is_dir()):
            yield target
            return
        scratch.touch(exist_ok=False)
        try:
            yield scratch
            _on_the_disk(scratch)
            _take_place(scratch, target)
        finally:
            with suppress(OSError):
                scratch.unlink(missing_ok=True)
    except OSError as problem:
        why = problem.strerror or problem
        raise BeamdaeError(f"{path}: it cannot be written, {why}.") from problem


def remove_stale_scratch_files(folder: Path) -> None:
    """Remove what processes of this machine that have ended left unfinished in a folder."""
    for path in folder.glob(".*.scratch"):
        made = _SCRATCH.fullmatch(path.name)
        if made and made["node"] == platform.node() and not _lives(int(made["process"])):
            with suppress(OSError):
                path.unlink()


def _lives(process: int) -> bool:
    if os.name == "nt":
        # No signal asks there; what is this process's own is not left over.
        return process == os.getpid()
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _on_the_disk(file: Path) -> None:
    # A name may reach the disk before what it names, and a full one may tell only now.
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _take_place(scratch: Path, target: Path) -> None:
    if target.is_file():
        if not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        scratch.chmod(target.stat().st_mode & 0o777)
    os.replace(scratch, target)


def escape_table(table: pd.DataFrame) -> pd.DataFrame:
    """The table with `escape_cell` done to its headers and its cells of text; the index is left."""
    import pandas as pd

    safe = table.rename(columns=escape_cell)
    for k, kind in enumerate(table.dtypes):
        if not pd.api.types.is_numeric_dtype(kind):
            safe.isetitem(k, [escape_cell(value) for value in table.iloc[:, k]])
    return safe


def escape_cell(value: Any) -> Any:
    """The value as a cell of a CSV file which no spreadsheet takes for a formula.

    A text that begins with = + - or @ and is no number gets an apostrophe in front; any other
    value is as it was.
    """
    formula = isinstance(value, str) and _FORMULA.match(value) and not _NUMBER.fullmatch(value)
    return f"'{value}" if formula else value


def unescape_cell(value: Any) -> Any:
    """What `escape_cell` made a cell of."""
    guarded = isinstance(value, str) and value[:1] == "'" and escape_cell(value[1:]) == value
    return value[1:] if guarded else value


@cache
def versions() -> dict[str, str]:
    """Versions of beamdae and of what its numbers depend on."""
    from importlib.metadata import version

    names = ("beamdae", "casadi", "scikit-sundae", "numpy", "scipy")
    return {name: version(name) for name in names}
