"""Events: what a run watches for, and what it does then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from beamdae.errors import BeamdaeError, finite, keep, one_of, shown
from beamdae.parts.part import Part, require_name
from beamdae.symbolic.statements import Quantity

# Signs of the rate at which a quantity goes through its value; 0: either.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}


@dataclass(frozen=True)
class Switch:
    """Joints and forces, by name, that become active or inactive."""

    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()


def activate(*parts: Part) -> Switch:
    """Have joints and forces act from an event on, as `do` of it."""
    return Switch(on=_names("activate", parts))


def deactivate(*parts: Part) -> Switch:
    """Have joints and forces act no longer from an event on, as `do` of it."""
    return Switch(off=_names("deactivate", parts))


def _names(what: str, parts: tuple[Any, ...]) -> tuple[str, ...]:
    for part in parts:
        if not isinstance(part, Part):
            raise BeamdaeError(f"{what}: expected joints and forces, got {shown(part)}.")
    return tuple(part.name for part in parts)


@dataclass(frozen=True, eq=False)
class Event:
    """A quantity goes through a value, in a direction.

    A quantity that touches its value and turns back, that begins with it, or that keeps it, does
    not cross it.

    Parameters
    ----------
    what
        An observed column, such as "tip.y", or a quantity of one column.
    crosses
        The value [unit of the column].
    direction
        "up", "down" or "both".
    do
        "stop": the run ends there; "record": it goes on; activate(part, ...), deactivate(part, ...)
        or a list of these: it goes on with these joints and forces, or without. A joint that
        becomes active is closed there; velocities change at once to what it allows, by impulses
        told in `Solution.events`, and the energy this takes counts as dissipated.
    name
        What it is called in results; default: what crosses which value.
    """

    what: Any
    crosses: float = 0.0
    direction: str = "both"
    do: Any = "stop"
    name: str | None = None

    def __post_init__(self) -> None:
        part = "event" if self.name is None else require_name("event", self.name)
        if not isinstance(self.what, (str, Quantity)):
            raise BeamdaeError(
                f"{part}: it must watch an observed column, named such as 'tip.y', or a quantity "
                f"of one column, got {shown(self.what)}."
            )
        crosses = finite(part, "crosses", self.crosses)
        if self.name is None and not isinstance(self.what, str):
            raise BeamdaeError("event: one that watches a quantity needs a name=.")
        one_of(part, "direction", self.direction, tuple(DIRECTIONS))
        do = (self.do,) if isinstance(self.do, Switch) else self.do
        if isinstance(do, (list, tuple)) and do and all(isinstance(x, Switch) for x in do):
            keep(self, do=tuple(do))
        elif not (isinstance(self.do, str) and self.do in ("stop", "record")):
            raise BeamdaeError(
                f"{part}: do must be 'stop', 'record', activate(...) or deactivate(...), "
                f"got {shown(self.do)}."
            )
        named = f"{self.what} crosses {crosses:g}" if self.name is None else self.name
        keep(self, crosses=crosses, name=named)
