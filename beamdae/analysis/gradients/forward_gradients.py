"""Derivatives of objectives along the derivatives of a run, also across events and impacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from beamdae.analysis.gradients.column_seeds import locate_column
from beamdae.analysis.gradients.objectives import (
    ColumnObjective,
    Objective,
    read_column,
)
from beamdae.analysis.sensitivities.neighbors import Difference
from beamdae.analysis.sensitivities.observable_derivatives import (
    differentiate_run_columns,
    time_derivative,
)
from beamdae.analysis.sensitivities.restart_times import differentiate_event_time, find_stop
from beamdae.analysis.sensitivities.run_chain import RunDerivative
from beamdae.equations.equations_of_motion import State
from beamdae.integrators.reaction_balance import bound_reactions
from beamdae.results.solution import Solution

Array = np.ndarray


def differentiate_along(
    objective: Objective,
    solution: Solution,
    differences: Mapping[str, Difference],
    derivatives: Mapping[str, RunDerivative],
) -> tuple[float, dict[str, float]]:
    """Return the value of an objective and its derivatives by parameter.

    Parameters
    ----------
    objective, solution
        Objective, and run.
    differences, derivatives
        Models at neighboring values, and derivatives of the run, by parameter.
    """
    solution = bound_reactions(solution)
    equations, trajectory = solution.equations, solution.trajectory
    changes_at: dict[tuple[bytes, int], dict[str, Array]] = {}
    along = {name: x.trajectory for name, x in derivatives.items()}
    shifts = np.array([x.shifts for x in derivatives.values()])
    moved = np.flatnonzero(shifts.any(axis=0)).tolist()
    ends = _differentiate_end_time(solution, differences, derivatives)
    value, result = 0.0, np.zeros(len(derivatives))
    for factor, term, run, weights in objective.sample(solution):
        times = run.t
        header, column = read_column(run, term.column)
        number, index = locate_column(equations, header)
        term_value, by_samples = term.evaluate(column, weights)
        value += factor * term_value
        if number is None:
            changes = [np.hstack(_motion(x.at(times)[1]))[:, index] for x in along.values()]
        else:
            key = times.tobytes(), number
            if key not in changes_at:
                changes_at[key] = differentiate_run_columns(
                    equations, trajectory, times, along, differences, [number]
                )
            changes = [x[:, index] for x in changes_at[key].values()]
        result += factor * (np.array(changes) @ by_samples)
        for k in moved:
            t = float(trajectory.intervals[k].t[0])
            result += factor * shifts[:, k] * _restart_rate(term, term_value, solution, t)
        if ends.any():
            result += factor * ends * _end_rate(term, term_value, solution)
    return value, dict(zip(derivatives, result.tolist(), strict=True))


def _motion(state: State) -> tuple[Array, Array, Array]:
    return state.q, state.v, state.lam


def _differentiate_end_time(
    solution: Solution,
    differences: Mapping[str, Difference],
    derivatives: Mapping[str, RunDerivative],
) -> Array:
    """Return the derivatives of the end of the run by parameter, (k,); zero without a stop."""
    stop, trajectory = find_stop(solution), solution.trajectory
    if stop is None:
        return np.zeros(len(derivatives))
    along = {
        name: State(*(y[-1:] for y in x.trajectory.intervals[-1].rows))
        for name, x in derivatives.items()
    }
    last, end = trajectory.intervals[-1], trajectory.end
    ends = differentiate_event_time(solution.equations, stop, last, end, along, differences)
    return np.array(list(ends.values()))


def _restart_rate(term: ColumnObjective, value: float, solution: Solution, t: float) -> float:
    """Return the derivative of a term with respect to the time `t` [s] of a restart.

    The states are those at fixed times, so that only integrals of columns that jump have a
    derivative.
    """
    run, trajectory = solution.at_times(np.array([t, np.nextafter(t, np.inf)])), solution.trajectory
    duration, (_, sides) = trajectory.end - trajectory.start, read_column(run, term.column)
    before, after = (term.end_derivative(value, float(y), 0.0, duration) for y in sides)
    return before - after


def _end_rate(term: ColumnObjective, value: float, solution: Solution) -> float:
    """Return the derivative of a term with respect to the end time of the run."""
    interval, trajectory = solution.trajectory.intervals[-1], solution.trajectory
    end = np.array([trajectory.end])
    header, (y,) = read_column(solution.at_times(end), term.column)
    number, index = locate_column(solution.equations, header)
    lam_rates, at = interval.derivative_at(end).lam, interval.at(end)
    if number is None:
        rates = np.hstack([at.v, at.a, lam_rates])
    else:
        equations = solution.equations.with_loads_of(interval.configuration)
        times = np.array([[trajectory.end, interval.branch]])
        rates = time_derivative(equations.observables[number], equations, times, at, lam_rates)
    duration = trajectory.end - trajectory.start
    return term.end_derivative(value, float(y), float(rates[0, index]), duration)
