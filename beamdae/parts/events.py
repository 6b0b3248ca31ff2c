"""Events: what a run watches for, and what it does then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    require_choice,
    require_finite,
    require_name,
    set_fields,
    short_repr,
)
from beamdae.parts.laws import Law
from beamdae.symbolic.statements import Quantity

# Signs of the rate at which a quantity goes through its value; 0: either.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}


@dataclass(frozen=True)
class Switch:
    """Joints and forces, by name, that become active or inactive.

    Attributes
    ----------
    on, off
        Which become active, and which inactive.
    as_is
        Those of the former that hold what they find.
    laws
        Laws of the time since the event [s] that some of those follow from there on.
    """

    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()
    as_is: tuple[str, ...] = ()
    laws: tuple[tuple[str, Law], ...] = ()


@dataclass(frozen=True, eq=False)
class Impact:
    """Velocities that change at once, by Newton's restitution, see `impact`."""

    on: Any
    restitution: float


Action = Switch | Impact


def select_switches(do: Any) -> tuple[Switch, ...]:
    """The switches among what an event does."""
    return tuple(x for x in do if isinstance(x, Switch)) if isinstance(do, tuple) else ()


def select_impacts(do: Any) -> tuple[Impact, ...]:
    """The impacts among what an event does."""
    return tuple(x for x in do if isinstance(x, Impact)) if isinstance(do, tuple) else ()


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
        "stop": the run ends there; "record": it goes on; activate(part, ...),
        deactivate(part, ...), change_law(driver, law), impact(gap) or a list of these: it goes on
        with these joints and forces, or without, and with other velocities. A joint that becomes
        active is closed there, or holds what it finds; velocities change at once to what it allows,
        by impulses told in `Solution.events`, and the energy this takes counts as dissipated.
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
                f"of one column, got {short_repr(self.what)}."
            )
        crosses = require_finite(part, "crosses", self.crosses)
        if self.name is None and not isinstance(self.what, str):
            raise BeamdaeError("event: one that watches a quantity needs a name=.")
        require_choice(part, "direction", self.direction, tuple(DIRECTIONS))
        do = (self.do,) if isinstance(self.do, Action) else self.do
        if isinstance(do, (list, tuple)) and do and all(isinstance(x, Action) for x in do):
            set_fields(self, do=tuple(do))
        elif not (isinstance(self.do, str) and self.do in ("stop", "record")):
            raise BeamdaeError(
                f"{part}: do must be 'stop', 'record', activate(...), deactivate(...), "
                f"change_law(...) or impact(...), got {short_repr(self.do)}."
            )
        named = f"{self.what} crosses {crosses:g}" if self.name is None else self.name
        set_fields(self, crosses=crosses, name=named)
