"""Warnings about impacts by events that do not occur, or depend on their order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.parts.events import select_impacts
from beamdae.results.event_records import EventRecord
from beamdae.results.trajectory import Trajectory

_ROUNDING = 1e-9  # of a column at its threshold, relative to the length or to 1 rad
_MIN_DEPARTURE = 1e-6  # from the threshold, relative to the same


def impact_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, event_records: Sequence[EventRecord]
) -> Iterator[str]:
    """Yield warnings about impacts that do not occur, or depend on their order.

    Touching a value is not a crossing, so that bodies that touch at the start pass through each
    other. If impacts of several events occur at the same time and each closes the gap of another,
    they follow one another.
    """
    later = {record.name for record in event_records}
    terms = [term for term in equations.events if select_impacts(term.do)]
    for term in terms:
        if term.name not in later and _starts_beyond(equations, trajectory, term):
            yield (
                f"{term.name}: this column starts at its threshold and moves beyond it, which is "
                "not a crossing, so the bodies pass through each other without an impact; start "
                "at a small distance, add a joint that keeps the bodies together, or use a Contact."
            )
    names = {term.name for term in terms}
    for t in dict.fromkeys(x.t for x in event_records):
        simultaneous = [x.name for x in event_records if x.t == t and x.name in names]
        different = list(dict.fromkeys(simultaneous))
        if 1 < len(different) < len(simultaneous):
            yield (
                f"{', '.join(different)}: these impacts at t = {t:.6g} s close the gaps of each "
                "other, so the motion after them depends on their order; make them one event, "
                "do=[bd.impact(...), bd.impact(...)]."
            )
            return


def _starts_beyond(equations: EquationsOfMotion, trajectory: Trajectory, term: EventTerm) -> bool:
    """Return True if the column of an event starts at its threshold and leaves it as if closing."""
    if term.side or term.due or term.occurred_at_start:
        return False  # the run resumes another one
    first = trajectory.intervals[0]
    p = equations.with_loads_of(first.configuration).p
    q, v, _, lam = first.rows
    difference = term.evaluate_difference(p, first.times, q, v, lam)
    size = equations.length if term.observable.columns[term.column].unit == "m" else 1.0
    departures = difference[np.abs(difference) > _MIN_DEPARTURE * size]
    if not len(departures) or abs(difference[0]) > _ROUNDING * size:
        return False
    return term.direction * departures[0] >= 0.0 and not _separates(equations, term, departures[0])


def _separates(equations: EquationsOfMotion, term: EventTerm, departure: float) -> bool:
    """Return True if the event monitors the gap of its impact, and the gap opens."""
    gaps = [x.on for x in select_impacts(term.do)]
    mechanism = equations.mechanism
    events = () if mechanism is None else mechanism.events
    is_gap = any(x.name == term.name and x.what is gap for x in events for gap in gaps)
    return is_gap and departure > 0.0
