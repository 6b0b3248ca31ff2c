"""Results with columns that are selected by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.results.columns import can_select, merge_columns, select_columns
from beamdae.results.outcome import Status
from beamdae.results.storage.files import write_result

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

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
