"""Warnings about parts that never act, and actions of events without effect."""

from __future__ import annotations

from collections.abc import Iterator

from beamdae.parts.events import select_impacts, select_switches
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part


def switch_warnings(mechanism: Mechanism | None) -> Iterator[str]:
    """Yield warnings about inactive parts that no event activates and actions without effect."""
    if mechanism is None:
        return
    events = [*mechanism.events, *(x for part in mechanism.parts.values() for x in part.events)]
    switches = [(event, switch) for event in events for switch in select_switches(event.do)]
    activated = {name for _, switch in switches for name in switch.on}
    can_rest = mechanism.inactive.union(*(switch.off for _, switch in switches))
    stops = [
        (event, impact.on.name)
        for event in events
        for impact in select_impacts(event.do)
        if isinstance(impact.on, Part)
    ]
    # Impacts act on inactive joints.
    for name in sorted(mechanism.inactive - activated - {name for _, name in stops}):
        yield (
            f"{name}: the part is inactive from the start and no event activates it, so it never "
            "acts; add an event with activate, or do not deactivate the part."
        )
    actions = [
        *((event, x) for event, switch in switches for x in switch.on if x not in switch.as_is),
        *stops,
    ]
    idle = [(event, name, "active") for event, name in actions if name not in can_rest]
    for event, switch in switches:
        never = mechanism.inactive - activated
        idle += [(event, name, "inactive") for name in switch.off if name in never]
    for event, name, state in idle:
        yield (
            f"{event.name}: {name} is always {state}, so this action does nothing; change the "
            "state of the part at the start, or omit the action."
        )
