"""Derivatives of an objective with respect to the states at the steps of a run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

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
    samples_at: dict[bytes, list[_IntervalSample]] = {}
    for factor, term in objective.terms:
        times = term.sample_times(grid)
        key, column = times.tobytes(), _Column.of(equations, term.column)
        if key not in samples_at:
            samples_at[key] = _sample_intervals(trajectory, times)
        samples, parts, values = samples_at[key], [], []
        for sample in samples:
            points = sample.points(column.is_elastic)
            y, arguments = column.evaluate(points.rows, points.at)
            values.append(sample.interpolate_forces(y, points.nodes) if column.is_elastic else y)
            parts.append((points, arguments))
        value, derivatives = term.evaluate(np.concatenate(values), grid.weights)
        result.value += factor * value
        ends = np.cumsum([len(x.times) for x in samples])[:-1]
        by_samples = np.split(factor * derivatives, ends)
        for sample, (points, arguments), by in zip(samples, parts, by_samples, strict=True):
            by_nodes = states[sample.index]
            if points.weights is not None:
                by = points.weights.T @ by
            is_between = points.nodes is None
            shape = len(points.rows), size
            by_state = np.zeros(shape, order="F") if is_between else by_nodes[points.nodes]
            column.add_gradient(result, by_state, arguments, points.at, by)
            if is_between:
                sample.transpose(by_state, equations.n, by_nodes)
            else:
                by_nodes[points.nodes] = by_state
    return result


class _Points(NamedTuple):
    """States at which a column is evaluated.

    Attributes
    ----------
    rows, at
        Rows of (t, branch), and the states.
    nodes
        Indices of the nodes at which they are; None for states between nodes.
    weights
        Weights (times, nodes) of the values at the nodes; None if they are the values.
    """

    rows: Array
    at: State
    nodes: Any
    weights: sp.csr_array | None


@dataclass(frozen=True)
class _IntervalSample:
    """Times within an interval; `nodes` selects them if they are consecutive nodes."""

    index: int
    interval: Interval
    times: Array
    nodes: slice | None

    def points(self, elastic: bool) -> _Points:
        """Return the states of a column; elastic forces between nodes are interpolated."""
        if self.nodes is None and not elastic:
            return self._points_between
        nodes: Any = self.nodes
        weights = None
        if nodes is None:
            nodes, weights = self.interval.force_weights_at(self.times)
        at = State(*(x[nodes] for x in self.interval.rows))
        return _Points(self.interval.times[nodes], at, nodes, weights)

    @cached_property
    def _points_between(self) -> _Points:
        rows = np.stack([self.times, np.full(len(self.times), self.interval.branch)], axis=1)
        return _Points(rows, self.interval.at(self.times, limited=True), None, None)

    def interpolate_forces(self, values: Array, nodes: Any) -> Array:
        """Return elastic forces at the times, given those at some nodes of the interval."""
        if self.nodes is not None:
            return values
        at_nodes = np.zeros((len(self.interval.nodes), 1))
        at_nodes[nodes, 0] = values
        return self.interval.interpolate_forces(at_nodes, self.times)[:, 0]

    def transpose(self, by_state: Array, n: int, by_nodes: Array) -> None:
        """Add derivatives with respect to (q, v, lam) at the times to those at the nodes."""
        weights = self.interval.weights_at(self.times)
        q, v, lam = np.split(by_state, [n, 2 * n], axis=1)
        by_nodes[:, :n] += weights.positions.T @ q
        by_nodes[:, n : 2 * n] += weights.positions_by_velocities.T @ q
        by_nodes[:, n : 2 * n] += weights.velocities.T @ v
        by_nodes[:, 2 * n :] += weights.reactions.T @ lam


def _sample_intervals(trajectory: Trajectory, times: Array) -> list[_IntervalSample]:
    """Distribute ascending times to the intervals of a run; intervals without times are omitted."""
    index, samples = trajectory.interval_index(times), []
    for k in np.unique(index).tolist():
        interval, t = trajectory.intervals[k], times[index == k]
        available = times_after_restart(interval.nodes) if k else interval.nodes
        first = int(np.searchsorted(available, t[0]))
        nodes = slice(first, first + len(t))
        are_nodes = np.array_equal(available[nodes], t)
        samples.append(_IntervalSample(k, interval, t, nodes if are_nodes else None))
    return samples


class _Column(NamedTuple):
    """Column of an observable, or of the coordinates, if `number` is None."""

    equations: EquationsOfMotion
    number: int | None
    column: int

    @classmethod
    def of(cls, equations: EquationsOfMotion, name: str) -> _Column:
        return cls(equations, *locate_column(equations, name))

    @property
    def observable(self) -> Observable:
        assert self.number is not None
        return self.equations.observables[self.number]

    @property
    def is_elastic(self) -> bool:
        return self.number is not None and is_elastic(self.equations, self.observable)

    def evaluate(self, rows: Array, at: State) -> tuple[Array, tuple[Array, ...]]:
        """Return the values (k,), and the arguments of the formula."""
        if self.number is None:
            return np.hstack([at.q, at.v, at.lam])[:, self.column], ()
        # Operators have few columns; products with all coordinates would copy these.
        o = self.observable
        acting, operator = o.active_columns
        q, v = (np.asarray(x[:, acting] @ operator.T) for x in (at.q, at.v))
        arguments = rows, q, v, self.equations.p[o.data], at.lam[:, o.rows]
        return o.function.output(self.column)(*arguments)[:, 0], arguments

    def add_gradient(
        self,
        seeds: ColumnSeeds,
        by_state: Array,
        arguments: tuple[Array, ...],
        at: State,
        by: Array,
    ) -> None:
        """Add derivatives `by` (k,) with respect to the values to those by states and numbers."""
        if self.number is None:
            by_state[:, self.column] += by
            return
        o, n = self.observable, self.equations.n
        gradient = o.function.output(self.column).weighted_gradient()(*arguments, by[:, None])
        ends = np.cumsum([arguments[1].shape[1], arguments[2].shape[1], arguments[3].shape[-1]])
        by_q, by_v, by_p, by_lam = np.split(gradient, ends, axis=1)
        seeds.numbers[o.data] += by_p.sum(axis=0)
        row = np.repeat(np.arange(o.operator.shape[0]), np.diff(o.operator.indptr))
        acting, operator = o.active_columns
        for first, part, x in ((0, by_q, at.q), (n, by_v, at.v)):
            # Most columns depend either on positions or on velocities.
            if part.any():
                change = np.einsum("ti,ti->i", part[:, row], x[:, o.operator.indices])
                seeds.operators[self.number] += change
                by_state[:, first + acting] += part @ operator
        by_state[:, 2 * n :][:, o.rows] += by_lam


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
    column = _Column.of(equations, term.column)
    values, arguments = column.evaluate(rows, at)
    value, derivatives = term.evaluate(values, weights)
    seeds.value += factor * value
    column.add_gradient(seeds, by_state, arguments, at, factor * derivatives)


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
