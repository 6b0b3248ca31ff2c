"""Provenance of a result: parts of the mechanism with their parameters, and hashes."""

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
    """Return the hash of the equations and, for a mechanism, its gravity and parts.

    The dictionary is JSON-compatible.
    """
    description: dict[str, Any] = {"identity": hash_model(equations)}
    mechanism = equations.mechanism
    if mechanism is not None:
        description["gravity"] = mechanism.gravity.tolist()
        description["parts"] = {
            name: {"kind": type(part).__name__, **_describe_fields(part, set())}
            for name, part in mechanism.parts.items()
        }
    return description


def _describe_fields(instance: Any, described: set[int]) -> dict[str, Any]:
    """Return descriptions of the public fields of an instance, by name.

    The field `name` and fields that cannot be described are omitted.

    `described` contains the ids of dataclass instances that have been described and are skipped.
    """
    if is_dataclass(instance):
        names = [f.name for f in fields(instance) if f.init]
    else:
        names = list(vars(instance))
    values = {
        name: _describe_value(getattr(instance, name, None), described)
        for name in names
        if name != "name" and not name.startswith("_")
    }
    return {name: value for name, value in values.items() if value is not None}


def _describe_value(value: Any, described: set[int]) -> Any:
    """Return a JSON-compatible description of a value, or None if it cannot be described."""
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        return _describe_value(value.tolist(), described)
    if isinstance(value, Attachment):
        return {"body": value.body.name, "at": list(value.point)}
    if isinstance(value, Part):
        return value.name
    if isinstance(value, Mapping):
        return {str(key): _describe_value(x, described) for key, x in value.items()}
    if isinstance(value, (list, tuple)):
        if len(value) > _MAX_ENTRIES:
            return f"{len(value)} entries"
        return [_describe_value(x, described) for x in value]
    if is_dataclass(value) and id(value) not in described:
        described.add(id(value))
        return {"kind": type(value).__name__, **_describe_fields(value, described)}
    return "function" if callable(value) and not is_dataclass(value) else None
