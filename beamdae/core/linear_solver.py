"""Linear solver of loops in the core, which request new pivots from Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from beamdae.linear.elimination import (
    EliminationPlan,
    Factors,
    allocate_factors,
    empty_plan,
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
