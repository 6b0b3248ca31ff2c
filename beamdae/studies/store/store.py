"""Outcomes kept on disk, each in files of its own that appear whole or not at all."""

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
from beamdae.studies.execution.case_run import Outcome, Task
from beamdae.studies.store.file_reads import changed_files
from beamdae.studies.store.trajectory_csv import format_trajectory, parse_trajectory

_FORMAT = 3
# Longer records are none of ours [bytes].
_MAX_RECORD_BYTES = 1_000_000_000


class _DamagedError(Exception):
    """A record that is there and cannot be used; the message says what is wrong with it."""


@dataclass(frozen=True)
class Store:
    """Outcomes by the fingerprint of their case, in `folder`/outcomes.

    Their rows are in `folder`/trajectories as well, under names for readers: links to the same
    file, where the file system has them.
    """

    folder: Path

    def record_path(self, task: Task) -> Path:
        """Where a task's outcome is kept."""
        return self.folder / "outcomes" / f"{task.key}.json"

    def rows_path(self, task: Task) -> Path:
        """Where a task's rows are kept."""
        return self.record_path(task).with_suffix(".csv")

    def trajectory_path(self, task: Task) -> Path:
        """Where a task's rows are for readers."""
        return self.folder / "trajectories" / f"{task.name or task.key}.csv"

    def save(self, task: Task, outcome: Outcome) -> Outcome:
        """Write an outcome, and return it with the name of its file.

        The record comes last, so that one that is there is complete; it has the hash of the rows
        and its own.

        Raises
        ------
        BeamdaeError
            If a file cannot be written. What was kept before is as it was.
        """
        rows, table = None, outcome.table
        if table is not None:
            # The record has the headers as they are.
            text = outcome.text or format_trajectory(table)
            write_bytes(self.rows_path(task), text)
            self._link_trajectory(task, text)
            rows = {
                "sha256": hashlib.sha256(text).hexdigest(),
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
        # Numbers of numpy are told as their own.
        content = json.loads(json.dumps(content, default=methodcaller("item")))
        record = {"format": _FORMAT, "sha256": _checksum(content), "outcome": content}
        write_bytes(self.record_path(task), f"{json.dumps(record)}\n".encode())
        return replace(outcome, text=b"")

    def load(self, task: Task) -> tuple[Outcome | None, str]:
        """The outcome of a task if there is one that serves, and what is wrong if it is damaged.

        None without a word if it was never kept, if files it has read have changed, if it failed
        under other limits, or lacks repetitions or frames that are asked for now.

        Raises
        ------
        BeamdaeError
            If there is a folder in the place of its file.
        """
        for path in (self.record_path(task), self.rows_path(task), self.trajectory_path(task)):
            if path.is_dir():
                raise BeamdaeError(f"{path}: it must be a file of results, and is a folder.")
        try:
            content = self._content(task)
            if content is None or not _is_usable(task, content):
                return None, ""
            kept = None
            if content["rows"] is not None:
                kept = _StoredRows(
                    self.rows_path(task), self.trajectory_path(task), **content["rows"]
                )
                self._link_trajectory(task, kept.text())
        except _DamagedError as problem:
            return None, str(problem)
        status = Status(**content["status"])
        values, frames, read = (content[name] for name in ("values", "frames", "read"))
        file = kept.shown.name if kept else ""
        return Outcome(status, values, kept, frames, read, file), ""

    def _content(self, task: Task) -> dict[str, Any] | None:
        path = self.record_path(task)
        try:
            if path.stat().st_size > _MAX_RECORD_BYTES:
                raise _DamagedError(f"{path.name} is larger than any record")
            record = json.loads(path.read_bytes())
        except FileNotFoundError:
            return None
        except OSError as problem:
            raise _DamagedError(f"{path.name} cannot be read, {problem.strerror}") from None
        except (ValueError, RecursionError, MemoryError):
            raise _DamagedError(f"{path.name} is no JSON") from None
        if not isinstance(record, dict) or "format" not in record:
            raise _DamagedError(f"{path.name} is no record, or one of an earlier version")
        if record["format"] != _FORMAT:
            raise _DamagedError(f"{path.name} is a record of another version")
        content = record.get("outcome")
        if not isinstance(content, dict) or record.get("sha256") != _checksum(content):
            raise _DamagedError(f"{path.name} is not what was written")
        if not _is_valid_record(content):
            raise _DamagedError(f"{path.name} has values no record has")
        return content

    def _link_trajectory(self, task: Task, text: bytes) -> None:
        """Have the rows of a task under its name, whatever was there before."""
        source, path = self.rows_path(task), self.trajectory_path(task)
        with suppress(OSError):
            if path.samefile(source) or path.read_bytes() == text:
                return
        with atomic_write(path) as scratch:
            scratch.unlink()
            try:
                os.link(source, scratch)
            except OSError:  # No file system has to have links.
                scratch.write_bytes(text)

    def remove_scratch_files(self) -> None:
        """Remove what processes that have ended left unfinished."""
        for folder in (self.folder, self.folder / "outcomes", self.folder / "trajectories"):
            remove_stale_scratch_files(folder)


@dataclass(frozen=True)
class _StoredRows:
    """Rows in a file, known to readers by another name; they are read when they are asked for."""

    path: Path
    shown: Path
    sha256: str
    columns: list[str]

    def text(self) -> bytes:
        """What the file has, if it is what was written."""
        try:
            text = self.path.read_bytes()
        except OSError as problem:
            raise _DamagedError(f"{self.shown.name} cannot be read, {problem.strerror}") from None
        if hashlib.sha256(text).hexdigest() != self.sha256:
            raise _DamagedError(f"{self.shown.name} is not what was written")
        return text

    @cached_property
    def table(self) -> pd.DataFrame:
        """The rows."""
        try:
            return parse_trajectory(self.text(), self.columns)
        except _DamagedError as problem:
            raise BeamdaeError(f"{self.shown.parent}: {problem}.") from None

    def __call__(self) -> pd.DataFrame:
        """See `Outcome.rows`."""
        return self.table


def _is_usable(task: Task, content: dict[str, Any]) -> bool:
    """Whether an outcome is what the task asks for now."""
    if changed_files(content["read"], task.case.model.home):
        return False
    if content["status"]["kind"] != "ok":
        return bool(content["limits"] == asdict(task.limits))
    if content["repetitions"] < task.repetitions:
        return False
    return not task.animated or content["frames"] is not None


def _is_valid_record(content: dict[str, Any]) -> bool:
    """Whether all that is made use of is there, and of its kind."""
    kinds: dict[str, Any] = {
        "status": dict,
        "values": dict,
        "rows": (dict, type(None)),
        "frames": (dict, type(None)),
        "read": dict,
        "limits": dict,
        "repetitions": int,
    }
    if not all(isinstance(content.get(name, Ellipsis), kind) for name, kind in kinds.items()):
        return False
    status, rows = content["status"], content["rows"]
    known = set(status) == {"kind", "sentence"} and isinstance(status["sentence"], str)
    plain = (str, int, float, type(None))
    return (
        known
        and status["kind"] in get_args(Kind)
        and all(isinstance(x, plain) for x in content["values"].values())
        and (rows is None or set(rows) == {"sha256", "columns"})
    )


def _checksum(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
