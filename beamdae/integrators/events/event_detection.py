"""Events of a run under way: found in the rows just produced, located on the dense output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from beamdae.equations.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.equations.formulations import State
from beamdae.integrators.events.crossings import Side, crossings, looks
from beamdae.integrators.rows import Rows
from beamdae.parts.events import impacts_of
from beamdae.results.event_records import DOWN, UP, Occurrence
from beamdae.results.outcome import Status
from beamdae.results.trajectory import Interval

Array = np.ndarray

_SAME_TIME = 1e-12
# Ways by which it is seen where a quantity goes, of the sizes of coordinates, and the least rate at
# which they change [1/s].
_AHEAD, _SLOW = 1e-6, 1e-3
# Steps at once where an event may end them: those beyond it are taken for nothing.
STEPS_AT_ONCE = 16


@dataclass(frozen=True)
class Leg:
    """Rows of a run between breakpoints and switches, and what was active of its parts then."""

    rows: Rows
    branch: float
    configuration: Configuration | None

    def interval(self, m: int) -> Interval:
        """All of the rows, with all `m` multipliers there are."""
        return self._of_all(self.rows.interval(self.branch), m)

    def tail(self, first: int, m: int) -> tuple[Interval, float] | None:
        """The last rows from `first` on, see `Rows.tail`."""
        seen = self.rows.tail(first, self.branch)
        return None if seen is None else (self._of_all(seen[0], m), seen[1])

    def _of_all(self, interval: Interval, m: int) -> Interval:
        active, rows = self.configuration, interval.rows
        if active is None:
            return interval
        rows = rows._replace(lam=active.among_all(rows.lam, m))
        return replace(interval, rows=rows, configuration=active)

    def cut_back(self, interval: Interval, t: float) -> None:
        """End the rows at time `t`, on the polynomials of their tail, see `Rows.cut_back`."""
        if self.configuration is not None:
            rows = interval.rows._replace(lam=self.configuration.own(interval.rows.lam))
            interval = replace(interval, rows=rows)
        self.rows.cut_back(interval, t)


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
class Watch:
    """The events of a run."""

    equations: EquationsOfMotion
    occurred: list[Occurrence] = field(default_factory=list)
    _sides: dict[str, Side] = field(default_factory=dict)
    # Events that cross their values where the rows end.
    _there: set[str] = field(default_factory=set)

    @property
    def may_stop(self) -> bool:
        """Whether there is one that ends the run of steps."""
        return any(term.do != "record" for term in self.equations.events)

    @property
    def sides(self) -> dict[str, int]:
        """On which sides of their values quantities are, as far as it was looked."""
        return {name: int(side.sign) for name, side in self._sides.items()}

    @property
    def fired(self) -> EventTerm:
        """The event that happened last."""
        name = self.occurred[-1].name
        return next(term for term in self.equations.events if term.name == name)

    def begins(self, leg: Leg) -> bool:
        """Whether the run begins with an event that is due; `leg` is its first one."""
        begin = leg.interval(self.equations.m)
        due = [term for term in self.equations.events if term.due]
        for term in due:
            self._side(term, float(self._beyond(term, begin.nodes, leg.branch, begin.rows)[0]))
            self._there.add(term.name)
        if due:
            # The others come one after the other: they are on the sides they were on before.
            term, state = due[0], State(*(x[0] for x in begin.rows))
            self._sides[term.name].sign = float(term.due)
            way = UP if term.due > 0 else DOWN
            t = float(begin.nodes[0])
            self.occurred.append(Occurrence(term.name, way, t, leg.branch, state, done=False))
        return bool(due)

    def switched(self, leg: Leg, impulses: dict[str, float], energy_lost: float) -> None:
        """What the event did that happened last; `leg` is the one that begins there."""
        self.occurred[-1] = replace(
            self.occurred[-1], impulses=impulses, energy_lost=energy_lost, done=True
        )
        begin, thrown = leg.interval(self.equations.m), bool(impacts_of(self.fired.do))
        for term in self.equations.events:
            side = self._sides[term.name]
            if term.name not in self._there:
                continue
            beyond = float(self._beyond(term, begin.nodes, leg.branch, begin.rows)[0])
            if thrown:
                side.begin_on(self._goes_to(term, begin) or -side.sign, beyond)
            else:
                side.begin_near(beyond)
        if self.fired.direction == 0 and not thrown:
            # Whichever way it goes on: it was on its value.
            self._sides[self.fired.name].sign = 0.0

    def _goes_to(self, term: EventTerm, begin: Interval) -> float:
        """The side to which a quantity leaves its value as the velocities are, 0 if it stays."""
        q, v, a, lam = begin.rows
        rates = np.abs(v[0]) / self.equations.position_scales
        ahead = _AHEAD / max(float(np.max(rates, initial=0.0)), _SLOW)
        t = begin.nodes[0] + np.array([-ahead, ahead])
        moved = State(
            q[0] + np.array([[-ahead], [ahead]]) * v[0], *(x[[0, 0]] for x in (v, a, lam))
        )
        change = float(np.diff(self._beyond(term, t, begin.branch, moved))[0])
        stays = _AHEAD**2 * self._sides[term.name].largest
        return float(np.sign(change)) if abs(change) > stays else 0.0

    def after(self, leg: Leg, first: int) -> EventTerm | None:
        """Look through the rows from the one before `first` on; what ends the leg there.

        Rows beyond it are dropped, and one is added where it happens.
        """
        seen, branch = leg.tail(first, self.equations.m), leg.branch
        if seen is None:
            return None
        interval, begin = seen
        t = looks(interval.t[interval.t >= begin])
        state = interval.at(t)
        found: list[_Crossing] = []
        signs = []
        for term in self.equations.events:
            values = self._beyond(term, t, branch, state)
            side = self._side(term, float(values[0]))
            signs.append(side.signs(values))
            located = crossings(t, values, signs[-1], side.sign, self._at(term, interval))
            found += [_Crossing(when, term, way) for when, way in located]
        found.sort(key=lambda one: (one.t, one.ends))
        end = next((one.t for one in found if one.ends), float(t[-1]))
        for term, sign in zip(self.equations.events, signs, strict=True):
            before = sign[(t <= end) & (sign != 0.0)]
            if len(before):
                self._sides[term.name].sign = float(before[-1])
        fired = self._occur([one for one in found if one.t <= end], end, interval)
        if fired is not None:
            leg.cut_back(interval, end)
        return fired

    def _occur(self, found: list[_Crossing], end: float, interval: Interval) -> EventTerm | None:
        """Note what happened up to `end`, and on which sides that leaves quantities; what ends."""
        fired: EventTerm | None = None
        self._there.clear()
        for one in found:
            side, beyond = self._sides[one.term.name], 1.0 if one.way == UP else -1.0
            if one.t == end:
                self._there.add(one.term.name)
            if fired is not None and one.ends:
                # Its turn comes when what the first one did is done.
                side.sign = -beyond
                continue
            side.sign = beyond
            if one.counts:
                at = State(*(x[0] for x in interval.at(np.array([one.t]))))
                name = one.term.name
                self.occurred.append(
                    Occurrence(name, one.way, one.t, interval.branch, at, done=_is_done(one))
                )
            if one.ends:
                fired = one.term
        return fired

    def _side(self, term: EventTerm, begin: float) -> Side:
        if term.name not in self._sides:
            o, e = term.observable, self.equations
            natural = {"rad": 1.0, "m": e.length}.get(o.columns[term.column].unit, 0.0)
            side = self._sides[term.name] = Side(largest=max(abs(term.crosses), natural))
            if term.begins_there:
                side.begin_near(begin)
                side.sign = float(term.side)
            elif term.due:
                side.sign = -float(term.due)
            elif term.side:
                side.begin_from(float(term.side), begin)
        return self._sides[term.name]

    def _beyond(self, term: EventTerm, t: Array, branch: float, state: State) -> Array:
        times = np.column_stack([t, np.full(len(t), branch)])
        return term.beyond(self.equations.p, times, state.q, state.v, state.lam)

    def _at(self, term: EventTerm, interval: Interval) -> Callable[[float], float]:
        def beyond(t: float) -> float:
            at = np.array([t])
            return float(self._beyond(term, at, interval.branch, interval.at(at))[0])

        return beyond


def output_times(times: Array, end: float, status: Status) -> Array:
    """The output times of a run that went to `end`; that of an event that stopped it is one."""
    reached = times[times <= end * (1.0 + _SAME_TIME)]
    if status.success and end > reached[-1] * (1.0 + _SAME_TIME):
        reached = np.append(reached, end)
    return reached


def _is_done(crossing: _Crossing) -> bool:
    """Whether nothing is left to do of an event that happens."""
    return not (crossing.ends and isinstance(crossing.term.do, tuple))
