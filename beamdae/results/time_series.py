"""Results with columns by name: tables, differences between runs and plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae import deferred
from beamdae.equations import measures
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_finite,
    require_positive,
    short_repr,
)
from beamdae.results.columns import can_select, merge_columns, observed_columns, select_columns
from beamdae.results.displays import Plot
from beamdae.results.outcome import Status
from beamdae.results.storage.files import write_result

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.results.step_response import StepResponse

Array = np.ndarray


class HasColumns:
    """Base class of results whose columns are selected by name, over their times or load factors.

    Subclasses define `status`, `metadata`, `all_columns`, `coordinate_columns` and `_index`.
    """

    status: Status
    _result_name = "Solution"  # in messages

    def metadata(self) -> dict[str, Any]:
        """Return the entries of the JSON file of `to_csv`."""
        raise NotImplementedError

    def all_columns(self) -> dict[str, Any]:
        """Return the columns (k,) of `table` by header."""
        raise NotImplementedError

    def coordinate_columns(self) -> dict[str, Array]:
        """Return the columns (k,) of `coordinates` by header; empty if they are not stored."""
        raise NotImplementedError

    @property
    def _index(self) -> tuple[str, Array]:
        """Header and values (k,) of the quantity over which columns are selected."""
        raise NotImplementedError

    def table(self) -> pd.DataFrame:
        """Return all observed columns as a table; headers contain units."""
        import pandas as pd

        return pd.DataFrame(self.all_columns())

    def to_csv(self, path: str | Path, *, sep: str = ",", decimal: str = ".") -> Path:
        """Write the table as CSV and the metadata to a JSON file of the same name.

        The metadata contain status, settings, versions and, of runs, statistics. If the result is
        not complete, the table has an additional last column "status" with "failed", "limited" or
        "interrupted" in each row. Existing files are replaced atomically. Headers that a
        spreadsheet would read as formulas begin with an additional apostrophe.

        Parameters
        ----------
        path
            Path of the CSV file, with any suffix except .json.
        sep
            Separator of the columns: ",", ";" or a tab. Spreadsheets with decimal commas, as in
            most European countries, need ";".
        decimal
            Decimal sign: "." or ",", other than `sep`.

        Returns
        -------
        Path
            The path of the CSV file.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, `path` ends with .json, or a file cannot be written.
        """
        return write_result(path, self.all_columns(), self.status, self.metadata(), sep, decimal)

    def coordinates(self) -> pd.DataFrame:
        """Return coordinates and multipliers, one row per time or point of a path.

        Those of runs include times and velocities. The table has no columns if the coordinates are
        not stored.
        """
        import pandas as pd

        return pd.DataFrame(self.coordinate_columns(), index=range(len(self._index[1])))

    def __getitem__(self, name: str | Sequence[str]) -> pd.Series | pd.DataFrame:
        """Return columns over time, or over the load factor, by name.

        Parameters
        ----------
        name
            Header of an observed column, energy, coordinate, velocity or multiplier, with or
            without its unit ("tip.y [m]" or "tip.y"). The name of an observable or a part ("tip")
            selects all its columns, and a list of names the columns of all of them. If an
            observable and a part have the same name, the observable is selected.

        Returns
        -------
        pandas.Series or pandas.DataFrame
            One column, or a table if there are several or `name` is a list. The index is the time
            [s] or, of equilibria, the sum of the load factors of all stages. With
            `mech.observe("stress", beam.largest_stress())`, for example, "stress" selects a table,
            and "stress.largest" a column.

        Raises
        ------
        BeamdaeError
            If no column has this name.

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
        columns = self._over_index(self._select(name))
        is_single = columns.shape[1] == 1 and not isinstance(name, (list, tuple))
        return columns.iloc[:, 0] if is_single else columns

    def __contains__(self, name: object) -> bool:
        """Return True if `result[name]` selects columns."""
        return can_select(self._select, name)

    def _all_columns_by_header(self) -> dict[str, Any]:
        return merge_columns(self.all_columns(), self.coordinate_columns())

    def _select(self, name: Any) -> list[str]:
        columns = self._all_columns_by_header()
        return select_columns(columns, name, self._result_name, self.all_columns())

    def _over_index(self, headers: list[str]) -> pd.DataFrame:
        import pandas as pd

        columns, (name, values) = self._all_columns_by_header(), self._index
        selected = {header: np.asarray(columns[header]) for header in dict.fromkeys(headers)}
        return pd.DataFrame(selected).set_index(pd.Index(values, name=name))


@dataclass(frozen=True, repr=False)
class TimeSeries(HasColumns):
    """Base class of results over time.

    Subclasses define `label`, `all_columns`, `coordinate_columns` and `at_times`.
    """

    @property
    def times(self) -> Array:
        """Output times (k,) [s]."""
        return self.all_columns()[measures.TIME]

    @property
    def label(self) -> str:
        """Short name shown in legends."""
        raise NotImplementedError

    @property
    def _index(self) -> tuple[str, Array]:
        return measures.TIME, self.times

    def at_times(self, times: Array) -> TimeSeries:
        """Return the result at other times [s], which must ascend and lie within the run."""
        raise NotImplementedError

    def step_response(
        self,
        name: str,
        target: float | None = None,
        t: float | None = None,
        band: float = 0.02,
        t_end: float | None = None,
    ) -> StepResponse:
        """Return rise time, settling time, overshoot and steady-state error of a column.

        The definitions are those of `control.step_info` (python-control): the rise time is that
        from 10 to 90 % of the step, which is the target minus the value at `t`, and the column has
        settled when it remains within `band` of the step about the target. Rows are interpolated
        linearly, and the peak is the largest row; output steps should be a small part of the rise
        time.

        Parameters
        ----------
        name
            Name of one column, see `solution[name]`.
        target
            Value that the column should reach. Defaults to its last value, that at `t_end`.
        t
            Time of the step [s], from which the times of the result are counted; earlier rows are
            ignored. Defaults to the first row.
        band
            Half the width of the band in which the column is settled, as a fraction of the step.
        t_end
            End of the evaluated time [s], such as that of a later disturbance; later rows are
            ignored. Defaults to the last row.

        Returns
        -------
        StepResponse
            Named tuple of `rise_time` and `settling_time` [s] (nan if the column does not reach 90
            % of the step, or has not settled at the end), `overshoot` (fraction of the step),
            `peak`, `peak_time` [s] and `steady_state_error` (target minus last value; nan if the
            values in the last quarter of the time since the step differ from it by more than the
            band, which is relative to the range of the column if that is smaller than the step).

        Raises
        ------
        BeamdaeError
            If `name` does not select one column, the column starts at the target or is not finite,
            `t` or `t_end` is not within the run, or `band` is not positive.

        Examples
        --------
        Overshoot exp(-pi D / sqrt(1 - D^2)) = 0.163 of a step response with damping ratio D = 0.5:

        >>> import beamdae as bd
        >>> mech = bd.Mechanism()
        >>> x, rate = mech.state("x"), mech.state("rate")
        >>> x.follows(rate)
        >>> rate.follows(1.0 - x - rate)
        >>> run = bd.simulate(mech, t_end=20.0, output_step=0.01)
        >>> step = run.step_response("x", target=1.0)
        >>> print(f"{step.overshoot:.3f}, settled after {step.settling_time:.2f} s")
        0.163, settled after 8.08 s
        """
        headers = self._select(name)
        if len(headers) != 1:
            raise BeamdaeError(
                f"step_response: {name!r} selects {len(headers)} columns; name one of them."
            )
        values = np.asarray(self._all_columns_by_header()[headers[0]], float)
        times = self.times
        begin = times[0] if t is None else require_finite("step_response", "t", t)
        if not times[0] <= begin < times[-1]:
            start, stop, given = format_distinct(times[0], times[-1], begin)
            raise BeamdaeError(
                f"step_response: t must be within the run, {start} to {stop} s, got {given} s."
            )
        end = times[-1] if t_end is None else require_finite("step_response", "t_end", t_end)
        if not begin < end <= times[-1]:
            start, stop, given = format_distinct(begin, times[-1], end)
            raise BeamdaeError(
                f"step_response: t_end must be later than {start} s and within the run, which "
                f"ends at {stop} s, got {given} s."
            )
        width = require_positive("step_response", "band", band)
        first, last = np.interp([begin, end], times, values)
        between = (times > begin) & (times < end)
        times = np.concatenate([[begin], times[between], [end]])
        values = np.concatenate([[first], values[between], [last]])
        final = last if target is None else require_finite("step_response", "target", target)
        from beamdae.results.step_response import measure_step_response

        return measure_step_response(headers[0], times, values, final, width)

    def difference(self, other: TimeSeries, *names: str) -> pd.DataFrame:
        """Return the differences between columns of this run and of another run.

        Parameters
        ----------
        other
            The run to subtract, of the same model or a different one. A solution is evaluated at
            the times of this run; a saved run or a run of a sweep must have rows at these times.
        *names
            Names of columns, see `solution[name]`. Defaults to the observed columns that both runs
            contain.

        Returns
        -------
        pandas.DataFrame
            Differences at the output times of this run that the other run covers, indexed by time
            [s].

        Raises
        ------
        BeamdaeError
            If `other` is not a run, one of the runs does not contain a named column, the runs have
            no observed column in common, no output time of this run lies within the other run, or a
            saved run or a run of a sweep has no row at one of these times.

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
            raise BeamdaeError(
                f"difference: other must be a solution or a saved run, got {short_repr(other)}."
            )
        begin = max(self.times[0], other.times[0])
        end = min(self.times[-1], other.times[-1])
        common = self.times[(self.times >= begin) & (self.times <= end)]
        if not len(common):
            ends = (self.times[0], self.times[-1], other.times[0], other.times[-1])
            one_start, one_end, other_start, other_end = format_distinct(*ends)
            raise BeamdaeError(
                f"difference: no output time of this run ({one_start} to {one_end} s) lies within "
                f"the other run ({other_start} to {other_end} s); choose runs that overlap in time."
            )
        one, two = self.at_times(common), other.at_times(common)
        headers = [header for name in names for header in one._select(name)]
        if not headers:
            columns = other.all_columns()
            headers = [
                header for header in observed_columns(one.all_columns()) if header in columns
            ]
        if not headers:
            raise BeamdaeError(
                "difference: the runs have no observed column in common; observe the same points "
                "in both runs, or name columns such as 'energy.kinetic'."
            )
        available = two._all_columns_by_header()
        missing = next((header for header in headers if header not in available), None)
        if missing is not None:
            raise BeamdaeError(
                f"difference: only one of the runs has the column {missing!r}; observe the "
                "same columns in both runs."
            )
        return one._over_index(headers) - two._over_index(headers)

    def plot(
        self,
        *names: str,
        x: str | None = None,
        data: Any = None,
        data_columns: Mapping[str, str] | None = None,
    ) -> Plot:
        """Plot columns over time or over another column, see `beamdae.plot`.

        Parameters
        ----------
        *names
            Names of columns, see `solution[name]`. Defaults to the columns of `data` or, without
            data, to up to three characteristic columns.
        x
            Column on the horizontal axis, such as "tip.x". Defaults to time.
        data
            Measured values, plotted as markers: a table or the path of a CSV file, see
            `beamdae.plot`.
        data_columns
            Names of columns of the run for columns of `data` with other names, see `fit`.

        Raises
        ------
        BeamdaeError
            If a name selects no column, `x` selects several columns, or the data cannot be read or
            contain none of the plotted columns.
        """
        return deferred.module("report.pictures.time_plots").plot(
            self, *names, x=x, data=data, data_columns=data_columns
        )

    def _rows_at(self, times: Array, owner: str, advice: str) -> Array:
        """Return the indices of the rows at exactly these times [s], or raise BeamdaeError."""
        rows = np.flatnonzero(np.isin(self.times, times))
        if not np.array_equal(self.times[rows], times):
            raise BeamdaeError(f"at_times: {owner} has no rows at some of the times; {advice}.")
        return rows
