"""Removal of redundant constraints before a run, and recovery of their reactions afterwards."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

if TYPE_CHECKING:
    from beamdae.equations.starts.reduced_equations import ReducedEquations

Array = np.ndarray


def remove_redundant(equations: EquationsOfMotion, start: float) -> ReducedEquations | None:
    """Return equations without the constraints that are redundant after `start` [s], or None.

    None means that the model does not request the removal or has no redundant constraints.
    """
    if not equations.redundant:
        return None
    # Models without redundant constraints start faster without this import.
    from beamdae.equations.starts.reduced_equations import remove_redundant_constraints

    after = next((b for b in equations.breakpoints if b > start), start + 1.0)
    return remove_redundant_constraints(equations, np.array([start, 0.5 * (start + after)]))


def restore_reactions(solution: Solution, reduced: ReducedEquations) -> Solution:
    """Return the solution of the full equations.

    The multipliers of all constraints have the minimum norm among those that give the same forces;
    see `ReducedEquations.restore_reactions` for the norm.
    """

    def restore(interval: Interval) -> Interval:
        rows = interval.rows
        lam = reduced.restore_reactions(interval.times, rows.q, rows.lam)
        return replace(interval, rows=rows._replace(lam=lam))

    return replace(
        solution,
        equations=reduced.full,
        trajectory=Trajectory(tuple(map(restore, solution.trajectory.intervals))),
        integrator={**solution.integrator, "redundant": reduced.description},
    )
