"""A run of a sweep, of which its rows are kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from beamdae.equations.measures import TIME
from beamdae.results.outcome import Status
from beamdae.results.time_series import TimeSeries

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class SweptRun(TimeSeries):
    """A run of a sweep: what it observed over time, looked at as a `Solution` is.

    Attributes
    ----------
    name
        The parameters that vary, with their values.
    parameters
        What is told of all parameters.
    status
        How it ended.
    warnings
        Sentences on what is not to be trusted as it stands.
    """

    name: str
    parameters: Mapping[str, Any]
    status: Status
    rows: pd.DataFrame
    warnings: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The parameters that vary, with their values."""
        return self.name

    def all_columns(self) -> dict[str, Array]:
        """The columns of `table` by header, as arrays."""
        columns = {str(c): self.rows[c].to_numpy(float) for c in self.rows}
        return {TIME: self.rows.index.to_numpy(float), **columns}

    def coordinates(self) -> pd.DataFrame:
        """No coordinates are kept."""
        return pd.DataFrame(index=range(len(self.rows)))

    def at_times(self, times: Array) -> SweptRun:
        """The same at some of its own times [s]."""
        advice = "its sweep and the other run must have the same output_step"
        rows = self.rows.iloc[self._rows_at(times, f"the run {self.name}", advice)]
        return SweptRun(self.name, self.parameters, self.status, rows, self.warnings)

    def __repr__(self) -> str:
        ended = f"{self.status.kind}, {self.status.sentence}"
        return f"<SweptRun of {self.name}: {ended}; {len(self.rows)} rows>"
