"""Linear solver of loops in the core, which request new pivots from Python."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from beamdae.linear.elimination import (
    LANES,
    EliminationPlan,
    Factors,
    aligned_zeros,
    allocate_factors,
    empty_plan,
    index_lanes,
)

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
    lane_x
        Work array of lanes by position.
    """

    lane_rows: Array = field(default_factory=lambda: np.zeros(0, np.uint32))
    lane_columns: Array = field(default_factory=lambda: np.zeros(0, np.uint32))
    lane_x: Array = field(default_factory=lambda: np.zeros(0))

    def set_plan(self, plan: EliminationPlan) -> None:
        """Use the pivots of another plan, and allocate its factors."""
        LinearSolver.set_plan(self, plan)
        self.lane_rows, self.lane_columns = map(index_lanes, (plan.rows, plan.columns))
        self.lane_x = aligned_zeros(LANES * len(plan.rows), self.factors.matrix.dtype)
