"""Store of outcomes on disk: JSON records and CSV trajectories, each written atomically."""

from __future__ import annotations

import csv
import hashlib
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, FileContentError
from beamdae.results.outcome import Status
from beamdae.results.storage.documents import Format
from beamdae.results.storage.files import (
    atomic_write,
    escape_cell,
    format_rows,
    remove_stale_scratch_files,
    write_bytes,
)
from beamdae.results.storage.reader import FileKind, open_regular_file, read_bytes
from beamdae.studies.store.file_reads import changed_files
from beamdae.studies.tasks import (
    Limits,
    Outcome,
    Task,
    shared_measures,
    shared_table,
    trajectory_columns,
)

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@dataclass(frozen=True)
class StoredRows:
    """Trajectory beside a record: its checksum, columns, and the measures of these columns."""

    sha256: str
    columns: list[str]
    measures: dict[str, list[float]]


@dataclass(frozen=True)
class Record:
    """Outcome of a task on disk; for the fields, see `Outcome` and `Task`."""

    status: Status
    values: dict[str, float | int | str | bool | None]
    rows: StoredRows | None
    frames: dict[str, Any] | None
    read: dict[str, str | None]
    limits: Limits
    repetitions: int


_FORMAT = Format(FileKind("record", "run the case again"), 4, Record)
_TRAJECTORY = FileKind("trajectory", "run the case again")


@dataclass(frozen=True)
class Store:
    """Outcomes on disk, by the key of the task.

    `folder`/outcomes contains the records and trajectories. `folder`/trajectories contains the
    trajectories under readable names, as hard links if the file system supports them.
    """

    folder: Path

    def record_path(self, task: Task) -> Path:
        """Return the path of the record of a task."""
        return self.folder / "outcomes" / f"{task.key}.json"

    def rows_path(self, task: Task) -> Path:
        """Return the path of the stored trajectory of a task."""
        return self.record_path(task).with_suffix(".csv")

    def trajectory_path(self, task: Task) -> Path:
        """Return the path of the trajectory of a task under its readable name."""
        return self.folder / "trajectories" / f"{task.name or task.key}.csv"

    def save(self, task: Task, outcome: Outcome) -> Outcome:
        """Write an outcome; return it with the name of its trajectory file, without `text`.

        The record is written last: if the record exists, the trajectory is complete. The record
        contains checksums of the trajectory and of the other entries of the record.

        The files are not flushed to the disk, which would take as long as a short run: after a
        power failure, the checksums show which runs must be repeated.

        Raises
        ------
        BeamdaeError
            If a file cannot be written. Existing files are not damaged.
        """
        rows, columns = None, trajectory_columns(outcome)
        if columns is not None:
            text = outcome.text or _format_table(outcome)
            source = write_bytes(self.rows_path(task), text, durable=False)
            _link_trajectory(source, self.trajectory_path(task), text)
            rows = {
                "sha256": hashlib.sha256(text).hexdigest(),
                # The CSV file escapes some headers.
                "columns": columns,
                # Tables and plots of large studies need only these numbers.
                "measures": shared_measures(outcome),
            }
        content = {
            "status": asdict(outcome.status),
            "values": outcome.values,
            "rows": rows,
            "frames": outcome.frames,
            "read": outcome.read,
            "limits": asdict(task.limits),
            "repetitions": task.repetitions,
        }
        write_bytes(self.record_path(task), _FORMAT.write(content), durable=False)
        file = outcome.file if rows is None else self.trajectory_path(task).name
        return replace(outcome, file=file, text=b"")

    def load(self, task: Task) -> tuple[Outcome | None, str]:
        """Return the stored outcome of a task or None, and a message about damaged files or "".

        The outcome is None without a message if no outcome is stored, if a file that the run has
        read has changed, if the run was unsuccessful under other limits, or if the record lacks
        repetitions or frames that the task requires.

        Raises
        ------
        BeamdaeError
            If a folder of the store is a link, the path of a file is a folder, or the trajectory
            cannot be written under its readable name.
        """
        # Paths are composed once, because this takes as long as reading a file.
        record, rows_path = self.record_path(task), self.rows_path(task)
        link = self.trajectory_path(task)
        for folder in (record.parent, link.parent):
            if folder.is_symlink():
                raise BeamdaeError(
                    f"{folder}: the path must be a folder, but is a link; remove the link."
                )
        for path in (record, rows_path, link):
            if path.is_dir():
                raise BeamdaeError(
                    f"{path}: the path must be a file, but is a folder; remove the folder."
                )
        try:
            content = _FORMAT.read(record) if os.path.lexists(record) else None
            if content is None or not _is_usable(task, content):
                return None, ""
            rows = None if content.rows is None else _read_rows(rows_path, link, content)
        except FileContentError as problem:
            return None, f"{problem.path.name}: {problem.problem}"
        outcome = Outcome(
            content.status,
            content.values,
            rows,
            content.frames,
            content.read,
            "" if rows is None else link.name,
            _measures={} if content.rows is None else content.rows.measures,
        )
        return outcome, ""

    def remove_scratch_files(self) -> None:
        """Remove unfinished files left by processes that have ended."""
        for folder in (self.folder, self.folder / "outcomes", self.folder / "trajectories"):
            remove_stale_scratch_files(folder)


def _read_rows(path: Path, link: Path, record: Record) -> Callable[[], pd.DataFrame]:
    """Check that the trajectory at `path` is unchanged, and restore its readable name, `link`.

    Return a function that parses the text, because most tables of large studies are not used, and
    the file may change later.
    """
    assert record.rows is not None
    csv_text = read_bytes(path, _TRAJECTORY)
    if hashlib.sha256(csv_text).hexdigest() != record.rows.sha256:
        raise _TRAJECTORY.error(path, "the trajectory has changed since it was written")
    _link_trajectory(path, link, csv_text)
    return partial(_parse_trajectory, csv_text, record.rows.columns)


def format_trajectory(columns: Sequence[str], numbers: Array) -> bytes:
    """Return times and columns, (k, 1 + columns), as CSV text in UTF-8 without loss of precision.

    Headers that a spreadsheet would evaluate are escaped.
    """
    head = StringIO()
    csv.writer(head, lineterminator="\n").writerow([TIME, *map(escape_cell, columns)])
    return (head.getvalue() + format_rows(numbers)).encode(errors="replace")


def _format_table(outcome: Outcome) -> bytes:
    table = shared_table(outcome)
    assert table is not None
    return format_trajectory(list(map(str, table)), table.reset_index().to_numpy(float))


def _parse_trajectory(text: bytes, columns: list[str]) -> pd.DataFrame:
    """Return the table of `format_trajectory`, whose checksum is right."""
    import pandas as pd

    body = text.partition(b"\n")[2].replace(b"\n", b",")
    cells = np.array([cell or b"nan" for cell in body.split(b",")[:-1]], bytes)
    numbers = cells.astype(float).reshape(-1, 1 + len(columns))
    return pd.DataFrame(numbers[:, 1:], pd.Index(numbers[:, 0], name=TIME), columns)


def _link_trajectory(source: Path, path: Path, text: bytes) -> None:
    with suppress(OSError):
        if path.samefile(source):
            return
        with open_regular_file(path) as stream:
            # One byte more than expected shows whether the file is longer.
            if stream.read(len(text) + 1) == text:
                return
    with suppress(OSError):
        # A link to a new name is created at once or not at all.
        os.link(source, path)
        return
    with atomic_write(path) as scratch:
        scratch.unlink()
        try:
            os.link(source, scratch)
        except OSError:  # The file system has no hard links.
            scratch.write_bytes(text)


def _is_usable(task: Task, record: Record) -> bool:
    if changed_files(record.read, task.case.model.home):
        return False
    if not record.status.success:
        return record.limits == task.limits
    return record.repetitions >= task.repetitions and not (task.frames and record.frames is None)
