"""Event detection by sign changes of event quantities, located on the dense output."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.equations.formulations.first_order import State
from beamdae.integrators.events.watches import (
    Scalar,
    Stop,
    evaluate_inside,
    sample_scalars,
)
from beamdae.integrators.step_history import RunSegment
from beamdae.parts.events import select_impacts
from beamdae.results.outcome import DOWN, UP, EventRecord
from beamdae.results.sampled_functions import locate_root
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Fractions of a step at which quantities are sampled besides its ends.
_SAMPLES = (0.25, 0.5, 0.75)
# A quantity is at its threshold within this distance, relative to its largest magnitude so far.
_VALUE_ROUNDING = 1e-13
# A quantity that starts at its threshold leaves it beyond this multiple of its initial distance ...
_LEAVING_FACTOR = 4.0
# ... and beyond this fraction of its size, because joints may fix it there to the tolerance of the
# run.
_CONSTRAINED_SHARE = 1e-6
# Distance, relative to the scales of the coordinates, over which the direction of departure after
# an impact is tested, ...
_PROBE_DISTANCE = 1e-6
# ... and lower bound on the rate of the coordinates in this test [1/s].
_MIN_RATE = 1e-3


@dataclass
class EventSide:
    """Side of its threshold on which an event quantity lies.

    Attributes
    ----------
    sign
        1 above the threshold, -1 below, 0 if unknown.
    largest
        Largest distance from the threshold so far, but not less than the magnitude of the threshold
        and the natural size of the quantity; rounding errors are relative to it.
    near
        Distance from the threshold within which the sign is 0 until the quantity first exceeds this
        distance.
    """

    sign: float = 0.0
    largest: float = 0.0
    near: float = 0.0

    def signs(self, differences: Array) -> Array:
        """Return the signs of new differences from the threshold, 0 near the threshold or if NaN.

        Update `largest` and `near`.
        """
        finite = np.nan_to_num(differences, nan=0.0)
        self.largest = max(self.largest, float(np.max(np.abs(finite), initial=0.0)))
        away = np.abs(finite) > max(_VALUE_ROUNDING * self.largest, self.near)
        if away.any():
            self.near = 0.0
        return np.where(away, np.sign(finite), 0.0)

    def begin(self, sign: float, difference: float, is_held: bool = False) -> None:
        """Start on the side given by `sign`, possibly at the threshold.

        A quantity that starts on the other side crosses the threshold once it is farther away than
        at the start. With a multiple of this distance, a ball that rests after many bounces would
        sink into the floor, by a constant factor from each bounce to the next. Joints may hold a
        quantity there up to the tolerance of the run.
        """
        self.sign, constrained = sign, _CONSTRAINED_SHARE * self.largest
        if is_held:
            self.near = max(_LEAVING_FACTOR * abs(difference), constrained)
        elif abs(difference) <= constrained:
            self.near = abs(difference)


@dataclass(frozen=True)
class _Crossing:
    """Crossing of a threshold, possibly in a direction that the event ignores."""

    t: float
    term: EventTerm
    direction: str

    @property
    def is_event(self) -> bool:
        requested = self.term.direction
        return requested == 0 or (requested > 0) == (self.direction == UP)

    @property
    def ends_segment(self) -> bool:
        return self.is_event and self.term.do != "record"


@dataclass
class EventDetector:
    """Detector of the events of a run.

    Attributes
    ----------
    equations
        Equations of all parts, which define the events.
    records
        Records of the events so far, in order of time.
    """

    equations: EquationsOfMotion
    records: list[EventRecord] = field(default_factory=list)
    _sides: dict[str, EventSide] = field(default_factory=dict)
    # Names of the events whose quantities cross their thresholds at the end of the segment.
    _at_end: set[str] = field(default_factory=set)
    # Simultaneous crossings that follow the last event at the same time; until then, their signs
    # are those before the crossing.
    _pending: list[_Crossing] = field(default_factory=list)
    # Names of the events whose signs are those after an impact at the time of the last event.
    _after_impact: set[str] = field(default_factory=set)

    @property
    def may_stop(self) -> bool:
        """True if the model has events that end a segment."""
        return any(term.do != "record" for term in self.equations.events)

    @property
    def signs(self) -> dict[str, int]:
        """Sign of (quantity - threshold) of each event after the last check; 0 if unknown."""
        return {name: int(side.sign) for name, side in self._sides.items()}

    @property
    def last_event(self) -> EventTerm:
        """Event of the last record."""
        name = self.records[-1].name
        return next(term for term in self.equations.events if term.name == name)

    def find_due_event(self, segment: RunSegment) -> EventTerm | None:
        """Record the first event that is due at the start, and return it."""
        start = segment.interval()
        due = [term for term in self.equations.events if term.due]
        for term in due:
            self._side(term, self._start_difference(term, start))
            self._at_end.add(term.name)
        if due:
            # Further due events keep their earlier signs, so that they follow one by one.
            term, state = due[0], State(*(x[0] for x in start.rows))
            self._sides[term.name].sign = float(term.due)
            direction = UP if term.due > 0 else DOWN
            t = float(start.nodes[0])
            self.records.append(
                EventRecord(term.name, direction, t, segment.branch, state, done=False)
            )
        return due[0] if due else None

    def record_switch(
        self, segment: RunSegment, impulses: dict[str, float], energy_lost: float
    ) -> None:
        """Complete the last record; reset the sides of quantities that are at their thresholds."""
        self.records[-1] = replace(
            self.records[-1], impulses=impulses, energy_lost=energy_lost, done=True
        )
        start = segment.interval()
        was_impact = bool(select_impacts(self.last_event.do))
        for term in self.equations.events:
            side = self._sides[term.name]
            if any(x.term is term for x in self._pending):
                continue
            difference = self._start_difference(term, start)
            is_at_threshold = term.name in self._at_end
            if was_impact and term is not self.last_event and select_impacts(term.do):
                # Bodies that touched before the impact have no sign.
                touches = not side.sign and abs(difference) <= _CONSTRAINED_SHARE * side.largest
                departure = self._departure_sign(term, start)
                direction = UP if departure > 0.0 else DOWN
                closing = _Crossing(float(start.nodes[0]), term, direction)
                is_reversed = is_at_threshold and departure * side.sign < 0.0
                if closing.is_event and (is_reversed or (touches and departure)):
                    # The last impact closes this gap.
                    self._pending.append(closing)
                    continue
            if not is_at_threshold:
                continue
            if was_impact:
                # A quantity that stays at its threshold is on the side from which it came.
                sign = side.sign if term.name in self._after_impact else -side.sign
                side.begin(self._departure_sign(term, start) or sign, difference)
                self._after_impact.add(term.name)
            else:
                side.begin(side.sign, difference, is_held=True)
        if self.last_event.direction == 0 and not was_impact:
            # The quantity may leave its threshold in either direction.
            self._sides[self.last_event.name].sign = 0.0

    def next_simultaneous_event(self, segment: RunSegment) -> EventTerm | None:
        """Record the next event at the time of the last one and return it; None if there is none.

        `segment` begins with the state after the actions of the last event.
        """
        if not self._pending:
            return None
        crossing = self._pending.pop(0)
        start = segment.interval()
        self._at_end.add(crossing.term.name)
        self._after_impact.discard(crossing.term.name)
        self._sides[crossing.term.name].sign = 1.0 if crossing.direction == UP else -1.0
        self._record(crossing, segment.branch, State(*(x[0] for x in start.rows)))
        return crossing.term

    def _departure_sign(self, term: EventTerm, start: Interval) -> float:
        """Return the sign of the rate of an event quantity at the start, 0 if it is negligible."""
        q, v, a, lam = start.rows
        rates = np.abs(v[0]) / self.equations.position_scales
        ahead = _PROBE_DISTANCE / max(float(np.max(rates, initial=0.0)), _MIN_RATE)
        t = start.nodes[0] + np.array([-ahead, ahead])
        displaced = State(
            q[0] + np.array([[-ahead], [ahead]]) * v[0], *(x[[0, 0]] for x in (v, a, lam))
        )
        change = float(np.diff(self._differences(term, start, t, displaced))[0])
        negligible = _PROBE_DISTANCE**2 * self._sides[term.name].largest
        return float(np.sign(change)) if abs(change) > negligible else 0.0

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first event that ends the segment in the rows from `row` on, see `Watch`.

        This event and all earlier ones are recorded. Without such an event, all events of these
        rows are recorded.
        """
        tail = segment.tail(row)
        if tail is None:
            return None
        interval, begin = tail
        events = self.equations.events
        scalars = [self._scalar(term, interval) for term in events]
        t, all_differences = sample_scalars(scalars, interval, begin, _SAMPLES)
        crossings: list[_Crossing] = []
        signs_by_term = []
        for term, scalar, differences in zip(events, scalars, all_differences, strict=True):
            side = self._side(term, float(differences[0]))
            signs = side.signs(differences)
            signs_by_term.append(signs)
            sign_before, differences_at = side.sign, partial(evaluate_inside, scalar, interval)
            for k in np.flatnonzero(signs).tolist():
                sign = float(signs[k])
                if sign_before == -sign:
                    when = float(t[max(k - 1, 0)])
                    # Otherwise, the quantity was already at its threshold, or jumped.
                    if k > 0 and differences[k - 1] * sign < 0.0:
                        when = locate_root(differences_at, when, float(t[k]))
                    crossings.append(_Crossing(when, term, UP if sign > 0.0 else DOWN))
                sign_before = sign
        crossings.sort(key=lambda crossing: (crossing.t, crossing.ends_segment))
        end = next((crossing.t for crossing in crossings if crossing.ends_segment), float(t[-1]))
        for term, signs in zip(events, signs_by_term, strict=True):
            nonzero_signs = signs[(t <= end) & (signs != 0.0)]
            if len(nonzero_signs):
                self._sides[term.name].sign = float(nonzero_signs[-1])
        terminal: EventTerm | None = None
        self._at_end.clear()
        self._pending.clear()
        self._after_impact.clear()
        for crossing in crossings:
            if crossing.t > end:
                break
            name = crossing.term.name
            side, sign = self._sides[name], 1.0 if crossing.direction == UP else -1.0
            if crossing.t == end:
                self._at_end.add(name)
            if terminal is not None and crossing.ends_segment:
                side.sign = -sign
                self._pending.append(crossing)
                continue
            side.sign = sign
            if crossing.is_event:
                state = State(*(x[0] for x in interval.at(np.array([crossing.t]), limited=True)))
                self._record(crossing, interval.branch, state)
            if crossing.ends_segment:
                terminal = crossing.term
        return None if terminal is None else Stop(end, end, event=terminal)

    def _record(self, crossing: _Crossing, branch: float, state: State) -> None:
        needs_action = crossing.ends_segment and isinstance(crossing.term.do, tuple)
        self.records.append(
            EventRecord(
                crossing.term.name,
                crossing.direction,
                crossing.t,
                branch,
                state,
                done=not needs_action,
            )
        )

    def _side(self, term: EventTerm, difference: float) -> EventSide:
        """Return the side of a quantity; the first call initializes it from `difference`."""
        if term.name not in self._sides:
            observable, equations = term.observable, self.equations
            unit = observable.columns[term.column].unit
            size = {"rad": 1.0, "m": equations.length}.get(unit, 0.0)
            side = self._sides[term.name] = EventSide(largest=max(abs(term.crosses), size))
            if term.occurred_at_start:
                side.begin(float(term.side), difference, is_held=True)
            elif term.due:
                side.sign = -float(term.due)
            elif term.side:
                side.begin(float(term.side), difference)
        return self._sides[term.name]

    def _scalar(self, term: EventTerm, interval: Interval) -> Scalar:
        """Return the quantity minus its threshold as its column shows it between steps."""
        differences = partial(self._differences, term, interval)
        if not term.observable.is_elastic:
            return differences
        at_nodes = differences(interval.nodes, interval.rows)[:, None]
        return lambda t, _: interval.interpolate_forces(at_nodes, t)[:, 0]

    def _differences(self, term: EventTerm, interval: Interval, t: Array, state: State) -> Array:
        """Return the quantity minus its threshold at each time of an interval."""
        p = self.equations.with_loads_of(interval.configuration).p
        times = interval.with_branch(t)
        return term.evaluate_difference(p, times, state.q, state.v, state.lam)

    def _start_difference(self, term: EventTerm, start: Interval) -> float:
        return float(self._differences(term, start, start.nodes, start.rows)[0])
