"""Controls of the live view: ranges of sliders from defaults, choices from annotations."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from typing import Any, Literal, get_args, get_origin

from beamdae.errors import BeamdaeError, require_mapping, require_pair
from beamdae.model_functions import Model
from beamdae.model_parameters import ModelParameter

# The slider of a number reaches from the default divided by this factor to the default times it.
_RANGE_FACTOR = 4.0
# A slider with positive ends is logarithmic from this ratio of its ends on.
_MIN_LOGARITHMIC_RATIO = 8.0
_FULL_TURN = {"rad": math.pi, "deg": 180.0, "°": 180.0}  # half a turn, in both directions


def create_controls(model: Model, ranges: Mapping[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return one control per parameter, as plain data for the page.

    Parameters
    ----------
    model
        The model.
    ranges
        Pairs (first, last) of slider ends by parameter, numbers or texts with units.

    Returns
    -------
    list of dict
        "name", "value", "unit", "description", "kind" ("number", "integer", "flag", "choice" or
        "text"); for numbers with a slider, its ends "low" and "high" and whether it is logarithmic
        ("log"); for choices, annotated as `Literal` texts, these values ("choices").

    Raises
    ------
    BeamdaeError
        If `ranges` has the wrong form, or names an unknown or another kind of parameter.
    """
    pairs = require_mapping(
        "view", "ranges", {} if ranges is None else ranges, "a dict of pairs by parameter"
    )
    ends = {str(name): _require_range(model, str(name), x) for name, x in pairs.items()}
    controls = [_create_control(x, ends.get(x.name)) for x in model.parameter_info.values()]
    literals = _read_literals(model)
    for control in controls:
        if control["kind"] != "text":
            continue
        name, default = control["name"], control["value"]
        if default in literals.get(name, ()):
            control |= {"kind": "choice", "choices": literals[name]}
    return controls


def _read_literals(model: Model) -> dict[str, list[str]]:
    """Return the texts of the parameters that are annotated as `Literal` texts."""
    try:
        annotations = inspect.get_annotations(model.build, eval_str=True)
    except Exception:  # Annotations can be any code, also of names that only type checkers import.
        return {}
    choices = {
        name: list(get_args(annotation))
        for name, annotation in annotations.items()
        if get_origin(annotation) is Literal
    }
    return {name: x for name, x in choices.items() if all(isinstance(text, str) for text in x)}


def _create_control(x: ModelParameter, ends: tuple[Any, Any] | None) -> dict[str, Any]:
    control = {"name": x.name, "unit": x.unit, "description": x.description}
    if isinstance(x.default, bool):
        return control | {"kind": "flag", "value": x.default}
    if not isinstance(x.default, (int, float)) or not math.isfinite(x.default):
        value = x.default if isinstance(x.default, str) else repr(x.default)
        return control | {"kind": "text", "value": value}
    kind = "integer" if isinstance(x.default, int) else "number"
    low, high = _default_range(x) if ends is None else ends
    is_log = kind == "number" and low > 0.0 and high >= _MIN_LOGARITHMIC_RATIO * low
    slider = {"low": low, "high": high, "log": is_log} if low < high else {}
    return control | {"kind": kind, "value": x.default, **slider}


def _default_range(x: ModelParameter) -> tuple[Any, Any]:
    """Return the ends of a slider; equal ends mean no slider, for a default of 0."""
    if x.unit in _FULL_TURN:
        return -_FULL_TURN[x.unit], _FULL_TURN[x.unit]
    if isinstance(x.default, int):
        return (1, int(_RANGE_FACTOR) * x.default) if x.default > 0 else (x.default, x.default)
    low, high = sorted((x.default / _RANGE_FACTOR, x.default * _RANGE_FACTOR))
    return (low, high) if math.isfinite(high - low) else (x.default, x.default)


def _require_range(model: Model, name: str, value: Any) -> tuple[Any, Any]:
    pair = require_pair("view", f"the range of {name}", value, "a pair (first, last)")
    low, high = (model.complete({name: x})[name] for x in pair)
    is_number = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in (low, high))
    if not is_number or not low < high:
        raise BeamdaeError(
            f"view: the range of {name} must be two ascending numbers, got {low} and {high}."
        )
    return low, high
