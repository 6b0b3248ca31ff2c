"""Factorization and solution by the core."""

import numpy as np
from linear_system import LinearSystem

from beamdae.core.linear_solver import LinearSolver
from beamdae.core.return_codes import DONE, NEW_PIVOTS


def refactorize(plan, factors, nonzeros):
    """Return True if the pivots of a plan suit the matrix with these non-zeros."""
    nonzeros = nonzeros.astype(factors.x.dtype)
    system = LinearSystem(LinearSolver(plan, factors), nonzeros, np.zeros_like(factors.x))
    code = system.factorize()
    assert code in (DONE, NEW_PIVOTS)
    assert system.linear.needs_pivots == (code == NEW_PIVOTS)
    assert system.linear.factorizations == (code == DONE)
    return code == DONE


def solve(plan, factors, right):
    """Replace a right-hand side by the solution with the last factors."""
    LinearSystem(LinearSolver(plan, factors), factors.matrix, right).solve()
