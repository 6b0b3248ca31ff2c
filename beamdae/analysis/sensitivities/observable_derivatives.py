"""Derivatives of observed columns with respect to parameters, and with respect to time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.sensitivities.neighbors import Difference, equations_key
from beamdae.equations.equations_of_motion import (
    EquationsOfMotion,
    Observable,
    State,
)
from beamdae.equations.structure import cache_on_owner
from beamdae.results.columns import remove_unit, require_one_column, select_columns
from beamdae.results.run_data import coordinate_headers
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Step of the differences of columns over time, relative to the mean step of the run.
_RELATIVE_TIME_STEP = 1e-3


def differentiate_columns(
    select: Callable[[EquationsOfMotion], Observable],
    times: Array,
    at: State,
    along: Mapping[str, State],
    differences: Mapping[str, Difference],
    inactive: frozenset[str] = frozenset(),
) -> dict[str, Array]:
    """Return the derivatives of the columns of an observable, (rows, columns), by parameter.

    The formula of the observable may have another form at the value of a parameter than next to it,
    such as q for 1 q, or without the forces that vanish there; the form next to it is
    differentiated.

    Parameters
    ----------
    select
        Function that returns the observable of equations.
    times, at
        Rows of (t, branch), and states of the run.
    along
        Derivatives of the states, by parameter.
    differences
        Models at neighboring values, by parameter.
    inactive
        Names of the inactive parts.
    """
    groups: dict[Any, list[str]] = {}
    for name in along:
        groups.setdefault(equations_key(differences[name].base), []).append(name)
    result: dict[str, Array] = {}
    for names in groups.values():
        e = differences[names[0]].base.without_loads_of(inactive)
        o = select(e)
        jacobians = differentiate_formula(o, e, times, at)
        for name in names:
            x, difference = along[name], differences[name]
            change = difference.along(lambda e: select(e).operator)
            dq, dv, da = (
                np.asarray(o.operator @ dx.T + change @ y.T).T
                for dx, y in ((x.q, at.q), (x.v, at.v), (x.a, at.a))
            )
            dp = difference.along(lambda e: e.p[select(e).data])
            dp = np.broadcast_to(dp, (len(times), len(dp)))
            result[name] = _multiply(jacobians, (dq, dv, dp, x.lam[:, o.rows], da))
    return result


def differentiate_formula(
    o: Observable, e: EquationsOfMotion, times: Array, at: State, first: int = 1
) -> list[Array]:
    """Return the derivatives (rows, size, columns) by (t, q, v, p, lam), and a if needed.

    Those by the arguments before `first` are omitted.
    """
    # Operators have few columns; products with all coordinates would copy these.
    acting, operator = o.active_columns
    motion = at.q, at.v, *([at.a] if o.has_accelerations else [])
    q, v, *a = (np.asarray(x[:, acting] @ operator.T) for x in motion)
    arguments = times, q, v, e.p[o.data], at.lam[:, o.rows], *a
    return [
        o.function.derivative(k)(*arguments).reshape(len(times), x.shape[-1], len(o.columns))
        for k, x in enumerate(arguments[first:], first)
    ]


def _multiply(jacobians: Sequence[Array], changes: Sequence[Array]) -> Array:
    """Return the sum of products (rows, columns) with changes (rows, size) of arguments."""
    pairs = zip(jacobians, changes, strict=False)
    return np.asarray(sum(np.einsum("rij,ri->rj", by, dx) for by, dx in pairs))


def differentiate_run_columns(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    times: Array,
    trajectories: Mapping[str, Trajectory],
    differences: Mapping[str, Difference],
    numbers: Sequence[int] | None = None,
) -> dict[str, Array]:
    """Return the derivatives of observed columns of a run, (rows, columns), by parameter.

    Elastic forces between steps are interpolated, see `results.run_data`.

    Parameters
    ----------
    equations, trajectory
        Equations of the run, and its states.
    times
        Ascending times of the rows [s].
    trajectories
        Derivatives of the states by parameter.
    differences
        Models at neighboring values, by parameter.
    numbers
        Indices of the observables; None for all of them.
    """
    numbers = range(len(equations.observables)) if numbers is None else numbers
    observables = [equations.observables[k] for k in numbers]
    ends = np.cumsum([0, *(len(x.columns) for x in observables)])
    result = {name: np.zeros((len(times), ends[-1])) for name in trajectories}
    are_elastic = np.array([x.is_elastic for x in observables], bool)
    for kind in np.unique(are_elastic):
        for inactive, points in group_times(trajectory, times, kind):
            rows, at = join_points(points, trajectory)
            along = {name: join_points(points, x)[1] for name, x in trajectories.items()}
            for k in np.flatnonzero(are_elastic == kind).tolist():
                select = partial(observable_of, numbers[k])
                changes = differentiate_columns(select, rows, at, along, differences, inactive)
                for name, change in changes.items():
                    for x, part in zip(points, split_points(points, change), strict=True):
                        values = part if x.weights is None else x.weights @ part
                        result[name][x.here, ends[k] : ends[k + 1]] = values
    return result


def observable_of(number: int, equations: EquationsOfMotion) -> Observable:
    """Return an observable by its index."""
    return equations.observables[number]


class ColumnPoints(NamedTuple):
    """States of an interval of a run at which columns at ascending times are evaluated.

    Attributes
    ----------
    interval
        Number of the interval.
    here, times
        The times [s] within the interval (j,), and which of all times they are.
    nodes, weights
        The nodes at which the states are, and their weights (j, nodes) in the columns at the times;
        None for states at the times.
    """

    interval: int
    here: slice
    times: Array
    nodes: Array | None
    weights: sp.csr_array | None


def group_times(
    trajectory: Trajectory, times: Array, elastic: bool
) -> list[tuple[frozenset[str], list[ColumnPoints]]]:
    """Return the points of each interval, by the names of the inactive parts.

    Elastic forces are interpolated between nodes.
    """
    index, groups = trajectory.interval_index(times), dict[frozenset[str], list[ColumnPoints]]()
    for k in np.unique(index).tolist():
        here, interval = slice(*np.searchsorted(index, [k, k + 1])), trajectory.intervals[k]
        at_nodes = interval.force_weights_at(times[here]) if elastic else (None, None)
        points = ColumnPoints(k, here, times[here], *at_nodes)
        groups.setdefault(interval.inactive, []).append(points)
    return list(groups.items())


def join_points(
    points: Sequence[ColumnPoints], trajectory: Trajectory, limited: bool = False
) -> tuple[Array, State]:
    """Return the rows (t, branch) and the states of points; see `Interval.at` for `limited`."""
    rows, states = [], []
    for x in points:
        interval, times = trajectory.intervals[x.interval], x.times
        if x.nodes is None:
            states.append(interval.at(times, limited))
        else:
            times = interval.nodes[x.nodes]
            states.append(State(*(y[x.nodes] for y in interval.rows)))
        rows.append(np.stack([times, np.full(len(times), interval.branch)], axis=1))
    if len(points) == 1:
        return rows[0], states[0]
    return np.concatenate(rows), State(*map(np.concatenate, zip(*states, strict=True)))


def split_points(points: Sequence[ColumnPoints], values: Array) -> list[Array]:
    """Split the values at joined states by points."""
    counts = [len(x.times) if x.weights is None else x.weights.shape[1] for x in points]
    return np.split(values, np.cumsum(counts)[:-1])


def time_derivative(
    o: Observable, equations: EquationsOfMotion, times: Array, at: State, rates: State
) -> Array:
    """Return the total time derivatives of the columns of an observable, (rows, columns).

    Parameters
    ----------
    o, equations
        Observable of these equations.
    times, at
        Rows of (t, branch), and the states, whose accelerations are those of the motion.
    rates
        Time derivatives of the accelerations and multipliers.
    """
    by_time, by_q, by_v, _, *by_forces = differentiate_formula(o, equations, times, at, 0)
    clock = np.tile([1.0, 0.0], (len(times), 1))
    v, a, jerk = (np.asarray(o.operator @ x.T).T for x in (at.v, at.a, rates.a))
    changes = clock, v, a, rates.lam[:, o.rows], jerk
    return _multiply((by_time, by_q, by_v, *by_forces), changes)


@cache_on_owner
def locate_column(equations: EquationsOfMotion, name: str) -> tuple[str, int | None, int]:
    """Return the header of a column, and the indices of its observable and in this one.

    Coordinates have None in place of the observable.

    Raises
    ------
    BeamdaeError
        If the name selects no column or several columns.
    """
    observed = {
        header: (number, column)
        for number, o in enumerate(equations.observables)
        for column, header in enumerate(o.headers)
    }
    # Observed columns take precedence, and the headers of all coordinates take long to compare.
    matches = [header for header in observed if name in (header, remove_unit(header))]
    if len(matches) != 1:
        coordinates = coordinate_headers(equations)[1:]
        matches = select_columns([*coordinates, *observed], name, observed=[*observed])
        header = require_one_column("Objective", name, matches)
        if header not in observed:
            return header, None, coordinates.index(header)
        matches = [header]
    return matches[0], *observed[matches[0]]


def read_column(run: Solution, name: str) -> tuple[str, Array]:
    """Return the header and the values of a column at the output times of a run.

    Raises
    ------
    BeamdaeError
        As `locate_column`.
    """
    header, number, _ = locate_column(run.equations, name)
    return header, (run.coordinate_columns() if number is None else run.columns)[header]


def differentiate_column(run: Solution, header: str, times: Array) -> Array:
    """Return the time derivatives (k,) of a column of the dense output at times of a run.

    Differences of second order at earlier times, so that at an accepted step they are those of the
    step that ends there; at later times in the first step.
    """
    end = run.trajectory.end
    times = np.clip(times, 0.0, end)
    step = _RELATIVE_TIME_STEP * min(run.trajectory.mean_step, end)
    steps = np.where(times >= 2.0 * step, -step, step)
    needed = times + np.outer([0.0, 1.0, 2.0], steps)
    unique = np.unique(needed)
    column = read_column(run.at_times(unique), header)[1]
    here, next_one, second = column[np.searchsorted(unique, needed)]
    return np.asarray((4.0 * next_one - 3.0 * here - second) / (2.0 * steps))
