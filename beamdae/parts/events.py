"""Events: crossings of a value by a quantity, and the actions they trigger."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from beamdae.errors import (
    BeamdaeError,
    plain_text,
    require_choice,
    require_finite,
    require_name,
    require_sequence,
    set_fields,
    short_repr,
)
from beamdae.parts.laws import Law
from beamdae.symbolic.statements import Quantity

# Sign of the rate of the quantity at the crossing; 0 accepts both signs.
DIRECTIONS = {"up": 1, "down": -1, "both": 0}


@dataclass(frozen=True)
class Switch:
    """Activation and deactivation of joints and forces, by name.

    Attributes
    ----------
    on, off
        Names of the parts that become active, and of the parts that become inactive.
    as_is
        Names in `on` of joints that keep the gaps that they have at the event.
    laws
        Pairs (name of a driver in `on`, new law as a function of the time since the event [s]).
    parts
        The parts named in `on` and `off`; assembly requires that the mechanism contains them.
    """

    on: tuple[str, ...] = ()
    off: tuple[str, ...] = ()
    as_is: tuple[str, ...] = ()
    laws: tuple[tuple[str, Law], ...] = ()
    # Instances of `Part`, whose module imports this one, because parts list their events.
    parts: tuple[Any, ...] = field(default=(), compare=False, repr=False)


@dataclass(frozen=True, eq=False)
class Impact:
    """Jump of velocities by Newton's law of restitution; see `impact`."""

    on: Any
    restitution: float


Action = Switch | Impact


def select_switches(do: Any) -> tuple[Switch, ...]:
    """Return the switches among the actions of an event."""
    return tuple(x for x in do if isinstance(x, Switch)) if isinstance(do, tuple) else ()


def select_impacts(do: Any) -> tuple[Impact, ...]:
    """Return the impacts among the actions of an event."""
    return tuple(x for x in do if isinstance(x, Impact)) if isinstance(do, tuple) else ()


def _require_consistent_switches(event: str, switches: tuple[Switch, ...]) -> None:
    """Reject actions of one event that contradict each other, because they occur at one instant."""
    activated = {name for switch in switches for name in switch.on}
    deactivated = {name for switch in switches for name in switch.off}
    for name in sorted(activated & deactivated):
        raise BeamdaeError(
            f"{event}: the event activates and deactivates {name!r} at the same time; keep one of "
            "the two actions."
        )
    drivers = [name for switch in switches for name, _ in switch.laws]
    for name in sorted(set(drivers)):
        if drivers.count(name) > 1:
            raise BeamdaeError(
                f"{event}: the event changes the law of {name!r} {drivers.count(name)} times; "
                "pass one change_law per driver."
            )


@dataclass(frozen=True, eq=False)
class Event:
    """Crossing of a value by a quantity, and the actions it triggers.

    A quantity that only touches the value, stays at it, or starts at it and leaves does not cross
    the value.

    Parameters
    ----------
    what
        Name of an observed column, such as "tip.y", "t" for the time, or a quantity with one
        column.
    crosses
        Value to be crossed, in the unit of the column.
    direction
        Direction of the crossing: "up", "down" or "both".
    do
        "stop" ends the run; "record" lists the event and continues. The actions
        `activate(part, ...)`, `deactivate(part, ...)`, `change_law(driver, law)` and `impact(gap)`,
        or a list of actions, change the mechanism. A joint that becomes active must be closed,
        unless it is activated with `as_is=True`; velocities jump to values that satisfy the joint.
        `Solution.events` lists the impulses, and the lost energy is part of the dissipated energy.
    name
        Name in the results. Defaults to "<column> crosses <value>"; required if `what` is a
        quantity.

    Raises
    ------
    BeamdaeError
        If `what` is neither a string nor a quantity, `crosses` is not finite, `direction` or `do`
        is unknown, `do` contradicts itself, or `name` is invalid or missing. Assembly raises this
        error if no observed column has the name `what`, a quantity has several columns, or two
        events have the same name.
    """

    what: Any
    crosses: float = 0.0
    direction: str = "both"
    do: Any = "stop"
    name: str | None = None

    def __post_init__(self) -> None:
        part = "event" if self.name is None else require_name("event", self.name)
        do = plain_text(self.do)
        set_fields(self, what=plain_text(self.what), do=do)
        if not isinstance(self.what, (str, Quantity)):
            raise BeamdaeError(
                f"{part}: the first argument must be the name of an observed column, "
                "such as 'tip.y', or a quantity with one column, got "
                f"{short_repr(self.what)}."
            )
        crosses = require_finite(part, "crosses", self.crosses)
        if self.name is None and not isinstance(self.what, str):
            raise BeamdaeError("event: an event on a quantity has no default name; pass name=.")
        require_choice(part, "direction", self.direction, tuple(DIRECTIONS))
        if isinstance(do, (list, tuple)):
            actions = require_sequence(part, "do", do, "'stop', 'record' or a list of actions")
        else:
            actions = [do]
        if actions and all(isinstance(x, Action) for x in actions):
            set_fields(self, do=tuple(actions))
            _require_consistent_switches(part, select_switches(self.do))
        elif not (isinstance(do, str) and do in ("stop", "record")):
            raise BeamdaeError(
                f"{part}: do must be 'stop', 'record', activate(...), deactivate(...), "
                f"change_law(...) or impact(...), got {short_repr(self.do)}."
            )
        name = f"{self.what} crosses {crosses:g}" if self.name is None else part
        set_fields(self, crosses=crosses, name=name)
