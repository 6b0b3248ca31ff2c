"""Derivatives of an objective with respect to the states at the steps of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.gradients.objectives import (
    ColumnObjective,
    Objective,
    SampleGrid,
    read_column,
    select_column,
    times_after_restart,
)
from beamdae.analysis.sensitivities.observable_derivatives import time_derivative
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.equations.structure import cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.results.columns import remove_unit
from beamdae.results.elastic_columns import is_elastic
from beamdae.results.run_data import coordinate_headers
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


@dataclass(frozen=True)
class OperatorSeeds:
    """Derivatives of an objective with respect to local coordinates of an observable over time.

    Attributes
    ----------
    select
        Function that returns the observable of equations.
    by_q, by_v
        Derivatives with respect to the local coordinates and velocities, (times, local).
    at
        States at the times.
    """

    select: Callable[[EquationsOfMotion], Observable]
    by_q: Array
    by_v: Array
    at: State

    def weigh(self, change: sp.sparray) -> float:
        """Return the change of the objective due to a change of `Observable.operator`."""
        q, v = ((change @ x.T).T for x in (self.at.q, self.at.v))
        return float(np.sum(self.by_q * q) + np.sum(self.by_v * v))

    def by_operator(self, pattern: sp.csr_array) -> Array:
        """Return the derivatives with respect to the non-zeros of `Observable.operator`."""
        row = np.repeat(np.arange(pattern.shape[0]), np.diff(pattern.indptr))
        column, parts = pattern.indices, ((self.by_q, self.at.q), (self.by_v, self.at.v))
        return np.asarray(sum(np.einsum("ti,ti->i", by[:, row], x[:, column]) for by, x in parts))


@dataclass
class ColumnSeeds:
    """Derivatives of an objective with respect to the states of a run, and directly to p.

    Attributes
    ----------
    value
        Value of the objective.
    states
        Derivatives with respect to (q, v, lam) at the nodes of each interval, (nodes, 2n + m).
    numbers
        Derivatives with respect to the numbers p in the formulas of observables, (n_p,).
    operators
        Derivatives through the operators of observables.
    """

    value: float
    states: list[Array]
    numbers: Array
    operators: list[OperatorSeeds]

    def by_operators(self, equations: EquationsOfMotion) -> list[sp.csr_array]:
        """Return the derivatives with respect to the non-zeros of all operators, by observable."""
        result = {id(x): x.operator * 0.0 for x in equations.observables}
        for seeds in self.operators:
            operator = result[id(seeds.select(equations))]
            operator.data += seeds.by_operator(operator)
        return list(result.values())


def differentiate_objective(
    objective: Objective, solution: Solution, equations: EquationsOfMotion
) -> ColumnSeeds:
    """Return the value of an objective and its derivatives by the states of the run.

    `equations` are those of the run, perhaps with further forces that vanish there.
    """
    size = 2 * equations.n + equations.m
    # By columns: most objectives depend on few of them, and only these need memory.
    states = [np.zeros((len(x.nodes), size), order="F") for x in solution.trajectory.intervals]
    result = ColumnSeeds(0.0, states, np.zeros(len(equations.p)), [])
    grid = SampleGrid.of(solution.trajectory)
    terms_at: dict[bytes, tuple[Array, list[tuple[float, ColumnObjective]]]] = {}
    for factor, term in objective.terms:
        times = term.sample_times(grid)
        terms_at.setdefault(times.tobytes(), (times, []))[1].append((factor, term))
    for times, terms in terms_at.values():
        samples = _sample_intervals(solution.trajectory, times)
        parts = [x.states() for x in samples]
        at = State(*map(_concatenate, zip(*parts, strict=True)))
        branches = np.concatenate([np.full(len(x.times), x.interval.branch) for x in samples])
        rows = np.stack([times, branches], axis=1)
        is_direct = len(samples) == 1 and samples[0].nodes is not None
        by_state = np.zeros((0 if is_direct else len(times), size), order="F")
        if is_direct:
            by_state = states[0][samples[0].nodes]
        numbers = solution.trajectory.observed_numbers(equations, times)
        for factor, term in terms:
            if not is_direct and _is_elastic(equations, term.column):
                _add_elastic_term(result, equations, factor, term, samples, grid.weights)
            else:
                add_term(result, by_state, equations, factor, term, rows, at, grid.weights, numbers)
        first = 0
        for k, sample in enumerate(() if is_direct else samples):
            last = first + len(sample.times)
            sample.transpose(by_state[first:last], equations.n, result.states[k])
            first = last
    return result


def _concatenate(parts: Sequence[Array]) -> Array:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


class _IntervalSample(NamedTuple):
    """Times within one interval; `nodes` selects them if they are consecutive nodes."""

    interval: Interval
    times: Array
    nodes: slice | None

    def states(self) -> State:
        """Return the states at the times."""
        if self.nodes is None:
            return self.interval.at(self.times, limited=True)
        return State(*(x[self.nodes] for x in self.interval.rows))

    def force_weights(self) -> tuple[Array, sp.csr_array]:
        """Return nodes, and their weights (times, nodes) in elastic forces at the times."""
        if self.nodes is None:
            return self.interval.force_weights_at(self.times)
        return np.arange(self.nodes.start, self.nodes.stop), sp.eye_array(len(self.times)).tocsr()

    def interpolate_forces(self, values: Array) -> Array:
        """Return elastic forces at the times, given those at the nodes of the interval."""
        if self.nodes is None:
            return self.interval.interpolate_forces(values, self.times)
        return values[self.nodes]

    def transpose(self, by_state: Array, n: int, by_nodes: Array) -> None:
        """Add derivatives with respect to (q, v, lam) at the times to those at the nodes."""
        if self.nodes is not None:
            by_nodes[self.nodes] += by_state
        elif len(self.times):
            weights = self.interval.weights_at(self.times)
            q, v, lam = np.split(by_state, [n, 2 * n], axis=1)
            by_nodes[:, :n] += weights.positions.T @ q
            by_nodes[:, n : 2 * n] += weights.positions_by_velocities.T @ q
            by_nodes[:, n : 2 * n] += weights.velocities.T @ v
            by_nodes[:, 2 * n :] += weights.reactions.T @ lam


def _sample_intervals(trajectory: Trajectory, times: Array) -> list[_IntervalSample]:
    """Distribute ascending times to the intervals of a run."""
    index, samples = trajectory.interval_index(times), []
    for k, interval in enumerate(trajectory.intervals):
        t = times[index == k]
        available = times_after_restart(interval.nodes) if k else interval.nodes
        first = int(np.searchsorted(available, t[0])) if len(t) else 0
        nodes = slice(first, first + len(t))
        are_nodes = np.array_equal(available[nodes], t)
        samples.append(_IntervalSample(interval, t, nodes if are_nodes else None))
    return samples


def add_term(
    seeds: ColumnSeeds,
    by_state: Array,
    equations: EquationsOfMotion,
    factor: float,
    term: ColumnObjective,
    rows: Array,
    at: State,
    weights: Array,
    numbers: Callable[[slice], Array],
) -> None:
    """Add the value of a term, and its derivatives with respect to the states `at` `rows`.

    `weights` are those of integrals, see `ColumnObjective.evaluate`; `numbers` selects the numbers
    p of observables, see `Trajectory.observed_numbers`.
    """
    number, column = _locate_column(equations, term.column)
    if number is None:
        values = np.hstack([at.q, at.v, at.lam])[:, column]
        value, derivatives = term.evaluate(values, weights)
        seeds.value += factor * value
        by_state[:, column] += factor * derivatives
        return
    o = equations.observables[number]
    if o.has_accelerations:
        raise BeamdaeError(
            "gradient: the objective must not contain accelerations, got "
            f"{o.headers[column]}; use a velocity, a force or bd.sensitivities."
        )
    arguments, function = _column_arguments(o, numbers(o.data), rows, at), o.function.output(column)
    value, derivatives = term.evaluate(function(*arguments)[:, 0], weights)
    seeds.value += factor * value
    gradient = function.weighted_gradient()(*arguments, factor * derivatives[:, None])
    _add_gradient(
        seeds, by_state, equations, lambda e: e.observables[number], arguments, at, gradient
    )


def _is_elastic(equations: EquationsOfMotion, column: str) -> bool:
    number, _ = _locate_column(equations, column)
    return number is not None and is_elastic(equations, equations.observables[number])


def _add_elastic_term(
    seeds: ColumnSeeds,
    equations: EquationsOfMotion,
    factor: float,
    term: ColumnObjective,
    samples: Sequence[_IntervalSample],
    weights: Array,
) -> None:
    """Add a term of a column that is interpolated between the nodes of each of the intervals."""
    number, column = _locate_column(equations, term.column)
    assert number is not None

    def select(e: EquationsOfMotion) -> Observable:
        return e.observables[number]

    o = select(equations)
    function, parts, values = o.function.output(column), [], []
    for sample in samples:
        interval = sample.interval
        nodes, by_node = sample.force_weights()
        numbers = equations.with_loads_of(interval.configuration).p[o.data]
        at = State(*(x[nodes] for x in interval.rows))
        arguments = _column_arguments(o, numbers, interval.times[nodes], at)
        at_nodes = np.zeros((len(interval.nodes), 1))
        at_nodes[nodes] = function(*arguments)
        values.append(sample.interpolate_forces(at_nodes)[:, 0])
        parts.append((at, arguments, nodes, by_node))
    value, derivatives = term.evaluate(np.concatenate(values), weights)
    seeds.value += factor * value
    ends = np.cumsum([len(x.times) for x in samples])[:-1]
    by_samples = np.split(factor * derivatives[:, None], ends)
    for (at, arguments, nodes, by_node), by_sample, states in zip(
        parts, by_samples, seeds.states, strict=True
    ):
        gradient = function.weighted_gradient()(*arguments, by_node.T @ by_sample)
        by_state = states[nodes]
        _add_gradient(seeds, by_state, equations, select, arguments, at, gradient)
        states[nodes] = by_state


@cache_on_owner
def _locate_column(equations: EquationsOfMotion, name: str) -> tuple[int | None, int]:
    """Return the indices of an observable and of its column.

    Coordinates have None in place of the observable.
    """
    observed = {
        header: (number, column)
        for number, o in enumerate(equations.observables)
        for column, header in enumerate(o.headers)
    }
    # Observed columns take precedence, and the headers of all coordinates take long to compare.
    matches = [header for header in observed if name in (header, remove_unit(header))]
    if len(matches) == 1:
        return observed[matches[0]]
    coordinates = coordinate_headers(equations)[1:]
    header = select_column(name, coordinates, list(observed))
    return observed[header] if header in observed else (None, coordinates.index(header))


def _add_gradient(
    seeds: ColumnSeeds,
    by_state: Array,
    equations: EquationsOfMotion,
    select: Callable[[EquationsOfMotion], Observable],
    arguments: tuple[Array, Array, Array, Array, Array],
    at: State,
    gradient: Array,
) -> None:
    """Add the gradient with respect to the arguments of an observable to those by states and p."""
    o, n = select(equations), equations.n
    ends = np.cumsum([arguments[1].shape[1], arguments[2].shape[1], arguments[3].shape[-1]])
    by_q, by_v, by_p, by_lam = np.split(gradient, ends, axis=1)
    seeds.numbers[o.data] += by_p.sum(axis=0)
    seeds.operators.append(OperatorSeeds(select, by_q, by_v, at))
    acting, operator = o.active_columns
    for first, part in ((0, by_q), (n, by_v)):
        # Most columns depend either on positions or on velocities.
        if part.any():
            by_state[:, first + acting] += part @ operator
    by_state[:, 2 * n :][:, o.rows] += by_lam


def _column_arguments(
    o: Observable, numbers: Array, rows: Array, at: State
) -> tuple[Array, Array, Array, Array, Array]:
    # Operators have few columns; products with all coordinates would copy these.
    acting, operator = o.active_columns
    q, v = (np.asarray(x[:, acting] @ operator.T) for x in (at.q, at.v))
    return rows, q, v, numbers, at.lam[:, o.rows]


def differentiate_end(
    objective: Objective, solution: Solution, equations: EquationsOfMotion
) -> float:
    """Return the derivative of an objective with respect to the end time of the run.

    `equations` are those of the run, perhaps with further forces that vanish there.
    """
    interval, grid = solution.trajectory.intervals[-1], SampleGrid.of(solution.trajectory)
    end = np.array([grid.end])
    at = State(*(x[0] for x in interval.at(end)))
    lam_rate = interval.derivative_at(end).lam[0]
    coordinates = coordinate_headers(equations)[1:]
    values = np.concatenate([at.q, at.v, at.lam])
    rates = np.concatenate([at.v, at.a, lam_rate])
    columns = dict(zip(coordinates, zip(values, rates, strict=True), strict=True))
    time = np.array([grid.end, interval.branch])
    equations = equations.with_loads_of(interval.configuration)
    for o in equations.observables:
        if o.has_accelerations:  # Objectives do not contain them.
            continue
        state = State(*(x[None] for x in at))
        arguments = _column_arguments(o, equations.p[o.data], time[None], state)
        observed = o.function(*arguments)[0]
        changes = time_derivative(o, equations, time, at, lam_rate)
        columns |= dict(zip(o.headers, zip(observed, changes, strict=True), strict=True))
    result = 0.0
    for factor, term in objective.terms:
        header, column = read_column(solution.at_times(term.sample_times(grid)), term.column)
        value = term.evaluate(column, grid.weights)[0]
        y, rate = columns[header]
        result += factor * term.end_derivative(value, y, rate, grid.end - grid.start)
    return float(result)


def differentiate_restart(
    terms: Sequence[tuple[float, ColumnObjective, float]], solution: Solution, t: float
) -> float:
    """Return the derivative of an objective with respect to the time `t` [s] of a restart.

    The states are those at fixed times, so that only integrals of columns that jump have a
    derivative. `terms` are factors, functions of columns and their values.
    """
    run = solution.at_times(np.array([t, np.nextafter(t, np.inf)]))
    duration, result = solution.trajectory.end - solution.trajectory.start, 0.0
    for factor, term, value in terms:
        before, after = (
            term.end_derivative(value, float(y), 0.0, duration)
            for y in read_column(run, term.column)[1]
        )
        result += factor * (before - after)
    return result


def evaluate_terms(
    objective: Objective, solution: Solution
) -> list[tuple[float, ColumnObjective, float]]:
    """Return the factors of the terms of an objective, the terms, and their values."""
    return [(factor, term, term.value(solution)) for factor, term in objective.terms]
