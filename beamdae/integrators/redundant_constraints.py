"""Runs of mechanisms with redundant constraints: integrated without, and told with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.reduced_equations import (
    ReducedEquations,
    remove_redundant_constraints,
)
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


def remove_redundant(equations: EquationsOfMotion, start: float) -> ReducedEquations | None:
    """The equations to integrate where redundant constraints are to be spared, if there are any."""
    if not equations.redundant:
        return None
    after = next((b for b in equations.breakpoints if b > start), start + 1.0)
    return remove_redundant_constraints(equations, np.array([start, 0.5 * (start + after)]))


def restore_reactions(solution: Solution, by: ReducedEquations) -> Solution:
    """The solution with the reactions of all constraints, of minimum norm."""
    intervals = tuple(_restore_interval(interval, by) for interval in solution.trajectory.intervals)
    return replace(
        solution,
        equations=by.whole,
        trajectory=Trajectory(intervals),
        integrator={**solution.integrator, "redundant": by.told},
    )


def _restore_interval(interval: Interval, by: ReducedEquations) -> Interval:
    rows = interval.rows
    lam = by.reactions(interval.times, rows.q, rows.lam)
    return replace(interval, rows=rows._replace(lam=lam))
