"""Parts that events switch on and off: other equations from there on, on the same coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import pairwise

import numpy as np

from beamdae.equations.assembly.configurations import Configuration
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm, State
from beamdae.equations.natural_frequencies import estimate_fastest_modes
from beamdae.equations.singular_laws import require_no_pole
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.integrators.events.impacts import apply_impact, solve_impulses
from beamdae.integrators.method import Method
from beamdae.integrators.run_plan import RunPlan, branch_time, interval_ends
from beamdae.parts.events import select_impacts, select_switches
from beamdae.results.outcome import Statistics

Array = np.ndarray

# A joint that is switched on may be open by this share of the mechanism: an event is located to
# the accuracy of the run.
_MAX_GAP = 1e-3
# So many switches within this share of the run are no progress.
_MAX_SWITCHES, _SWITCH_WINDOW = 200, 1e-4
# Impacts nearer to each other than this share of the run have no end.
_MIN_FLIGHT = 1e-9


@dataclass(frozen=True)
class SwitchResult:
    """What a switch did.

    Attributes
    ----------
    configuration, route, state
        From there on.
    ends, branch
        Where the smooth intervals end that are left [s], and a time inside the first one.
    impulses
        Of the multipliers that changed the velocities.
    energy_lost
        What that took of the kinetic energy [J].
    """

    configuration: Configuration
    plan: RunPlan
    state: State
    ends: tuple[float, ...]
    branch: float
    impulses: dict[str, float]
    energy_lost: float


def initial_configuration(equations: EquationsOfMotion) -> Configuration | None:
    """What is active at the start of a run; None where nothing is switched."""
    known = equations.configurations
    return None if known is None else known.initial_configuration(equations)


def apply_event(
    whole: EquationsOfMotion,
    now: Configuration,
    plan: RunPlan,
    event: EventTerm,
    time: Array,
    ends: tuple[float, ...],
    before: State,
) -> SwitchResult:
    """Throw back and switch what an event asks for, at time = (t, branch).

    Raises
    ------
    BeamdaeError
        If a joint that is switched on is open, the joints contradict each other, or a law that
        begins there becomes infinite.
    """
    known = whole.configurations
    assert known is not None
    v, impulses = before.v, dict[str, float]()
    if impacts := select_impacts(event.do):
        struck = known.impact_equations(whole, now, event.name, impacts)
        v, own = apply_impact(struck, time, before)
        impulses |= own
    then = known.configuration_after(whole, now, event, time, before.q)
    if any(switch.laws for switch in select_switches(event.do)):
        ends, time = _restrict_intervals(then.equations, time, ends)
    starter = ConsistencySolver(then.equations)
    _require_closed(starter, time, before.q)
    state = starter.state(time, before.q, v)
    mass = starter.linearize_forces(time, state)[2]
    gradient = starter.constraint_matrix(time, state.q)
    _, more = solve_impulses(then.equations.lam_names, mass, gradient, gradient @ (state.v - v))
    lost = 0.5 * float(before.v @ (mass @ before.v) - state.v @ (mass @ state.v))
    onward = replace(
        plan,
        starter=starter,
        state=state,
        fastest_modes=cache(partial(estimate_fastest_modes, starter, time, state)),
        matrices={},
    )
    told = {name: impulses.get(name, 0.0) + more.get(name, 0.0) for name in {**more, **impulses}}
    return SwitchResult(then, onward, state, ends, float(time[1]), told, lost)


def _restrict_intervals(
    equations: EquationsOfMotion, time: Array, ends: tuple[float, ...]
) -> tuple[tuple[float, ...], Array]:
    """The `ends` of intervals that are left and time = (t, branch), with laws that begin here."""
    t = float(time[0])
    left = interval_ends(equations.breakpoints, t, ends[-1]) if t < ends[-1] else ()
    require_no_pole(equations.laws, tuple(pairwise((t, *left))))
    if t == ends[0]:
        return (t, *left), time
    return left, np.array([t, branch_time(t, left[0])])


def _require_closed(starter: ConsistencySolver, time: Array, q: Array) -> None:
    e = starter.equations
    gaps = np.abs(starter.position_gaps(time, q))
    if e.m and not np.max(gaps) <= _MAX_GAP * min(1.0, e.length):
        worst = int(np.argmax(gaps))
        raise BeamdaeError(
            f"{e.lam_names[worst]}: it is open by {gaps[worst]:.3g}, a joint must be closed where "
            "it is switched on; activate(..., as_is=True) has it hold what it finds."
        )


@dataclass
class MethodCache:
    """The methods of a run, one a configuration, made when they are first needed."""

    make: Callable[[RunPlan], Method]
    first: Method
    configuration: Configuration | None
    _made: dict[frozenset[str], Method] = field(default_factory=dict, init=False)
    # The one of joints that hold what they found, which does not come back, and those before it.
    _latest: tuple[EquationsOfMotion | None, Method | None] = field(
        default=(None, None), init=False
    )
    _past: list[Statistics] = field(default_factory=list, init=False)
    _switches: list[float] = field(default_factory=list, init=False)
    _impacts: dict[str, float] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        now = self.configuration
        if now is not None and now.frozen_gaps:
            self._latest = (now.equations, self.first)
        else:
            self._made[frozenset() if now is None else now.inactive] = self.first

    def on(self, plan: RunPlan, now: Configuration) -> Method:
        """The method of a configuration."""
        if not now.frozen_gaps:
            if now.inactive not in self._made:
                self._made[now.inactive] = self.make(plan)
            return self._made[now.inactive]
        equations, method = self._latest
        if method is None or equations is not now.equations:
            if method is not None:
                self._past.append(method.counts)
            method = self.make(plan)
            self._latest = (now.equations, method)
        return method

    @property
    def counts(self) -> Statistics:
        """What all of them cost."""
        latest = self._latest[1]
        own = [*self._made.values(), *([] if latest is None else [latest])]
        counts = [vars(one) for one in (*(method.counts for method in own), *self._past)]
        return Statistics(**{name: sum(one[name] for one in counts) for name in counts[0]})

    def stall_reason(self, event: EventTerm, t: float, duration: float) -> str | None:
        """Why there is no point in going on after another event at time `t` [s], or None."""
        if select_impacts(event.do):
            flight = t - self._impacts.get(event.name, -np.inf)
            self._impacts[event.name] = t
            if flight < _MIN_FLIGHT * duration:
                return (
                    f"impacts of event {event.name} accumulate, the last two are {flight:.2g} s "
                    "apart; have it rest from here on by a joint that is switched on, or take a "
                    "Contact"
                )
        self._switches.append(t)
        within = t - self._switches[-_MAX_SWITCHES:][0]
        if len(self._switches) < _MAX_SWITCHES or within > _SWITCH_WINDOW * duration:
            return None
        return (
            f"no end in sight, event {event.name} and others have switched parts {_MAX_SWITCHES} "
            f"times within {within:.2g} s; let them cross values that are apart from each other"
        )
