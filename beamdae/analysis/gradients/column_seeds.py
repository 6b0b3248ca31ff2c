"""Derivatives of an objective with respect to the states at the steps of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.gradients.objectives import (
    ColumnObjective,
    Objective,
    SampleGrid,
    select_column,
    times_after_restart,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.equations.structure import cache_on_owner
from beamdae.errors import BeamdaeError
from beamdae.results.columns import remove_unit
from beamdae.results.elastic_columns import is_elastic
from beamdae.results.run_data import coordinate_headers
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


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
        Derivatives with respect to the non-zeros of `Observable.operator`, by observable.
    """

    value: float
    states: list[Array]
    numbers: Array
    operators: list[Array]

    @classmethod
    def empty(cls, equations: EquationsOfMotion, states: list[Array]) -> ColumnSeeds:
        """Return derivatives that are zero."""
        operators = [np.zeros(x.operator.nnz) for x in equations.observables]
        return cls(0.0, states, np.zeros(len(equations.p)), operators)


def differentiate_objective(objective: Objective, solution: Solution) -> ColumnSeeds:
    """Return the value of an objective and its derivatives by the states of the run.

    All parts are active during the run.
    """
    equations, trajectory = solution.equations, solution.trajectory
    size = 2 * equations.n + equations.m
    # By columns: most objectives depend on few of them, and only these need memory.
    states = [np.zeros((len(x.nodes), size), order="F") for x in trajectory.intervals]
    result, grid = ColumnSeeds.empty(equations, states), SampleGrid.of(trajectory)
    terms_at: dict[bytes, tuple[Array, list[tuple[float, ColumnObjective]]]] = {}
    for factor, term in objective.terms:
        times = term.sample_times(grid)
        terms_at.setdefault(times.tobytes(), (times, []))[1].append((factor, term))
    for times, terms in terms_at.values():
        samples = _sample_intervals(trajectory, times)
        parts = [x.states() for x in samples]
        at = State(*map(_concatenate, zip(*parts, strict=True)))
        branches = np.concatenate([np.full(len(x.times), x.interval.branch) for x in samples])
        rows = np.stack([times, branches], axis=1)
        is_direct = len(samples) == 1 and samples[0].nodes is not None
        by_state = np.zeros((0 if is_direct else len(times), size), order="F")
        if is_direct:
            by_state = states[0][samples[0].nodes]
        for factor, term in terms:
            if not is_direct and _is_elastic(equations, term.column):
                _add_elastic_term(result, equations, factor, term, samples, grid.weights)
            else:
                add_term(result, by_state, equations, factor, term, rows, at, grid.weights)
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
) -> None:
    """Add the value of a term, and its derivatives with respect to the states `at` `rows`.

    `weights` are those of integrals, see `ColumnObjective.evaluate`.
    """
    number, column = locate_column(equations, term.column)
    if number is None:
        values = np.hstack([at.q, at.v, at.lam])[:, column]
        value, derivatives = term.evaluate(values, weights)
        seeds.value += factor * value
        by_state[:, column] += factor * derivatives
        return
    o = equations.observables[number]
    arguments, function = _column_arguments(o, equations.p, rows, at), o.function.output(column)
    value, derivatives = term.evaluate(function(*arguments)[:, 0], weights)
    seeds.value += factor * value
    gradient = function.weighted_gradient()(*arguments, factor * derivatives[:, None])
    _add_gradient(seeds, by_state, equations, number, arguments, at, gradient)


def _is_elastic(equations: EquationsOfMotion, column: str) -> bool:
    number, _ = locate_column(equations, column)
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
    number, column = locate_column(equations, term.column)
    assert number is not None
    o = equations.observables[number]
    function, parts, values = o.function.output(column), [], []
    for sample in samples:
        interval = sample.interval
        nodes, by_node = sample.force_weights()
        at = State(*(x[nodes] for x in interval.rows))
        arguments = _column_arguments(o, equations.p, interval.times[nodes], at)
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
        _add_gradient(seeds, by_state, equations, number, arguments, at, gradient)
        states[nodes] = by_state


@cache_on_owner
def locate_column(equations: EquationsOfMotion, name: str) -> tuple[int | None, int]:
    """Return the indices of an observable and of its column.

    Coordinates have None in place of the observable.

    Raises
    ------
    BeamdaeError
        If the name selects no column or several columns, or an acceleration.
    """
    observed = {
        header: (number, column)
        for number, o in enumerate(equations.observables)
        for column, header in enumerate(o.headers)
    }
    # Observed columns take precedence, and the headers of all coordinates take long to compare.
    matches = [header for header in observed if name in (header, remove_unit(header))]
    if len(matches) == 1:
        (header,) = matches
    else:
        coordinates = coordinate_headers(equations)[1:]
        header = select_column(name, coordinates, list(observed))
        if header not in observed:
            return None, coordinates.index(header)
    if equations.observables[observed[header][0]].has_accelerations:
        raise BeamdaeError(
            f"gradient: the objective must not contain accelerations, got {header}; use a "
            "velocity, a force or bd.sensitivities."
        )
    return observed[header]


def _add_gradient(
    seeds: ColumnSeeds,
    by_state: Array,
    equations: EquationsOfMotion,
    number: int,
    arguments: tuple[Array, Array, Array, Array, Array],
    at: State,
    gradient: Array,
) -> None:
    """Add the gradient with respect to the arguments of an observable to those by states and p."""
    o, n = equations.observables[number], equations.n
    ends = np.cumsum([arguments[1].shape[1], arguments[2].shape[1], arguments[3].shape[-1]])
    by_q, by_v, by_p, by_lam = np.split(gradient, ends, axis=1)
    seeds.numbers[o.data] += by_p.sum(axis=0)
    row = np.repeat(np.arange(o.operator.shape[0]), np.diff(o.operator.indptr))
    for by, x in ((by_q, at.q), (by_v, at.v)):
        if by.any():
            changes = np.einsum("ti,ti->i", by[:, row], x[:, o.operator.indices])
            seeds.operators[number] += changes
    acting, operator = o.active_columns
    for first, part in ((0, by_q), (n, by_v)):
        # Most columns depend either on positions or on velocities.
        if part.any():
            by_state[:, first + acting] += part @ operator
    by_state[:, 2 * n :][:, o.rows] += by_lam


def _column_arguments(
    o: Observable, p: Array, rows: Array, at: State
) -> tuple[Array, Array, Array, Array, Array]:
    # Operators have few columns; products with all coordinates would copy these.
    acting, operator = o.active_columns
    q, v = (np.asarray(x[:, acting] @ operator.T) for x in (at.q, at.v))
    return rows, q, v, p[o.data], at.lam[:, o.rows]
