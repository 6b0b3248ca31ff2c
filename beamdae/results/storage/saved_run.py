"""Runs kept in one file each, and what was kept of a run."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.model_hash import hash_model
from beamdae.errors import BeamdaeError
from beamdae.results.outcome import Statistics, Status
from beamdae.results.storage.files import atomic_write, require_file_path, versions, write_result
from beamdae.results.storage.packed_run import pack_run
from beamdae.results.time_series import TimeSeries

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.results.solution import Solution

Array = np.ndarray

_FORMAT, _VERSION = "beamdae run", 1
# What NumPy and zipfile make of bytes that are no longer those that were written.
_DAMAGED = (
    *(AttributeError, EOFError, KeyError, MemoryError, OSError, RuntimeError, TypeError),
    *(ValueError, struct.error, zipfile.BadZipFile, zlib.error),
)
_TOLD, _TABLE, _COORDINATES = "told", "table", "coordinates"


@dataclass(frozen=True, repr=False)
class SavedRun(TimeSeries):
    """What a file keeps of a run: its tables, how it ended and how good it is.

    It is looked at as a `Solution` is, `run["tip.y"]`, `run.plot("tip")`, `run.to_csv(path)`;
    for what needs the equations (`observe`, `animate`, `section_forces`, times between the rows)
    give `load` the model.

    Attributes
    ----------
    status, statistics
        How it ended and what it cost.
    told
        What `to_csv` writes as JSON beside a table, the versions that computed it among it.
    """

    status: Status
    statistics: Statistics
    told: dict[str, Any]
    columns: dict[str, Array] = field(repr=False)
    kept: dict[str, Array] = field(repr=False)

    @property
    def label(self) -> str:
        """Short name of what made it."""
        return str(self.told["label"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what is not to be trusted as it stands."""
        return tuple(self.told["warnings"])

    def all_columns(self) -> dict[str, Array]:
        """The columns of `table` by header, as arrays."""
        return dict(self.columns)

    def coordinates(self) -> pd.DataFrame:
        """Time, all coordinates, velocities and multipliers, named by part, with units."""
        import pandas as pd

        return pd.DataFrame(self.kept)

    def summary(self) -> dict[str, Any]:
        """Status, statistics and quality as plain values."""
        return dict(self.told["result"])

    def at_times(self, times: Array) -> SavedRun:
        """The same at some of its own times [s]."""
        whose = f"the saved run {self.told['file']}"
        rows = self._rows_at(times, whose, "load it with its model, bd.load(path, model)")
        columns, kept = ({h: x[rows] for h, x in y.items()} for y in (self.columns, self.kept))
        return SavedRun(self.status, self.statistics, self.told, columns, kept)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table as CSV and the rest as JSON beside it, as `Solution.to_csv`."""
        return write_result(path, self.columns, self.status, self.told)

    def __repr__(self) -> str:
        ended = f"{self.status.kind}, {self.status.sentence}"
        return (
            f"<SavedRun by {self.label}: {ended}; t = {self.times[0]:g} to {self.times[-1]:g} s "
            f"in {len(self.times)} rows; from {self.told['file']}>"
        )


def save_run(solution: Solution, path: str | Path) -> Path:
    """Write all of a run to one file, see `load`: a zip archive of NumPy arrays and JSON.

    Raises
    ------
    BeamdaeError
        If it cannot be written.
    """
    file = require_file_path("save", path)
    kept, coordinates = pack_run(solution), solution.coordinates()
    table = solution.all_columns()
    told = {
        "format": _FORMAT,
        "version": _VERSION,
        "label": solution.label,
        "identity": hash_model(solution.equations),
        "plain": kept.plain,
        _TABLE: list(table),
        _COORDINATES: list(coordinates),
        "beside": {**solution.beside(), "versions": versions()},
    }
    arrays: dict[str, Any] = {
        **kept.arrays,
        _TABLE: np.stack(list(table.values())),
        _COORDINATES: coordinates.to_numpy().T,
        _TOLD: np.frombuffer(json.dumps(told).encode(), np.uint8),
    }
    with atomic_write(file) as scratch, open(scratch, "wb") as opened:
        np.savez_compressed(opened, **arrays)
    return file


def read_saved_run(file: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """The arrays of a file, and what is told with them.

    Raises
    ------
    BeamdaeError
        If there is no such file, or it is none of `save_run` of this version.
    """
    wrong = BeamdaeError(f"{file}: it is no saved run of version {_VERSION}, or not all of one.")
    try:
        whole = file.read_bytes()
    except OSError as problem:
        why = problem.strerror or problem
        raise BeamdaeError(f"{file}: it cannot be read, {why}.") from None
    try:
        # Nothing that could be executed is read.
        with np.load(io.BytesIO(whole), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        told = json.loads(arrays[_TOLD].tobytes())
    except _DAMAGED:
        raise wrong from None
    if not isinstance(told, dict) or (told.get("format"), told.get("version")) != (
        _FORMAT,
        _VERSION,
    ):
        raise wrong
    return arrays, told


def saved_run_from_arrays(file: Path, arrays: dict[str, Array], told: dict[str, Any]) -> SavedRun:
    """What `read_saved_run` found as tables."""
    plain = told["plain"]
    return SavedRun(
        Status(**plain["status"]),
        Statistics(**plain["statistics"]),
        {**told["beside"], "label": told["label"], "file": file.name},
        dict(zip(told[_TABLE], arrays[_TABLE], strict=True)),
        dict(zip(told[_COORDINATES], arrays[_COORDINATES], strict=True)),
    )
