"""Tables of consecutive runs, each resumed from the previous: one per run and one combined."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.equations.measures import ENERGIES, LEDGER_COLUMNS, TIME
from beamdae.errors import BeamdaeError, is_valid_path
from beamdae.results.outcome import REACHED_END, Kind, Status
from beamdae.results.solution import Solution
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.documents import read_json
from beamdae.results.storage.files import unescape_cell, write_bytes, write_table
from beamdae.results.storage.reader import ContentError, FileKind, read_bytes

Array = np.ndarray

# Works and the energy imbalance, which start from zero in each run.
CUMULATIVE_COLUMNS = LEDGER_COLUMNS[len(ENERGIES) :]
_STATUS = "status"
# Entries of the result that are combined by their maximum; other numbers except the last time are
# added.
_MAXIMA = ("max_residual", "max_position_drift", "max_velocity_drift", "energy_imbalance")
_METADATA_KIND = FileKind("metadata of a run", "run the model again")
_TABLE_KIND = FileKind("table of a run", "run the model again")


@dataclass(frozen=True)
class _Part:
    file: str

    def __post_init__(self) -> None:
        if not self.file or Path(self.file).name != self.file or not is_valid_path(self.file):
            raise ValueError("it must be the name of a file in the folder of the table")


@dataclass(frozen=True)
class _Metadata:
    """Fields of the metadata of a run that are combined; others are copied."""

    status: Kind
    reason: str
    result: dict[str, Any]
    start: Any
    events: list[dict[str, Any]]
    warnings: list[str]
    end: dict[str, float | str]
    parts: list[_Part] = field(default_factory=list)


# Metadata that apply to a single run and are omitted from the combined metadata.
_OF_ONE_RUN = ("versions", "written", "errors")


@dataclass(frozen=True)
class RunParts:
    """Files of consecutive runs in one folder, each resumed from the end of the previous run.

    Attributes
    ----------
    table
        Path of the combined table; the table of the run itself if there are no previous runs.
    before
        Paths of the tables of the previous runs in chronological order.
    """

    table: Path
    before: tuple[Path, ...] = ()

    @classmethod
    def ending_at(cls, table: Path, checkpoint: Checkpoint) -> RunParts:
        """Find the runs in the folder of `table` that lead to a checkpoint.

        There are no previous runs if `table` does not exist.

        Raises
        ------
        BeamdaeError
            If the table belongs to a different run, the table of a previous run is missing, or
            metadata cannot be read.
        """
        if not table.exists():
            return cls(table)
        names = [part["file"] for part in _read_metadata(table).get("parts", [])]
        parts = [table.with_name(name) for name in names] or [table]
        for k, part in enumerate(parts):
            if not part.exists():
                raise BeamdaeError(
                    f"{part}: this part of the run in {table} is missing; restore the "
                    "file, or choose another --out."
                )
            if _read_metadata(part).get("end", {}).get("state") == checkpoint.state:
                return cls(table, tuple(parts[: k + 1]))
        raise BeamdaeError(
            f"{table}: the table belongs to another run and is not overwritten; choose "
            "another --out, or move the file."
        )

    @property
    def latest(self) -> Path:
        """Path of the table that `write` creates for the resumed run."""
        return self._numbered_path(len(self.before) + 1) if self.before else self.table

    def _numbered_path(self, number: int) -> Path:
        return self.table.with_name(f"{self.table.stem}_part{number}{self.table.suffix}")

    def write(self, solution: Solution) -> tuple[dict[str, Any], list[Path]]:
        """Write the table of the resumed run and, if there are previous runs, the combined table.

        Returns
        -------
        dict
            Columns of the combined table by header.
        list of Path
            Paths of all tables and their metadata.

        Raises
        ------
        BeamdaeError
            If a file cannot be read or written, or the runs have different columns. No file is left
            partially written.
        """
        latest = solution.to_csv(self.latest)
        if not self.before:
            return dict(solution.all_columns()), [latest, latest.with_suffix(".json")]
        before = list(self.before)
        if before == [self.table]:
            before = [self._numbered_path(1)]
            for suffix in (self.table.suffix, ".json"):
                content = read_bytes(self.table.with_suffix(suffix), _TABLE_KIND)
                write_bytes(before[0].with_suffix(suffix), content)
        parts = [*before, latest]
        metadata = [_read_metadata(part) for part in parts]
        with _METADATA_KIND.errors_of(self.table):
            columns = _join_columns([_read_columns(part) for part in parts], metadata)
            joined_metadata = _join_metadata([part.name for part in parts], metadata)
        table_columns = dict(columns)
        if joined_metadata["status"] != "ok":
            table_columns[_STATUS] = [joined_metadata["status"]] * len(columns[TIME])
        write_table(self.table, table_columns, joined_metadata)
        tables = dict.fromkeys([*parts, self.table])
        return columns, [file for table in tables for file in (table, table.with_suffix(".json"))]


def _read_metadata(table: Path) -> dict[str, Any]:
    return read_json(table.with_suffix(".json"), _METADATA_KIND, _Metadata)


def _read_columns(table: Path) -> dict[str, Array]:
    """Read the numeric columns of a CSV file, by header."""
    text = read_bytes(table, _TABLE_KIND)
    with _TABLE_KIND.errors_of(table):
        header, *rows = csv.reader(io.StringIO(text.decode(), newline=""))
        headers = [unescape_cell(cell) for cell in header]
        columns = dict(zip(headers, zip(*rows, strict=True), strict=True))
        columns.pop(_STATUS, None)
        numbers = {
            name: np.array([float(x) if x else np.nan for x in column])
            for name, column in columns.items()
        }
        for name in (TIME, *CUMULATIVE_COLUMNS):
            if name not in numbers or headers.count(name) > 1:
                raise ContentError(f"{name} must be a column of the table")
        if not (np.diff(numbers[TIME]) > 0.0).all():
            raise ContentError(f"{TIME} must ascend")
    return numbers


def _join_columns(
    tables: Sequence[dict[str, Array]], metadata: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Concatenate the columns of all runs, accumulating works and imbalance from run to run."""
    latest = tables[-1]
    for table in tables[:-1]:
        if list(table) != list(latest):
            different = next(iter(set(table) ^ set(latest)), "their order")
            raise BeamdaeError(
                f"run: the runs have different columns ({different}) and cannot be "
                "joined; resume with the same observables, or choose another --out."
            )
    pieces = {name: [tables[0][name]] for name in latest}
    works = dict.fromkeys(CUMULATIVE_COLUMNS, 0.0)
    for previous, table in zip(metadata[:-1], tables[1:], strict=True):
        for name in CUMULATIVE_COLUMNS:
            works[name] += float(previous["end"][name])
        for name, column in table.items():
            # The first row repeats the end of the previous run.
            pieces[name].append(column[1:] + works.get(name, 0.0))
    return {name: np.concatenate(columns) for name, columns in pieces.items()}


def _join_status(metadata: Sequence[dict[str, Any]]) -> Status:
    status, has_pending_event = REACHED_END, False
    for part in metadata:
        status = status.followed_by(Status(part["status"], part["reason"]), has_pending_event)
        has_pending_event = any(not event.get("done", True) for event in part["events"])
    return status


def _join_metadata(names: Sequence[str], metadata: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the metadata of the combined table, given file name and metadata of each run."""
    latest = metadata[-1]
    results = [part["result"] for part in metadata]
    result = dict(latest["result"])
    for name, value in result.items():
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if name in _MAXIMA:
            result[name] = max(one[name] for one in results)
        elif name != "last_time" and is_number:
            result[name] = sum(one[name] for one in results)
    # An event that a run did not execute is executed and listed by the next run.
    events = [
        event for part in metadata[:-1] for event in part["events"] if event.get("done", True)
    ]
    works = {name: sum(part["end"][name] for part in metadata) for name in CUMULATIVE_COLUMNS}
    status = _join_status(metadata)
    return {k: x for k, x in latest.items() if k not in _OF_ONE_RUN} | {
        "status": status.kind,
        "reason": status.sentence,
        "result": result | {"status": status.kind, "reason": status.sentence},
        "start": metadata[0]["start"],
        "events": [*events, *latest["events"]],
        "warnings": [warning for part in metadata for warning in part["warnings"]],
        "end": latest["end"] | works,
        "parts": [
            {
                "file": name,
                "to": part["result"]["last_time"],
                "status": part["status"],
                "reason": part["reason"],
            }
            for name, part in zip(names, metadata, strict=True)
        ],
    }
