"""Outcomes kept on disk, each in files of its own that appear whole or not at all."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from operator import methodcaller
from pathlib import Path

import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.results.solution import Status
from beamdae.studies.work import Outcome, Task


@dataclass(frozen=True)
class Store:
    """Outcomes by the fingerprint of their case, in `folder`/outcomes and `folder`/trajectories."""

    folder: Path

    def _record(self, key: str) -> Path:
        return self.folder / "outcomes" / f"{key}.json"

    def trajectory(self, key: str) -> Path:
        """Where the rows of a case are."""
        return self.folder / "trajectories" / f"{key}.csv"

    def keep(self, task: Task, outcome: Outcome) -> None:
        """Write an outcome; the record comes last, so that one that is there is complete."""
        if outcome.table is not None:
            _write(self.trajectory(task.key), outcome.table.to_csv())
        record = {
            "status": asdict(outcome.status),
            "values": outcome.values,
            "rows": None if outcome.table is None else len(outcome.table),
            "frames": outcome.frames,
            "limits": asdict(task.limits),
            "repetitions": task.repetitions,
        }
        # Numbers of numpy are told as their own.
        text = json.dumps(record, indent=1, default=methodcaller("item"))
        _write(self._record(task.key), text + "\n")

    def outcome(self, task: Task) -> Outcome | None:
        """The outcome of a task, if there is one that serves.

        None if it was never kept, if its files are damaged, if it failed under other limits, or
        lacks repetitions or frames that are asked for now.
        """
        try:
            record = json.loads(self._record(task.key).read_text())
            table = None
            if record["rows"] is not None:
                table = pd.read_csv(self.trajectory(task.key), index_col=0)
                if len(table) != record["rows"]:
                    return None
            status = Status(**record["status"])
            failed = not status.success
            if failed and record["limits"] != asdict(task.limits):
                return None
            if not failed and record["repetitions"] < task.repetitions:
                return None
            if not failed and task.animated and record["frames"] is None:
                return None
            return Outcome(status, record["values"], table, record["frames"])
        except (OSError, ValueError, KeyError, TypeError):
            return None


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = path.with_suffix(f".{os.getpid()}")
        scratch.write_text(text)
        scratch.replace(path)
    except OSError as problem:
        raise BeamdaeError(f"{path}: it cannot be written, {problem.strerror}.") from problem
