"""From the events of a model to what tells how near they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from beamdae.equations.equations_of_motion import EventTerm, Observable
from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.parts.events import DIRECTIONS, Event
from beamdae.symbolic.statements import Quantity


def event_terms(
    events: Sequence[Event],
    observed: Sequence[Observable],
    stated: Callable[[str, Quantity], Observable],
) -> tuple[EventTerm, ...]:
    """The events on the global coordinates.

    Parameters
    ----------
    observed
        What the columns are that they name.
    stated
        Makes an observable of a quantity.

    Raises
    ------
    BeamdaeError
        If there is no such column, a quantity has several, or two events have one name.
    """
    found: list[EventTerm] = []
    columns = {
        ".".join(filter(None, (o.name, column.name))): (o, k)
        for o in observed
        for k, column in enumerate(o.columns)
    }
    for event in events:
        name = str(event.name)
        if name in (other.name for other in found):
            raise BeamdaeError(f"event: the name {name!r} is taken, every event needs its own.")
        if isinstance(event.what, str):
            if event.what not in columns:
                near = suggest(event.what, columns)
                raise BeamdaeError(f"{name}: no column {short_repr(event.what)} is observed{near}.")
            observable, column = columns[event.what]
        else:
            if len(event.what.columns) != 1:
                told = ", ".join(column.name for column in event.what.columns)
                raise BeamdaeError(
                    f"{name}: its quantity has several columns ({told}); observe it, and name one."
                )
            observable, column = stated(name, event.what), 0
        direction = DIRECTIONS[event.direction]
        found.append(EventTerm(name, observable, column, event.crosses, direction, event.do))
    return tuple(found)
