"""Derivatives of objectives along the derivatives of a run, also across events and impacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from beamdae.analysis.gradients.column_seeds import (
    ColumnSeeds,
    OperatorSeeds,
    differentiate_end,
    differentiate_objective,
    differentiate_restart,
    evaluate_terms,
)
from beamdae.analysis.gradients.objectives import Objective
from beamdae.analysis.sensitivities.directions import equations_key
from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.restart_times import differentiate_event_time, find_stop
from beamdae.analysis.sensitivities.run_derivatives import RunDerivative
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.integrators.reaction_balance import bound_reactions
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Trajectory

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
    intervals, stop = solution.trajectory.intervals, find_stop(solution)
    by_restart = np.zeros(len(intervals))
    moved = np.flatnonzero(np.any([x.shifts for x in derivatives.values()], axis=0)).tolist()
    terms = evaluate_terms(objective, solution) if moved else []
    for k in moved:
        by_restart[k] = differentiate_restart(terms, solution, float(intervals[k].t[0]))
    groups: dict[Any, list[str]] = {}
    for name, difference in differences.items():
        groups.setdefault(equations_key(difference.base), []).append(name)
    value, result = 0.0, dict[str, float]()
    for names in groups.values():
        group = {name: differences[name] for name in names}
        base = group[names[0]].base
        seeds = differentiate_objective(objective, solution, base)
        value, by_end, ends = seeds.value, 0.0, dict.fromkeys(names, 0.0)
        if stop is not None:
            last = {name: derivatives[name].trajectory.intervals[-1].rows for name in names}
            at_end = {name: State(*(x[-1:] for x in rows)) for name, rows in last.items()}
            end = solution.trajectory.end
            ends = differentiate_event_time(base, stop, intervals[-1], end, at_end, group)
            by_end = differentiate_end(objective, solution, base)
        for name, difference in group.items():
            total = _weigh(seeds, difference, derivatives[name].trajectory)
            total += float(derivatives[name].shifts @ by_restart)
            result[name] = total + ends[name] * by_end
    return value, result


def _weigh(seeds: ColumnSeeds, difference: Difference, along: Trajectory) -> float:
    """Return the derivative at fixed times along the derivatives of states and of the model."""
    total = difference.derivative(lambda e: e.p) @ seeds.numbers
    for by_operator in seeds.operators:
        total += by_operator.weigh(difference.derivative(_operator_of(by_operator)))
    for by_nodes, interval in zip(seeds.states, along.intervals, strict=True):
        q, v, _, lam = interval.rows
        total += np.sum(by_nodes * np.hstack([q, v, lam]))
    return float(total)


def _operator_of(seeds: OperatorSeeds) -> Callable[[EquationsOfMotion], Any]:
    return lambda e: seeds.select(e).operator
