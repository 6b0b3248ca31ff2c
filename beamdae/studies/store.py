"""Outcomes kept on disk, each in files of its own that appear whole or not at all."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError
from beamdae.studies.work import Outcome


@dataclass(frozen=True)
class Store:
    """Outcomes by the fingerprint of their case, in `folder`/outcomes and `folder`/trajectories."""

    folder: Path

    def _record(self, key: str) -> Path:
        return self.folder / "outcomes" / f"{key}.json"

    def trajectory(self, key: str) -> Path:
        """Where the rows of a case are."""
        return self.folder / "trajectories" / f"{key}.csv"

    def __contains__(self, key: str) -> bool:
        return self._record(key).is_file()

    def keep(self, key: str, outcome: Outcome) -> None:
        """Write an outcome; the record comes last, so that one that is there is complete."""
        if outcome.table is not None:
            _write(self.trajectory(key), outcome.table.to_csv())
        record = {
            "status": outcome.status,
            "values": _plain(outcome.values),
            "has rows": outcome.table is not None,
            "frames": outcome.frames,
        }
        _write(self._record(key), json.dumps(record, indent=1) + "\n")

    def outcome(self, key: str) -> Outcome:
        """Read an outcome back.

        Raises
        ------
        BeamdaeError
            If its files are damaged.
        """
        try:
            record = json.loads(self._record(key).read_text())
            table = None
            if record["has rows"]:
                table = pd.read_csv(self.trajectory(key), index_col=0)
            return Outcome(record["status"], record["values"], table, record["frames"])
        except (OSError, ValueError, KeyError) as problem:
            raise BeamdaeError(
                f"{self._record(key)}: this result cannot be read ({problem}), remove it to have "
                "it computed again."
            ) from problem


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = path.with_suffix(f".{os.getpid()}")
        scratch.write_text(text)
        scratch.replace(path)
    except OSError as problem:
        raise BeamdaeError(f"{path}: it cannot be written, {problem.strerror}.") from problem


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in values.items()}
