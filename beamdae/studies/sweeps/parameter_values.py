"""The values of parameters a sweep goes through, and what is told of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from beamdae.errors import BeamdaeError, require_iterable, short_repr
from beamdae.model_functions import Model
from beamdae.studies.case import format_parameter, grid

_MOST_VALUES = 1_000_000


@dataclass(frozen=True)
class Value:
    """A value of a parameter, and what is told of it."""

    value: Any
    told: Any


def combinations_of(part: str, model: Model, over: Any) -> list[dict[str, Value]]:
    """The parameters of each case, from values by parameter or a list of combinations.

    Raises
    ------
    BeamdaeError
        If the model has no such parameter, one has no values, or values of a wrong type.
    """
    if isinstance(over, Mapping) and over:
        lists = {name: _values(part, model, name, values) for name, values in over.items()}
        return grid(**lists)
    wanted = "a dict of values by parameter, or a list of combinations of them"
    listed = _listed(part, "over", None if isinstance(over, Mapping) else over, wanted)
    if not listed or not all(isinstance(one, Mapping) for one in listed):
        raise BeamdaeError(f"{part}: over must be {wanted}, got {short_repr(over)}.")
    names = list(dict.fromkeys(name for one in listed for name in one))
    # What one of them leaves open is as the model has it.
    whole = [{x: one.get(x, model.parameters.get(x)) for x in names} for one in listed]
    return [{x: _value(model, x, value) for x, value in one.items()} for one in whole]


def _values(part: str, model: Model, name: Any, values: Any) -> list[Value]:
    if name not in model.parameters:
        model.complete({name: None})
    if isinstance(values, Mapping):
        found = [_value(model, name, value, str(told)) for told, value in values.items()]
    else:
        wanted = "a list of values, or a dict of them by name"
        found = [_value(model, name, x) for x in _listed(part, name, values, wanted)]
    if not found:
        raise BeamdaeError(f"{part}: {name} must have at least one value, got none.")
    return found


def _listed(part: str, name: str, values: Any, wanted: str) -> list[Any]:
    """The entries of whatever has an order, if they are not too many."""
    unordered = isinstance(values, (str, bytes, set, frozenset))
    found = require_iterable(part, name, None if unordered else values, wanted, _MOST_VALUES + 1)
    if len(found) > _MOST_VALUES:
        raise BeamdaeError(f"{part}: {name} must have at most {_MOST_VALUES} values, got more.")
    return found


def _value(model: Model, name: str, value: Any, told: str | None = None) -> Value:
    checked = model.complete({name: value})[name]
    if told is not None:
        return Value(checked, told)
    plain = isinstance(checked, (bool, int, float, str))
    return Value(checked, checked if plain else format_parameter(checked))
