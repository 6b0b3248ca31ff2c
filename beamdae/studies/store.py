"""Store of outcomes in a results folder: JSON records, CSV trajectories, and a lock."""

from __future__ import annotations

import csv
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, FileContentError
from beamdae.results.outcome import Status
from beamdae.results.storage.documents import FileKind, Format, read_bytes
from beamdae.results.storage.files import (
    describe_write_error,
    escape_cell,
    format_rows,
    write_bytes,
)
from beamdae.studies.file_reads import changed_files
from beamdae.studies.run_values import COUNT_COLUMNS
from beamdae.studies.tasks import TRAJECTORY, Outcome, Rows, Task

Array = np.ndarray


_LOCK_FILE = ".lock"


@dataclass(frozen=True)
class StoredRows:
    """Trajectory of a record: its file, checksum and columns, and the measures of these columns."""

    file: str
    sha256: str
    columns: tuple[str, ...]
    measures: dict[str, list[float]]


@dataclass(frozen=True)
class Record:
    """Outcome of a task on disk; for the fields, see `Outcome` and `Task`.

    `counts` are the `values` in the columns of counts of the case table.
    """

    status: Status
    counts: dict[str, int | None]
    values: dict[str, float | int | str | bool | None]
    rows: StoredRows | None
    frames: dict[str, Any] | None
    read: dict[str, str | None]
    time_limit: float | None
    repetitions: int


_FORMAT = Format(FileKind("record", "run the case again"), 7, Record)


@dataclass(frozen=True)
class Store:
    """Outcomes on disk: records in `folder`/outcomes and trajectories in `folder`/trajectories.

    The files are not flushed to the disk, which would take as long as a short run: after a power
    failure, the checksums show which runs must be repeated.
    """

    folder: Path

    def record_path(self, task: Task) -> Path:
        """Return the path of the record of a task."""
        return self.folder / "outcomes" / f"{task.key}.json"

    def save(self, task: Task, outcome: Outcome) -> Outcome:
        """Write an outcome; return it with the name of its trajectory file, without `text`.

        The record is written last: if the record exists, the trajectory is complete.

        Raises
        ------
        BeamdaeError
            If a file cannot be written. Existing files are not damaged.
        """
        rows = None
        if outcome.rows is not None:
            write_bytes(self.folder / "trajectories" / task.file, outcome.text, durable=False)
            digest = hashlib.sha256(outcome.text).hexdigest()
            # Tables and plots of large studies need only the measures.
            rows = asdict(StoredRows(task.file, digest, outcome.rows.headers, outcome.measures))
        content = {
            "status": asdict(outcome.status),
            "counts": {k: x for k, x in outcome.values.items() if k in COUNT_COLUMNS},
            "values": {k: x for k, x in outcome.values.items() if k not in COUNT_COLUMNS},
            "rows": rows,
            "frames": outcome.frames,
            "read": outcome.read,
            "time_limit": task.time_limit,
            "repetitions": task.repetitions,
        }
        write_bytes(self.record_path(task), _FORMAT.write(content), durable=False)
        return replace(outcome, file="" if rows is None else task.file, text=b"")

    def load(self, task: Task) -> Outcome | None:
        """Return the stored outcome of a task, or None if there is none that can be used.

        It cannot be used if it is damaged, a file that the run has read has changed, the run was
        unsuccessful under another time limit, or it lacks repetitions or frames of the task.
        """
        try:
            record = _FORMAT.read(self.record_path(task))
            if not _is_usable(task, record):
                return None
            stored, rows = record.rows, None
            if stored is not None:
                path = self.folder / "trajectories" / Path(stored.file).name
                if hashlib.sha256(read_bytes(path, TRAJECTORY)).hexdigest() != stored.sha256:
                    return None
                rows = Rows(stored.columns, path)
        except FileContentError:
            return None
        measures, file = ({}, "") if stored is None else (stored.measures, stored.file)
        return Outcome(
            record.status,
            record.counts | record.values,
            rows,
            measures,
            record.frames,
            record.read,
            file,
        )


def format_trajectory(columns: Sequence[str], numbers: Array) -> bytes:
    """Return times and columns, (k, 1 + columns), as CSV text in UTF-8 without loss of precision.

    Headers that a spreadsheet would evaluate are escaped.
    """
    head = StringIO()
    csv.writer(head, lineterminator="\n").writerow([TIME, *map(escape_cell, columns)])
    return (head.getvalue() + format_rows(numbers)).encode(errors="replace")


def _is_usable(task: Task, record: Record) -> bool:
    if changed_files(record.read, task.case.model.home):
        return False
    if not record.status.success:
        return record.time_limit == task.time_limit
    return record.repetitions >= task.repetitions and not (task.frames and record.frames is None)


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Hold the lock of a results folder, which is created if needed.

    The lock is a file that the system unlocks when the process ends, even if the process is killed;
    the file remains. File systems without locks are not protected.

    Raises
    ------
    BeamdaeError
        If another process runs a study in this folder, the file cannot be created, or an operation
        in the block misses the folder, because it has been deleted.
    """
    path = folder / _LOCK_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as problem:
        raise describe_write_error(path, problem) from problem
    try:
        if not _lock_file(descriptor):
            raise BeamdaeError(
                f"{folder}: another process is running a study in this folder; wait until it ends, "
                "or choose another folder."
            )
        yield
    except FileNotFoundError as problem:
        # Any operation of the study may be the first to miss the folder.
        if folder.is_dir():
            raise
        raise describe_write_error(path, problem) from problem
    finally:
        os.close(descriptor)


def _lock_file(descriptor: int) -> bool:
    """Lock an open file; return False if another process holds the lock.

    If the file system has no locks, return True.
    """
    try:
        import fcntl
    except ImportError:
        return _lock_file_on_windows(descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # The file system has no locks.
        return True
    return True


def _lock_file_on_windows(descriptor: int) -> bool:
    try:
        import msvcrt
    except ImportError:  # A browser has neither locks nor other processes.
        return True
    try:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    except OSError:
        return False
    return True
