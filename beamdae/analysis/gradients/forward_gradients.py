"""Derivatives of objectives along the derivatives of a run, also across events and impacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from beamdae.analysis.gradients.column_seeds import (
    OperatorSeeds,
    differentiate_end,
    differentiate_objective,
    differentiate_restart,
    evaluate_terms,
)
from beamdae.analysis.gradients.objectives import Objective
from beamdae.analysis.sensitivities.further_forces import further_key
from beamdae.analysis.sensitivities.model_differences import Difference
from beamdae.analysis.sensitivities.run_derivatives import (
    RunDerivative,
    differentiate_event_time,
    find_stop,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
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
    intervals, stop = solution.trajectory.intervals, find_stop(solution)
    terms = evaluate_terms(objective, solution)
    starts = [float(x.t[0]) for x in intervals]
    all_seeds: dict[Any, Any] = {}
    result: dict[str, float] = {}
    for name, difference in differences.items():
        base, along = difference.base, derivatives[name]
        key = further_key(base)
        if key not in all_seeds:
            all_seeds[key] = differentiate_objective(objective, solution, base)
        seeds = all_seeds[key]
        total = difference.derivative(lambda e: e.p) @ seeds.numbers
        for by_operator in seeds.operators:
            total += by_operator.weigh(difference.derivative(_operator_of(by_operator)))
        for by_nodes, interval in zip(seeds.states, along.trajectory.intervals, strict=True):
            q, v, _, lam = interval.rows
            total += np.sum(by_nodes * np.hstack([q, v, lam]))
        for t, dt in zip(starts, along.shifts, strict=True):
            if dt:
                total += dt * differentiate_restart(terms, solution, t)
        if stop is not None:
            at_end = State(*(x[-1:] for x in along.trajectory.intervals[-1].rows))
            shift = differentiate_event_time(
                base,
                stop,
                intervals[-1],
                solution.trajectory.end,
                {name: at_end},
                {name: difference},
            )[name]
            total += shift * differentiate_end(objective, solution, base)
        result[name] = float(total)
    return next(iter(all_seeds.values())).value, result


def _operator_of(seeds: OperatorSeeds) -> Callable[[EquationsOfMotion], Any]:
    return lambda e: seeds.select(e).operator
