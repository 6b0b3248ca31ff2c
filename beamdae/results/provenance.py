"""What a result is the result of: parts with their numbers, and a hash of the equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.model_hash import hash_model
from beamdae.parts.attachments import Attachment
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part

# Longer lists, such as measured points, are told by their number.
_MOST_ENTRIES = 16


def describe_provenance(equations: EquationsOfMotion) -> dict[str, Any]:
    """Hash of the equations, see `hash_model`, and what the mechanism is made of, if it is one."""
    told: dict[str, Any] = {"identity": hash_model(equations)}
    mechanism = equations.mechanism
    return told if mechanism is None else told | _mechanism(mechanism)


def _mechanism(mechanism: Mechanism) -> dict[str, Any]:
    parts = {
        name: {"kind": type(part).__name__, **_values(part, set())}
        for name, part in mechanism.parts.items()
    }
    return {"gravity": mechanism.gravity.tolist(), "parts": parts}


def _values(thing: Any, told: set[int]) -> dict[str, Any]:
    """What something was made with, by argument; what is in `told` already is left out."""
    names = [f.name for f in fields(thing) if f.init] if is_dataclass(thing) else list(vars(thing))
    found = {
        name: _plain(getattr(thing, name, None), told)
        for name in names
        if name != "name" and not name.startswith("_")
    }
    return {name: value for name, value in found.items() if value is not None}


def _plain(value: Any, told: set[int]) -> Any:
    """A value in JSON, or None."""
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist(), told)
    if isinstance(value, Attachment):
        return {"body": value.body.name, "at": list(value.point)}
    if isinstance(value, Part):
        return value.name
    if isinstance(value, Mapping):
        return {str(k): _plain(x, told) for k, x in value.items()}
    if isinstance(value, (list, tuple)):
        most = len(value) <= _MOST_ENTRIES
        return [_plain(x, told) for x in value] if most else f"{len(value)} entries"
    if is_dataclass(value) and id(value) not in told:
        told.add(id(value))
        return {"kind": type(value).__name__, **_values(value, told)}
    return "function" if callable(value) and not is_dataclass(value) else None
