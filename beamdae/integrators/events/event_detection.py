"""Events of a run under way: found in the rows just produced, located on the dense output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm, State
from beamdae.integrators.step_history import StepHistory
from beamdae.parts.events import select_impacts
from beamdae.results.event_records import DOWN, UP, EventRecord
from beamdae.results.outcome import Status
from beamdae.results.trajectory import Interval

Array = np.ndarray

# Where in a step it is looked for a quantity that crosses its value: two crossings closer to each
# other than a quarter of a step may go unseen.
_SAMPLES = np.array([0.25, 0.5, 0.75, 1.0])
# A quantity nearer to its value than this share of the largest it was is on it.
_VALUE_ROUNDING = 1e-13
# Times are located to rounding, of themselves or of their step.
_TIME_ROUNDING = 4.0 * float(np.finfo(float).eps)
# A quantity that begins on its value has left it at so many times what it was off by, and at this
# share of its size: joints that hold it there do so to the tolerance of the run.
_LEAVING_FACTOR, _HELD_SHARE = 4.0, 1e-6


@dataclass
class EventSide:
    """On which side of its value a quantity is, where that is known (else 0).

    Attributes
    ----------
    largest
        The largest it was, or what is natural, to tell rounding by.
    near
        Within this much of its value it is on no side, until it has left it.
    """

    sign: float = 0.0
    largest: float = 0.0
    near: float = 0.0

    def signs(self, beyond: Array) -> Array:
        """Sides of further values; what is not finite is on none."""
        finite = np.nan_to_num(beyond, nan=0.0)
        self.largest = max(self.largest, float(np.max(np.abs(finite), initial=0.0)))
        away = np.abs(finite) > max(_VALUE_ROUNDING * self.largest, self.near)
        if away.any():
            self.near = 0.0
        return np.where(away, np.sign(finite), 0.0)

    def begin_near(self, beyond: float) -> None:
        """Begin on the value, up to rounding and what a consistent start changes."""
        self.near = max(_LEAVING_FACTOR * abs(beyond), _HELD_SHARE * self.largest)

    def begin_from(self, sign: float, beyond: float) -> None:
        """Begin on the side where a run before ended, which may be on the value up to rounding."""
        self.sign = sign
        if abs(beyond) <= _HELD_SHARE * self.largest:
            self.begin_on(sign, beyond)

    def begin_on(self, sign: float, beyond: float) -> None:
        """Begin on the value, up to rounding, on a side that is known: however short that is."""
        self.sign, self.near = sign, _LEAVING_FACTOR * abs(beyond)


def sample_times(steps: Array) -> Array:
    """Ascending times of the steps, the first one included, and between them."""
    inside = steps[:-1, None] + np.diff(steps)[:, None] * _SAMPLES
    inside[:, -1] = steps[1:]
    return np.concatenate([steps[:1], inside.ravel()])


def find_crossings(
    t: Array, values: Array, signs: Array, before: float, beyond: Callable[[float], float]
) -> list[tuple[float, str]]:
    """When the side changes from the one it was on before, and which way."""
    found = []
    for k in np.flatnonzero(signs):
        sign = float(signs[k])
        if before == -sign:
            found.append(
                (_locate_crossing(t, values, int(k), sign, beyond), UP if sign > 0.0 else DOWN)
            )
        before = sign
    return found


def _locate_crossing(
    t: Array, values: Array, k: int, sign: float, beyond: Callable[[float], float]
) -> float:
    """When a quantity that has changed sides at look `k` did so."""
    if k == 0:
        return float(t[0])
    a, b = float(t[k - 1]), float(t[k])
    # It was on its value there already, or jumped.
    if not values[k - 1] * sign < 0.0:
        return a
    if beyond(a) * sign >= 0.0 or beyond(b) * sign <= 0.0:
        return b
    # Here, for importing it takes as long as a short run.
    from scipy.optimize import brentq

    return float(brentq(beyond, a, b, xtol=_TIME_ROUNDING * max(abs(b), b - a), rtol=1e-15))


_SAME_TIME = 1e-12
# Ways by which it is seen where a quantity goes, of the sizes of coordinates, and the least rate at
# which they change [1/s].
_PROBE_DISTANCE, _MIN_RATE = 1e-6, 1e-3
# Steps at once where an event may end them: those beyond it are taken for nothing.
STEPS_PER_EVENT_CHECK = 16


@dataclass(frozen=True)
class RunSegment:
    """Rows of a run between breakpoints and switches, and what was active of its parts then."""

    rows: StepHistory
    branch: float
    configuration: Configuration | None

    def interval(self, m: int) -> Interval:
        """All of the rows, with all `m` multipliers there are."""
        return self._of_all(self.rows.interval(self.branch), m)

    def tail(self, first: int, m: int) -> tuple[Interval, float] | None:
        """The last rows from `first` on, see `StepHistory.tail`."""
        seen = self.rows.tail(first, self.branch)
        return None if seen is None else (self._of_all(seen[0], m), seen[1])

    def _of_all(self, interval: Interval, m: int) -> Interval:
        active, rows = self.configuration, interval.rows
        if active is None:
            return interval
        rows = rows._replace(lam=active.expand_multipliers(rows.lam, m))
        return replace(interval, rows=rows, configuration=active)

    def truncate(self, interval: Interval, t: float) -> None:
        """End the rows at time `t`, on the polynomials of their tail, see `StepHistory.truncate`."""
        if self.configuration is not None:
            rows = interval.rows._replace(
                lam=self.configuration.select_multipliers(interval.rows.lam)
            )
            interval = replace(interval, rows=rows)
        self.rows.truncate(interval, t)


@dataclass(frozen=True)
class _Crossing:
    """A quantity goes through its value, whether its event asks for this direction or not."""

    t: float
    term: EventTerm
    way: str

    @property
    def counts(self) -> bool:
        """Whether the event happens."""
        asked = self.term.direction
        return asked == 0 or (asked > 0) == (self.way == UP)

    @property
    def ends(self) -> bool:
        """Whether it ends a leg."""
        return self.counts and self.term.do != "record"


@dataclass
class EventDetector:
    """The events of a run."""

    equations: EquationsOfMotion
    occurrences: list[EventRecord] = field(default_factory=list)
    _sides_by_event: dict[str, EventSide] = field(default_factory=dict)
    # Events that cross their values where the rows end.
    _at_end: set[str] = field(default_factory=set)

    @property
    def may_stop(self) -> bool:
        """Whether there is one that ends the run of steps."""
        return any(term.do != "record" for term in self.equations.events)

    @property
    def event_signs(self) -> dict[str, int]:
        """On which sides of their values quantities are, as far as it was looked."""
        return {name: int(side.sign) for name, side in self._sides_by_event.items()}

    @property
    def last_event(self) -> EventTerm:
        """The event that happened last."""
        name = self.occurrences[-1].name
        return next(term for term in self.equations.events if term.name == name)

    def has_due_event(self, leg: RunSegment) -> bool:
        """Whether the run begins with an event that is due; `leg` is its first one."""
        begin = leg.interval(self.equations.m)
        due = [term for term in self.equations.events if term.due]
        for term in due:
            self._side(
                term, float(self._evaluate_signed(term, begin.nodes, leg.branch, begin.rows)[0])
            )
            self._at_end.add(term.name)
        if due:
            # The others come one after the other: they are on the sides they were on before.
            term, state = due[0], State(*(x[0] for x in begin.rows))
            self._sides_by_event[term.name].sign = float(term.due)
            way = UP if term.due > 0 else DOWN
            t = float(begin.nodes[0])
            self.occurrences.append(EventRecord(term.name, way, t, leg.branch, state, done=False))
        return bool(due)

    def record_switch(
        self, leg: RunSegment, impulses: dict[str, float], energy_lost: float
    ) -> None:
        """What the event did that happened last; `leg` is the one that begins there."""
        self.occurrences[-1] = replace(
            self.occurrences[-1], impulses=impulses, energy_lost=energy_lost, done=True
        )
        begin, thrown = leg.interval(self.equations.m), bool(select_impacts(self.last_event.do))
        for term in self.equations.events:
            side = self._sides_by_event[term.name]
            if term.name not in self._at_end:
                continue
            beyond = float(self._evaluate_signed(term, begin.nodes, leg.branch, begin.rows)[0])
            if thrown:
                side.begin_on(self._departure_sign(term, begin) or -side.sign, beyond)
            else:
                side.begin_near(beyond)
        if self.last_event.direction == 0 and not thrown:
            # Whichever way it goes on: it was on its value.
            self._sides_by_event[self.last_event.name].sign = 0.0

    def _departure_sign(self, term: EventTerm, begin: Interval) -> float:
        """The side to which a quantity leaves its value as the velocities are, 0 if it stays."""
        q, v, a, lam = begin.rows
        rates = np.abs(v[0]) / self.equations.position_scales
        ahead = _PROBE_DISTANCE / max(float(np.max(rates, initial=0.0)), _MIN_RATE)
        t = begin.nodes[0] + np.array([-ahead, ahead])
        moved = State(
            q[0] + np.array([[-ahead], [ahead]]) * v[0], *(x[[0, 0]] for x in (v, a, lam))
        )
        change = float(np.diff(self._evaluate_signed(term, t, begin.branch, moved))[0])
        stays = _PROBE_DISTANCE**2 * self._sides_by_event[term.name].largest
        return float(np.sign(change)) if abs(change) > stays else 0.0

    def find_terminal_event(self, leg: RunSegment, first: int) -> EventTerm | None:
        """Look through the rows from the one before `first` on; what ends the leg there.

        Rows beyond it are dropped, and one is added where it happens.
        """
        seen, branch = leg.tail(first, self.equations.m), leg.branch
        if seen is None:
            return None
        interval, begin = seen
        t = sample_times(interval.t[interval.t >= begin])
        state = interval.at(t)
        found: list[_Crossing] = []
        signs = []
        for term in self.equations.events:
            values = self._evaluate_signed(term, t, branch, state)
            side = self._side(term, float(values[0]))
            signs.append(side.signs(values))
            located = find_crossings(t, values, signs[-1], side.sign, self._at(term, interval))
            found += [_Crossing(when, term, way) for when, way in located]
        found.sort(key=lambda one: (one.t, one.ends))
        end = next((one.t for one in found if one.ends), float(t[-1]))
        for term, sign in zip(self.equations.events, signs, strict=True):
            before = sign[(t <= end) & (sign != 0.0)]
            if len(before):
                self._sides_by_event[term.name].sign = float(before[-1])
        last_event = self._record_crossings([one for one in found if one.t <= end], end, interval)
        if last_event is not None:
            leg.truncate(interval, end)
        return last_event

    def _record_crossings(
        self, found: list[_Crossing], end: float, interval: Interval
    ) -> EventTerm | None:
        """Note what happened up to `end`, and on which sides that leaves quantities; what ends."""
        last_event: EventTerm | None = None
        self._at_end.clear()
        for one in found:
            side, beyond = self._sides_by_event[one.term.name], 1.0 if one.way == UP else -1.0
            if one.t == end:
                self._at_end.add(one.term.name)
            if last_event is not None and one.ends:
                # Its turn comes when what the first one did is done.
                side.sign = -beyond
                continue
            side.sign = beyond
            if one.counts:
                at = State(*(x[0] for x in interval.at(np.array([one.t]))))
                name = one.term.name
                self.occurrences.append(
                    EventRecord(
                        name, one.way, one.t, interval.branch, at, done=_needs_no_action(one)
                    )
                )
            if one.ends:
                last_event = one.term
        return last_event

    def _side(self, term: EventTerm, begin: float) -> EventSide:
        if term.name not in self._sides_by_event:
            o, e = term.observable, self.equations
            natural = {"rad": 1.0, "m": e.length}.get(o.columns[term.column].unit, 0.0)
            side = self._sides_by_event[term.name] = EventSide(
                largest=max(abs(term.crosses), natural)
            )
            if term.begins_there:
                side.begin_near(begin)
                side.sign = float(term.side)
            elif term.due:
                side.sign = -float(term.due)
            elif term.side:
                side.begin_from(float(term.side), begin)
        return self._sides_by_event[term.name]

    def _evaluate_signed(self, term: EventTerm, t: Array, branch: float, state: State) -> Array:
        times = np.column_stack([t, np.full(len(t), branch)])
        return term.beyond(self.equations.p, times, state.q, state.v, state.lam)

    def _at(self, term: EventTerm, interval: Interval) -> Callable[[float], float]:
        def beyond(t: float) -> float:
            at = np.array([t])
            return float(self._evaluate_signed(term, at, interval.branch, interval.at(at))[0])

        return beyond


def output_times(times: Array, end: float, status: Status) -> Array:
    """The output times of a run that went to `end`; that of an event that stopped it is one."""
    reached = times[times <= end * (1.0 + _SAME_TIME)]
    if status.success and end > reached[-1] * (1.0 + _SAME_TIME):
        reached = np.append(reached, end)
    return reached


def _needs_no_action(crossing: _Crossing) -> bool:
    """Whether nothing is left to do of an event that happens."""
    return not (crossing.ends and isinstance(crossing.term.do, tuple))
