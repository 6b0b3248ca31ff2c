"""Common part of the results of `sensitivities` and its counterparts for other analyses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    require_choice,
    require_mapping,
    require_names,
    short_repr,
    suggest,
)
from beamdae.model_functions import Model
from beamdae.results.columns import require_one_column, select_columns
from beamdae.results.storage.files import write_escaped_table

# Imported by the methods that return tables: importing pandas takes as long as a short run.
if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


class SensitivityResult(ABC):
    """An analysis and its derivatives with respect to `parameters`, values by name."""

    parameters: Mapping[str, float]

    def __repr__(self) -> str:
        by = ", ".join(f"{name} = {value:g}" for name, value in self.parameters.items())
        return f"<{type(self).__name__} by {by}; {self._summary}>"

    @property
    @abstractmethod
    def _summary(self) -> str:
        """Description of the analysis for `repr`."""

    @abstractmethod
    def table(self) -> pd.DataFrame:
        """Return the derivatives with respect to all parameters."""

    def to_csv(self, path: str | Path) -> Path:
        """Write `table` as CSV and return the path.

        Raises
        ------
        BeamdaeError
            If the path is invalid or the file cannot be written.
        """
        return write_escaped_table(path, self.table())

    def _require_parameter(self, caller: str, parameter: str) -> str:
        name: str = require_choice(caller, "parameter", parameter, list(self.parameters))
        return name


def derivative_header(column: str, parameter: str) -> str:
    """Return the header of the derivative of a column, such as 'd(tip.y)/d(E) [m per unit]'."""
    name, _, unit = column.removesuffix("]").rpartition(" [")
    return f"d({name})/d({parameter}) [{unit} per unit]"


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


def require_parameter_names(caller: str, model: Any, by: Any) -> tuple[str, ...]:
    """Return the names in `by` if they are distinct and `model` is a model function.

    `caller` is the calling function, for messages.
    """
    if not isinstance(model, Model):
        raise BeamdaeError(
            f"{caller}: model must be a model function (bd.model), got {short_repr(model)}."
        )
    names = tuple(require_names(caller, "by", by, "a list of names of parameters"))
    if not names or len(set(names)) < len(names):
        raise BeamdaeError(
            f"{caller}: by must contain each parameter once, got {short_repr(names)}."
        )
    return names


def require_parameters(caller: str, model: Any, by: Any) -> tuple[str, ...]:
    """Return the names in `by` if they are float parameters of the model.

    `caller` is the calling function, for messages.
    """
    names = require_parameter_names(caller, model, by)
    for name in names:
        if name not in model.parameters:
            available = [k for k, x in model.parameters.items() if isinstance(x, float)]
            raise BeamdaeError(
                f"{caller}: {model.name} has no parameter {short_repr(name)}"
                f"{suggest(str(name), available)}; parameters with derivatives: "
                f"{', '.join(available) or 'none'}."
            )
        if not isinstance(model.parameters[name], float):
            raise BeamdaeError(
                f"{caller}: {name} of {model.name} is not a float "
                f"({short_repr(model.parameters[name])}) and has no derivative."
            )
    return names


def complete_parameters(caller: str, model: Model, parameters: Any) -> dict[str, Any]:
    """Return the values of all parameters, of which `parameters` changes some, or is None."""
    given = {} if parameters is None else parameters
    return model.complete(require_mapping(caller, "parameters", given, "values by name"))
