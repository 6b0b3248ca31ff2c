"""Backward sweep over a run, across breakpoints, events, impacts and switches of parts.

It transposes `RunDerivatives`: with the jump of the derivatives at a restart whose time t depends
on a parameter,

    s+ = J_x (s- + f- dt) + J_t dt + J_p dp - f+ dt,    dt = -(h_x s- + h_p dp) / (dh/dt),

the derivatives y+ of an objective with respect to the state after the restart become

    y- = J_x^T y+ - h_x^T y_t / (dh/dt),    y_t = y+ . (J_x f- + J_t - f+).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.analysis.gradients.alpha_adjoint import transpose_alpha_steps
from beamdae.analysis.gradients.column_seeds import (
    ColumnSeeds,
    OperatorSeeds,
    add_columns,
    differentiate_end,
    differentiate_objective,
    differentiate_restart,
    evaluate_terms,
)
from beamdae.analysis.gradients.objectives import ColumnObjective, Objective
from beamdae.analysis.gradients.radau_adjoint import transpose_radau_steps
from beamdae.analysis.sensitivities.further_forces import further_key
from beamdae.analysis.sensitivities.model_differences import (
    FOUR_NEIGHBORS,
    RELATIVE_DIFFERENCE,
    Difference,
    interpolate,
)
from beamdae.analysis.sensitivities.operator_changes import moves_operators
from beamdae.analysis.sensitivities.phases import ImpactDifference, Phase
from beamdae.analysis.sensitivities.recorded_maps import Gradient
from beamdae.analysis.sensitivities.redundant_derivatives import RedundantConstraints, ScaledRows
from beamdae.analysis.sensitivities.run_derivatives import (
    breakpoint_derivatives,
    derive_states,
    differentiate_breakpoint,
    event_number,
    event_rate,
    find_event,
    find_stop,
    node_state,
    record_impact,
    require_inner_breakpoints,
    state_before_restart,
    time_rounding,
    with_active_multipliers,
)
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.equations_of_motion import (
    Configuration,
    EquationsOfMotion,
    FrozenGaps,
    State,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.integrators.compiled_run import FactorizedMatrix
from beamdae.integrators.events.impacts import apply_impact
from beamdae.integrators.reaction_balance import bound_reactions
from beamdae.parts.events import select_impacts, select_switches
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray


@dataclass(frozen=True)
class RunPhases:
    """Equations of all intervals of a run at neighboring values of one parameter.

    Events of the neighboring models are at the times and positions of those of the run.

    Attributes
    ----------
    whole
        Equations of all parts.
    phases
        Equations of the active parts, by interval.
    impacts
        Equations of the impacts at the start of an interval, by index of the interval.
    shifted
        Indices of the intervals that begin at a breakpoint that depends on the parameter.
    """

    whole: Difference
    phases: tuple[Phase, ...]
    impacts: Mapping[int, ImpactDifference]
    shifted: frozenset[int]

    @classmethod
    def of(cls, run: AdjointRun, difference: Difference) -> RunPhases:
        """Return the phases of a run for one parameter.

        Raises
        ------
        BeamdaeError
            If the parameter changes the structure of the equations after an event, or moves a
            breakpoint across the start or the end of the run, or one of several breakpoints at the
            same time.
        """
        solution, redundant = run.solution, run.redundant
        rounding = time_rounding(solution.trajectory)
        intervals = solution.trajectory.intervals
        reduced = difference if redundant is None else redundant.reduce(difference)
        phase = Phase.first(reduced, intervals[0].configuration)
        require_inner_breakpoints(phase.active, solution.trajectory)
        phases, impacts, shifted = [phase], {}, set()
        for k in range(1, len(intervals)):
            number, configuration = run.events[k], intervals[k].configuration
            if number is not None:
                assert configuration is not None
                before = intervals[k - 1].configuration
                if select_impacts(solution.equations.events[number].do):
                    assert before is not None
                    impacts[k] = phase.impact(number, solution.equations, before)
                time, at = node_state(intervals[k], 0)
                phase = phase.after_event(number, configuration, time, 0.0, at.q, 0.0 * at.q)
            elif differentiate_breakpoint(phase.active, float(intervals[k].t[0]), rounding):
                shifted.add(k)
            phases.append(phase)
        return cls(difference, tuple(phases), impacts, frozenset(shifted))

    @property
    def moves_operators(self) -> bool:
        """True if operators of joints depend on the parameter."""
        return any(map(moves_operators, (self.whole, *(x.active for x in self.phases))))

    @property
    def moves_breakpoints(self) -> bool:
        """True if breakpoints of laws depend on the parameter."""
        return any(dt != 0.0 for x in self.phases for _, dt in breakpoint_derivatives(x.active))

    @property
    def key(self) -> object:
        """Key that parameters share if one backward sweep serves all of them.

        The sweep must shift the intervals of all these parameters.
        """
        if self.moves_operators:
            return self.whole.name
        return (
            self.moves_breakpoints,
            further_key(self.whole.base),
            *(x.active.base.structure for x in self.phases),
        )


@dataclass(frozen=True)
class AdjointRun:
    """Run whose objectives are differentiated.

    Attributes
    ----------
    solution, method
        The run and its integrator.
    redundant
        The run without redundant constraints, None if it has none.
    events
        Index of the event that acts at the start of each interval, None if there is none.
    stop
        Index of the event that stops the run, None if it reaches the end time.
    """

    solution: Solution
    method: GeneralizedAlpha | Radau
    redundant: RedundantConstraints | None
    events: tuple[int | None, ...]
    stop: int | None

    @classmethod
    def of(cls, solution: Solution, method: GeneralizedAlpha | Radau) -> AdjointRun:
        """Return the run with its events and redundant constraints.

        Raises
        ------
        BeamdaeError
            If the derivatives do not exist at an event.
        """
        events: list[int | None] = [None]
        for interval in solution.trajectory.intervals[1:]:
            event = find_event(solution, solution.equations, float(interval.t[0]))
            events.append(None if event is None else event_number(solution.equations, event.name))
        solution = bound_reactions(solution)
        redundant, stop = RedundantConstraints.of(solution), find_stop(solution)
        return cls(solution, method, redundant, tuple(events), stop)

    @property
    def intervals(self) -> tuple[Interval, ...]:
        """Intervals of the run, with the multipliers of independent and active constraints."""
        solution = self.solution if self.redundant is None else self.redundant.solution
        return tuple(map(with_active_multipliers, solution.trajectory.intervals))


@dataclass
class RunAdjoint:
    """Derivatives of an objective of a run by its start and by the numbers of the model.

    Attributes
    ----------
    seeds
        Value, and derivatives through the columns and the quantities of events alone.
    q, v
        Derivatives with respect to the requested initial coordinates and velocities, (n,) each.
    numbers
        Derivatives with respect to the numbers p of the active parts and to their breakpoints, by
        interval, see `_numbers_of`.
    thresholds
        Derivatives with respect to the values at which events act, by index of the event.
    impacts
        Derivatives with respect to the numbers and the coefficients of restitution of impacts, by
        index of the interval that follows.
    scales
        Derivatives with respect to the scales of the coordinates, (n,), which weight the reactions
        of redundant constraints.
    along_operators
        Derivative through operators of joints that depend on the parameter.
    """

    seeds: ColumnSeeds
    q: Array
    v: Array
    numbers: list[Array]
    scales: Array
    thresholds: dict[int, float] = field(default_factory=dict)
    impacts: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    along_operators: float = 0.0

    def derivative(self, phases: RunPhases, dq: Array, dv: Array) -> float:
        """Return the derivative with respect to a parameter.

        `dq` and `dv` are the derivatives of the requested initial coordinates and velocities.
        """
        whole = phases.whole
        result = self.along_operators + dq @ self.q + dv @ self.v
        result += whole.derivative(lambda e: e.p) @ self.seeds.numbers
        result += whole.derivative(lambda e: e.position_scales) @ self.scales
        for phase, numbers in zip(phases.phases, self.numbers, strict=True):
            result += phase.active.derivative(_numbers_of) @ numbers
        for number, weight in self.thresholds.items():
            result += weight * whole.derivative(_threshold_of(number))
        for k, (numbers, restitution) in self.impacts.items():
            difference = phases.impacts[k]
            result += difference.equations.derivative(lambda e: e.p) @ numbers
            result += difference.restitution @ restitution
        for seeds in self.seeds.operators:
            result += seeds.weigh(whole.derivative(_operator_of(seeds)))
        return float(result)


def _numbers_of(equations: EquationsOfMotion) -> Array:
    return np.concatenate([equations.p, equations.breakpoints])


def _threshold_of(number: int) -> Callable[[EquationsOfMotion], float]:
    return lambda e: e.events[number].crosses


def _operator_of(seeds: OperatorSeeds) -> Callable[[EquationsOfMotion], Any]:
    return lambda e: seeds.select(e).operator


def transpose_run(objective: Objective, run: AdjointRun, phases: RunPhases) -> RunAdjoint:
    """Sweep backwards over all intervals of a run.

    The equations are those at the value of the parameter of `phases`, perhaps with further forces
    that vanish in the run.

    Raises
    ------
    BeamdaeError
        If the derivatives do not exist at an event, or steps cannot be transposed.
    """
    return _RunSweep(objective, run, phases).sweep()


class _RunSweep:
    def __init__(self, objective: Objective, run: AdjointRun, phases: RunPhases) -> None:
        self._objective = objective
        self._run, self._phases, self._intervals = run, phases, run.intervals
        self._matrices: dict[int, FactorizedMatrix] = {}
        whole = phases.whole.base
        # The number of multipliers includes those of redundant and inactive constraints.
        seeds = differentiate_objective(objective, run.solution, whole)
        numbers = [np.zeros(len(_numbers_of(x.active.base))) for x in phases.phases]
        empty = np.zeros(whole.n)
        self._result = RunAdjoint(seeds, empty, empty, numbers, np.zeros(whole.n))

    @cached_property
    def _terms(self) -> list[tuple[float, ColumnObjective, float]]:
        return evaluate_terms(self._objective, self._run.solution)

    def sweep(self) -> RunAdjoint:
        """Return the derivatives."""
        result, n = self._result, self._phases.whole.base.n
        if self._run.stop is not None:
            solution = self._run.solution
            by_end = differentiate_end(self._objective, solution, self._phases.whole.base)
            last, end = len(self._intervals) - 1, solution.trajectory.end
            self._transpose_event(last, self._run.stop, end, by_end)
        if self._run.redundant is not None:
            self._reduce_reactions(self._run.redundant)
        for k in reversed(range(len(self._intervals))):
            by_nodes = self._active_seeds(k)
            if k == 0:
                self._transpose_start(by_nodes)
            else:
                by_q, by_v, by_t = self._transpose_restart(k, by_nodes)
                before = result.seeds.states[k - 1][-1]
                before[:n] += by_q
                before[n : 2 * n] += by_v
                self._transpose_time(k, by_t)
        return result

    def _active_seeds(self, k: int) -> Array:
        """Return the derivatives with respect to q, v and the active multipliers at the nodes."""
        seeds, configuration = self._result.seeds.states[k], self._intervals[k].configuration
        if configuration is None:
            return seeds
        n = self._phases.whole.base.n
        lam = configuration.select_multipliers(seeds[:, 2 * n :])
        return np.hstack([seeds[:, : 2 * n], lam])

    def _add_numbers(self, k: int, *parts: Gradient) -> None:
        numbers = self._result.numbers[k]
        for part in parts:
            numbers[: len(part.numbers)] += part.numbers
            self._result.along_operators += part.operators

    def _transpose_steps(
        self, k: int, start: StartDerivatives, by_nodes: Array, moves: bool
    ) -> Gradient:
        """Return the derivatives with respect to the state at the start of the steps."""
        interval, method = self._intervals[k], self._run.method
        if isinstance(method, Radau):
            return transpose_radau_steps(start, interval, by_nodes)
        return transpose_alpha_steps(method, start, interval, by_nodes[1:], self._matrices, moves)

    def _transpose_start(self, by_nodes: Array) -> None:
        result = self._result
        start = derive_states(self._phases.phases[0].active)
        time, at = node_state(self._intervals[0], 0)
        steps = self._transpose_steps(0, start, by_nodes, False)
        by_state = _add(steps.inputs, _as_state(by_nodes[0], start.equations))
        first = start.start_map(time, at, at.v).transposed(*by_state)
        result.q, result.v = first.inputs
        self._add_numbers(0, steps, first)

    def _transpose_restart(self, k: int, by_nodes: Array) -> tuple[Array, Array, float]:
        """Return the derivatives with respect to the state and the time of a restart.

        They are those with respect to q and v at the end of the interval before, (n,) each, and to
        the time, at which the interval before ends and interval `k` begins.
        """
        run, phases, number = self._run, self._phases, self._run.events[k]
        old = ConsistencySolver(phases.phases[k - 1].active.base)
        time, at = state_before_restart(self._intervals[k - 1], old, run.method)
        impact = phases.impacts.get(k)
        v = at.v
        if impact is not None:
            v = apply_impact(impact.impact, time, at)[0]
        start = derive_states(phases.phases[k].active)
        by_first = _as_state(by_nodes[0], start.equations)
        interval, moves = self._intervals[k], number is not None or self._breakpoint_moves(k)
        after, first_state = node_state(interval, 0)
        h = float(interval.t[1] - interval.t[0])
        steps = self._transpose_steps(k, start, by_nodes, moves)
        if moves:
            record = start.restart_map(after, first_state, v, h)
            none = tuple(map(np.zeros_like, steps.inputs))
            # Steps of Radau are not moved with their start.
            is_fixed = isinstance(run.method, Radau)
            moved, fixed = (none, steps.inputs) if is_fixed else (steps.inputs, none)
            jump = record.transposed(*moved, *_add(fixed, by_first))
        else:
            record = start.start_map(after, first_state, v)
            jump = record.transposed(*_add(steps.inputs, by_first))
        by_q, by_v = jump.inputs
        by_t = steps.time + jump.time
        self._add_numbers(k, steps, jump)
        if moves:
            by_t += differentiate_restart(self._terms, run.solution, float(time[0]))
        if number is not None:
            by_positions, by_switch_time = self._transpose_switch(k, number, time, at.q)
            by_q = by_q + by_positions
            by_t += by_switch_time
        before_impact = None if impact is None else record_impact(impact, time, at, h)
        if before_impact is not None:
            part = before_impact.transposed(by_v)
            by_positions, by_v, by_restitution = part.inputs
            self._result.impacts[k] = (part.numbers, by_restitution)
            self._result.along_operators += part.operators
            by_q = by_q + by_positions
            by_t += part.time
        if moves:
            by_t += float(by_q @ at.v + by_v @ at.a)
        return by_q, by_v, by_t

    def _breakpoint_moves(self, k: int) -> bool:
        """Return True if the start of interval `k` is a breakpoint that may move."""
        t = float(self._intervals[k].t[0])
        rounding = time_rounding(self._run.solution.trajectory)

        def has_breakpoint(equations: EquationsOfMotion) -> bool:
            return any(abs(b - t) <= rounding for b in equations.breakpoints)

        active = self._phases.phases[k - 1].active
        if not has_breakpoint(active.base):
            return False  # The onset of a contact.
        # Breakpoints of laws that begin at an event move with the event.
        is_after_event = not has_breakpoint(self._phases.whole.base)
        return is_after_event or k in self._phases.shifted

    def _transpose_switch(self, k: int, number: int, time: Array, q: Array) -> tuple[Array, float]:
        """Return the derivatives with respect to positions and time of gaps that joints keep."""
        phases, solution = self._phases, self._run.solution
        numbers = self._result.numbers
        configurations = [x.configuration for x in solution.trajectory.intervals]
        whole, active = phases.whole, phases.phases[k].active
        here = configurations[k]
        if here is not None and here.equations.structure == active.base.structure:
            return _weigh_gaps(solution.equations, configurations, k, number, time, q, numbers)
        # Forces that vanish in the run are present in the neighboring models.
        neighbors = zip(*(x.configurations for x in phases.phases), strict=True)
        gradients = [
            _weigh_gaps(e, x, k, number, time, q, numbers)
            for e, x in zip(whole.equations, neighbors, strict=True)
        ]
        by_q, by_t = (
            interpolate(whole.steps, [np.asarray(x[i]) for x in gradients]) for i in range(2)
        )
        return by_q, float(by_t)

    def _transpose_time(self, k: int, by_t: float) -> None:
        """Add the derivatives with respect to the quantities that determine the time of restart."""
        result, phases = self._result, self._phases
        if by_t == 0.0:
            return
        number, t = self._run.events[k], float(self._intervals[k].t[0])
        if number is None:
            e = phases.phases[k - 1].active.base
            rounding = time_rounding(self._run.solution.trajectory)
            moved = [j for j, b in enumerate(e.breakpoints) if abs(b - t) <= rounding]
            # Restarts at short pulses and peaks of forces do not move.
            for j in moved[:1]:
                result.numbers[k - 1][len(e.p) + j] += by_t
            return
        self._transpose_event(k - 1, number, t, by_t)

    def _transpose_event(self, k: int, number: int, t: float, by_t: float) -> None:
        """Add the derivatives with respect to the quantity of an event at the end of interval `k`.

        `by_t` is the derivative with respect to the time `t` [s] of the event.
        """
        result, whole = self._result, self._phases.whole.base
        before, term = self._run.solution.trajectory.intervals[k], whole.events[number]
        rate = event_rate(whole, number, before, t)
        result.thresholds[number] = result.thresholds.get(number, 0.0) + by_t / rate
        by_columns = np.zeros((1, len(term.observable.columns)))
        by_columns[0, term.column] = -by_t / rate
        add_columns(
            result.seeds,
            result.seeds.states[k][-1:],
            whole.with_loads_of(before.configuration),
            lambda e: e.events[number].observable,
            np.array([[t, before.branch]]),
            before.at(np.array([t])),
            by_columns,
        )

    def _reduce_reactions(self, redundant: RedundantConstraints) -> None:
        """Replace derivatives with respect to all multipliers by those of independent ones."""
        result, whole = self._result, self._phases.whole
        derivatives, n = derive_states(whole), whole.base.n
        for k, seeds in enumerate(result.seeds.states):
            interval = self._intervals[k]
            reduced = np.zeros((len(seeds), len(redundant.reduced.independent)))
            for row in np.flatnonzero(np.any(seeds[:, 2 * n :], axis=1)).tolist():
                time, at = node_state(interval, row)
                part, by_scales, reduced[row] = _transpose_reactions(
                    derivatives, redundant.reduced.independent, time, at, seeds[row, 2 * n :]
                )
                seeds[row, :n] += part.inputs[0]
                result.scales += by_scales
                result.seeds.numbers += part.numbers
                result.along_operators += part.operators
            result.seeds.states[k] = np.hstack([seeds[:, : 2 * n], reduced])


def _as_state(row: Array, equations: EquationsOfMotion) -> State:
    """Return the derivatives with respect to (q, v, lam) as a State."""
    q, v, lam = np.split(row, [equations.n, 2 * equations.n])
    return State(q, v, np.zeros(equations.n), lam)


def _add(one: Sequence[Array], other: Sequence[Array]) -> tuple[Array, ...]:
    return tuple(x + y for x, y in zip(one, other, strict=True))


def _weigh_gaps(
    whole: EquationsOfMotion,
    configurations: Sequence[Configuration | None],
    k: int,
    number: int,
    time: Array,
    q: Array,
    numbers: Sequence[Array],
) -> tuple[Array, float]:
    """Return the derivatives with respect to the positions and the time of an event.

    Joints may keep the gaps that they have at the event, and laws may begin there, so that the
    numbers of this interval and of later ones depend on both.

    Parameters
    ----------
    whole, configurations
        Equations of all parts, and configurations by interval.
    k, number
        Index of the interval after the event, and of the event.
    time, q
        (t, branch) and positions at the event.
    numbers
        Derivatives of the objective with respect to the numbers of the active parts, by interval.
    """
    event, result = whole.events[number], np.zeros(len(q))
    before, after = configurations[k - 1], configurations[k]
    parts = [name for switch in select_switches(event.do) for name in switch.as_is]
    if not parts or before is None or after is None or whole.configurations is None:
        return result, 0.0
    assembler = whole.configurations
    gaps = {name: after.frozen_gaps[name] for name in parts}

    def weigh(one: FrozenGaps, other: FrozenGaps) -> float:
        """Return the derivative of the objective along the difference of two sets of gaps."""
        total = 0.0
        for configuration, weights in zip(configurations[k:], numbers[k:], strict=True):
            assert configuration is not None
            kept = {x for x in gaps if configuration.frozen_gaps.get(x) == gaps[x]}
            if kept:
                ends = [
                    _numbers_of(
                        assembler.configuration_without(
                            whole,
                            configuration.inactive,
                            {**configuration.frozen_gaps, **{name: x[name] for name in kept}},
                        ).equations
                    )
                    for x in (one, other)
                ]
                total += float((ends[0] - ends[1]) @ weights)
        return total

    def freeze(time: Array, q: Array) -> FrozenGaps:
        return assembler.switch_parts(before, event, time, q)[1]

    def offsets_at(q: Array) -> Array:
        frozen = freeze(time, q)
        return np.concatenate([frozen[name].offsets for name in gaps])

    stencil = list(zip(FOUR_NEIGHBORS.steps, FOUR_NEIGHBORS.derivative_weights, strict=True))
    delta = RELATIVE_DIFFERENCE * (whole.time_scale or 1.0)
    by_t = sum(
        weight * weigh(freeze(time + np.array([step * delta, 0.0]), q), gaps) / delta
        for step, weight in stencil
    )
    by_offsets = []
    for name, gap in gaps.items():
        for i, offset in enumerate(gap.offsets):
            # The numbers are linear in the offsets.
            size = max(abs(offset), whole.length, 1.0)
            moved = [
                {**gaps, name: replace(gap, offsets=_changed(gap.offsets, i, sign * size))}
                for sign in (1.0, -1.0)
            ]
            by_offsets.append(weigh(*moved) / (2.0 * size))
    deltas = RELATIVE_DIFFERENCE * whole.position_scales
    rows = [k for k, x in enumerate(whole.lam_names) if x.rpartition(".")[0] in gaps]
    pattern = plan_state_sums(whole.structure).gradient_pattern
    for i in np.unique(pattern.tocsr()[rows].indices):
        direction = np.zeros(len(q))
        direction[i] = deltas[i]
        changes = [weight * offsets_at(q + step * direction) for step, weight in stencil]
        result[i] = np.sum(changes, axis=0) @ by_offsets / deltas[i]
    return result, float(by_t)


def _changed(values: tuple[float, ...], i: int, change: float) -> tuple[float, ...]:
    return (*values[:i], values[i] + change, *values[i + 1 :])


def _transpose_reactions(
    derivatives: StartDerivatives, independent: Array, time: Array, at: State, by_lam: Array
) -> tuple[Gradient, Array, Array]:
    """Transpose the derivatives of `redundant_derivatives` at one state.

    Parameters
    ----------
    derivatives
        Maps of the equations with all constraints.
    independent
        Indices of the independent constraints.
    time, at
        (t, branch), and the state with the multipliers of the independent constraints.
    by_lam
        Derivatives of an objective with respect to all multipliers, (m,).

    Returns
    -------
    tuple
        Derivatives with respect to the positions, to the scales of the coordinates, (n,), and to
        the multipliers of the independent constraints.
    """
    full = derivatives.equations
    matrix = derivatives.solver.constraint_matrix(time, at.q)
    gradient = matrix.toarray()
    rows = ScaledRows.of(gradient, full.position_scales)
    start = np.zeros(full.m)
    start[independent] = at.lam
    scaled_start = rows.length * start
    rest = scaled_start - rows.project(scaled_start)
    by_result = by_lam / rows.length
    by_length = -by_result * (scaled_start - rest) / rows.length
    by_start = rows.project(by_result)
    by_scaled = np.outer(by_result - by_start, rows.inverse @ scaled_start)
    by_scaled += np.outer(rest, rows.inverse @ by_result)
    by_length += by_start * start - np.sum(by_scaled * rows.scaled, axis=1) / rows.length
    by_rate = by_scaled / rows.length[:, None] + by_length[:, None] * rows.scaled
    weights = (by_rate * full.position_scales)[matrix.indices, column_indices(matrix)]
    by_scales = np.sum(by_rate * gradient, axis=0)
    part = derivatives.gradient_map(time, at.q).transposed(weights)
    return part, by_scales, (rows.length * by_start)[independent]
