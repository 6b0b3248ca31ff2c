"""Saved runs: files written by `Solution.save`, and their tables."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.equations.model_hash import hash_model
from beamdae.errors import BeamdaeError, MissingModelError
from beamdae.input_files import register_input
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import ColumnDerivatives, require_derivatives
from beamdae.results.energy_balance import Quality
from beamdae.results.outcome import Statistics, Status
from beamdae.results.run_data import coordinate_headers
from beamdae.results.solution import Solution
from beamdae.results.storage.files import atomic_write, require_file_path, write_result
from beamdae.results.storage.packed_run import (
    PLAIN,
    PackedRun,
    array_rules,
    pack_run,
    require_consistent,
    unpack_derivatives,
    unpack_trajectory,
)
from beamdae.results.storage.reader import (
    MAX_ARCHIVE_BYTES,
    Archive,
    FileKind,
    checksum,
    is_compression_allowed,
    open_archive,
    parse_json,
    require_json_limits,
    translate_field_errors,
)
from beamdae.results.storage.schema import (
    ArrayRule,
    FieldError,
    anything,
    choice,
    column_name,
    flag,
    integer,
    mapping,
    number,
    record,
    require_equal,
    sequence,
    text,
)
from beamdae.results.time_series import TimeSeries

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

KIND = FileKind("saved run", "simulate and save the run again")
_FORMAT = "beamdae run"
_VERSION = 2
_READABLE_VERSIONS = (1, 2)
_CHECKSUM = "checksum"
# Names of arrays in the archive. `_CONTENT` is JSON and contains the headers of the other two.
_CONTENT = "told"
_TABLE = "table"
_COORDINATES = "coordinates"
# Largest difference between the coordinates and the states at the output times, relative to the
# largest value of a coordinate. Other versions may interpolate differently between the steps.
_MAX_DEVIATION = 1e-3

# Rule for `RunData.summary`.
RESULT = record(
    {
        "success": flag,
        "status": text,
        "reason": text,
        "last_time": number(),
        **{f.name: number(0.0) for f in fields(Statistics)},
        **{f.name: number(finite=False) for f in fields(Quality)},
    }
)
_METADATA = record(
    {
        "status": text,
        "reason": text,
        "result": RESULT,
        "warnings": sequence(text),
        "versions": mapping(text),
    },
    others=True,
)
_CONTENT_RULE = record(
    {
        "format": text,
        "version": integer(),
        "label": text,
        "identity": text,
        "plain": PLAIN,
        _TABLE: sequence(column_name),
        _COORDINATES: sequence(column_name),
        "beside": _METADATA,
        _CHECKSUM: text,
    }
)


@read_only_data
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
    derivatives
        Derivatives of the columns with respect to parameters, see `simulate`; None without them.
    """

    status: Status
    statistics: Statistics
    _metadata: dict[str, Any]
    _columns: dict[str, Array] = field(repr=False)
    _coordinates: dict[str, Array] = field(repr=False)
    derivatives: ColumnDerivatives | None = field(default=None, repr=False)

    def __getattr__(self, name: str) -> Any:
        # Called only for attributes that a saved run does not have.
        from beamdae.results.solution import Solution

        is_known = hasattr(Solution, name) or name in Solution.__dataclass_fields__
        if not name.startswith("_") and is_known:
            raise MissingModelError(
                f"SavedRun: {name} needs the equations of the run; load the run with its model, "
                "bd.load(path, model)."
            )
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

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

    def coordinate_columns(self) -> dict[str, Array]:
        """Return the columns (k,) of `coordinates` by header."""
        return dict(self._coordinates)

    def sensitivity(self, column: str, parameter: str) -> pd.Series:
        """Return the derivative of a column over time, see `Solution.sensitivity`."""
        return require_derivatives(self.derivatives).sensitivity(column, parameter)

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
            Output times of the run in ascending order, (k,) [s].

        Raises
        ------
        BeamdaeError
            If the run has no row at one of the times.
        """
        owner = f"the saved run {self._metadata['file']}"
        rows = self._rows_at(times, owner, "load the run with bd.load(path, model)")
        columns = {header: column[rows] for header, column in self._columns.items()}
        coordinates = {header: column[rows] for header, column in self._coordinates.items()}
        derivatives = self.derivatives and self.derivatives.at_times(self.times[rows])
        return SavedRun(
            self.status, self.statistics, self._metadata, columns, coordinates, derivatives
        )

    def to_csv(self, path: str | Path, *, sep: str = ",", decimal: str = ".") -> Path:
        """Write the table as CSV and the metadata as JSON, and return the path of the CSV file.

        Parameters
        ----------
        path
            See `Solution.to_csv`.
        sep, decimal
            See `Solution.to_csv`.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, `path` ends with .json, or a file cannot be written.
        """
        return write_result(path, self._columns, self.status, self._metadata, sep, decimal)

    def __repr__(self) -> str:
        return (
            f"<SavedRun by {self.label}: {self.status.kind}, {self.status.sentence}; "
            f"t = {self.times[0]:g} to {self.times[-1]:g} s in {len(self.times)} rows; "
            f"from {self._metadata['file']}>"
        )


def save_run(run: Solution, path: str | Path) -> Path:
    """Write all data of a run to a zip archive of NumPy arrays and JSON; return the path.

    Raises
    ------
    BeamdaeError
        If the file cannot be written, or the run exceeds the size limits of a file.
    """
    file = require_file_path("save", path)
    packed, table = pack_run(run), run.all_columns()
    coordinates = run.coordinate_columns()
    arrays: dict[str, Any] = {
        **packed.arrays,
        _TABLE: np.stack(list(table.values())),
        _COORDINATES: np.stack(list(coordinates.values())),
    }
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "label": run.label,
        "identity": hash_model(run.equations),
        "plain": packed.plain,
        _TABLE: list(table),
        _COORDINATES: list(coordinates),
        "beside": run.metadata(),
    }
    raw = json.dumps({**content, _CHECKSUM: checksum(content, arrays)}).encode()
    require_json_limits(file, KIND, raw)
    arrays[_CONTENT] = np.frombuffer(raw, np.uint8)
    with atomic_write(file) as scratch, open(scratch, "wb") as stream:
        np.savez_compressed(stream, **arrays)
        stream.flush()
        size = os.fstat(stream.fileno()).st_size
        if not is_compression_allowed(sum(x.nbytes for x in arrays.values()), size):
            # Constant arrays, which `read_saved_run` accepts only if they are not compressed.
            stream.seek(0)
            np.savez(stream, **arrays)
            stream.truncate()
            size = os.fstat(stream.fileno()).st_size
        if size > MAX_ARCHIVE_BYTES:
            raise BeamdaeError(
                f"{file}: the run needs {size} bytes, but a saved run has at most "
                f"{MAX_ARCHIVE_BYTES}; save fewer rows with solution.at_times(times).save(path)."
            )
    return file


def read_saved_run(file: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Read the arrays and the JSON content of a file written by `save_run`.

    Raises
    ------
    BeamdaeError
        If the file cannot be read, is not a complete saved run of a supported version, or a field
        has a type, shape or value that `save_run` does not write.
    """
    register_input(file)
    with open_archive(file, KIND) as archive:
        content = _read_content(archive)
        plain = content["plain"]
        rules = array_rules(plain) | {
            _TABLE: ArrayRule((len(content[_TABLE]), "rows"), finite=False),
            _COORDINATES: ArrayRule((len(content[_COORDINATES]), "rows")),
            _CONTENT: ArrayRule(("bytes",), "u"),
        }
        arrays = archive.read_arrays(rules)
    del arrays[_CONTENT]
    expected = content.pop(_CHECKSUM)
    if content["version"] > 1 and expected != checksum(content, arrays):
        raise KIND.error(file, "the content has changed since it was written (wrong checksum)")
    with translate_field_errors(file, KIND), np.errstate(all="ignore"):
        require_consistent(PackedRun(arrays, plain))
        _require_consistent_tables(arrays, content)
    return arrays, content


def _read_content(archive: Archive) -> dict[str, Any]:
    """Return the JSON content of a saved run, in the current format except for its version."""
    file = archive.path
    if _CONTENT not in archive.headers or archive.headers[_CONTENT].dtype != np.uint8:
        raise KIND.incomplete(file)
    content = parse_json(file, KIND, archive.read_array(_CONTENT).tobytes())
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise KIND.incomplete(file)
    with translate_field_errors(file, KIND):
        record({"version": choice(*_READABLE_VERSIONS)}, others=True)(content)
        if content["version"] == 1:
            # This version has no checksum, and the package versions only in the metadata.
            record({"plain": mapping(anything), "beside": _METADATA}, others=True)(content)
            content["plain"]["versions"] = content["beside"]["versions"]
            content[_CHECKSUM] = ""
        _CONTENT_RULE(content)
    return content


def _require_consistent_tables(arrays: dict[str, Array], content: dict[str, Any]) -> None:
    """Raise FieldError unless tables and metadata agree with the data of the run."""
    plain, metadata, t = content["plain"], content["beside"], arrays["t"]
    for name in (_TABLE, _COORDINATES):
        headers = content[name]
        if len(set(headers)) < len(headers) or headers[:1] != [TIME]:
            raise FieldError(f"must be different headers that begin with {TIME!r}", name)
        if not np.array_equal(arrays[name][0], t):
            raise FieldError(f"must begin with the times of t, the column {TIME!r}", name)
    missing = next((x for x in LEDGER_COLUMNS if x not in content[_TABLE]), None)
    if missing is not None:
        raise FieldError(f"must contain the column {missing!r}", _TABLE)
    n, m = len(arrays["q0"]), arrays["lam"].shape[1]
    columns = len(content[_COORDINATES])
    require_equal(_COORDINATES, columns, "1 + 2 n + m", 1 + 2 * n + m)
    result, status = metadata["result"], plain["status"]
    for name, value in (("status", status["kind"]), ("reason", status["sentence"])):
        require_equal(f"beside.{name}", metadata[name], f"plain.status {name}", value)
        require_equal(f"beside.result.{name}", result[name], f"plain.status {name}", value)
    require_equal("beside.result.success", result["success"], "status ok", status["kind"] == "ok")
    for name, value in plain["statistics"].items():
        require_equal(f"beside.result.{name}", result[name], f"plain.statistics.{name}", value)
    end = float(arrays["nodes"][-1])
    require_equal("beside.result.last_time", result["last_time"], "the last of nodes", end)
    packed = PackedRun(arrays, plain)
    _, state = unpack_trajectory(packed).at(t)
    motion, saved = np.hstack([state.q, state.v]), arrays[_COORDINATES][1 : 2 * n + 1].T
    scale = np.max(np.abs(motion), axis=0, initial=0.0)
    if not (np.abs(saved - motion) <= _MAX_DEVIATION * scale).all():
        raise FieldError(
            "must be the coordinates and velocities of the states q and v", _COORDINATES
        )


def packed_run_from_arrays(
    equations: EquationsOfMotion, arrays: dict[str, Array], content: dict[str, Any]
) -> PackedRun:
    """Return the packed run of the result of `read_saved_run`.

    Raises
    ------
    FieldError
        If the coordinates differ from the coordinates of the equations.
    """
    headers = coordinate_headers(equations)
    require_equal(_COORDINATES, content[_COORDINATES], "the coordinates of the model", headers)
    return PackedRun(arrays, content["plain"])


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
        unpack_derivatives(PackedRun(arrays, plain)),
    )
