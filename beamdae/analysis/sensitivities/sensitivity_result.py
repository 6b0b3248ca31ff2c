"""Common part of the results of `sensitivities` and its counterparts for other analyses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_choice,
    require_mapping,
    require_names,
    short_repr,
    suggest,
)
from beamdae.model_functions import Model, require_model_function
from beamdae.results.column_derivatives import derivative_columns, select_derivative
from beamdae.results.displays import HasTable

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


class SensitivityResult(HasTable, ABC):
    """An analysis and the derivatives of its columns with respect to `parameters`."""

    parameters: Mapping[str, float]

    def __repr__(self) -> str:
        by = ", ".join(f"{name} = {value:g}" for name, value in self.parameters.items())
        return f"<{type(self).__name__} by {by}; {self._summary}>"

    @property
    @abstractmethod
    def _summary(self) -> str:
        """Description of the analysis for `repr`."""

    @property
    @abstractmethod
    def _index(self) -> tuple[str, Array]:
        """Name and values (k,) of the index of the columns."""

    @property
    @abstractmethod
    def _columns(self) -> Mapping[str, Mapping[str, Array]]:
        """Derivatives (k,) by parameter and header of the column."""

    def _further_columns(self, parameter: str) -> Mapping[str, Array]:
        """Return derivatives by header that the table omits."""
        return {}

    def sensitivity(self, column: str, parameter: str) -> pd.Series:
        """Return the derivative of a column with respect to a parameter.

        Parameters
        ----------
        column
            Header of an observed column, with or without its unit, such as "tip.y". Runs and
            equilibria also have those of coordinates and multipliers, and runs velocities.
        parameter
            Name of the parameter.

        Returns
        -------
        pandas.Series
            Derivative (k,) in the unit of the column per unit of the parameter; NaN where it does
            not exist. The index is that of the analysis: times [s], load factors, numbers of modes,
            or times [s] at fixed phases (t - t_start) / period.

        Raises
        ------
        BeamdaeError
            If the parameter is not one of `parameters`, or the name selects no column or several
            columns; works are not differentiated.
        """
        parameter = require_choice("sensitivity", "parameter", parameter, list(self.parameters))
        columns, name = self._columns[parameter], type(self).__name__
        everything = {**self._further_columns(parameter), **columns}
        return select_derivative(everything, column, parameter, self._index, name, columns)

    def table(self) -> pd.DataFrame:
        """Return the index and the derivatives of all columns, one row per value of the index.

        The header of the derivative of "tip.y [m]" with respect to "E" is "d(tip.y)/d(E) [m per
        unit of E]".
        """
        import pandas as pd

        name, values = self._index
        return pd.DataFrame({name: values, **self._values, **derivative_columns(self._columns)})

    @property
    def _values(self) -> Mapping[str, Array]:
        """Columns of the table beside the derivatives."""
        return {}


def require_parameters(
    caller: str, model: Any, by: Any, argument: str = "by", *, allows_lists: bool = False
) -> tuple[str, ...]:
    """Return the names in `by` if they are distinct float parameters of the model.

    `caller` is the calling function and `argument` the name of its argument, for messages. With
    `allows_lists`, lists and tuples of floats are parameters, too.
    """
    require_model_function(caller, model)
    names = tuple(require_names(caller, argument, by, "a list of names of parameters"))
    if not names or len(set(names)) < len(names):
        raise BeamdaeError(
            f"{caller}: {argument} must contain each parameter once, got {short_repr(names)}."
        )

    available = []
    for key, value in model.parameters.items():
        is_list = allows_lists and isinstance(value, (tuple, list)) and len(value) > 0
        if isinstance(value, float) or (is_list and all(as_real(x) is not None for x in value)):
            available.append(key)
    kind = "neither a float nor a list of floats" if allows_lists else "not a float"
    for name in names:
        if name not in model.parameters:
            raise BeamdaeError(
                f"{caller}: {model.name} has no parameter {short_repr(name)}"
                f"{suggest(str(name), available)}; parameters with derivatives: "
                f"{', '.join(available) or 'none'}."
            )
        value = model.parameters[name]
        if name not in available:
            is_whole = isinstance(value, int) and not isinstance(value, bool)
            remedy = (
                f"; compare whole numbers by sweep, or write {value}.0 in the model for a real "
                "number"
            )
            raise BeamdaeError(
                f"{caller}: {name} of {model.name} is {kind} ({short_repr(value)}) and has no "
                f"derivative{remedy if is_whole else ''}."
            )
    return names


def select_parameters(
    caller: str, model: Any, by: Any, parameters: Any, *, allows_lists: bool = False
) -> tuple[tuple[str, ...], Model]:
    """Return the names of `require_parameters`, and the model with changed `parameters`."""
    names = require_parameters(caller, model, by, allows_lists=allows_lists)
    return names, change_defaults(caller, model, parameters)


def change_defaults(caller: str, model: Model, parameters: Any) -> Model:
    """Return the model with other values of `parameters`, by name or None, as defaults."""
    return replace(model, parameters=complete_parameters(caller, model, parameters))


def complete_parameters(caller: str, model: Model, parameters: Any) -> dict[str, Any]:
    """Return the values of all parameters, of which `parameters` changes some, or is None."""
    given = {} if parameters is None else parameters
    return model.complete(require_mapping(caller, "parameters", given, "values by name"))
