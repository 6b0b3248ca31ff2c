"""Derivatives of the states of a run, across breakpoints, events, impacts and switches.

At a restart whose time t depends on the parameter, with the states x = (q, v) and their rates f
before (-) and after (+) it, the derivatives s at fixed time change from s- to

    s+ = J_x (s- + f- dt) + J_t dt + J_p dp - f+ dt,

where J is the jump from x- to x+. For breakpoints, dt follows from the model function; for events
h(t, x, p) = 0, it is dt = -(h_x s- + h_p dp) / (dh/dt). Rosenwasser & Yusupov, Sensitivity of
Automatic Control Systems, 2000; Galan, Feehery & Barton, Appl. Numer. Math. 31 (1999) 17,
doi:10.1016/S0168-9274(98)00125-1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.sensitivities.alpha_replay import differentiate_alpha_steps
from beamdae.analysis.sensitivities.further_forces import further_key, locate_numbers
from beamdae.analysis.sensitivities.model_differences import Difference, derivative_call
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_columns,
    time_derivative,
)
from beamdae.analysis.sensitivities.operator_changes import moves_operators
from beamdae.analysis.sensitivities.phases import ImpactDifference, Phase
from beamdae.analysis.sensitivities.radau_replay import differentiate_radau_steps
from beamdae.analysis.sensitivities.recorded_maps import Record
from beamdae.analysis.sensitivities.start_derivatives import (
    StartDerivatives,
    has_unique_equilibrium,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.smooth_intervals import SAME_TIME, time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.integrators.events.impacts import apply_impact, select_active_constraints
from beamdae.integrators.reaction_balance import bound_reactions
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.results.event_records import EventRecord
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.simulation import as_equations

Array = np.ndarray

# Slowest rate of an event quantity at an event, relative to the range of the quantity and to the
# duration of the interval before it. A parabola that passes its threshold with a slower rate
# exceeds it by less than 1e-8 of its range, which runs do not resolve.
_MIN_EVENT_RATE = 1e-4


class RunDerivative(NamedTuple):
    """Derivative of a run with respect to one parameter.

    Attributes
    ----------
    trajectory
        Derivatives of the states at fixed times.
    shifts
        Derivatives of the times [s] at which the intervals begin, (intervals,).
    """

    trajectory: Trajectory
    shifts: Array


class RunDerivatives:
    """Derivatives of a run with respect to parameters that the same equations serve.

    `starts` are the derivatives of the initial positions and velocities by parameter, if they do
    not follow from the models.
    """

    def __init__(
        self,
        solution: Solution,
        method: GeneralizedAlpha | Radau,
        differences: Mapping[str, Difference],
        starts: Mapping[str, tuple[Array, Array]] | None = None,
    ) -> None:
        self._solution, self._method = bound_reactions(solution), method
        self._differences = differences
        self._starts = starts
        self._equations = solution.equations

    def by_parameter(self) -> dict[str, RunDerivative]:
        """Return the derivatives by parameter.

        Raises
        ------
        BeamdaeError
            If an event or a moving breakpoint does not have a derivative, or steps cannot be
            differentiated.
        """
        intervals = self._solution.trajectory.intervals
        phases = [Phase.first(x, intervals[0].configuration) for x in self._differences.values()]
        for phase in phases:
            require_inner_breakpoints(phase.active, self._solution.trajectory)
        rows: list[list[Interval]] = []
        all_shifts: list[Array] = []
        before: Interval | None = None
        for interval in intervals:
            if before is None:
                derivatives, firsts = self._differentiate_start(phases, interval)
                shifts, moved = np.zeros(len(phases)), firsts
            else:
                crossing = self._cross(phases, before, interval, rows[-1])
                phases, shifts, v = crossing[:3]
                keys = {further_key(x.active.base) for x in phases}
                if len(keys) > 1 and self._equations.configurations is not None:
                    return self._differentiate_one_by_one()
                derivatives, moved, firsts = _restart(phases, interval, v, shifts, *crossing[3:])
            all_shifts.append(shifts)
            active = with_active_multipliers(interval)
            numbers = _numbers(phases, derivatives.equations)
            steps_of, has_all = self._equations, derivatives.equations
            if locate_numbers(steps_of, has_all) is None:
                steps_of = has_all
            if isinstance(self._method, Radau):
                nodes = differentiate_radau_steps(derivatives, steps_of, active, firsts, numbers)
            else:
                nodes = differentiate_alpha_steps(
                    self._method, derivatives, steps_of, active, moved, numbers, shifts
                )
                nodes[0] = np.hstack(firsts)
                if shifts.any():
                    nodes[1:] -= np.multiply.outer(rates_at_steps(active)[1:], shifts).swapaxes(
                        1, 2
                    )
            rows.append([self._derivative_interval(interval, x) for x in nodes.swapaxes(0, 1)])
            before = interval
        return {
            name: RunDerivative(
                Trajectory(tuple(x[k] for x in rows)), np.array([x[k] for x in all_shifts])
            )
            for k, name in enumerate(self._differences)
        }

    def _differentiate_one_by_one(self) -> dict[str, RunDerivative]:
        """Return the derivatives by parameters with different equations after an event.

        Forces may vanish at the value of one parameter, or its value may coincide with another
        number of a law, which is then one number of the equations instead of two.
        """
        solution, method, starts = self._solution, self._method, self._starts
        return {
            name: RunDerivatives(solution, method, {name: x}, starts).by_parameter()[name]
            for name, x in self._differences.items()
        }

    def _derivative_interval(self, interval: Interval, rows: Array) -> Interval:
        n, m = self._equations.n, self._equations.m
        q, v, a, lam = np.split(rows, [n, 2 * n, 3 * n], axis=1)
        if interval.configuration is not None:
            lam = interval.configuration.expand_multipliers(lam, m)
        return replace(interval, rows=State(q, v, a, lam))

    def _differentiate_start(
        self, phases: list[Phase], interval: Interval
    ) -> tuple[StartDerivatives, list[Array]]:
        """Return the maps of the equations, and the derivatives of the consistent start."""
        derivatives = _derive_common(phases)
        time, at = node_state(with_active_multipliers(interval), 0)
        numbers, starts = _numbers(phases, derivatives.equations), []
        for phase, dp in zip(phases, numbers, strict=True):
            if self._starts is None:
                starts.append(differentiate_start(phase.active, derivatives, time, at, dp))
            else:
                starts.append(self._starts[phase.whole.name])
        changes = [np.array(x) for x in zip(*starts, strict=True)]
        return derivatives, derivatives.start_map(time, at, at.v).along(changes, numbers)

    def _cross(
        self, phases: list[Phase], before: Interval, after: Interval, along: list[Interval]
    ) -> tuple[list[Phase], Array, Array, Array, Array]:
        """Return the phases after a restart, the derivatives of its time, and the velocities.

        The derivatives of positions and velocities along the moving time follow, one parameter a
        row. `along` are the derivatives of the interval `before`, one per parameter.
        """
        t = float(after.t[0])
        event = find_event(self._solution, self._equations, t)
        old = derive_states(phases[0].active)
        time, at = state_before_restart(before, old.solver, self._method)
        if event is None:
            shifts = self._breakpoint_shifts(phases, t)
        else:
            shifts = self._event_shifts(event, before, along)
        totals = [
            State(x.rows.q[-1] + dt * at.v, x.rows.v[-1] + dt * at.a, 0.0 * at.a, 0.0 * at.lam)
            for x, dt in zip(along, shifts, strict=True)
        ]
        v, velocities = at.v, [x.v for x in totals]
        if event is not None:
            number = event_number(self._equations, event.name)
            if select_impacts(self._equations.events[number].do):
                h = float(after.t[1] - after.t[0])
                v, velocities = self._jump(phases, number, before, time, at, totals, shifts, h)
            assert after.configuration is not None
            phases = [
                phase.after_event(number, after.configuration, time, dt, at.q, total.q)
                for phase, dt, total in zip(phases, shifts, totals, strict=True)
            ]
        return phases, np.array(shifts), v, np.array([x.q for x in totals]), np.array(velocities)

    def _jump(
        self,
        phases: list[Phase],
        number: int,
        before: Interval,
        time: Array,
        at: State,
        totals: list[State],
        shifts: list[float],
        h: float,
    ) -> tuple[Array, list[Array]]:
        """Return the velocities after the impacts of an event, and their total derivatives."""
        assert before.configuration is not None
        velocities = []
        for phase, along, dt in zip(phases, totals, shifts, strict=True):
            difference = phase.impact(number, self._equations, before.configuration)
            jump, dv = record_impact(difference, time, at, h), along.v
            if jump is not None:
                dp = difference.equations.derivative(lambda e: e.p)
                changes = [x[None] for x in (along.q, along.v, difference.restitution)]
                dv = jump.along(changes, dp[None], np.array([dt]))[0][0]
            velocities.append(dv)
        return apply_impact(difference.impact, time, at)[0], velocities

    def _event_shifts(
        self, event: EventRecord, before: Interval, along: list[Interval]
    ) -> list[float]:
        """Return the derivatives of the time of the event at the end of an interval [s]."""
        states = {
            name: State(*(y[-1:] for y in x.rows))
            for name, x in zip(self._differences, along, strict=True)
        }
        number = event_number(self._equations, event.name)
        shifts = differentiate_event_time(
            self._equations, number, before, event.t, states, self._differences
        )
        return list(shifts.values())

    def _breakpoint_shifts(self, phases: list[Phase], t: float) -> list[float]:
        """Return the derivatives of the breakpoint at `t` [s], zero for onsets of contacts."""
        rounding = time_rounding(self._solution.trajectory)
        return [differentiate_breakpoint(x.active, t, rounding) for x in phases]


def time_rounding(trajectory: Trajectory) -> float:
    """Return the difference up to which times of a run are the same [s]."""
    return SAME_TIME * max(abs(trajectory.start), abs(trajectory.end))


def event_number(equations: EquationsOfMotion, name: str) -> int:
    """Return the index of an event."""
    return next(k for k, x in enumerate(equations.events) if x.name == name)


def find_event(solution: Solution, equations: EquationsOfMotion, t: float) -> EventRecord | None:
    """Return the record of the event that acts at `t` [s], or None.

    `equations` are those of all parts.

    Raises
    ------
    BeamdaeError
        If the derivative does not exist, because several events act, or the event is at the end of
        the run or at a breakpoint.
    """
    rounding, end = time_rounding(solution.trajectory), solution.trajectory.end
    records = [
        x
        for x in solution.event_records
        if abs(x.t - t) <= rounding
        and not isinstance(equations.events[event_number(equations, x.name)].do, str)
    ]
    if not records:
        return None
    names = [x.name for x in records]
    coincidence = ""
    if len(names) > 1:
        # Impacts that close each other's gaps occur several times.
        coincidence = f"events {' and '.join(dict.fromkeys(names))} act at the same time"
    elif end - t <= rounding:
        coincidence = f"event {names[0]} acts at the end of the run"
    elif any(abs(t - b) <= rounding for b in equations.breakpoints):
        coincidence = f"event {names[0]} acts at a breakpoint of a law"
    if coincidence:
        raise BeamdaeError(
            f"{derivative_call()}: {coincidence}, t = {t:g} s, where the derivatives do not exist; "
            "separate the two times."
        )
    return records[0]


def find_stop(solution: Solution) -> int | None:
    """Return the index of the event that stopped a run, None if it reached its end time.

    Raises
    ------
    BeamdaeError
        If several events stop the run at the same time.
    """
    end, rounding = solution.trajectory.end, time_rounding(solution.trajectory)
    events = solution.equations.events
    numbers = [
        event_number(solution.equations, x.name)
        for x in solution.event_records
        if abs(x.t - end) <= rounding
    ]
    stops = [k for k in dict.fromkeys(numbers) if events[k].do == "stop"]
    if len(stops) > 1:
        names = " and ".join(events[k].name for k in stops)
        raise BeamdaeError(
            f"{derivative_call()}: events {names} stop the run at the same time, t = {end:g} s, "
            "where the derivatives do not exist; separate the two times."
        )
    return stops[0] if stops else None


def differentiate_breakpoint(difference: Difference, t: float, rounding: float) -> float:
    """Return the derivative of the breakpoint at `t` [s]; zero if there is none.

    Raises
    ------
    BeamdaeError
        If breakpoints at this time move apart.
    """
    moves = breakpoint_derivatives(difference)
    at = [dt for b, dt in moves if abs(b - t) <= rounding]
    if at and max(at) != min(at):
        raise BeamdaeError(
            f"{derivative_call()}: {difference.name} moves one of several breakpoints at t = "
            f"{t:g} s, where the derivatives do not exist; separate their times."
        )
    return at[0] if at else 0.0


def require_inner_breakpoints(difference: Difference, trajectory: Trajectory) -> None:
    """Reject a parameter that moves a breakpoint across the start or the end of the run."""
    rounding = time_rounding(trajectory)
    for b, dt in breakpoint_derivatives(difference):
        if dt and min(abs(b - trajectory.start), abs(b - trajectory.end)) <= rounding:
            raise BeamdaeError(
                f"{derivative_call()}: {difference.name} moves the breakpoint of a law at t = "
                f"{b:g} s across the start or the end of the run, where the derivatives do "
                "not exist; choose another value, or another t_end."
            )


def record_impact(difference: ImpactDifference, time: Array, at: State, h: float) -> Record | None:
    """Return the map from (q, v, restitution) to the velocities after an impact.

    Return None if no body is stopped. See `StartDerivatives.impact_map` for the arguments.
    """
    impact, derivatives = difference.impact, derive_states(difference.equations)
    rates = derivatives.solver.constraint_levels(time, at.q, at.v)[1]
    active = select_active_constraints(impact, rates)
    if not len(active):
        return None
    return derivatives.impact_map(time, at, active, impact.coefficients, h)


def derive_states(difference: Difference) -> StartDerivatives:
    """Return the derivatives of consistent states along directions of the parameter."""
    moving = difference if moves_operators(difference) else None
    return StartDerivatives(ConsistencySolver(difference.base), moving)


def differentiate_event_time(
    equations: EquationsOfMotion,
    number: int,
    interval: Interval,
    t: float,
    along: Mapping[str, State],
    differences: Mapping[str, Difference],
) -> dict[str, float]:
    """Return the derivatives of the time of an event [s] by parameter.

    Parameters
    ----------
    equations, number
        Equations of all parts, and index of the event in them.
    interval, t
        Interval of the run that contains the event, and the time of the event [s].
    along
        Derivatives of the state at this time before the event, one row, by parameter.
    differences
        Models at neighboring values, by parameter.

    Raises
    ------
    BeamdaeError
        If the event quantity hardly changes at the event.
    """
    times, at = np.array([[t, interval.branch]]), interval.at(np.array([t]))
    term, rate = (
        equations.events[number],
        event_rate(equations, number, interval, t),
    )
    changes = differentiate_columns(
        lambda e: e.events[number].observable,
        equations,
        times,
        at,
        along,
        differences,
        interval.configuration,
    )
    thresholds = {
        name: x.derivative(lambda e: e.events[number].crosses) for name, x in differences.items()
    }
    return {
        name: (thresholds[name] - float(change[0, term.column])) / rate + 0.0  # not -0.0
        for name, change in changes.items()
    }


def event_rate(equations: EquationsOfMotion, number: int, interval: Interval, t: float) -> float:
    """Return the rate of the quantity of an event at the time `t` [s] of the event.

    Raises
    ------
    BeamdaeError
        If the event quantity hardly changes at the event.
    """
    term, equations = equations.events[number], equations.with_loads_of(interval.configuration)
    time, at = np.array([t, interval.branch]), interval.at(np.array([t]))
    state = State(*(x[0] for x in at))
    lam_rate = interval.derivative_at(np.array([t])).lam[0]
    rate = float(time_derivative(term.observable, equations, time, state, lam_rate)[term.column])
    values = term.evaluate_difference(
        equations.p, interval.times, interval.rows.q, interval.rows.v, interval.rows.lam
    )
    duration = max(float(interval.nodes[-1] - interval.nodes[0]), np.finfo(float).tiny)
    if not abs(rate) > _MIN_EVENT_RATE * float(np.ptp(values)) / duration:
        raise BeamdaeError(
            f"{derivative_call()}: the quantity of event {term.name} only touches its value at t = "
            f"{t:g} "
            "s, where the derivatives do not exist; choose other values of the parameters."
        )
    return rate


def state_before_restart(
    before: Interval, solver: ConsistencySolver, method: GeneralizedAlpha | Radau
) -> tuple[Array, State]:
    """Return (t, branch) and the state at the end of an interval, with its accelerations."""
    time, at = node_state(with_active_multipliers(before), -1)
    if isinstance(method, Radau):
        # Fast modes may be far from equilibrium within the steps; these accelerations belong to
        # the positions and velocities.
        at = State(at.q, at.v, *solver.acceleration(time, at.q, at.v))
    # The velocities of generalized-alpha change at the rate of its own accelerations, also for
    # modes that are too fast for the step.
    return time, at


def rates_at_steps(interval: Interval) -> Array:
    """Return the rates of (q, v, q'', lam) at the steps of a method without stages."""
    rates = interval.derivative_at(interval.nodes)
    return np.hstack([interval.rows.v, interval.rows.a, rates.a, rates.lam])


def _restart(
    phases: list[Phase], interval: Interval, v: Array, shifts: Array, dq: Array, dv: Array
) -> tuple[StartDerivatives, list[Array], list[Array]]:
    """Return the maps of the equations after a restart, and the derivatives of its state.

    They are those along the moving time, and those at fixed time, of (q, v, a, lam). `v` are the
    velocities before the restart, and `dq` and `dv` derivatives along the moving time.
    """
    derivatives = _derive_common(phases)
    time, at = node_state(with_active_multipliers(interval), 0)
    numbers = _numbers(phases, derivatives.equations)
    if not shifts.any():
        first = derivatives.start_map(time, at, v).along((dq, dv), numbers)
        return derivatives, first, first
    record = derivatives.restart_map(time, at, v, float(interval.t[1] - interval.t[0]))
    states = record.along((dq, dv), numbers, shifts)
    return derivatives, states[:4], states[4:]


def _numbers(phases: list[Phase], equations: EquationsOfMotion) -> Array:
    """Return the derivatives of the numbers p of equations that contain those of all phases."""
    result = np.zeros((len(phases), len(equations.p)))
    for row, phase in zip(result, phases, strict=True):
        base, dp = phase.active.base, phase.active.derivative(lambda e: e.p)
        is_same = base.structure == equations.structure
        at = slice(None) if is_same else locate_numbers(base, equations)
        assert at is not None
        row[at] = dp
    return result


def _derive_common(phases: list[Phase]) -> StartDerivatives:
    """Return the maps of the equations of the phase with the most forces, which serve all."""
    return derive_states(max((x.active for x in phases), key=lambda x: len(x.base.forces)))


def breakpoint_derivatives(difference: Difference) -> list[tuple[float, float]]:
    """Return pairs of a breakpoint [s] and its derivative."""
    derivatives = difference.derivative(lambda e: np.array(e.breakpoints))
    return list(zip(difference.base.breakpoints, derivatives.tolist(), strict=True))


def with_active_multipliers(interval: Interval) -> Interval:
    """Return an interval with the multipliers of the active parts."""
    if interval.configuration is None:
        return interval
    lam = interval.configuration.select_multipliers(interval.rows.lam)
    return replace(interval, rows=interval.rows._replace(lam=lam))


def node_state(interval: Interval, k: int) -> tuple[Array, State]:
    """Return (t, branch) and the state of a node."""
    return interval.times[k], State(*(x[k] for x in interval.rows))


def differentiate_start(
    difference: Difference, derivatives: StartDerivatives, time: Array, at: State, dp: Array
) -> tuple[Array, Array]:
    """Return the derivatives of the requested initial positions and velocities.

    `StartDerivatives.consistent_state` makes them consistent.
    """
    base = derivatives.equations
    models = (base, *difference.equations)
    if np.array_equal(at.q, base.q0) and not any(start_adds_velocities(e, time) for e in models):
        dq, dv = difference.derivative(lambda e: e.q0), difference.derivative(lambda e: e.v0)
    else:

        def start(e: EquationsOfMotion) -> Array:
            return np.concatenate(ConsistencySolver(e).start_state(time, e.q0, e.v0)[:2])

        dq, dv = np.split(difference.derivative(start), 2)
    if base.start is not None and base.start.description == EQUILIBRIUM:
        dq = derivatives.correct_equilibrium(time, at, dq, dp)
    return dq, dv


def assemble_neighbors(
    base: EquationsOfMotion, start: Any, build: Callable[[Any], Any] = lambda x: x
) -> Callable[[Any], EquationsOfMotion]:
    """Return the function that assembles models at neighboring values of parameters.

    If the run starts in a unique equilibrium, that of its neighbors is not searched: they start at
    that of the run, whose derivative follows from the static equations, see
    `StartDerivatives.correct_equilibrium`.

    Parameters
    ----------
    base, start
        Equations of the run, and its start; None for that of the model.
    build
        Function that completes a mechanism.
    """

    def assemble(mechanism: Any) -> EquationsOfMotion:
        return as_equations(derivative_call(), build(mechanism), start)

    time = time_on_branch(base.breakpoints, 0.0)
    if (
        base.start is None
        or base.start.description != EQUILIBRIUM
        or base.configurations is not None
        or base.redundant
        or len(base.states)
        or start_adds_velocities(base, time)
        or not has_unique_equilibrium(base, time)
    ):
        return assemble

    def assemble_as_drawn(mechanism: Any) -> EquationsOfMotion:
        neighbor = as_equations(derivative_call(), build(mechanism), AS_DRAWN)
        if neighbor.n != base.n:  # Rejected by the caller.
            return neighbor
        result = replace(neighbor, q0=base.q0, v0=base.v0, start=base.start)
        return assemble(mechanism) if start_adds_velocities(result, time) else result

    return assemble_as_drawn


def start_adds_velocities(equations: EquationsOfMotion, time: Array) -> bool:
    """Return True if bodies are set in motion at the start, see `ConsistencySolver.start_state`."""
    kernels = [joint.kernel for joint in equations.structure.joints]
    if not np.any(equations.v0) and all(x.is_scleronomic for x in kernels):
        return False
    solver = ConsistencySolver(equations)
    return not np.array_equal(
        solver.rigid_velocities(time, equations.q0, equations.v0), equations.v0
    )
