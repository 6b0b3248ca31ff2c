"""How a mechanism may be asked to start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beamdae.errors import BeamdaeError, require_finite, short_repr

AS_DRAWN, EQUILIBRIUM = "as drawn", "equilibrium"
_ALLOWED = (
    f"{AS_DRAWN!r}, {EQUILIBRIUM!r} or a dict of positions and velocities by name such as "
    "{'crank.angle': 0.3, 'crank.angle_dot': 5.0}"
)


def require_start(part: str, start: Any, more: str = "") -> Any:
    """Return `start` if it is one that can be asked for; `more` is what may be besides."""
    if isinstance(start, str) and start in (AS_DRAWN, EQUILIBRIUM):
        return start
    if isinstance(start, Mapping) and all(isinstance(name, str) for name in start):
        return {
            name: require_finite(part, f"start[{short_repr(name)}]", start[name]) for name in start
        }
    raise BeamdaeError(f"{part}: start must be {_ALLOWED}{more}, got {short_repr(start)}.")
