"""Provenance of a result: hash of the equations, and parts of the mechanism with their fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.model_hash import hash_model
from beamdae.parts.attachments import Attachment
from beamdae.parts.part import Part

_MAX_ENTRIES = 16  # longer lists, such as measured points, are replaced by their length


def describe_provenance(equations: EquationsOfMotion) -> dict[str, Any]:
    """Return the hash of the equations and, for a mechanism, its gravity and parts, for JSON."""
    description: dict[str, Any] = {"identity": hash_model(equations)}
    mechanism = equations.mechanism
    if mechanism is not None:
        description["gravity"] = mechanism.gravity.tolist()
        parts = mechanism.parts.items()
        description["parts"] = {name: _describe_fields(part, set()) for name, part in parts}
    return description


def _describe_fields(instance: Any, described: set[int]) -> dict[str, Any]:
    """Return class and public fields; instances with ids in `described` are not repeated."""
    described.add(id(instance))
    is_data = is_dataclass(instance)
    names = [f.name for f in fields(instance) if f.init] if is_data else vars(instance)
    values = {
        name: _describe_value(getattr(instance, name, None), described)
        for name in names
        if name != "name" and not name.startswith("_")
    }
    kind = {"class": type(instance).__name__}
    return kind | {name: value for name, value in values.items() if value is not None}


def _describe_value(value: Any, described: set[int]) -> Any:
    """Return a description for JSON, or None if there is none."""
    match value:
        case bool() | int() | float() | str():
            return value
        case np.ndarray() | np.generic():
            return _describe_value(value.tolist(), described)
        case Attachment():
            return {"body": value.body.name, "at": list(value.point)}
        case Part():
            return value.name
        case Mapping():
            return {str(key): _describe_value(x, described) for key, x in value.items()}
        case list() | tuple():
            if len(value) > _MAX_ENTRIES:
                return f"{len(value)} entries"
            return [_describe_value(x, described) for x in value]
    if is_dataclass(value):
        return None if id(value) in described else _describe_fields(value, described)
    return "function" if callable(value) else None
