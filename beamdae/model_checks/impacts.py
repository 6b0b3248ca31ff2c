"""Warnings about impacts that do not occur, or depend on their order or on elements of beams."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.model_checks.model_contacts import attached_mass
from beamdae.parts.events import select_impacts
from beamdae.results.event_records import EventRecord
from beamdae.results.trajectory import Trajectory
from beamdae.symbolic.statements import Quantity

# A column starts at its threshold within this distance, and has left it beyond the second one; both
# are relative to the length of the mechanism, or to 1 for angles.
_START_ROUNDING = 1e-9
_MIN_DEPARTURE = 1e-6
_MAX_CHECKED_STEPS = 100  # after the start


def impact_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, event_records: Sequence[EventRecord]
) -> Iterator[str]:
    """Yield warnings about impacts that do not occur, or depend on their order or on elements.

    Touching a value is not a crossing, so that bodies that touch at the start pass through each
    other. If impacts of several events occur at the same time and each closes the gap of another,
    they follow one another. The impulse at a section of a beam without a mass is proportional to
    the mass of the element, as far as no wave has time to leave it.
    """
    terms = [term for term in equations.events if select_impacts(term.do)]
    later = {record.name for record in event_records}
    for term in terms:
        direction = _find_closing_direction(equations, term)
        # If both directions may close the gap, a later impact shows that bodies separated first.
        if not direction and term.name in later:
            continue
        if _misses_first_impact(equations, trajectory, term, direction):
            yield (
                f"{term.name}: this column starts at its threshold and moves beyond it, which is "
                "not a crossing, so the bodies pass through each other without an impact; start "
                "at a small distance, add a joint that keeps the bodies together, or use a Contact."
            )
        of_section = _find_struck_section(equations, term) if term.name in later else None
        if of_section is not None:
            beam, s = of_section
            yield (
                f"{term.name}: this impact changes the velocity of {beam} at s = {s:.4g} m at "
                "once, where the mass is that of parts of elements, so its impulses and the "
                "stresses after it depend on the number of elements; use a Contact with the local "
                "stiffness of the bodies (Hertz), or attach the mass of the struck body there."
            )
    names = {term.name for term in terms}
    by_time: dict[float, list[str]] = {}
    for record in event_records:
        if record.name in names:
            by_time.setdefault(record.t, []).append(record.name)
    for t, simultaneous in by_time.items():
        different = list(dict.fromkeys(simultaneous))
        if 1 < len(different) < len(simultaneous):
            yield (
                f"{', '.join(different)}: these impacts, all at t = {t:.6g} s, close the gaps of "
                "each other, so the motion after them depends on their order; list them as the "
                "actions of one event, do=[bd.impact(...), bd.impact(...)], to solve them together."
            )
            return


def _find_closing_direction(equations: EquationsOfMotion, term: EventTerm) -> int:
    """Return 1 or -1 if upward or downward crossings are impacts, or 0 if both may be."""
    if term.direction or equations.mechanism is None:
        return term.direction
    # Contact gaps are positive between bodies that do not touch.
    gaps = [x.on for x in select_impacts(term.do)]
    events = [x for x in equations.mechanism.events if x.name == term.name]
    return -1 if any(event.what is gap for event in events for gap in gaps) else 0


def _find_struck_section(equations: EquationsOfMotion, term: EventTerm) -> tuple[str, float] | None:
    """Return the beam and the arc length of an impact at a section without a heavier mass."""
    for impact in select_impacts(term.do):
        on = impact.on
        pieces = on.pieces if isinstance(on, Quantity) else [x.piece for x in on.attachments]
        for beam, s in ((x.owner, x.s) for x in pieces):
            if not isinstance(beam, Beam) or s is None:
                continue
            element, _ = beam.mesh.locate(s)
            mass = beam.section.at(s).rhoA * float(beam.mesh.element_lengths[element])
            if attached_mass(equations, beam, s, on) < mass:
                return beam.name, s
    return None


def _misses_first_impact(
    equations: EquationsOfMotion, trajectory: Trajectory, term: EventTerm, direction: int
) -> bool:
    """Return True if the column of an event starts at its threshold and goes beyond it at once.

    If `direction` is 0, both sides are beyond it.
    """
    if term.side or term.due or term.occurred_at_start:
        # The run resumes another one.
        return False
    first = trajectory.intervals[0]
    last = 1 + _MAX_CHECKED_STEPS * first.nodes_per_step
    times = np.column_stack([first.nodes[:last], np.full(len(first.nodes[:last]), first.branch)])
    q, v, _, lam = (x[:last] for x in first.rows)
    p = equations.with_loads_of(first.configuration).p
    difference = term.evaluate_difference(p, times, q, v, lam)
    unit = term.observable.columns[term.column].unit
    size = equations.length if unit == "m" else 1.0
    if not abs(difference[0]) <= _START_ROUNDING * size:
        return False
    departures = difference[np.abs(difference) > _MIN_DEPARTURE * size]
    return bool(len(departures) and departures[0] * (direction or departures[0]) > 0.0)
