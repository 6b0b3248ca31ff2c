"""Derivatives of observed columns with respect to parameters, and with respect to time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from beamdae.errors import BeamdaeError
from beamdae.results.elastic_columns import is_elastic
from beamdae.results.trajectory import Trajectory

Array = np.ndarray


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
        arguments = _arguments(o, e, times, at)
        by_q, by_v, by_p, by_lam, *by_a = (
            _jacobian(o, k, arguments) for k in range(1, len(arguments))
        )
        for name in names:
            x, difference = along[name], differences[name]
            change = difference.along(lambda e: select(e).operator)
            dq, dv, da = (
                np.asarray(o.operator @ dx.T + change @ y.T).T
                for dx, y in ((x.q, at.q), (x.v, at.v), (x.a, at.a))
            )
            dp = difference.along(lambda e: e.p[select(e).data])
            parts = [(by_q, dq), (by_v, dv), (by_lam, x.lam[:, o.rows]), *((by, da) for by in by_a)]
            motion = sum(np.einsum("rij,ri->rj", by, dx) for by, dx in parts)
            result[name] = motion + np.einsum("rij,i->rj", by_p, dp)
    return result


def _arguments(o: Observable, e: EquationsOfMotion, times: Array, at: State) -> tuple[Array, ...]:
    """Return the arguments (t, q, v, p, lam) of the formula, and the accelerations if needed."""
    motion = at.q, at.v, *([at.a] if o.has_accelerations else [])
    q, v, *a = (np.asarray(o.operator @ x.T).T for x in motion)
    return times, q, v, e.p[o.data], at.lam[:, o.rows], *a


def _jacobian(o: Observable, k: int, arguments: tuple[Array, ...]) -> Array:
    """Return the derivatives (rows, size, columns) by an argument of the formula."""
    jacobian = o.function.derivative(k)(*arguments)
    return jacobian.reshape(len(arguments[0]), arguments[k].shape[-1], len(o.columns))


def differentiate_run_columns(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    times: Array,
    trajectories: Mapping[str, Trajectory],
    differences: Mapping[str, Difference],
    numbers: Sequence[int] | None = None,
) -> dict[str, Array]:
    """Return the derivatives of observed columns of a run, (rows, columns), by parameter.

    Elastic forces between steps are interpolated, see `results.elastic_columns`.

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
        Indices of the observables; None for all.
    """
    numbers = range(len(equations.observables)) if numbers is None else numbers
    observables = [equations.observables[k] for k in numbers]
    ends = np.cumsum([0, *(len(x.columns) for x in observables)])
    result = {name: np.zeros((len(times), ends[-1])) for name in trajectories}
    are_elastic = [is_elastic(equations, x) for x in observables]
    splits = {True: _split_by_interval, False: _split_by_configuration}
    parts = {x: list(splits[x](trajectory, times, trajectories)) for x in set(are_elastic)}
    for k, (number, is_interpolated) in enumerate(zip(numbers, are_elastic, strict=True)):
        columns = slice(ends[k], ends[k + 1])
        for x in parts[is_interpolated]:
            changes = differentiate_columns(
                partial(observable_of, number), x.rows, x.at, x.along, differences, x.inactive
            )
            for name, change in changes.items():
                rows = change if x.weights is None else x.weights @ change
                result[name][x.here, columns] = rows
    return result


def observable_of(number: int, equations: EquationsOfMotion) -> Observable:
    """Return an observable by its index."""
    return equations.observables[number]


class _Part(NamedTuple):
    """States at which observables are differentiated.

    Attributes
    ----------
    here
        Mask (k,) of the times at which the results are needed.
    weights
        Weights (times, states) of the results at the states; None if the states are at the times.
    rows, at
        Rows of (t, branch), and the states.
    along
        Derivatives of the states by parameter.
    inactive
        Names of the inactive parts.
    """

    here: Array
    weights: sp.csr_array | None
    rows: Array
    at: State
    along: dict[str, State]
    inactive: frozenset[str]


def _split_by_configuration(
    trajectory: Trajectory, times: Array, trajectories: Mapping[str, Trajectory]
) -> Iterator[_Part]:
    """Yield the states at ascending times (k,) [s], by active parts."""
    rows, at = trajectory.at(times)
    along = {name: x.at(times)[1] for name, x in trajectories.items()}
    for configuration, here in trajectory.by_configuration(times):
        part = {name: _select_rows(x, here) for name, x in along.items()}
        inactive = frozenset() if configuration is None else configuration.inactive
        yield _Part(here, None, rows[here], _select_rows(at, here), part, inactive)


def _split_by_interval(
    trajectory: Trajectory, times: Array, trajectories: Mapping[str, Trajectory]
) -> Iterator[_Part]:
    """Yield the states at nodes, which elastic forces at ascending times (k,) [s] interpolate."""
    index = trajectory.interval_index(times)
    for k, interval in enumerate(trajectory.intervals):
        here = index == k
        nodes, weights = interval.force_weights_at(times[here])
        at = _select_rows(interval.rows, nodes)
        along = {x: _select_rows(y.intervals[k].rows, nodes) for x, y in trajectories.items()}
        yield _Part(here, weights, interval.times[nodes], at, along, interval.inactive)


def _select_rows(state: State, rows: Array) -> State:
    return State(*(x[rows] for x in state))


def time_derivative(
    o: Observable, equations: EquationsOfMotion, times: Array, at: State, lam_rates: Array
) -> Array:
    """Return the total time derivatives of the columns of an observable, (rows, columns).

    Parameters
    ----------
    o, equations
        Observable of these equations.
    times, at
        Rows of (t, branch), and the states, whose accelerations are those of the motion.
    lam_rates
        Time derivatives of the multipliers, (rows, m).

    Raises
    ------
    BeamdaeError
        If the columns depend on accelerations, whose time derivatives are unknown.
    """
    if o.has_accelerations:
        raise BeamdaeError(
            f"{o.name}: the time derivative of accelerations is unknown; do not observe them in "
            "this analysis."
        )
    arguments = _arguments(o, equations, times, at)
    a = np.asarray(o.operator @ at.a.T).T
    clock = np.tile([1.0, 0.0], (len(times), 1))
    rates = (0, clock), (1, arguments[2]), (2, a), (4, lam_rates[:, o.rows])
    return sum(np.einsum("rij,ri->rj", _jacobian(o, k, arguments), x) for k, x in rates)
