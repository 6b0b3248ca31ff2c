"""Derivatives of an objective with respect to the states at the steps of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.gradients.objectives import (
    Objective,
    SampleGrid,
)
from beamdae.analysis.sensitivities.neighbors import Difference
from beamdae.analysis.sensitivities.observable_derivatives import (
    ColumnPoints,
    group_times,
    join_points,
    locate_column,
    split_points,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable, State
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


@dataclass
class ColumnSeeds:
    """Derivatives of an objective with respect to the states of a run, and directly to p.

    Attributes
    ----------
    states
        Derivatives with respect to (q, v, lam) at the nodes of each interval, (nodes, 2n + m).
    numbers
        Derivatives with respect to the numbers p in the formulas of observables, (n_p,).
    operators
        Derivatives with respect to the entries of `Observable.operator`, by number of the
        observable.
    """

    states: list[Array]
    numbers: Array
    operators: dict[int, Array]

    def contract(self, difference: Difference) -> float:
        """Return the derivative with respect to a parameter at constant states of the run."""
        result = float(self.numbers @ difference.along(lambda e: e.p))
        for k, by in self.operators.items():
            change = difference.along(lambda e, k=k: e.observables[k].operator)
            result += float(change.multiply(by).sum())
        return result


def differentiate_objective(
    weights: Mapping[Objective, float], equations: EquationsOfMotion, trajectory: Trajectory
) -> ColumnSeeds:
    """Return the derivatives of a weighted sum of objectives by the states of a run.

    The parts of the model are active during the whole run.
    """
    size = 2 * equations.n + equations.m
    # By columns: most objectives depend on few of them, and only these need memory.
    states = [np.zeros((len(x.nodes), size), order="F") for x in trajectory.intervals]
    result = ColumnSeeds(states, np.zeros(len(equations.p)), {})
    grid, points_at = SampleGrid.of(trajectory), dict[tuple[bytes, bool], Any]()
    for term, factor in weights.items():
        times, column = term.sample_times(grid), _Column.of(equations, term.column)
        key = times.tobytes(), column.is_elastic
        if key not in points_at:
            ((_, points),) = group_times(trajectory, times, column.is_elastic)
            points_at[key] = points, *join_points(points, trajectory, limited=True)
        points, rows, at = points_at[key]
        values, arguments = column.evaluate(rows, at)
        parts = zip(points, split_points(points, values), strict=True)
        samples = np.concatenate([_values_at_times(x, trajectory, part) for x, part in parts])
        by_samples = factor * term.evaluate(samples, grid.weights)[1]
        by_values = [
            by_samples[x.here] if x.weights is None else x.weights.T @ by_samples[x.here]
            for x in points
        ]
        for columns, by_states in column.gradient(result, arguments, at, np.concatenate(by_values)):
            for x, part in zip(points, split_points(points, by_states), strict=True):
                interval = trajectory.intervals[x.interval]
                _add_to_nodes(x, interval, result.states[x.interval], columns, part)
    return result


def _values_at_times(points: ColumnPoints, trajectory: Trajectory, values: Array) -> Array:
    """Return the values of a column at the times, given those at the states of the points."""
    if points.weights is None:
        return values
    interval = trajectory.intervals[points.interval]
    at_nodes = np.zeros((len(interval.nodes), 1))
    at_nodes[points.nodes, 0] = values
    return interval.interpolate_forces(at_nodes, points.times)[:, 0]


def _add_to_nodes(
    points: ColumnPoints, interval: Interval, by_nodes: Array, columns: Array, by_states: Array
) -> None:
    """Add derivatives by columns of the states (q, v, lam) of points to those at the nodes."""
    if points.nodes is not None:
        by_nodes[points.nodes[:, None], columns] += by_states
        return
    weights, n = interval.weights_at(points.times), interval.rows.v.shape[1]
    of_kinds = weights.positions, weights.velocities, weights.reactions
    kind = min(int(columns[0]) // n, 2)
    by_nodes[:, columns] += of_kinds[kind].T @ by_states
    if kind == 0:
        by_nodes[:, n + columns] += weights.positions_by_velocities.T @ by_states


class _Column(NamedTuple):
    """Column of an observable, or of the coordinates, if `number` is None."""

    equations: EquationsOfMotion
    number: int | None
    column: int

    @classmethod
    def of(cls, equations: EquationsOfMotion, name: str) -> _Column:
        return cls(equations, *locate_column(equations, name)[1:])

    @property
    def observable(self) -> Observable:
        assert self.number is not None
        return self.equations.observables[self.number]

    @property
    def is_elastic(self) -> bool:
        return self.number is not None and self.observable.is_elastic

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

    def gradient(
        self, seeds: ColumnSeeds, arguments: tuple[Array, ...], at: State, by: Array
    ) -> Iterator[tuple[Array, Array]]:
        """Yield columns of (q, v, lam), (c,), and the derivatives by them, (states, c).

        Derivatives by the numbers are added to `seeds`; `by` are those by the values, (states,).
        """
        n = self.equations.n
        if self.number is None:
            yield np.array([self.column]), by[:, None]
            return
        o = self.observable
        gradient = o.function.output(self.column).weighted_gradient()(*arguments, by[:, None])
        ends = np.cumsum([arguments[1].shape[1], arguments[2].shape[1], arguments[3].shape[-1]])
        *by_motion, by_p, by_lam = np.split(gradient, ends, axis=1)
        seeds.numbers[o.data] += by_p.sum(axis=0)
        acting, operator = o.active_columns
        for first, part, x in zip((0, n), by_motion, (at.q, at.v), strict=True):
            # Most columns depend either on positions or on velocities.
            if part.any():
                by_operator = seeds.operators.setdefault(self.number, np.zeros(o.operator.shape))
                by_operator += part.T @ x
                yield first + acting, part @ operator
        if by_lam.size:
            yield 2 * n + np.arange(self.equations.m)[o.rows], by_lam
