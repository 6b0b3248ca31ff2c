"""Events that happened in a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion, State

Array = np.ndarray

UP, DOWN = "up", "down"


@dataclass(frozen=True)
class EventRecord:
    """An event that happened.

    Attributes
    ----------
    name, direction
        Of the event, and "up" or "down".
    t, branch
        When [s], and a time inside the interval, by which laws choose their piece.
    state
        The state there, on the polynomials of the dense output, before parts are switched.
    impulses
        By multiplier, where velocities changed at once: what changed them [N s], joints and gaps.
    energy_lost
        Kinetic energy that this took [J].
    done
        Whether it did what it was to do: a run that ended before goes on with that.
    """

    name: str
    direction: str
    t: float
    branch: float
    state: State
    impulses: dict[str, float] = field(default_factory=dict)
    energy_lost: float = 0.0
    done: bool = True

    @property
    def plain(self) -> dict[str, Any]:
        """What happened when."""
        told = {"event": self.name, "direction": self.direction, measures.TIME: self.t}
        switched = {"impulses": self.impulses, "energy lost [J]": self.energy_lost}
        due = {} if self.done else {"done": False}
        return told | (switched if self.impulses else {}) | due


def format_event_counts(names: Iterable[str]) -> str:
    """Which events happened, and how often, from the name of each that did."""
    told = Counter(names)
    return ", ".join(x if n == 1 else f"{x} {n} times" for x, n in told.items()) or "none"


def format_event_times(event_records: Sequence[EventRecord]) -> str:
    """Which events happened, how often, and when for the first time."""
    times: dict[str, list[float]] = {}
    for one in event_records:
        times.setdefault(one.name, []).append(one.t)
    return (
        ", ".join(
            f"{name} at {at[0]:.4g} s"
            if len(at) == 1
            else f"{name} {len(at)} times from {at[0]:.4g} s"
            for name, at in times.items()
        )
        or "none"
    )


def tabulate_events(
    equations: EquationsOfMotion, event_records: Sequence[EventRecord]
) -> dict[str, Any]:
    """Columns: which events happened when, and what was observed then."""
    columns: dict[str, Any] = {
        "event": [one.name for one in event_records],
        "direction": [one.direction for one in event_records],
        measures.TIME: np.array([one.t for one in event_records]),
    }
    if any(one.impulses for one in event_records):
        columns["energy lost [J]"] = np.array([one.energy_lost for one in event_records])
        for name in dict.fromkeys(name for one in event_records for name in one.impulses):
            columns[f"impulse.{name}"] = np.array(
                [one.impulses.get(name, 0.0) for one in event_records]
            )
    headers = [header for o in equations.observables for header in o.headers]
    times = np.array([(one.t, one.branch) for one in event_records]).reshape(-1, 2)
    sizes = (equations.n, equations.n, equations.n, equations.m)
    states = zip(*(one.state for one in event_records), strict=True) if event_records else [()] * 4
    rows = (np.reshape(x, (len(event_records), n)) for x, n in zip(states, sizes, strict=True))
    values = measures.ObservedRows(equations)(times, *rows)
    return columns | dict(zip(headers, values.T, strict=True))
