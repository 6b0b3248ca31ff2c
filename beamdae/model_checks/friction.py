"""Warnings of analyses at rest about friction, which depends on the sliding velocity."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import list_first

_MAX_NAMES = 3  # of parts with friction in a warning

IGNORED = (
    "friction depends on the sliding velocity and is zero at rest, so this equilibrium ignores it"
)
DAMPING = (
    "about a state at rest, friction acts as a damper, which friction_speed determines, and damps "
    "small motions only; omit it from linear analyses, or choose an instant of sliding"
)


def friction_warnings(
    e: EquationsOfMotion, consequence: str, inactive: Collection[str]
) -> Iterator[str]:
    """Yield a warning that names the active parts with friction."""
    names = [name for name in e.frictions if name not in inactive]
    if names:
        yield f"{list_first(names, _MAX_NAMES)}: {consequence}."
