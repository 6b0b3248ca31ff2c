"""Result files: atomic writing of text, bytes and CSV tables with their JSON metadata."""

from __future__ import annotations

import csv
import errno
import json
import os
import platform
import re
import secrets
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson

from beamdae.deferred import installed_version
from beamdae.errors import (
    BeamdaeError,
    format_message,
    is_valid_path,
    path_as_text,
    require_choice,
    short_repr,
)
from beamdae.input_files import register_output, require_output

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.results.outcome import Status

# Names of scratch files contain the id and the host name of the writing process.
_SCRATCH = re.compile(r"\.(?P<process>\d+)@(?P<node>[^@]*)@[0-9a-f]+\.scratch(\.\w+)?")
# Spreadsheets read text that starts with these (half- or full-width) characters as a formula.
_FORMULA = re.compile("'*[=+\\-@\t\r＝＋－＠]")  # noqa: RUF001
_NOT_INSTALLED = "not installed"
_SEPARATORS = (",", ";", "\t")
_DECIMAL_SIGNS = (".", ",")
_BLOCK_ROWS = 10_000  # of a table that are formatted together
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(inf|nan)")


def write_result(
    path: Any,
    columns: Mapping[str, Any],
    status: Status,
    metadata: Mapping[str, Any],
    sep: Any = ",",
    decimal: Any = ".",
) -> Path:
    """Write the CSV and JSON files of `to_csv`.

    If the run did not succeed, a last column "status" is added to the table.

    Raises
    ------
    BeamdaeError
        If `path` is not a file path, its suffix is .json, `sep` or `decimal` is invalid, an entry
        of `metadata` is not a JSON value, or a file cannot be written.
    """
    file = require_file_path("to_csv", path)
    sep, decimal = _require_signs(sep, decimal)
    if not status.success:
        rows = len(next(iter(columns.values())))
        columns = {**columns, "status": np.full(rows, status.kind)}
    return write_table(file, columns, metadata, sep, decimal)


def _require_signs(sep: Any, decimal: Any) -> tuple[str, str]:
    """Return the separator of columns and the decimal sign of a method `to_csv`."""
    sep = require_choice("to_csv", "sep", sep, _SEPARATORS)
    decimal = require_choice("to_csv", "decimal", decimal, _DECIMAL_SIGNS)
    if sep == decimal:
        raise BeamdaeError(
            "to_csv: sep and decimal must differ, got ',' for both; write sep=';' for spreadsheets "
            "with decimal commas."
        )
    return sep, decimal


def write_table(
    path: Path,
    columns: Mapping[str, Any],
    metadata: Mapping[str, Any],
    sep: str = ",",
    decimal: str = ".",
) -> Path:
    """Write a table as CSV and its metadata to a JSON file of the same name.

    Headers and strings are escaped by `escape_cell`, and NaN is written as an empty cell. The entry
    "written", the current time, is added to the metadata, and the installed package versions if the
    metadata have no entry "versions".

    Returns
    -------
    Path
        Path of the CSV file.

    Raises
    ------
    BeamdaeError
        If the suffix of the path is .json, an entry of `metadata` is not a JSON value, or a file
        cannot be written.
    """
    if path.suffix == ".json":
        raise BeamdaeError(f"{path}: the suffix .json is reserved for the metadata; use .csv.")
    text = _format_metadata(metadata)
    # Both files are complete on disk before either of them is replaced.
    with atomic_write(path.with_suffix(".json")) as sidecar:
        sidecar.write_text(text, encoding="utf-8")
        with atomic_write(path) as scratch:
            _write_columns(scratch, columns.items(), sep, decimal)
    return path


def write_metadata(path: Path, metadata: Mapping[str, Any]) -> None:
    """Replace the JSON metadata of the table at `path`, see `write_table`."""
    write_text(path.with_suffix(".json"), _format_metadata(metadata))


def _format_metadata(metadata: Mapping[str, Any]) -> str:
    # The versions of a saved run are those with which it was computed.
    origin = {
        "versions": metadata.get("versions", versions()),
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    for name, value in metadata.items():
        try:
            json.dumps({name: value})
        except (TypeError, ValueError, RecursionError) as problem:
            raise BeamdaeError(
                f"to_csv: the entry {short_repr(name)} must be a JSON value (text, numbers, lists "
                f"and dictionaries), got {short_repr(value)} ({format_message(problem)}); convert "
                "it, for example an array with tolist()."
            ) from None
    return json.dumps({**metadata, **origin}, indent=2) + "\n"


def _write_columns(
    path: Path, columns: Iterable[tuple[Any, Any]], sep: str = ",", decimal: str = "."
) -> None:
    """Write pairs of header and values as CSV in the format of pandas, without importing pandas."""
    pairs = list(columns)
    arrays = [np.asarray(x) for _, x in pairs]
    with open(path, "w", encoding="utf-8", errors="backslashreplace", newline="") as file:
        writer = csv.writer(file, delimiter=sep, lineterminator=os.linesep)
        writer.writerow(escape_cell(header) for header, _ in pairs)
        if arrays and all(array.dtype.kind == "f" for array in arrays):
            signs = str.maketrans({",": sep, ".": decimal})
            for first in range(0, len(arrays[0]), _BLOCK_ROWS):
                block = [array[first : first + _BLOCK_ROWS] for array in arrays]
                text = format_rows(np.column_stack(block)).translate(signs)
                file.write(text.replace("\n", os.linesep))
            return
        cells = [[_format_cell(x, decimal) for x in array.tolist()] for array in arrays]
        writer.writerows(zip(*cells, strict=True))


def format_rows(rows: np.ndarray) -> str:
    """Return rows of numbers (k, columns) as lines of comma-separated values.

    Numbers have the shortest text that is read back as the same number; NaN is empty.
    """
    if np.isinf(rows).any():
        # JSON has no infinity.
        lines = (",".join(map(repr, row)) for row in rows.tolist())
        return "".join(f"{line}\n" for line in lines).replace("nan", "")
    text = orjson.dumps(np.ascontiguousarray(rows), option=orjson.OPT_SERIALIZE_NUMPY).decode()
    lines_of_text = text[2:-2].replace("],[", "\n").replace("null", "")
    return f"{lines_of_text}\n" if len(rows) else ""


def _format_cell(value: Any, decimal: str) -> Any:
    if isinstance(value, float):
        return "" if value != value else repr(value).replace(".", decimal)
    return escape_cell(value)


def write_escaped_table(
    path: str | Path, table: pd.DataFrame, sep: Any = ",", decimal: Any = "."
) -> Path:
    """Write a table for a method `to_csv` and return the path; texts are escaped by `escape_cell`.

    Raises
    ------
    BeamdaeError
        If the path, `sep` or `decimal` is invalid, or the file cannot be written.
    """
    file = require_file_path("to_csv", path)
    signs = _require_signs(sep, decimal)
    # Integers and booleans with missing values become objects.
    columns = (
        (h, x.astype(object).where(x.notna(), None) if x.hasnans else x) for h, x in table.items()
    )
    with atomic_write(file) as scratch:
        _write_columns(scratch, columns, *signs)
    return file


def escape_cell(value: Any) -> Any:
    """Return a cell of a table that spreadsheets, R and pandas read as the value.

    Strings that begin with =, +, - or @ (half- or full-width), a tab or a carriage return, even
    after apostrophes, and are neither numbers nor the unit "-" would be read as formulas and are
    prefixed with an apostrophe; line breaks become spaces. R reads True and False as texts, so they
    become TRUE and FALSE. Other values are returned unchanged.
    """
    if isinstance(value, (bool, np.bool_)):
        return str(value).upper()
    if not isinstance(value, str):
        return value
    is_formula = value != "-" and _FORMULA.match(value) and not _NUMBER.fullmatch(value)
    line = " ".join(value.splitlines())
    return f"'{line}" if is_formula else line


def unescape_cell(value: Any) -> Any:
    """Remove the apostrophe that `escape_cell` has added to a string; return others unchanged."""
    is_escaped = isinstance(value, str) and value[:1] == "'" and escape_cell(value[1:]) == value
    return value[1:] if is_escaped else value


def require_file_path(name: str, path: Any) -> Path:
    """Return `path` as a `Path`.

    Raises
    ------
    BeamdaeError
        If `path` is not the path of a file; the message begins with `name`.
    """
    text = path_as_text(path) or ""
    if not (is_valid_path(text) and Path(text).name):
        raise BeamdaeError(f"{name}: path must be the path of a file, got {short_repr(path)}.")
    return Path(text)


def write_text(path: Path, text: str) -> Path:
    """Write a text as UTF-8 with `atomic_write` and return the path.

    Line endings are not translated. Characters that UTF-8 cannot encode (lone surrogates) are
    written as backslash escapes.

    Raises
    ------
    BeamdaeError
        If the file cannot be written.
    """
    return write_bytes(path, text.encode("utf-8", errors="backslashreplace"))


def write_bytes(path: Path, content: bytes, durable: bool = True) -> Path:
    """Write bytes with `atomic_write` and return the path; see there for `durable`."""
    with atomic_write(path, durable) as scratch:
        scratch.write_bytes(content)
    return path


@contextmanager
def atomic_write(path: Path, durable: bool = True, kind: str = "") -> Iterator[Path]:
    """Yield a scratch file that replaces the file at `path` when the block ends.

    The folder of `path` is created if needed. If the block raises any exception, including
    KeyboardInterrupt, the file at `path` is unchanged and the scratch file is removed; those of
    killed processes are removed with the first file that is written to their folder. Permissions of
    an existing file are preserved. If `path` is a symbolic link, the link is replaced and its
    target is unchanged; links to folders in the path are followed. Devices and pipes, and links of
    the system such as /dev/stdout, are written directly. A file that is not `durable` may be empty
    after a power failure.

    Raises
    ------
    BeamdaeError
        If the file is an input, see `require_output`, or cannot be written, or the block raises an
        OSError.
    """
    owner = f"{os.getpid()}@{platform.node()}"
    try:
        # The working folder, to which relative paths refer, may have been deleted.
        target = Path(os.path.realpath(path.parent), path.name)
        scratch = target.with_name(f".{owner}@{secrets.token_hex(8)}.scratch")
        target.parent.mkdir(parents=True, exist_ok=True)
        if _is_written_directly(target):
            yield target
            return
        require_output(target, kind=kind)
        _remove_stale_scratch_files(target.parent)
        scratch.touch(exist_ok=False)
        try:
            yield scratch
            if durable:
                # Otherwise the renamed file could reach the disk before its content. Some file
                # systems report a full disk only here.
                with open(scratch, "rb+") as file:
                    os.fsync(file.fileno())
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            if target.is_file() and not target.is_symlink():
                if not os.access(target, os.W_OK):
                    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
                scratch.chmod(target.stat().st_mode & 0o777)
            os.replace(scratch, target)
            if durable:
                register_output(target)
        finally:
            with suppress(OSError):
                scratch.unlink(missing_ok=True)
    except OSError as problem:
        raise describe_write_error(path, problem) from problem


def is_in_deleted_folder(path: Path) -> bool:
    """Return True if a path is relative and the working folder has been deleted."""
    if path.is_absolute():
        return False
    try:
        Path.cwd()
    except OSError:
        return True
    return False


def describe_write_error(path: Path, problem: OSError) -> BeamdaeError:
    """Return the error for a file that cannot be written."""
    reason = problem.strerror or problem
    if is_in_deleted_folder(path):
        reason = "the working folder has been deleted"
    return BeamdaeError(f"{path}: the file cannot be written: {reason}.")


def _is_written_directly(target: Path) -> bool:
    """Return True for devices, pipes and sockets, and for links of the system."""
    if target.is_symlink():
        # Such as /dev/stdout and /dev/fd/1.
        return str(target.parent) in ("/dev", f"/proc/{os.getpid()}/fd")
    return target.exists() and not (target.is_file() or target.is_dir())


@cache
def _remove_stale_scratch_files(folder: Path) -> None:
    """Remove scratch files of killed processes of this machine, once in each folder."""
    for path in folder.glob(".*.scratch*"):
        name = _SCRATCH.fullmatch(path.name)
        if name and name["node"] == platform.node() and not _is_running(int(name["process"])):
            with suppress(OSError):
                path.unlink()


def _is_running(process: int) -> bool:
    if os.name == "nt":
        # Windows has no signal 0, so only the current process is known to be running.
        return process == os.getpid()
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


@cache
def versions() -> dict[str, str]:
    """Return the versions of beamdae and of the packages that affect numerical results.

    The version of a package that is missing is "not installed".
    """
    names = ("beamdae", "casadi", "scikit-sundae", "numpy", "scipy")
    return {name: installed_version(name) or _NOT_INSTALLED for name in names}
