"""Parts that events switch on and off: other equations from there on, on the same coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.configurations import Configuration
from beamdae.equations.consistent_start import Starter
from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.equations.formulations import State
from beamdae.equations.spectrum import fastest_modes
from beamdae.errors import BeamdaeError
from beamdae.integrators.method import Method
from beamdae.integrators.route import Route
from beamdae.results.outcome import Statistics

Array = np.ndarray

# A joint that is switched on may be open by this share of the mechanism: an event is located to
# the accuracy of the run.
_OPEN = 1e-3
# So many switches within this share of the run are no progress.
_MOST_SWITCHES, _WITHIN = 200, 1e-4


@dataclass(frozen=True)
class Switched:
    """What a switch did: the route and the state from there on, impulses and the energy lost."""

    route: Route
    state: State
    impulses: dict[str, float]
    energy_lost: float


def first_configuration(equations: EquationsOfMotion) -> Configuration | None:
    """What is active at the start of a run; None where nothing is switched."""
    known = equations.configurations
    return None if known is None else known.of(equations, known.first)


def switched(
    whole: EquationsOfMotion,
    now: Configuration,
    route: Route,
    event: EventTerm,
    time: Array,
    before: State,
) -> tuple[Configuration, Switched]:
    """Switch parts as an event asks for, at time = (t, branch).

    Raises
    ------
    BeamdaeError
        If a joint that is switched on is open, or the joints contradict each other.
    """
    assert whole.configurations is not None
    then = whole.configurations.of(whole, whole.configurations.after(now.inactive, event.do))
    starter = Starter(then.equations)
    _require_closed(starter, time, before.q)
    state = starter.state(time, before.q, before.v)
    mass = starter.linearized(time, state)[2]
    impulses = _impulses(starter, time, state.q, mass, state.v - before.v)
    lost = 0.5 * float(before.v @ (mass @ before.v) - state.v @ (mass @ state.v))
    onward = replace(
        route,
        starter=starter,
        state=state,
        fastest_modes=cache(partial(fastest_modes, starter, time, state)),
        matrices={},
    )
    return then, Switched(onward, state, impulses, lost)


def _require_closed(starter: Starter, time: Array, q: Array) -> None:
    e = starter.equations
    gaps = np.abs(starter.gaps(time, q))
    if e.m and not np.max(gaps) <= _OPEN * min(1.0, e.length):
        worst = int(np.argmax(gaps))
        raise BeamdaeError(
            f"{e.lam_names[worst]}: it is open by {gaps[worst]:.3g}, a joint must be closed where "
            "it is switched on."
        )


def _impulses(
    starter: Starter, time: Array, q: Array, mass: sp.csc_array, change: Array
) -> dict[str, float]:
    """Impulses of the multipliers that change the velocities: M (v+ - v-) = -G^T Lambda."""
    e = starter.equations
    if not e.m or not np.any(change):
        return dict.fromkeys(e.lam_names, 0.0)
    gradient = starter.constraint_matrix(time, q)
    saddle = sp.block_array([[mass, gradient.T], [gradient, None]], format="csc")
    found = splu(saddle).solve(np.concatenate([np.zeros(e.n), gradient @ change]))
    return dict(zip(e.lam_names, found[e.n :].tolist(), strict=True))


@dataclass
class Methods:
    """The methods of a run, one a configuration, made when they are first needed."""

    make: Callable[[Route], Method]
    first: Method
    configuration: Configuration | None
    _made: dict[frozenset[str], Method] = field(default_factory=dict, init=False)
    _switches: list[float] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        now = self.configuration
        self._made[frozenset() if now is None else now.inactive] = self.first

    def on(self, route: Route, now: Configuration) -> Method:
        """The method of a configuration."""
        inactive = now.inactive
        if inactive not in self._made:
            self._made[inactive] = self.make(route)
        return self._made[inactive]

    @property
    def counts(self) -> Statistics:
        """What all of them cost."""
        counts = [vars(method.counts) for method in self._made.values()]
        return Statistics(**{name: sum(one[name] for one in counts) for name in counts[0]})

    def stall(self, event: EventTerm, t: float, duration: float) -> str | None:
        """Why there is no point in going on after another switch at time `t` [s], or None."""
        self._switches.append(t)
        within = t - self._switches[-_MOST_SWITCHES:][0]
        if len(self._switches) < _MOST_SWITCHES or within > _WITHIN * duration:
            return None
        return (
            f"no end in sight, event {event.name} and others have switched parts {_MOST_SWITCHES} "
            f"times within {within:.2g} s; let them cross values that are apart from each other"
        )
