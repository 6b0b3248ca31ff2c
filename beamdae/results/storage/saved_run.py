"""Saved runs: files written by `Solution.save`, and their tables."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.model_hash import hash_model
from beamdae.errors import BeamdaeError, MissingModelError
from beamdae.input_files import CHECKPOINT, register_input
from beamdae.read_only import read_only_data
from beamdae.results.column_derivatives import ColumnDerivatives, require_derivatives
from beamdae.results.outcome import Statistics, Status
from beamdae.results.solution import Solution
from beamdae.results.storage.checkpoint import SAVED_RUN, SAVED_RUN_VERSION, Checkpoint
from beamdae.results.storage.documents import Format, as_plain
from beamdae.results.storage.files import atomic_write, require_file_path
from beamdae.results.storage.packed_run import PackedRun, pack_run, unpack_fields
from beamdae.results.time_series import TimeSeries

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@dataclass(frozen=True)
class SavedContent:
    """Content of a saved run.

    Attributes
    ----------
    label, identity
        Short name of the integrator, and the hash of the equations, see `hash_model`.
    run
        Data of the run.
    table, coordinates
        Columns of the tables by header.
    metadata
        Metadata of the run, see `Solution.metadata`.
    checkpoint
        Last state of the run.
    """

    label: str
    identity: str
    run: PackedRun
    table: dict[str, Array]
    coordinates: dict[str, Array]
    metadata: dict[str, Any]
    checkpoint: Checkpoint


_FORMAT = Format(SAVED_RUN, SAVED_RUN_VERSION, SavedContent)


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
        If the file cannot be written.
    """
    file = require_file_path("save", path)
    content = SavedContent(
        run.label,
        hash_model(run.equations),
        pack_run(run),
        run.all_columns(),
        run.coordinate_columns(),
        as_plain(run.metadata()),
        Checkpoint.of(run),
    )
    with atomic_write(file, kind=CHECKPOINT) as scratch, open(scratch, "wb") as stream:
        _FORMAT.write_archive(stream, content)
    return file


def load_saved_run(path: Any, equations: EquationsOfMotion | None) -> SavedRun | Solution:
    """Return the tables of a run, or the run if its equations are given.

    Raises
    ------
    BeamdaeError
        If the file cannot be read, is not a complete saved run of this version, or contains a run
        of other equations.
    """
    file = require_file_path("load", path)
    register_input(file, CHECKPOINT)
    content = _FORMAT.read_archive(file)
    run = content.run
    with _FORMAT.kind.errors_of(file):
        if equations is None:
            metadata = {**content.metadata, "label": content.label, "file": file.name}
            tables = content.table, content.coordinates
            derivatives = run.derivatives and replace(run.derivatives)
            return SavedRun(run.status, run.statistics, metadata, *tables, derivatives)
        if hash_model(equations) != content.identity:
            raise BeamdaeError(
                f"{file}: the file contains a run of a model with other parts or values; "
                "pass the model of this run, or omit the model to load only the tables."
            )
        return Solution(*unpack_fields(equations, run))
