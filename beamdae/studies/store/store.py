"""Store of outcomes on disk: JSON records and CSV trajectories, each written atomically."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from operator import methodcaller
from pathlib import Path
from typing import Any, get_args

import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.results.outcome import Kind, Status
from beamdae.results.storage.files import atomic_write, remove_stale_scratch_files, write_bytes
from beamdae.studies.store.file_reads import changed_files
from beamdae.studies.store.trajectory_csv import format_trajectory, parse_trajectory
from beamdae.studies.tasks import Outcome, Task

_FORMAT = 3
_MAX_RECORD_BYTES = 1_000_000_000  # larger files are not records


class _DamagedError(Exception):
    """Raised for a record or trajectory that cannot be used; the message gives the reason."""


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
        """Write an outcome, and return it with the name of its trajectory file.

        The record is written last: if the record exists, the trajectory is complete. The record
        contains checksums of the trajectory and of the other entries of the record.

        Raises
        ------
        BeamdaeError
            If a file cannot be written. Existing files are not damaged.
        """
        rows, table = None, outcome.table
        if table is not None:
            text = outcome.text or format_trajectory(table)
            write_bytes(self.rows_path(task), text)
            self._link_trajectory(task, text)
            rows = {
                "sha256": hashlib.sha256(text).hexdigest(),
                # The CSV file escapes some headers.
                "columns": [str(c) for c in table],
            }
            outcome = replace(outcome, file=self.trajectory_path(task).name)
        content = {
            "status": asdict(outcome.status),
            "values": outcome.values,
            "rows": rows,
            "frames": outcome.frames,
            "read": outcome.read,
            "limits": asdict(task.limits),
            "repetitions": task.repetitions,
        }
        # Convert NumPy scalars to Python numbers.
        content = json.loads(json.dumps(content, default=methodcaller("item")))
        record = {"format": _FORMAT, "sha256": _checksum(content), "outcome": content}
        write_bytes(self.record_path(task), f"{json.dumps(record)}\n".encode())
        return replace(outcome, text=b"")

    def load(self, task: Task) -> tuple[Outcome | None, str]:
        """Return the stored outcome of a task or None, and a message about damaged files or "".

        The outcome is None without a message if no outcome is stored, if a file that the run has
        read has changed, if the run was unsuccessful under other limits, or if the record lacks
        repetitions or frames that the task requires.

        Raises
        ------
        BeamdaeError
            If the path of a file is a folder, or the link to the trajectory cannot be written.
        """
        for path in (self.record_path(task), self.rows_path(task), self.trajectory_path(task)):
            if path.is_dir():
                raise BeamdaeError(
                    f"{path}: the path must be a file, but is a folder; remove the folder."
                )
        try:
            content = self._load_content(task)
            if content is None or not _is_usable(task, content):
                return None, ""
            rows = None
            if content["rows"] is not None:
                rows = _StoredRows(
                    self.rows_path(task), self.trajectory_path(task), **content["rows"]
                )
                self._link_trajectory(task, rows.read())
        except _DamagedError as problem:
            return None, str(problem)
        outcome = Outcome(
            Status(**content["status"]),
            content["values"],
            rows,
            content["frames"],
            content["read"],
            rows.readable_path.name if rows else "",
        )
        return outcome, ""

    def _load_content(self, task: Task) -> dict[str, Any] | None:
        path = self.record_path(task)
        try:
            if path.stat().st_size > _MAX_RECORD_BYTES:
                raise _DamagedError(f"{path.name} is too large for a record")
            record = json.loads(path.read_bytes())
        except FileNotFoundError:
            return None
        except OSError as problem:
            raise _DamagedError(f"{path.name} cannot be read ({problem.strerror})") from None
        except (ValueError, RecursionError, MemoryError):
            raise _DamagedError(f"{path.name} is not valid JSON") from None
        if not isinstance(record, dict) or "format" not in record:
            raise _DamagedError(f"{path.name} is not a record, or has an earlier format")
        if record["format"] != _FORMAT:
            raise _DamagedError(f"{path.name} has an unsupported format")
        content = record.get("outcome")
        if not isinstance(content, dict) or record.get("sha256") != _checksum(content):
            raise _DamagedError(f"{path.name} has changed since it was written")
        if not _is_valid_record(content):
            raise _DamagedError(f"{path.name} has unexpected values")
        return content

    def _link_trajectory(self, task: Task, text: bytes) -> None:
        source, path = self.rows_path(task), self.trajectory_path(task)
        with suppress(OSError):
            if path.samefile(source) or path.read_bytes() == text:
                return
        with atomic_write(path) as scratch:
            scratch.unlink()
            try:
                os.link(source, scratch)
            except OSError:  # The file system has no hard links.
                scratch.write_bytes(text)

    def remove_scratch_files(self) -> None:
        """Remove unfinished files left by processes that have ended."""
        for folder in (self.folder, self.folder / "outcomes", self.folder / "trajectories"):
            remove_stale_scratch_files(folder)


@dataclass(frozen=True)
class _StoredRows:
    """Trajectory in a file, parsed on first access; see `Outcome.rows`."""

    path: Path
    readable_path: Path
    sha256: str
    columns: list[str]

    def read(self) -> bytes:
        try:
            text = self.path.read_bytes()
        except OSError as problem:
            raise _DamagedError(
                f"{self.readable_path.name} cannot be read ({problem.strerror})"
            ) from None
        if hashlib.sha256(text).hexdigest() != self.sha256:
            raise _DamagedError(f"{self.readable_path.name} has changed since it was written")
        return text

    @cached_property
    def table(self) -> pd.DataFrame:
        try:
            return parse_trajectory(self.read(), self.columns)
        except _DamagedError as problem:
            raise BeamdaeError(f"{self.readable_path.parent}: {problem}.") from None

    def __call__(self) -> pd.DataFrame:
        return self.table


def _is_usable(task: Task, content: dict[str, Any]) -> bool:
    if changed_files(content["read"], task.case.model.home):
        return False
    if content["status"]["kind"] != "ok":
        return bool(content["limits"] == asdict(task.limits))
    if content["repetitions"] < task.repetitions:
        return False
    return not task.animated or content["frames"] is not None


def _is_valid_record(content: dict[str, Any]) -> bool:
    types: dict[str, Any] = {
        "status": dict,
        "values": dict,
        "rows": (dict, type(None)),
        "frames": (dict, type(None)),
        "read": dict,
        "limits": dict,
        "repetitions": int,
    }
    if not all(isinstance(content.get(name, Ellipsis), kind) for name, kind in types.items()):
        return False
    status, rows = content["status"], content["rows"]
    return (
        set(status) == {"kind", "sentence"}
        and isinstance(status["sentence"], str)
        and status["kind"] in get_args(Kind)
        and all(isinstance(x, (str, int, float, type(None))) for x in content["values"].values())
        and (rows is None or set(rows) == {"sha256", "columns"})
    )


def _checksum(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
