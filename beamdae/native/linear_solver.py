"""Linear solver of compiled loops, which requests new pivots from Python."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from beamdae.linear.elimination import (
    EliminationPlan,
    Factors,
    allocate_factors,
    empty_plan,
    refactorize,
    solve,
    substitute_triangles_in_lanes,
)
from beamdae.linear.lane_operations import (
    LANES,
    aligned_zeros,
    gather_lanes,
    index_lanes,
    scatter_lanes,
    set_entry,
)
from beamdae.native.return_codes import DONE, NEW_PIVOTS, SINGULAR

Array = np.ndarray


@dataclass(slots=True)
class LinearSolver:
    """Linear solver of a loop, with the factors of its last matrix.

    Attributes
    ----------
    plan, factors
        Pivots, and factors of the last matrix.
    needs_pivots
        1 while a request for new pivots is pending, else 0.
    is_untried
        1 from `set_plan` until a matrix has been factorized with the new pivots, else 0.
    singular
        1 if no pivots suit the matrix of the current step, else 0.
    factorizations, solves
        Numbers of factorizations and solutions.
    """

    plan: EliminationPlan
    factors: Factors
    needs_pivots: int = 0
    is_untried: int = 0
    singular: int = 0
    factorizations: int = 0
    solves: int = 0

    @classmethod
    def empty(cls, dtype: type) -> Self:
        """Return a solver without pivots, which requests pivots at the first factorization."""
        plan = empty_plan()
        linear = cls(plan, allocate_factors(plan, dtype))
        linear.set_plan(plan)
        linear.is_untried = 0
        return linear

    def set_plan(self, plan: EliminationPlan) -> None:
        """Use the pivots of another plan, and allocate its factors."""
        self.plan, self.factors = plan, allocate_factors(plan, self.factors.matrix.dtype)
        self.is_untried = 1


@dataclass(slots=True)
class LaneSolver(LinearSolver):
    """Linear solver for several right-hand sides, one per vector lane; its plans have no blocks.

    Attributes
    ----------
    lane_rows, lane_columns
        Indices in all lanes of right-hand sides: rows and columns of the pivots, by position.
    x
        Work array of lanes by position.
    """

    lane_rows: Array = field(default_factory=lambda: np.zeros(0, np.uint32))
    lane_columns: Array = field(default_factory=lambda: np.zeros(0, np.uint32))
    x: Array = field(default_factory=lambda: np.zeros(0))

    def set_plan(self, plan: EliminationPlan) -> None:
        """Use the pivots of another plan, and allocate its factors."""
        LinearSolver.set_plan(self, plan)
        self.lane_rows, self.lane_columns = map(index_lanes, (plan.rows, plan.columns))
        self.x = aligned_zeros(LANES * len(plan.rows), self.factors.matrix.dtype)


def factorize_linear(linear: LinearSolver, nonzeros: Array) -> int:
    """Factorize the matrix with these CSC non-zeros; return DONE, NEW_PIVOTS or SINGULAR."""
    if linear.singular == 1:
        return SINGULAR
    if linear.plan.rows.size == 0 or not refactorize(linear.plan, linear.factors, nonzeros):
        linear.needs_pivots = 1
        return NEW_PIVOTS
    linear.factorizations += 1
    linear.is_untried = 0
    return DONE


def solve_linear(linear: LinearSolver, right: Array) -> None:
    """Replace `right` by the solution computed with the last factors."""
    linear.solves += 1
    solve(linear.plan, linear.factors, right)


def solve_linear_lanes(linear: LaneSolver, right: Array) -> None:
    """Replace the right-hand sides, one per lane, by solutions with the last factors.

    They are not refined.
    """
    plan, x, size = linear.plan, linear.x, linear.plan.rows.size
    linear.solves += LANES
    gather_lanes(x, 0, size, right, linear.lane_rows, 0)
    for k in range(size):
        set_entry(x, k, x, k, plan.scale[plan.rows[k]])
    substitute_triangles_in_lanes(plan, linear.factors, x)
    scatter_lanes(right, linear.lane_columns, 0, x, 0, size)
