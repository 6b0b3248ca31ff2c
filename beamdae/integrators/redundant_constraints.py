"""Runs of mechanisms with redundant constraints: integrated without, and told with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.reduced_equations import Reduced, reduced
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray


def spared(equations: EquationsOfMotion, start: float) -> Reduced | None:
    """The equations to integrate where redundant constraints are to be spared, if there are any."""
    if not equations.redundant:
        return None
    after = next((b for b in equations.breakpoints if b > start), start + 1.0)
    return reduced(equations, np.array([start, 0.5 * (start + after)]))


def with_all(solution: Solution, by: Reduced) -> Solution:
    """The solution with the reactions of all constraints, of minimum norm."""
    intervals = tuple(_with_all(interval, by) for interval in solution.trajectory.intervals)
    return replace(
        solution,
        equations=by.whole,
        trajectory=Trajectory(intervals),
        integrator={**solution.integrator, "redundant": by.told},
    )


def _with_all(interval: Interval, by: Reduced) -> Interval:
    rows = interval.rows
    lam = by.reactions(interval.times, rows.q, rows.lam)
    return replace(interval, rows=rows._replace(lam=lam))
