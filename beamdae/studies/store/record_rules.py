"""Content of records: outcome, values, animation and trajectory of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.errors import format_distinct
from beamdae.results.outcome import Status
from beamdae.results.storage.reader import ContentError
from beamdae.studies.run_values import REACHED_COLUMN
from beamdae.studies.store.trajectory_csv import parse_trajectory
from beamdae.studies.tasks import Limits

_ROUNDING_OF_TIMES = 1e-9  # relative difference of the end time and the last row


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


def parse_rows(text: bytes, record: Record) -> pd.DataFrame:
    """Return the trajectory of a record.

    Raises
    ------
    ContentError
        If the columns differ from the record, a cell is neither a number nor empty, or the times do
        not ascend from 0 to the end time in the record. An unsuccessful run may end earlier.
    """
    assert record.rows is not None
    try:
        table = parse_trajectory(text, TIME, record.rows.columns)
    except ValueError as problem:
        raise ContentError(str(problem)) from None
    times = table.index.to_numpy()
    if not (len(times) and np.isfinite(times).all() and times[0] == 0.0):
        raise ContentError(f"{TIME} must contain finite times that begin with 0")
    if not (np.diff(times) > 0.0).all():
        raise ContentError(f"{TIME} must ascend")
    reached: Any = record.values.get(REACHED_COLUMN)
    if reached is not None:
        excess, rounding = times[-1] - reached, _ROUNDING_OF_TIMES * reached
        if excess > rounding or (record.status.success and excess < -rounding):
            recorded, end = format_distinct(reached, times[-1])
            raise ContentError(f"{TIME} must end at {recorded} s as in the record, got {end} s")
    return table
