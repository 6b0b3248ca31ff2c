"""Derivatives of the columns of a run with respect to parameters of its model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, require_choice
from beamdae.read_only import read_only_data
from beamdae.results.columns import require_one_column, select_columns

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@read_only_data
@dataclass(frozen=True, eq=False)
class ColumnDerivatives:
    """Derivatives of columns of a run with respect to parameters of its model function.

    Attributes
    ----------
    t
        Times (k,) [s].
    parameters
        Values of the parameters by name.
    observed, coordinates
        Derivatives (k,) of the observed columns, and of the coordinates, velocities and
        multipliers, by parameter and header of the column, in the unit of the column per unit of
        the parameter.
    evaluate
        Function that returns the derivatives at other times [s]; None for a run from a file or
        another process.
    """

    t: Array
    parameters: Mapping[str, float]
    observed: Mapping[str, Mapping[str, Array]]
    coordinates: Mapping[str, Mapping[str, Array]]
    evaluate: Callable[[Array], ColumnDerivatives] | None = None

    def at_times(self, times: Array) -> ColumnDerivatives:
        """Return the derivatives at other times [s] within the run.

        Raises
        ------
        BeamdaeError
            If the run comes from a file, and has no row at one of the times.
        """
        if np.array_equal(times, self.t):
            return self
        if self.evaluate is not None:
            return replace(self.evaluate(times), evaluate=self.evaluate)
        rows = np.flatnonzero(np.isin(self.t, times))
        if not np.array_equal(self.t[rows], times):
            raise BeamdaeError(
                "at_times: the derivatives of a run from a file are known only at its output "
                "times; choose these times, or simulate the run again."
            )

        def select(columns: Mapping[str, Mapping[str, Array]]) -> dict[str, dict[str, Array]]:
            return {name: {h: x[rows] for h, x in y.items()} for name, y in columns.items()}

        return ColumnDerivatives(
            times, self.parameters, select(self.observed), select(self.coordinates)
        )

    def columns(self) -> dict[str, Array]:
        """Return the derivatives of the observed columns (k,) by their own headers."""
        return derivative_columns(self.observed)

    def sensitivity(self, column: str, parameter: str) -> pd.Series:
        """Return the derivative of a column over time, see `Solution.sensitivity`."""
        parameter = require_choice("sensitivity", "parameter", parameter, list(self.parameters))
        observed = self.observed[parameter]
        columns = {**observed, **self.coordinates[parameter], **observed}
        return select_derivative(columns, column, parameter, (TIME, self.t), observed=observed)


def require_derivatives(derivatives: ColumnDerivatives | None) -> ColumnDerivatives:
    """Return the derivatives of a run if it has them.

    Raises
    ------
    BeamdaeError
        If the run has no derivatives.
    """
    if derivatives is None:
        raise BeamdaeError(
            "sensitivity: the run has no derivatives; name the parameters in "
            "simulate(..., sensitivities=[...]), and check that the run reached its end."
        )
    return derivatives


def derivative_header(column: str, parameter: str) -> str:
    """Return the header of a derivative, such as 'd(tip.y)/d(E) [m per unit of E]'."""
    name, _, unit = column.removesuffix("]").rpartition(" [")
    return f"d({name})/d({parameter}) [{unit} per unit of {parameter}]"


def derivative_columns(by_parameter: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return derivatives by header, from those by parameter and header of the column."""
    return {
        derivative_header(header, parameter): values
        for parameter, columns in by_parameter.items()
        for header, values in columns.items()
    }


def select_derivative(
    columns: Mapping[str, Array],
    column: str,
    parameter: str,
    index: tuple[str, Array],
    of: str = "Solution",
    observed: Iterable[str] = (),
) -> pd.Series:
    """Return the derivative of a column with respect to a parameter.

    Parameters
    ----------
    columns
        Derivatives (k,) by header of the column.
    column, of, observed
        Name of the column, see `select_columns`.
    parameter
        Name of the parameter.
    index
        Name and values (k,) of the index.

    Raises
    ------
    BeamdaeError
        If the name selects no column or several columns.
    """
    import pandas as pd

    selected = select_columns(columns, column, of=of, observed=observed)
    header = require_one_column("sensitivity", column, selected)
    name, values = index
    return pd.Series(
        columns[header], pd.Index(values, name=name), name=derivative_header(header, parameter)
    )
