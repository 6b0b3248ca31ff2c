"""Store of outcomes in a results folder: JSON records, CSV trajectories, and a lock."""

from __future__ import annotations

import csv
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import msgspec
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
# The integers of a column of the case table.
_Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]


@dataclass(frozen=True)
class Record:
    """Outcome of a task on disk; for the fields, see `Outcome` and `Task`.

    `counts` are the `values` in the columns of counts of the case table; `columns` and `sha256` are
    the headers and the checksum of the trajectory, if there is one.
    """

    status: Status
    counts: dict[str, _Count | None]
    values: dict[str, float | int | str | bool | None]
    columns: tuple[str, ...] | None
    sha256: str
    measures: dict[str, list[float]]
    frames: dict[str, Any] | None
    read: dict[str, str | None]
    errors: dict[str, float]
    file: str
    time_limit: float | None
    repetitions: int


_FORMAT = Format(FileKind("record", "run the case again"), 10, Record)


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
        columns, digest, file = None, "", ""
        if outcome.rows is not None:
            columns, file = outcome.rows.headers, task.file
            write_bytes(self.folder / "trajectories" / file, outcome.text, durable=False)
            digest = hashlib.sha256(outcome.text).hexdigest()
        record = Record(
            outcome.status,
            {name: x for name, x in outcome.values.items() if name in COUNT_COLUMNS},
            {name: x for name, x in outcome.values.items() if name not in COUNT_COLUMNS},
            columns,
            digest,
            # Tables and plots of large studies need only the measures.
            outcome.measures,
            outcome.frames,
            outcome.read,
            outcome.errors,
            file,
            task.time_limit,
            task.repetitions,
        )
        write_bytes(self.record_path(task), _FORMAT.write(record), durable=False)
        return replace(outcome, file=file, text=b"")

    def load(self, task: Task) -> Outcome | None:
        """Return the stored outcome of a task, or None if there is none that can be used.

        It cannot be used if it is damaged, a file that the run has read has changed, the run was
        unsuccessful under another time limit, or it lacks repetitions or frames of the task.
        """
        try:
            record = _FORMAT.read(self.record_path(task))
            if not _is_usable(task, record):
                return None
            rows = None
            if record.columns is not None:
                path = self.folder / "trajectories" / Path(record.file).name
                if hashlib.sha256(read_bytes(path, TRAJECTORY)).hexdigest() != record.sha256:
                    return None
                rows = Rows(record.columns, path)
        except FileContentError:
            return None
        return Outcome(
            record.status,
            record.counts | record.values,
            rows,
            record.measures,
            record.frames,
            record.read,
            record.errors,
            record.file,
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
