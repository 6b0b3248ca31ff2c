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
from contextlib import nullcontext
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from beamdae import deferred
from beamdae.analysis.sensitivities.implicit import (
    differentiate_equilibrium,
    find_unique_equilibrium,
)
from beamdae.analysis.sensitivities.linear_steps import Matrices, differentiate_steps
from beamdae.analysis.sensitivities.neighbors import (
    Difference,
    NumericModel,
    derivative_call,
    difference_models,
)
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_columns,
    group_times,
    join_points,
    time_derivative,
)
from beamdae.analysis.sensitivities.start_derivatives import (
    group_directions,
)
from beamdae.equations.equations_of_motion import (
    Configuration,
    EquationsOfMotion,
    State,
)
from beamdae.equations.smooth_intervals import SAME_TIME, time_on_branch
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.reduced_equations import keep_constraints
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.equations.structure import has_same_patterns
from beamdae.errors import (
    BeamdaeError,
    require_choice,
    short_repr,
    warn_user,
    warnings_are_ignored,
)
from beamdae.integrators import Auto, GeneralizedAlpha, Integrator, Radau
from beamdae.integrators.events.switching import apply_impact
from beamdae.integrators.reaction_balance import bound_reactions, remove_redundant
from beamdae.interrupts import keep_result
from beamdae.linear.blas_threads import single_threaded
from beamdae.memory import require_memory
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import AS_DRAWN, require_start
from beamdae.results.outcome import EventRecord
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.simulation import as_equations, is_unchecked, simulate, unchecked

Array = np.ndarray

# Slowest rate of an event quantity at an event, relative to the range of the quantity and to the
# duration of the interval before it. A parabola that passes its threshold with a slower rate
# exceeds it by less than 1e-8 of its range, which runs do not resolve.
_MIN_EVENT_RATE = 1e-4


def time_rounding(trajectory: Trajectory) -> float:
    """Return the difference up to which times of a run are the same [s]."""
    return SAME_TIME * max(abs(trajectory.start), abs(trajectory.end))


def event_number(equations: EquationsOfMotion, name: str) -> int:
    """Return the index of an event."""
    return next(k for k, x in enumerate(equations.events) if x.name == name)


def find_event(solution: Solution, t: float) -> EventRecord | None:
    """Return the record of the event that acts at `t` [s], or None.

    Raises
    ------
    BeamdaeError
        If the derivative does not exist, because several events act, or the event is at the end of
        the run or at a breakpoint.
    """
    records = _records_at(solution, t, stops=False)
    if not records:
        return None
    rounding, times = time_rounding(solution.trajectory), solution.equations.breakpoints
    for at, place in (
        (solution.trajectory.end, "the end of the run"),
        *((x, "a breakpoint of a law") for x in times),
    ):
        if abs(t - at) <= rounding:
            raise BeamdaeError(
                f"{derivative_call()}: event {records[0].name} acts at {place}, t = {t:g} s, where "
                "the derivatives do not exist; separate the two times."
            )
    return records[0]


def find_stop(solution: Solution) -> int | None:
    """Return the index of the event that stopped a run, None if it reached its end time.

    Raises
    ------
    BeamdaeError
        If several events stop the run at the same time.
    """
    records = _records_at(solution, solution.trajectory.end, stops=True)
    return event_number(solution.equations, records[0].name) if records else None


def _records_at(solution: Solution, t: float, *, stops: bool) -> list[EventRecord]:
    """Return the record of the event that acts at `t` [s], or stops the run, if there is one."""
    equations, rounding = solution.equations, time_rounding(solution.trajectory)

    def is_sought(name: str) -> bool:
        action = equations.events[event_number(equations, name)].do
        return action == "stop" if stops else not isinstance(action, str)

    records = [x for x in solution.event_records if abs(x.t - t) <= rounding and is_sought(x.name)]
    # Impacts that close each other's gaps occur several times.
    names = list(dict.fromkeys(x.name for x in records))
    if len(records if not stops else names) > 1:
        raise BeamdaeError(
            f"{derivative_call()}: events {' and '.join(names)} act at the same time, t = {t:g} s, "
            "where the derivatives do not exist; separate the two times."
        )
    return records


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


def differentiate_event_time(
    equations: EquationsOfMotion,
    number: int,
    interval: Interval,
    t: float,
    along: Mapping[str, Interval],
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
        Derivatives of the states of the interval, by parameter.
    differences
        Models at neighboring values, by parameter.

    Raises
    ------
    BeamdaeError
        If the event quantity hardly changes at the event.
    """
    term, here = equations.events[number], np.array([t])
    # Elastic forces follow from the states at several nodes, with weights, others from that at t.
    is_elastic = term.observable.is_elastic
    ((inactive, points),) = group_times(Trajectory((interval,)), here, is_elastic)
    times, at = join_points(points, Trajectory((interval,)))
    active = equations.without_loads_of(inactive)
    values = term.evaluate_difference(
        active.p, interval.times, interval.rows.q, interval.rows.v, interval.rows.lam
    )
    duration = max(float(interval.nodes[-1] - interval.nodes[0]), np.finfo(float).tiny)
    if is_elastic:
        rate = float(interval.force_rates_at(values, here)[0])
    else:
        lam_rates = interval.derivative_at(here).lam
        rate = float(time_derivative(term.observable, active, times, at, lam_rates)[0, term.column])
    if not abs(rate) > _MIN_EVENT_RATE * float(np.ptp(values)) / duration:
        raise BeamdaeError(
            f"{derivative_call()}: the quantity of event {term.name} only touches its value at t = "
            f"{t:g} s, where the derivatives do not exist; choose other values of the parameters."
        )
    changes = differentiate_columns(
        lambda e: e.events[number].observable,
        times,
        at,
        {name: join_points(points, Trajectory((x,)))[1] for name, x in along.items()},
        differences,
        inactive,
    )
    weights = points[0].weights
    return {
        name: (
            differences[name].along(lambda e: e.events[number].crosses)
            - float((change if weights is None else weights @ change)[0, term.column])
        )
        / rate
        + 0.0  # not -0.0
        for name, change in changes.items()
    }


def breakpoint_derivatives(difference: Difference) -> list[tuple[float, float]]:
    """Return pairs of a breakpoint [s] and its derivative."""
    derivatives = difference.along(lambda e: np.array(e.breakpoints))
    return list(zip(difference.base.breakpoints, derivatives.tolist(), strict=True))


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


Result = TypeVar("Result")

# Errors of derivatives are larger than those of the motion.
DERIVATIVE_METHOD = Radau(rtol=1e-5)
# With the default tolerance of 1e-6, Newton errors of runs led to errors of derivatives of up to
# 1e-4; with this tolerance, they are limited by rounding errors.
_NEWTON_TOLERANCE = 1e-10
# Reason of interrupts after which only the estimate of the error is missing.
_INTERRUPTED_ESTIMATE = "interrupted while the error of the derivatives was estimated"


def require_differentiable_method(
    integrator: Any, default: GeneralizedAlpha | Radau = DERIVATIVE_METHOD
) -> GeneralizedAlpha | Radau:
    """Return the integrator of a run that is differentiated: Radau for Auto.

    Newton errors of generalized-alpha are reduced.

    Raises
    ------
    BeamdaeError
        If runs of the integrator cannot be differentiated.
    """
    method = default if integrator is None else integrator
    if isinstance(method, Auto):
        return Radau(**{x.name: getattr(method, x.name) for x in fields(method)})
    if isinstance(method, Radau):
        return method
    if not isinstance(method, GeneralizedAlpha):
        # A sequence of steps of variable order cannot be replayed.
        name = type(method).__name__ if isinstance(method, Integrator) else short_repr(method)
        raise BeamdaeError(
            f"{derivative_call()}: runs of {name} cannot be differentiated; use Radau or "
            "GeneralizedAlpha."
        )
    if method.formulation != "index3":
        raise BeamdaeError(
            f"{derivative_call()}: GeneralizedAlpha must have formulation='index3', got "
            f"{short_repr(method)}."
        )
    return replace(method, newton_tolerance=min(method.newton_tolerance, _NEWTON_TOLERANCE))


@dataclass(eq=False)
class DifferentiableRun:
    """Run of a model, and its derivatives by parameter as soon as they are needed.

    Attributes
    ----------
    model, method
        The model, and the integrator of the run.
    settings
        Further arguments of the run, see `simulate`.
    solution
        The run.
    neighbors
        Models around the values of parameters, as far as they are known.
    """

    model: NumericModel
    method: GeneralizedAlpha | Radau
    settings: dict[str, Any]
    solution: Solution
    neighbors: dict[str, Difference] = field(default_factory=dict, init=False)
    _along: dict[str, RunDerivative] = field(default_factory=dict, init=False)

    @classmethod
    def of(
        cls, model: Any, method: GeneralizedAlpha | Radau, start: Any = None, **settings: Any
    ) -> Self:
        """Integrate a model.

        Raises
        ------
        BeamdaeError
            If the start is a result, or the model has a sampled controller.
        """
        mechanism = model()
        start = None if start is None else require_start(derivative_call(), start)
        # Rejects sampled controllers; the run computes the start, such as an equilibrium.
        as_equations(derivative_call(), mechanism, AS_DRAWN)
        settings |= {"start": start, "keep_steps": True}
        return cls(model, method, settings, simulate(mechanism, method, **settings))

    def repeat(self, model: Any, method: GeneralizedAlpha | Radau) -> Self:
        """Return the run of another model by another integrator."""
        return self.of(model, method, **self.settings | {"progress": None, "partial": "raise"})

    def require_end(self) -> None:
        """Reject a run that did not reach its end."""
        status = self.solution.status
        if not status.success:
            raise BeamdaeError(
                f"{derivative_call()}: the run of {self.model.name} did not reach its end "
                f"({status.sentence}); differentiate a shorter run, or change the integrator."
            )

    def differentiate(
        self, names: Sequence[str]
    ) -> tuple[dict[str, Difference], dict[str, RunDerivative]]:
        """Return the models around the values of parameters, and the derivatives of the run."""
        self.require_end()
        differences = self.difference(names)
        missing = {name: x for name, x in differences.items() if name not in self._along}
        if missing:
            self._along |= differentiate_states(self.solution, self.method, missing)
        return differences, {x: self._along[x] for x in names}

    def difference(self, names: Sequence[str]) -> dict[str, Difference]:
        """Return the models around the values of parameters."""
        equations = self.solution.equations
        if missing := [x for x in names if x not in self.neighbors]:
            assemble = assemble_neighbors(equations, self.settings["start"])
            self.neighbors |= difference_models(self.model, missing, equations, assemble)
        return {x: self.neighbors[x] for x in names}


def assess_derivatives(estimate_error: Any, compute: Callable[[], Result]) -> Result:
    """Return derivatives, and issue warnings of their errors unless these are not estimated.

    Raises
    ------
    Interrupted
        With the derivatives, if only the estimate was interrupted.
    """
    call = derivative_call()
    require_choice(call, "estimate_error", estimate_error, (True, False))
    with nullcontext() if estimate_error else unchecked():
        result = compute()
    if estimate_error:
        with keep_result(result, call, _INTERRUPTED_ESTIMATE):
            warn_of_errors(result)
    return result


def warn_of_errors(result: Any) -> None:
    """Measure the errors of `Sensitivities` or a `Gradient`, unless this takes long, and warn."""
    if is_unchecked() or warnings_are_ignored():
        return
    for sentence in deferred.module("accuracy.runs").check_errors(result, result.solution):
        warn_user(f"{derivative_call()}: {sentence}")
