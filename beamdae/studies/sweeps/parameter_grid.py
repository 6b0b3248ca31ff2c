"""Parameter values of the cases of a sweep, their positions in a grid, and samples of the cases."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    require_entries,
    require_mapping,
    short_repr,
)
from beamdae.model_functions import Model
from beamdae.read_only import read_only_data
from beamdae.studies.case import format_parameter, grid, list_entries

Array = np.ndarray


@read_only_data
@dataclass(frozen=True)
class GridAxis:
    """Values of a parameter of a sweep.

    Attributes
    ----------
    name
        Name of the parameter; "case" if the cases are a list without a grid.
    values
        Values in the order of the axis: numbers ascending, others in the order of the cases.
    is_numeric
        True if all values are numbers.
    """

    name: str
    values: tuple[Any, ...]
    is_numeric: bool

    @classmethod
    def of(cls, name: str, settings: Sequence[Mapping[str, Any]]) -> GridAxis:
        """Return the axis of a parameter of the cases."""
        values = list({repr(x[name]): x[name] for x in settings}.values())
        is_numeric = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in values)
        return cls(name, tuple(sorted(values) if is_numeric else values), is_numeric)

    def locate(self, settings: Sequence[Mapping[str, Any]]) -> list[int]:
        """Return the index of the value of each case."""
        indices = {repr(x): k for k, x in enumerate(self.values)}
        return [indices[repr(setting[self.name])] for setting in settings]


@read_only_data
@dataclass(frozen=True)
class ParameterGrid:
    """Cases arranged by the values of the varied parameters.

    Attributes
    ----------
    axes
        One axis per varied parameter; one axis with all cases if the cases do not form a full
        grid; none for a single case.
    positions
        Index of each case along each axis, (cases, axes).
    """

    axes: tuple[GridAxis, ...]
    positions: Array

    @classmethod
    def of(cls, settings: Sequence[Mapping[str, Any]], axes: tuple[GridAxis, ...]) -> ParameterGrid:
        """Return the grid of the parameter values `settings` of the cases."""
        columns = [axis.locate(settings) for axis in axes]
        positions = np.array(columns, int).reshape(len(axes), len(settings)).T
        size = math.prod(len(axis.values) for axis in axes)
        if size == len(settings) == len(np.unique(positions, axis=0)):
            return cls(axes, positions)
        numbers = tuple(range(1, len(settings) + 1))
        return cls((GridAxis("case", numbers, True),), np.arange(len(settings))[:, None])

    def sample(self, limit: int) -> set[int]:
        """Return at most `limit` cases that span the grid evenly, as row numbers.

        The sample is a grid as well and includes the ends of each axis if `limit` permits.
        """
        counts = [1] * len(self.axes)
        # Add a node to each axis in turn while the limit permits.
        unfinished = list(range(len(counts)))
        while unfinished:
            k = min(unfinished, key=lambda axis: counts[axis])
            fits = math.prod(counts) // counts[k] * (counts[k] + 1) <= limit
            if fits and counts[k] < len(self.axes[k].values):
                counts[k] += 1
            else:
                unfinished.remove(k)
        is_in_sample = np.ones(len(self.positions), bool)
        for k, (axis, count) in enumerate(zip(self.axes, counts, strict=True)):
            nodes = np.linspace(0, len(axis.values) - 1, count).round().astype(int)
            is_in_sample &= np.isin(self.positions[:, k], nodes)
        return set(np.flatnonzero(is_in_sample).tolist())


@dataclass(frozen=True)
class ParameterValue:
    """Value of a parameter, and its form in tables and labels."""

    value: Any
    label: Any


def expand_values(part: str, model: Model, over: Any) -> list[dict[str, ParameterValue]]:
    """Return the parameters of each case.

    `over` contains values by parameter, or is a list of combinations. A parameter that a
    combination omits has the default of the model.

    Raises
    ------
    BeamdaeError
        If `over` has the wrong form, or a parameter is unknown, has no values, or has a value of
        the wrong type.
    """
    allowed = "a dict of values by parameter, or a list of parameter combinations"
    if isinstance(over, Mapping):
        by_name = require_mapping(part, "over", over, allowed)
        if not by_name:
            raise BeamdaeError(f"{part}: over must be {allowed}, got {{}}.")
        return grid(**{x: _require_values(part, model, x, y) for x, y in by_name.items()})
    entries = list_entries(part, "over", over, allowed)
    if not entries or not all(isinstance(combination, Mapping) for combination in entries):
        raise BeamdaeError(f"{part}: over must be {allowed}, got {short_repr(over)}.")
    listed = [require_mapping(part, "over", combination, allowed) for combination in entries]
    names = list(dict.fromkeys(name for combination in listed for name in combination))
    return [
        {x: _check_value(model, x, combination.get(x, model.parameters.get(x))) for x in names}
        for combination in listed
    ]


def _require_values(part: str, model: Model, name: Any, values: Any) -> list[ParameterValue]:
    if name not in model.parameters:
        model.complete({name: None})  # raises the error that names the model's parameters
    allowed = "a list of values, or a dict of values by name"
    if isinstance(values, Mapping):
        by_label = require_entries(part, name, values, allowed)
        checked = [_check_value(model, name, x, str(label)) for label, x in by_label.items()]
    else:
        checked = [_check_value(model, name, x) for x in list_entries(part, name, values, allowed)]
    if not checked:
        raise BeamdaeError(f"{part}: {name} must have at least one value, got none.")
    return checked


def _check_value(model: Model, name: str, value: Any, label: str | None = None) -> ParameterValue:
    checked = model.complete({name: value})[name]
    if label is not None:
        return ParameterValue(checked, label)
    plain = isinstance(checked, (bool, int, float, str))
    return ParameterValue(checked, checked if plain else format_parameter(checked))
