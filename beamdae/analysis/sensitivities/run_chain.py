"""Derivatives of the states of a run: its start, breakpoints, events, impacts and switches.

At a restart whose time t depends on the parameter, with the states x = (q, v) and their rates f
before (-) and after (+) it, the derivatives s at fixed time change from s- to

    s+ = J_x (s- + f- dt) + J_t dt + J_p dp - f+ dt,

where J is the jump from x- to x+. For breakpoints, dt follows from the model function; for events
h(t, x, p) = 0, it is dt = -(h_x s- + h_p dp) / (dh/dt). Rosenwasser & Yusupov, Sensitivity of
Automatic Control Systems, 2000; Galan, Feehery & Barton, Appl. Numer. Math. 31 (1999) 17,
doi:10.1016/S0168-9274(98)00125-1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.sensitivities.implicit import (
    differentiate_equilibrium,
    find_unique_equilibrium,
)
from beamdae.analysis.sensitivities.linear_steps import Matrices, differentiate_steps
from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    derivative_call,
)
from beamdae.analysis.sensitivities.restart_times import (
    breakpoint_derivatives,
    differentiate_event_time,
    event_number,
    find_event,
    require_inner_breakpoints,
    time_rounding,
)
from beamdae.analysis.sensitivities.start_derivatives import (
    group_directions,
)
from beamdae.equations.equations_of_motion import (
    Configuration,
    EquationsOfMotion,
    State,
)
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.reduced_equations import keep_constraints
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.structure import has_same_patterns
from beamdae.errors import (
    BeamdaeError,
)
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.integrators.events.switching import apply_impact
from beamdae.integrators.reaction_balance import bound_reactions, remove_redundant
from beamdae.linear.blas_threads import single_threaded
from beamdae.memory import require_memory
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.simulation import as_equations

Array = np.ndarray


def differentiate_starts(
    differences: Sequence[Difference], time: Array, at: State
) -> list[tuple[Array, Array]]:
    """Return the derivatives of the requested initial positions and velocities along parameters.

    `time` and `at` are (t, branch) and the state at the start of the run.
    """
    bases = {id(x.base): x.base for x in differences}
    equilibria = {key: find_unique_equilibrium(e) for key, e in bases.items()}

    def start(e: EquationsOfMotion) -> Array:
        return np.concatenate(ConsistencySolver(e).start_state(time, e.q0, e.v0)[:2])

    result = []
    for x in differences:
        equilibrium, models = equilibria[id(x.base)], (x.base, *x.models)
        is_consistent = np.array_equal(at.q, x.base.q0)
        if is_consistent and not any(start_adds_velocities(e, time) for e in models):
            dq, dv = x.along(lambda e: e.q0), x.along(lambda e: e.v0)
        else:
            dq, dv = np.split(x.along(start), 2)
        result.append((differentiate_equilibrium(equilibrium, x) if equilibrium else dq, dv))
    return result


def assemble_neighbors(base: EquationsOfMotion, start: Any) -> Callable[[Any], EquationsOfMotion]:
    """Return the function that assembles models at neighboring values of parameters.

    If the run starts in a unique equilibrium, that of its neighbors is not searched: they start at
    that of the run, whose derivative follows from the static equations.

    Parameters
    ----------
    base, start
        Equations of the run, and its start; None for that of the model.
    """

    def assemble(mechanism: Any) -> EquationsOfMotion:
        return as_equations(derivative_call(), mechanism, start)

    time = time_on_branch(base.breakpoints, 0.0)
    if (
        base.configurations is not None
        or base.redundant
        or len(base.states)
        or start_adds_velocities(base, time)
        or find_unique_equilibrium(base) is None
    ):
        return assemble

    def assemble_as_drawn(mechanism: Any) -> EquationsOfMotion:
        neighbor = as_equations(derivative_call(), mechanism, AS_DRAWN)
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


Starts = Mapping[str, tuple[Array, Array]]

# Copies of the derivatives of all steps that are in memory at the same time.
COPIES_OF_ROWS = 3.0


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


def differentiate_states(
    solution: Solution,
    method: GeneralizedAlpha | Radau,
    differences: Mapping[str, Difference],
    starts: Starts | None = None,
) -> dict[str, RunDerivative]:
    """Return the derivatives of a run by parameter.

    `starts` are the derivatives of the initial positions and velocities by parameter, if they do
    not follow from the models.

    Raises
    ------
    BeamdaeError
        If an event or a moving breakpoint does not have a derivative, steps cannot be
        differentiated, or the derivatives need too much memory.
    """
    equations, trajectory = solution.equations, solution.trajectory
    nodes = sum(len(x.nodes) for x in trajectory.intervals)
    require_memory(
        derivative_call(),
        f"derivatives of {trajectory.steps} steps with respect to {len(differences)} parameters",
        COPIES_OF_ROWS * 8.0 * nodes * len(differences) * (3 * equations.n + equations.m),
        "use longer steps or fewer parameters",
    )
    solution = bound_reactions(solution)
    with single_threaded:
        reduced = remove_redundant(equations, solution.trajectory.start)
        if reduced is None:
            return _Chain(solution, method, differences, starts).differentiate()
        rows, full = reduced.independent, StateEvaluator(equations)

        def keep(e: EquationsOfMotion) -> EquationsOfMotion:
            return keep_constraints(e, rows)

        def reduce(interval: Interval) -> Interval:
            """Return an interval with the multipliers of the independent constraints."""
            states = interval.rows
            lam = np.zeros((len(states.lam), len(rows)))
            for k, (time, q) in enumerate(zip(interval.times, states.q, strict=True)):
                gradient = full.constraint_matrix(time, q).toarray()
                force = gradient.T @ states.lam[k]
                lam[k] = np.linalg.lstsq(gradient[rows].T, force, rcond=None)[0]
            return replace(interval, rows=states._replace(lam=lam))

        def restore(interval: Interval, change: Interval, difference: Difference) -> Interval:
            """Difference the reactions of minimum norm along the derivatives."""

            def evaluate(e: EquationsOfMotion, q: Array, lam: Array) -> Array:
                neighbor = replace(reduced, full=e, equations=keep(e))
                return neighbor.restore_reactions(interval.times, q, lam)

            (q, _, _, lam), along = interval.rows, change.rows
            lam = difference.along(evaluate, (q, along.q), (lam, along.lam))
            return replace(change, rows=along._replace(lam=lam))

        intervals, result = tuple(map(reduce, solution.trajectory.intervals)), {}
        run = replace(solution, equations=reduced.equations, trajectory=Trajectory(intervals))
        smaller = {
            name: replace(x, base=keep(x.base), models=tuple(map(keep, x.models)))
            for name, x in differences.items()
        }
        for name, x in _Chain(run, method, smaller, starts).differentiate().items():
            pairs = zip(intervals, x.trajectory.intervals, strict=True)
            restored = tuple(restore(*pair, differences[name]) for pair in pairs)
            result[name] = x._replace(trajectory=Trajectory(restored))
        return result


class _Crossing(NamedTuple):
    """Restart of a run, and its derivatives, one parameter a row.

    Attributes
    ----------
    phases
        Models after it.
    v
        Velocities that are made consistent after it.
    shifts
        Derivatives of its time [s], (k,).
    dq, dv
        Derivatives of the positions and of `v` along the moving time, (k, n).
    """

    phases: list[Phase]
    v: Array
    shifts: Array
    dq: Array
    dv: Array


class _Chain:
    """Intervals and restarts of a run, through which the derivatives of all parameters pass."""

    def __init__(
        self,
        solution: Solution,
        method: GeneralizedAlpha | Radau,
        differences: Mapping[str, Difference],
        starts: Starts | None,
    ) -> None:
        self._solution, self._method, self._starts = solution, method, starts
        self._differences, self._equations = differences, solution.equations
        self._matrices = Matrices()

    def differentiate(self) -> dict[str, RunDerivative]:
        """Return the derivatives by parameter."""
        intervals, whole = self._solution.trajectory.intervals, self._differences.values()
        first, phases = (
            intervals[0].configuration,
            [Phase(x, x, [None] * len(x.models)) for x in whole],
        )
        if first is not None:
            phases = [
                _activate(x, first, [e.configurations.initial_configuration(e) for e in x.models])
                for x in whole
            ]
        for phase in phases:
            require_inner_breakpoints(phase.active, self._solution.trajectory)
        time, at = node_state(with_active_multipliers(intervals[0]), 0)
        if self._starts is None:
            starts = differentiate_starts([x.active for x in phases], time, at)
        else:
            starts = [self._starts[name] for name in self._differences]
        dq, dv = (np.array(x) for x in zip(*starts, strict=True))
        crossing = _Crossing(phases, at.v, np.zeros(len(phases)), dq, dv)
        rows, all_shifts = [self._differentiate_interval(crossing, intervals[0])], [crossing.shifts]
        for before, interval in pairwise(intervals):
            crossing = self._cross(crossing.phases, before, interval, rows[-1])
            rows.append(self._differentiate_interval(crossing, interval))
            all_shifts.append(crossing.shifts)
        return {
            name: RunDerivative(
                Trajectory(tuple(x[k] for x in rows)), np.array([x[k] for x in all_shifts])
            )
            for k, name in enumerate(self._differences)
        }

    def _differentiate_interval(self, crossing: _Crossing, interval: Interval) -> list[Interval]:
        """Return the derivatives of an interval at fixed times, by parameter."""
        active, n = with_active_multipliers(interval), self._equations.n
        equations, (time, at) = interval.active_equations(self._equations), node_state(active, 0)
        result = [interval] * len(crossing.phases)
        for directions in group_directions([x.active for x in crossing.phases]):
            maps, members, numbers = directions
            shifts, dq, dv = (x[members] for x in (crossing.shifts, crossing.dq, crossing.dv))
            h = float(interval.t[1] - interval.t[0]) if shifts.any() else 0.0
            start_map = maps.start_map(time, at, crossing.v, h)
            fixed = moved = maps.along(start_map, np.hstack([dq, dv]), numbers, shifts)
            if shifts.any():
                rates = np.concatenate([at.v, at.a])
                changes = moved[:, : len(rates)] - np.multiply.outer(shifts, rates)
                fixed = maps.along(maps.completion_map(time, at), changes, numbers)
            if isinstance(self._method, Radau):
                moved, shifts = fixed, np.zeros_like(shifts)
            nodes = differentiate_steps(
                self._method, directions, equations, active, moved, shifts, self._matrices
            )
            nodes[0] = fixed
            if shifts.any():
                rows, along = active.rows, active.derivative_at(active.nodes)
                rates = np.hstack([rows.v, rows.a, along.a, along.lam])[1:]
                nodes[1:] -= rates[:, None] * shifts[:, None]
            for member, x in zip(members, nodes.swapaxes(0, 1), strict=True):
                q, v, a, lam = np.split(x, [n, 2 * n, 3 * n], axis=1)
                if interval.configuration is not None:
                    lam = interval.configuration.expand_multipliers(lam, self._equations.m)
                result[member] = replace(interval, rows=State(q, v, a, lam))
        return result

    def _cross(
        self, phases: list[Phase], before: Interval, after: Interval, along: list[Interval]
    ) -> _Crossing:
        """Return a restart; `along` are the derivatives of the interval `before` by parameter."""
        t = float(after.t[0])
        event = find_event(self._solution, t)
        time, at = node_state(with_active_multipliers(before), -1)
        # The velocities of generalized-alpha change at the rate of its own accelerations, also for
        # modes that are too fast for the step.
        if isinstance(self._method, Radau):
            # Fast modes may be far from equilibrium within the steps; these accelerations belong to
            # the positions and velocities.
            solver = ConsistencySolver(before.active_equations(self._equations))
            at = State(at.q, at.v, *solver.acceleration(time, at.q, at.v))
        if event is None:
            rounding, shifts = time_rounding(self._solution.trajectory), np.zeros(len(phases))
            for k, difference in enumerate(x.active for x in phases):
                pairs = breakpoint_derivatives(difference)
                rates = [dt for b, dt in pairs if abs(b - t) <= rounding] or [0.0]
                if max(rates) != min(rates):
                    raise BeamdaeError(
                        f"{derivative_call()}: {difference.name} moves one of several breakpoints "
                        f"at t = {t:g} s, where the derivatives do not exist; separate their times."
                    )
                shifts[k] = rates[0]
        else:
            number = event_number(self._equations, event.name)
            ends = dict(zip(self._differences, along, strict=True))
            by_name = differentiate_event_time(
                self._equations, number, before, event.t, ends, self._differences
            )
            shifts = np.array(list(by_name.values()))
        dq = np.array([x.rows.q[-1] for x in along]) + np.multiply.outer(shifts, at.v)
        dv = np.array([x.rows.v[-1] for x in along]) + np.multiply.outer(shifts, at.a)
        if event is None:
            return _Crossing(phases, at.v, shifts, dq, dv)
        v = at.v
        models = [list(zip(x.whole.models, x.configurations, strict=True)) for x in phases]
        if select_impacts(self._equations.events[number].do):

            def hit(model: tuple[EquationsOfMotion, Any], time: Array, q: Array, v: Array) -> Array:
                e, now = model
                impacts = select_impacts(e.events[number].do)
                impact = e.configurations.impact_equations(e, now, event.name, impacts)
                return apply_impact(impact, time, at._replace(q=q, v=v))[0]

            for k, (phase, dt) in enumerate(zip(phases, shifts.tolist(), strict=True)):
                clock = time, np.array([dt, 0.0])
                changes = clock, (at.q, dq[k]), (at.v, dv[k])
                dv[k] = replace(phase.whole, models=models[k]).along(hit, *changes)
            v = hit((self._equations, before.configuration), time, *at[:2])
        assert after.configuration is not None
        after_event = []
        for k, (phase, dt) in enumerate(zip(phases, shifts.tolist(), strict=True)):
            # Joints may keep the gaps that they have at the event, and laws may begin there: the
            # event of each neighboring model is at its own time and positions.
            configurations = [
                e.configurations.configuration_after(
                    e, now, e.events[number], time + np.array([step * dt, 0.0]), at.q + step * dq[k]
                )
                for (e, now), step in zip(models[k], phase.whole.steps, strict=True)
            ]
            after_event.append(_activate(phase.whole, after.configuration, configurations))
        return _Crossing(after_event, v, shifts, dq, dv)


def with_active_multipliers(interval: Interval) -> Interval:
    """Return an interval with the multipliers of the active parts."""
    if interval.configuration is None:
        return interval
    lam = interval.configuration.select_multipliers(interval.rows.lam)
    return replace(interval, rows=interval.rows._replace(lam=lam))


def node_state(interval: Interval, k: int) -> tuple[Array, State]:
    """Return (t, branch) and the state of a node."""
    return interval.times[k], State(*(x[k] for x in interval.rows))


class Phase(NamedTuple):
    """Equations of the active parts at neighboring values of one parameter.

    Attributes
    ----------
    whole
        Equations of all parts.
    active
        Equations of the active parts.
    configurations
        Active parts of the neighboring models; None if the active parts never change.
    """

    whole: Difference
    active: Difference
    configurations: Sequence[Any]


def _activate(
    whole: Difference, configuration: Configuration, neighbors: Sequence[Configuration]
) -> Phase:
    """Return the phase with these active parts of the run and of the neighboring models."""
    models = [x.equations for x in neighbors]
    if not all(has_same_patterns(e.structure, models[0].structure) for e in models):
        raise BeamdaeError(
            f"{derivative_call()}: {whole.name} changes the structure of the equations after an "
            "event; use differences of runs for this parameter."
        )
    return Phase(whole, whole.between(configuration.equations, models), neighbors)
