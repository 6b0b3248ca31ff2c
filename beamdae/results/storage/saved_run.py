"""Saved runs: files written by `Solution.save`, and their tables."""

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
from beamdae.results.run_data import RunData
from beamdae.results.storage.files import atomic_write, require_file_path, versions, write_result
from beamdae.results.storage.packed_run import pack_run
from beamdae.results.time_series import TimeSeries

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_FORMAT = "beamdae run"
_VERSION = 1
# Exceptions that NumPy and zipfile raise for incomplete or damaged files.
_READ_ERRORS = (
    *(AttributeError, EOFError, KeyError, MemoryError, OSError, RuntimeError, TypeError),
    *(ValueError, struct.error, zipfile.BadZipFile, zlib.error),
)
# Names of arrays in the archive. `_CONTENT` is JSON and contains the headers of the other two.
_CONTENT = "told"
_TABLE = "table"
_COORDINATES = "coordinates"


@dataclass(frozen=True, repr=False)
class SavedRun(TimeSeries):
    """Tables, status and statistics of a saved run, loaded without its model.

    A saved run has the methods of `Solution` that do not need the equations, such as
    `run["tip.y"]`, `run.plot("tip")` and `run.to_csv(path)`. To use `observe`, `animate`,
    `section_forces` or times between the rows, pass the model to `load`.

    Attributes
    ----------
    status
        Termination status and its reason, see `Solution`.
    statistics
        Computational cost of the run.
    """

    status: Status
    statistics: Statistics
    _metadata: dict[str, Any]
    _columns: dict[str, Array] = field(repr=False)
    _coordinates: dict[str, Array] = field(repr=False)

    @property
    def label(self) -> str:
        """Short name of the integrator."""
        return str(self._metadata["label"])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the reliability of the run, see `Solution.warnings`."""
        return tuple(self._metadata["warnings"])

    def all_columns(self) -> dict[str, Array]:
        """Return the columns (k,) of `table` by header."""
        return dict(self._columns)

    def coordinates(self) -> pd.DataFrame:
        """Return time, coordinates, velocities and multipliers; headers contain names and units."""
        import pandas as pd

        return pd.DataFrame(self._coordinates)

    def summary(self) -> dict[str, Any]:
        """Return status, last time [s], statistics and quality as a flat dictionary."""
        return dict(self._metadata["result"])

    def metadata(self) -> dict[str, Any]:
        """Return the metadata of the run, including the package versions at the time of the run."""
        return dict(self._metadata)

    def at_times(self, times: Array) -> SavedRun:
        """Return the saved run restricted to some of its output times.

        Parameters
        ----------
        times
            Ascending output times of the run (k,) [s].

        Raises
        ------
        BeamdaeError
            If the run has no row at one of the times.
        """
        owner = f"the saved run {self._metadata['file']}"
        rows = self._rows_at(times, owner, "load the run with bd.load(path, model)")
        columns = {header: column[rows] for header, column in self._columns.items()}
        coordinates = {header: column[rows] for header, column in self._coordinates.items()}
        return SavedRun(self.status, self.statistics, self._metadata, columns, coordinates)

    def to_csv(self, path: str | Path) -> Path:
        """Write the table as CSV and the metadata as JSON, and return the path of the CSV file.

        Parameters
        ----------
        path
            See `Solution.to_csv`.

        Raises
        ------
        BeamdaeError
            If the suffix is .json, or a file cannot be written.
        """
        return write_result(path, self._columns, self.status, self._metadata)

    def __repr__(self) -> str:
        return (
            f"<SavedRun by {self.label}: {self.status.kind}, {self.status.sentence}; "
            f"t = {self.times[0]:g} to {self.times[-1]:g} s in {len(self.times)} rows; "
            f"from {self._metadata['file']}>"
        )


def save_run(run: RunData, path: str | Path) -> Path:
    """Write all data of a run to a zip archive of NumPy arrays and JSON; return the path.

    Raises
    ------
    BeamdaeError
        If the file cannot be written.
    """
    file = require_file_path("save", path)
    packed, table = pack_run(run), run.all_columns()
    coordinate_headers, coordinates = run.coordinate_table()
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "label": run.label,
        "identity": hash_model(run.equations),
        "plain": packed.plain,
        _TABLE: list(table),
        _COORDINATES: coordinate_headers,
        "beside": {**run.metadata(), "versions": versions()},
    }
    arrays: dict[str, Any] = {
        **packed.arrays,
        _TABLE: np.stack(list(table.values())),
        _COORDINATES: coordinates.T,
        _CONTENT: np.frombuffer(json.dumps(content).encode(), np.uint8),
    }
    with atomic_write(file) as scratch, open(scratch, "wb") as stream:
        np.savez_compressed(stream, **arrays)
    return file


def read_saved_run(file: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read the arrays and the JSON content of a file written by `save_run`.

    Raises
    ------
    BeamdaeError
        If the file cannot be read, or is not a saved run of the current version.
    """
    invalid = BeamdaeError(
        f"{file}: the file is not a complete saved run of version {_VERSION}; save the run again."
    )
    try:
        raw = file.read_bytes()
    except OSError as problem:
        why = problem.strerror or problem
        raise BeamdaeError(f"{file}: the saved run cannot be read: {why}.") from None
    try:
        # Pickled objects are rejected because reading them could execute code.
        with np.load(io.BytesIO(raw), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        content = json.loads(arrays[_CONTENT].tobytes())
    except _READ_ERRORS:
        raise invalid from None
    if not isinstance(content, dict):
        raise invalid
    if (content.get("format"), content.get("version")) != (_FORMAT, _VERSION):
        raise invalid
    return arrays, content


def saved_run_from_arrays(
    file: Path, arrays: dict[str, Array], content: dict[str, Any]
) -> SavedRun:
    """Create a `SavedRun` from the result of `read_saved_run`."""
    plain = content["plain"]
    return SavedRun(
        Status(**plain["status"]),
        Statistics(**plain["statistics"]),
        {**content["beside"], "label": content["label"], "file": file.name},
        dict(zip(content[_TABLE], arrays[_TABLE], strict=True)),
        dict(zip(content[_COORDINATES], arrays[_COORDINATES], strict=True)),
    )
