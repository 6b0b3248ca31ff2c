"""Tables of runs each of which went on where the one before ended, and of all of them as one."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.measures import ENERGIES, LEDGER_COLUMNS, TIME
from beamdae.errors import BeamdaeError
from beamdae.results.outcome import REACHED_END, Status
from beamdae.results.storage.checkpoint import Checkpoint
from beamdae.results.storage.files import unescape_cell, write_bytes, write_table

if TYPE_CHECKING:
    from beamdae.results.solution import Solution

Array = np.ndarray

# What goes on from run to run: works, and what the books are off by.
CUMULATIVE_COLUMNS = LEDGER_COLUMNS[len(ENERGIES) :]
_STATUS = "status"
# What runs cost adds up, how far they are off is the most of them.
_MOST = ("max_residual", "max_position_drift", "max_velocity_drift", "energy_imbalance")


@dataclass(frozen=True)
class RunParts:
    """Runs that went on from each other, in one folder.

    Attributes
    ----------
    table
        Where the table of all of them is; those of the parts have numbers.
    before
        Their tables, those from the first one to the end that is gone on from.
    """

    table: Path
    before: tuple[Path, ...] = ()

    @classmethod
    def ending_at(cls, table: Path, checkpoint: Checkpoint) -> RunParts:
        """Those that end at a checkpoint; none where there is no table.

        Raises
        ------
        BeamdaeError
            If the table is of another run, or a part is missing: nothing is overwritten.
        """
        if not table.exists():
            return cls(table)
        told = _beside(table)
        own = [table.with_name(str(part["file"])) for part in told.get("parts", [])] or [table]
        for k, part in enumerate(own):
            if not part.exists():
                raise BeamdaeError(f"{part}: this part of the run is missing, see {table}.")
            if _beside(part).get("end", {}).get("state") == checkpoint.state:
                return cls(table, tuple(own[: k + 1]))
        raise BeamdaeError(
            f"{table}: it is not of the run that is to go on, and is not overwritten; give another "
            "--out, or move it away."
        )

    @property
    def latest(self) -> Path:
        """Where the table of the run that goes on belongs."""
        return self._numbered(len(self.before) + 1) if self.before else self.table

    def _numbered(self, number: int) -> Path:
        return self.table.with_name(f"{self.table.stem}_part{number}{self.table.suffix}")

    def write(self, solution: Solution) -> tuple[dict[str, Any], list[Path]]:
        """Write the tables of a run that went on, and of all; the columns, and what was written.

        Raises
        ------
        BeamdaeError
            If a file cannot be read or written; what was there before is there still.
        """
        latest = solution.to_csv(self.latest)
        if not self.before:
            return dict(solution.all_columns()), [latest, latest.with_suffix(".json")]
        before = list(self.before)
        if before == [self.table]:
            before = [self._numbered(1)]
            for suffix in (self.table.suffix, ".json"):
                write_bytes(
                    before[0].with_suffix(suffix), self.table.with_suffix(suffix).read_bytes()
                )
        parts = [*before, latest]
        columns = _joined([_read(part) for part in parts], [_beside(part) for part in parts])
        whole, told = dict(columns), _told([(part.name, _beside(part)) for part in parts])
        if told["status"] != "ok":
            columns[_STATUS] = [told["status"]] * len(columns[TIME])
        write_table(self.table, columns, told)
        tables = dict.fromkeys([*parts, self.table])
        return whole, [file for table in tables for file in (table, table.with_suffix(".json"))]


def _beside(table: Path) -> dict[str, Any]:
    path = table.with_suffix(".json")
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise BeamdaeError(f"{path}: it cannot be read, {problem.strerror or problem}.") from None
    except ValueError:
        told = None
    if not isinstance(told, dict):
        raise BeamdaeError(f"{path}: it is not what is written beside a table.")
    return told


def _read(table: Path) -> dict[str, Array]:
    """Columns of numbers by header, as they are in the file."""
    try:
        with open(table, encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
        cells = zip(*rows, strict=True)
        columns = dict(zip(map(unescape_cell, header), cells, strict=True))
        columns.pop(_STATUS, None)
        return {
            name: np.array([float(x) if x else np.nan for x in column])
            for name, column in columns.items()
        }
    except OSError as problem:
        raise BeamdaeError(f"{table}: it cannot be read, {problem.strerror or problem}.") from None
    except ValueError:
        raise BeamdaeError(f"{table}: it is not a table of a run.") from None


def _joined(tables: Sequence[dict[str, Array]], beside: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The columns of all runs, one after the other, with works that go on."""
    latest = tables[-1]
    for table in tables[:-1]:
        if list(table) != list(latest):
            other = next(iter(set(table) ^ set(latest)), "their order")
            raise BeamdaeError(
                f"run: the runs have other columns and make no common table, {other} differs."
            )
    found = {name: [tables[0][name]] for name in latest}
    works = dict.fromkeys(CUMULATIVE_COLUMNS, 0.0)
    for told, table in zip(beside[:-1], tables[1:], strict=True):
        for name in CUMULATIVE_COLUMNS:
            works[name] += float(told["end"][name])
        for name, column in table.items():
            # The first row is the end of the run before.
            found[name].append(column[1:] + works.get(name, 0.0))
    return {name: np.concatenate(columns) for name, columns in found.items()}


def _ended(beside: Sequence[dict[str, Any]]) -> Status:
    """How runs ended that went on from each other, taken as one."""
    status, due = REACHED_END, False
    for told in beside:
        status = status.followed_by(Status(told["status"], told["reason"]), due)
        due = any(not event.get("done", True) for event in told["events"])
    return status


def _told(parts: Sequence[tuple[str, dict[str, Any]]]) -> dict[str, Any]:
    """What is beside the table of all: that of the last run, with what adds up."""
    latest = parts[-1][1]
    results = [told["result"] for _, told in parts]
    result = dict(latest["result"])
    for name, value in result.items():
        if name in _MOST:
            result[name] = max(one[name] for one in results)
        elif (
            name != "last_time" and isinstance(value, (int, float)) and not isinstance(value, bool)
        ):
            result[name] = sum(one[name] for one in results)
    events = [one for _, told in parts[:-1] for one in told["events"] if one.get("done", True)]
    works = {name: sum(told["end"][name] for _, told in parts) for name in CUMULATIVE_COLUMNS}
    status = _ended([told for _, told in parts])
    own = {k: x for k, x in latest.items() if k not in ("versions", "written", "errors")}
    return own | {
        "status": status.kind,
        "reason": status.sentence,
        "result": result | {"status": status.kind, "reason": status.sentence},
        "start": parts[0][1]["start"],
        "events": [*events, *latest["events"]],
        "warnings": [sentence for _, told in parts for sentence in told["warnings"]],
        "end": latest["end"] | works,
        "parts": [
            {
                "file": name,
                "to": told["result"]["last_time"],
                "status": told["status"],
                "reason": told["reason"],
            }
            for name, told in parts
        ],
    }
