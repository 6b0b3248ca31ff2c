"""Events: what a run watches for, and what it does then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from beamdae.errors import BeamdaeError, finite, keep, one_of, shown
from beamdae.parts.part import require_name
from beamdae.symbolic.statements import Quantity

# Signs of the rate at which a quantity goes through its value; 0: either.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}


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
        "stop": the run ends there; "record": it goes on.
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
        one_of(part, "do", self.do, ("stop", "record"))
        named = f"{self.what} crosses {crosses:g}" if self.name is None else self.name
        keep(self, crosses=crosses, name=named)
