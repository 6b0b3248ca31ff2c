"""Backward sweep over a run: derivatives of an objective by the numbers of the equations.

The sweep serves the parameters on which the equations depend through their numbers p and the
requested start alone. Derivatives along other parameters, and those of runs with events that switch
parts, follow from `forward_gradients`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.analysis.gradients.column_seeds import ColumnSeeds, differentiate_objective
from beamdae.analysis.gradients.objectives import Objective
from beamdae.analysis.sensitivities.linear_steps import Matrices, transpose_steps
from beamdae.analysis.sensitivities.run_chain import node_state
from beamdae.analysis.sensitivities.start_derivatives import StartDerivatives
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.integrators import GeneralizedAlpha, Radau
from beamdae.integrators.reaction_balance import bound_reactions
from beamdae.results.solution import Solution

Array = np.ndarray


@dataclass(frozen=True)
class RunAdjoint:
    """Derivatives of an objective of a run by its start and by the numbers of the model.

    Attributes
    ----------
    seeds
        Value, and derivatives through the columns alone.
    q, v
        Derivatives with respect to the requested initial coordinates and velocities, (n,) each.
    numbers
        Derivatives with respect to the numbers p, through the motion alone, (n_p,).
    """

    seeds: ColumnSeeds
    q: Array
    v: Array
    numbers: Array


def transpose_run(
    objective: Objective, solution: Solution, method: GeneralizedAlpha | Radau
) -> RunAdjoint:
    """Sweep backwards over all intervals of a run.

    Between two intervals, a law has a breakpoint: positions and velocities are continuous.

    Raises
    ------
    BeamdaeError
        If steps cannot be transposed.
    """
    solution = bound_reactions(solution)
    equations, intervals = solution.equations, solution.trajectory.intervals
    start, n = StartDerivatives(ConsistencySolver(equations)), equations.n
    seeds = differentiate_objective(objective, solution)
    numbers, matrices = np.zeros(len(equations.p)), Matrices()
    for k in reversed(range(len(intervals))):
        interval, by_nodes = intervals[k], seeds.states[k]
        by_start, by_p = transpose_steps(method, start, interval, by_nodes[1:], matrices)
        time, at = node_state(interval, 0)
        before = intervals[k - 1] if k else interval
        by_start[: 2 * n] += by_nodes[0, : 2 * n]
        by_start[3 * n :] += by_nodes[0, 2 * n :]
        start_map = start.start_map(time, at, before.rows.v[-1 if k else 0])
        by_request, by_numbers = start.gradient(start_map, by_start)
        numbers += by_p + by_numbers
        if k:
            seeds.states[k - 1][-1, : 2 * n] += by_request[: 2 * n]
    return RunAdjoint(seeds, by_request[:n], by_request[n : 2 * n], numbers)
