"""Linear solver of compiled loops, which requests new pivots from Python."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.linear.elimination import (
    EliminationPlan,
    Factors,
    allocate_factors,
    eliminate,
    empty_plan,
    refactorize,
    solve,
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
    def empty(cls, dtype: type) -> LinearSolver:
        """Return a solver without pivots, which requests pivots at the first factorization."""
        plan = empty_plan()
        return cls(plan, allocate_factors(plan, dtype))

    def set_plan(self, plan: EliminationPlan) -> None:
        """Use the pivots of another plan, and allocate its factors."""
        self.plan, self.factors = plan, allocate_factors(plan, self.factors.matrix.dtype)
        self.is_untried = 1


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


def eliminate_linear(linear: LinearSolver, nonzeros: Array) -> int:
    """Factorize without a test of the accuracy; return DONE, NEW_PIVOTS or SINGULAR."""
    if linear.singular == 1:
        return SINGULAR
    if linear.plan.rows.size == 0 or not eliminate(linear.plan, linear.factors, nonzeros):
        linear.needs_pivots = 1
        return NEW_PIVOTS
    linear.factorizations += 1
    return DONE


def solve_linear(linear: LinearSolver, right: Array) -> None:
    """Replace `right` by the solution computed with the last factors."""
    linear.solves += 1
    solve(linear.plan, linear.factors, right)
