"""Time derivatives of observed columns, from the dense output of a run."""

from __future__ import annotations

import numpy as np

from beamdae.results.solution import Solution

Array = np.ndarray


def column_rates(run: Solution) -> dict[str, Array]:
    """Return the time derivatives (k,) of the observed columns at the times of a run, by header.

    With an observable y(t, q, v, a, lam), these are y_t + y_q q' + y_v v' + y_a a' + y_lam lam',
    where the rates are the derivatives of the dense output. They are therefore the exact
    derivatives of the interpolated columns; at an accepted step, those of the step that ends there.
    """
    equations, trajectory = run.equations, run.trajectory
    times, at = trajectory.at(run.t)
    rate = trajectory.derivative_at(run.t)
    # Rates of (t, branch): laws do not change their piece.
    clock = np.broadcast_to([1.0, 0.0], times.shape)
    result: dict[str, Array] = {}
    numbers = trajectory.observed_numbers(equations, run.t)
    for o in equations.observables:
        p, lam, count = numbers(o.data), at.lam[:, o.rows], len(o.columns)
        q, v, dq, dv = (np.asarray(o.operator @ x.T).T for x in (at.q, at.v, rate.q, rate.v))
        arguments, rates = [times, q, v, p, lam], {0: clock, 1: dq, 2: dv, 4: rate.lam[:, o.rows]}
        if o.has_accelerations:
            local, rates[5] = (np.asarray(o.operator @ x.T).T for x in (at.a, rate.a))
            arguments.append(local)
        values = np.zeros((len(times), count))
        for argument, along in rates.items():
            jacobian = o.function.derivative(argument)(*arguments)
            shape = (len(times), along.shape[1], count)
            values += np.einsum("rij,ri->rj", jacobian.reshape(shape), along)
        result |= dict(zip(o.headers, values.T, strict=True))
    return result
