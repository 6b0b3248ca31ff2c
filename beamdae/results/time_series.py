"""What has columns over time: by name, as tables, in files, drawn, and against another."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations import measures
from beamdae.errors import BeamdaeError, short_repr
from beamdae.results.columns import merge_columns, observed_columns, select_columns
from beamdae.results.displays import Plot, load_views
from beamdae.results.storage.files import atomic_write, require_file_path

# Tables are made for those who ask for them: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@dataclass(frozen=True, repr=False)
class TimeSeries:
    """Columns over time; a subclass has `t`, `all_columns` and `coordinates`."""

    @property
    def times(self) -> Array:
        """Output times [s]."""
        return self.all_columns()[measures.TIME]

    @property
    def label(self) -> str:
        """Short name of what made it, for legends."""
        raise NotImplementedError

    def all_columns(self) -> dict[str, Array]:
        """The columns of `table` by header, as arrays."""
        raise NotImplementedError

    def coordinates(self) -> pd.DataFrame:
        """Time, all coordinates, velocities and multipliers, named by part, with units."""
        raise NotImplementedError

    def at_times(self, times: Array) -> TimeSeries:
        """The same at other times [s], ascending and within the run."""
        raise NotImplementedError

    def _rows_at(self, times: Array, whose: str, advice: str) -> Array:
        """Which rows are at some of its own times [s], where it has no others."""
        rows = np.flatnonzero(np.isin(self.times, times))
        if not np.array_equal(self.times[rows], times):
            raise BeamdaeError(f"at_times: {whose} has no rows at some of the times; {advice}.")
        return rows

    def __getitem__(self, name: str) -> pd.Series | pd.DataFrame:
        """Columns over time, by name.

        Parameters
        ----------
        name
            A header, with or without its unit ("tip.y [m]" or "tip.y"), of an observed column, an
            energy, a coordinate, velocity or multiplier; or the name of an observable ("tip").
            Of an observable and a part of one name the observable is meant.

        Returns
        -------
        pandas.Series or pandas.DataFrame
            One column, or all those of an observable, over t [s].

        Raises
        ------
        BeamdaeError
            If there is none of the name.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
        >>> mech.observe("ball", ball.point)
        >>> solution = bd.simulate(mech, t_end=1.0)
        >>> print(f"{solution['ball.y'].min():.3f} m")
        -2.905 m
        """
        found = self._over_time(self._selected(name))
        return found.iloc[:, 0] if found.shape[1] == 1 else found

    def table(self) -> pd.DataFrame:
        """Time, observed quantities and the energy ledger; headers carry units."""
        import pandas as pd

        return pd.DataFrame(self.all_columns())

    def difference(self, other: TimeSeries, *names: str) -> pd.DataFrame:
        """Columns of this run minus those of another, over the times of this one.

        Parameters
        ----------
        other
            Another run, of the same or of another model. Between its output times it is evaluated
            by its dense output.
        names
            As for `solution[name]`; default all observed columns both have.

        Returns
        -------
        pandas.DataFrame
            Over t [s], as far as both runs go.

        Raises
        ------
        BeamdaeError
            If one of them has no such column, or they have no time in common.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
        >>> mech.observe("ball", ball.point)
        >>> a, b = (bd.simulate(mech, method, 1.0) for method in (bd.Radau(), bd.Ida(1e-8)))
        >>> bool((a.difference(b, "ball.y").abs() < 1e-6).all(axis=None))
        True
        """
        if not isinstance(other, TimeSeries):
            raise BeamdaeError(f"difference: other must be a solution, got {short_repr(other)}.")
        begin, end = (f([self.times[k], other.times[k]]) for f, k in ((max, 0), (min, -1)))
        common = self.times[(self.times >= begin) & (self.times <= end)]
        if not len(common):
            raise BeamdaeError(
                f"difference: the runs have no time in common, one is from {self.times[0]:g} to "
                f"{self.times[-1]:g} s, the other from {other.times[0]:g} to {other.times[-1]:g} s."
            )
        one, two = (run.at_times(common) for run in (self, other))
        headers = [h for name in names for h in one._selected(name)] or [
            h for h in observed_columns(one.all_columns()) if h in other.all_columns()
        ]
        every = two._every()
        missing = next((name for name in headers if name not in every), None)
        if missing is not None:
            raise BeamdaeError(f"difference: only one of the runs has the column {missing!r}.")
        return one._over_time(headers) - two._over_time(headers)

    def plot(self, *names: str) -> Plot:
        """Draw columns over time, see `beamdae.plot`."""
        return load_views().plot_time_series(self, *names)

    def to_parquet(self, path: str | Path) -> Path:
        """Write the table as Parquet (needs pyarrow: `pip install beamdae[parquet]`).

        Raises
        ------
        BeamdaeError
            If pyarrow is missing, or the file cannot be written.
        """
        file = require_file_path("to_parquet", path)
        table = self.table()
        with atomic_write(file) as scratch:
            try:
                table.to_parquet(scratch, index=False)
            except ImportError:
                raise BeamdaeError(
                    "to_parquet: it needs pyarrow, which is not there; pip install pyarrow."
                ) from None
        return file

    def _every(self) -> dict[str, Any]:
        return merge_columns(self.all_columns(), self.coordinates())

    def _selected(self, name: str) -> list[str]:
        return select_columns(self._every(), name, observed=self.all_columns())

    def _over_time(self, headers: list[str]) -> pd.DataFrame:
        import pandas as pd

        every, index = self._every(), pd.Index(self.times, name=measures.TIME)
        found = {h: np.asarray(every[h]) for h in dict.fromkeys(headers)}
        return pd.DataFrame(found).set_index(index)
