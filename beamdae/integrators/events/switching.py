"""Actions of events: impacts, which change v, and switches, which change the equations.

Positions change only as far as needed to close the small gaps of activated joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import (
    Configuration,
    EquationsOfMotion,
    EventTerm,
    ImpactEquations,
    State,
)
from beamdae.equations.smooth_intervals import branch_time, plan_ends
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.dependent_constraints import require_independent_constraints
from beamdae.errors import BeamdaeError
from beamdae.integrators.integrator import Method
from beamdae.integrators.run_plan import RunPlan, estimate_fastest_modes
from beamdae.parts.events import select_impacts, select_switches
from beamdae.results.outcome import Statistics

Array = np.ndarray


def apply_impact(
    impact: ImpactEquations, time: Array, state: State
) -> tuple[Array, Mapping[str, float]]:
    """Return the velocities after an impact at `time` = (t, branch), and impulses by constraint.

    Closed gaps that are already opening are excluded, because contacts can only push.

    Raises
    ------
    BeamdaeError
        If the active joints depend on each other at the impact.
    """
    solver = ConsistencySolver(impact.equations)
    rates = solver.constraint_levels(time, state.q, state.v)[1]
    active = select_active_constraints(impact, rates)
    if not len(active):
        return state.v, {}
    if len(active) < len(rates):
        # Imported here, because few impacts meet open gaps.
        from beamdae.equations.starts.reduced_equations import keep_constraints

        solver = ConsistencySolver(keep_constraints(impact.equations, active))
    require_independent_constraints(solver, time, state.q)
    # M (v+ - v-) = -G^T P and G (v+ - v-) = -(1 + e) G v- with the impulses P.
    changes = -(1.0 + impact.coefficients[active]) * rates[active]
    change, impulses = solver.solve_saddle(time, state.q, None, 0.0, changes)
    return state.v + change, _name_impulses(solver, impulses)


def _name_impulses(solver: ConsistencySolver, impulses: Array) -> dict[str, float]:
    return dict(zip(solver.equations.lam_names, impulses.tolist(), strict=True))


def select_active_constraints(impact: ImpactEquations, rates: Array) -> Array:
    """Return the indices of the constraints that act in an impact, empty if no body is stopped.

    `rates` are the rates of the constraints before the impact, (m,).
    """
    names = impact.equations.lam_names
    opening = np.array([name in impact.gaps for name in names], bool) & (rates <= 0.0)
    (active,) = np.nonzero(~opening)
    if not any(names[k] in impact.restitution for k in active):
        return active[:0]
    return active


# Largest gap of a joint that is activated, relative to the length of the mechanism, or to 1 m for
# longer mechanisms. Gaps are not exactly zero because events are located to the accuracy of the
# run.
_MAX_GAP = 1e-3
# A run stalls if events act this many times ...
_MAX_SWITCHES = 200
# ... within this fraction of its duration.
_SWITCH_WINDOW = 1e-4
# Impacts accumulate if one has no impulse that follows after less than this fraction of the run:
# the bodies still separate, so that the flight is below the rounding errors of the positions.
_MAX_UNRESOLVED_FLIGHT = 1e-3
_IMPACT_ADVICE = (
    "; activate a joint that keeps the bodies together with bd.activate(joint, as_is=True), or use "
    "a Contact"
)


@dataclass(frozen=True)
class SwitchResult:
    """Equations and state after the actions of an event.

    Attributes
    ----------
    configuration, plan, state
        Active parts, plan of the run and consistent state after the event.
    ends
        Ends of the remaining smooth intervals [s].
    branch
        Time [s] inside the first of these intervals.
    impulses
        Impulses [N s or N m s] of the velocity jump, by name of the multiplier.
    energy_lost
        Kinetic energy lost in the velocity jump [J].
    """

    configuration: Configuration
    plan: RunPlan
    state: State
    ends: tuple[float, ...]
    branch: float
    impulses: dict[str, float]
    energy_lost: float


def initial_configuration(equations: EquationsOfMotion) -> Configuration | None:
    """Return the configuration at the start of a run, or None if the active parts never change.

    See `EquationsOfMotion.configurations`.
    """
    configurations = equations.configurations
    return None if configurations is None else configurations.initial_configuration(equations)


def apply_event(
    equations: EquationsOfMotion,
    configuration: Configuration,
    plan: RunPlan,
    event: EventTerm,
    time: Array,
    ends: tuple[float, ...],
    state: State,
) -> SwitchResult:
    """Apply the impacts of an event, then its switches, at `time` = (t, branch).

    `equations` contain all parts, `configuration` those active before the event; `ends` are the
    ends of the remaining intervals [s].

    Raises
    ------
    BeamdaeError
        If a joint that is switched on is open, if joints contradict or depend on each other, if a
        law that begins at the event becomes infinite, or if no accelerations exist after the event
        (see `ConsistencySolver.acceleration`).
    """
    configurations = equations.configurations
    assert configurations is not None
    v, impulses = state.v, dict[str, float]()
    if impacts := select_impacts(event.do):
        impact = configurations.impact_equations(equations, configuration, event.name, impacts)
        v, impact_impulses = apply_impact(impact, time, state)
        impulses |= impact_impulses
    after = configurations.configuration_after(equations, configuration, event, time, state.q)
    if any(switch.laws for switch in select_switches(event.do)):
        t, end = float(time[0]), ends[-1]
        later_ends = plan_ends(after.equations, t, end, plan.is_adaptive) if t < end else ()
        if t == ends[0]:
            ends = (t, *later_ends)
        else:
            ends, time = later_ends, np.array([t, branch_time(t, later_ends[0])])
    solver = ConsistencySolver(after.equations)
    _require_closed(solver, time, state.q)
    restart = solver.state(time, state.q, v)
    mass = solver.mass_matrix(time, restart.q)
    changes = solver.constraint_matrix(time, restart.q) @ (restart.v - v)
    switch_impulses = _name_impulses(
        solver, solver.solve_saddle(time, restart.q, restart.v, 0.0, changes)[1]
    )
    energy_lost = 0.5 * float(state.v @ (mass @ state.v) - restart.v @ (mass @ restart.v))
    plan_after = replace(
        plan,
        starter=solver,
        state=restart,
        fastest_modes=cache(partial(estimate_fastest_modes, solver, time, restart)),
        matrices={},
    )
    sums = {
        name: impulses.get(name, 0.0) + switch_impulses.get(name, 0.0)
        for name in {**switch_impulses, **impulses}
    }
    return SwitchResult(after, plan_after, restart, ends, float(time[1]), sums, energy_lost)


def _require_closed(solver: ConsistencySolver, time: Array, q: Array) -> None:
    equations = solver.equations
    levels = solver.position_gaps(time, q)
    gaps = np.abs(levels)
    if equations.m and not np.max(gaps) <= _MAX_GAP * min(1.0, equations.length):
        worst = int(np.argmax(gaps))
        name, gap = equations.lam_names[worst], float(gaps[worst])
        if equations.mechanism is not None:
            joint = equations.mechanism.parts[name.rpartition(".")[0]]
            gap = joint.gap_size(float(levels[worst]), float(time[0]))
        raise BeamdaeError(
            f"{name}: the joint has a gap of {gap:.3g} "
            "(in m or rad) when it is activated; close the gap first, or keep it with "
            "activate(..., as_is=True)."
        )


class MethodCache:
    """Methods of a run, one per configuration, created on first use.

    Attributes
    ----------
    first
        Method at the start.
    """

    def __init__(
        self,
        make: Callable[[RunPlan], Method],
        plan: RunPlan,
        configuration: Configuration | None,
    ) -> None:
        """Create the method for the plan at the start; `make` creates those of all plans."""
        self._make = make
        self.first = make(plan)
        self._methods = {self._key(configuration): self.first}
        self._past_counts: list[Statistics] = []

    @staticmethod
    def _key(configuration: Configuration | None) -> Any:
        if configuration is None:
            return frozenset()
        # Configurations with frozen gaps are equal if their equations are.
        return configuration.equations if configuration.frozen_gaps else configuration.inactive

    def get(self, plan: RunPlan, configuration: Configuration) -> Method:
        """Return the method of a configuration; create it for `plan` if there is none yet."""
        key = self._key(configuration)
        if key not in self._methods:
            # Configurations with frozen gaps never recur: only their last method is kept.
            for old in [x for x in self._methods if not isinstance(x, frozenset)]:
                if configuration.frozen_gaps:
                    self._past_counts.append(self._methods.pop(old).counts)
            self._methods[key] = self._make(plan)
        return self._methods[key]

    @property
    def counts(self) -> Statistics:
        """Sum of the statistics of all methods of the run."""
        counts = [
            vars(x) for x in [*(m.counts for m in self._methods.values()), *self._past_counts]
        ]
        return Statistics(**{name: sum(count[name] for count in counts) for name in counts[0]})


class StallCheck:
    """Check of the events of a run of this duration [s], which may act ever more frequently."""

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._times: list[float] = []
        self._impact_times: dict[str, float] = {}

    def reason(self, event: EventTerm, t: float, impulses: Mapping[str, float]) -> str:
        """Return the reason why the run stalls after an event has acted at time `t` [s], or "".

        `impulses` are those of the event, by constraint.
        """
        advice = "; separate the thresholds of the events"
        if select_impacts(event.do):
            advice = _IMPACT_ADVICE
            flight = t - self._impact_times.get(event.name, -np.inf)
            self._impact_times[event.name] = t
            is_resolved = any(impulses[x] for x in impulses if x.startswith(f"{event.name}."))
            # Otherwise, bodies would sink into each other, because the next impact would be
            # detected at the position that they have reached.
            if not is_resolved and flight < _MAX_UNRESOLVED_FLIGHT * self._duration:
                return (
                    f"impacts of event {event.name} accumulate, and the last two are "
                    f"{flight:.2g} s apart{advice}"
                )
        self._times.append(t)
        window = t - self._times[-_MAX_SWITCHES:][0]
        if len(self._times) < _MAX_SWITCHES or window > _SWITCH_WINDOW * self._duration:
            return ""
        return (
            f"events acted {_MAX_SWITCHES} times within {window:.2g} s, the last one is "
            f"{event.name}{advice}"
        )
