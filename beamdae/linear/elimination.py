"""Numeric factorization of sparse matrices with known pivots and fill, and solution of systems.

`refactorize` and `solve` are plain loops over arrays that numba can compile: they do not allocate,
raise or call Python. The matrix is eliminated column by column from the left with the pivots of an
`EliminationPlan`, as in the refactorization of KLU (Davis & Palamadai Natarajan, ACM Trans. Math.
Softw. 37 (2010) 36).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray

# A solution is accurate if its backward error does not exceed this value.
MAX_BACKWARD_ERROR = 1e-10
# Pivots that require more steps of iterative refinement are rejected.
MAX_REFINEMENTS = 2


class EliminationPlan(NamedTuple):
    """Pivots of a matrix and the pattern of its factors.

    A position is an index in the order of elimination. Integers are unsigned, so that compiled
    loops need not check for negative indices.

    Attributes
    ----------
    rows, columns
        Rows and columns of the pivots, by position.
    scale
        Scale factors of the rows, by position.
    starts, positions, sources
        Columns of the matrix, by position: their starts, the positions of their rows, and the
        indices of their CSC non-zeros.
    upper_starts, upper_rows, lower_starts, lower_rows
        Columns of the factors above and below the diagonal: their starts, and the positions of
        their rows, ascending.
    """

    rows: Array
    columns: Array
    scale: Array
    starts: Array
    positions: Array
    sources: Array
    upper_starts: Array
    upper_rows: Array
    lower_starts: Array
    lower_rows: Array


class Factors(NamedTuple):
    """Factors of the last matrix; the next factorization overwrites them.

    Attributes
    ----------
    matrix
        Scaled entries of the matrix in the order of `EliminationPlan.sources`.
    upper, lower, inverse
        Entries of the factors above and below the diagonal, and the reciprocals of the pivots.
    x, right, residual, terms
        Work arrays.
    refinements
        Number of steps of iterative refinement per solution, shape (1,).
    """

    matrix: Array
    upper: Array
    lower: Array
    inverse: Array
    x: Array
    right: Array
    residual: Array
    terms: Array
    refinements: Array


def empty_plan() -> EliminationPlan:
    """Return the plan of a matrix without rows."""
    none = np.zeros(0, np.uint32)
    return EliminationPlan(none, none, np.zeros(0), *(none for _ in range(7)))


def allocate_factors(plan: EliminationPlan, dtype: Any) -> Factors:
    """Return zero arrays for the factors of a plan."""
    patterns = (plan.sources, plan.upper_rows, plan.lower_rows)
    matrix, upper, lower = (np.zeros(len(rows), dtype) for rows in patterns)
    inverse, x, right, residual = np.zeros((4, len(plan.rows)), dtype)
    terms, refinements = np.zeros(len(plan.rows)), np.zeros(1, np.int64)
    return Factors(matrix, upper, lower, inverse, x, right, residual, terms, refinements)


def refactorize(plan: EliminationPlan, factors: Factors, nonzeros: Array) -> bool:
    """Factorize the matrix with these CSC non-zeros; return False if the pivots are unsuitable.

    Pivots are unsuitable if one of them or its reciprocal is not finite, or if refinement does not
    make solutions accurate.
    """
    return _eliminate(plan, factors, nonzeros) and _set_refinements(plan, factors)


def solve(plan: EliminationPlan, factors: Factors, right: Array) -> None:
    """Replace `right` by the solution; apply the refinements that `refactorize` found necessary."""
    rows, columns, scale = plan.rows, plan.columns, plan.scale
    x, scaled_right = factors.x, factors.right
    for k in range(len(x)):
        scaled_right[k] = x[k] = scale[k] * right[rows[k]]
    lower_starts, lower_rows, lower = plan.lower_starts, plan.lower_rows, factors.lower
    upper_starts, upper_rows, upper = plan.upper_starts, plan.upper_rows, factors.upper
    inverse, residual, terms = factors.inverse, factors.residual, factors.terms
    _substitute(lower_starts, lower_rows, lower, upper_starts, upper_rows, upper, inverse, x)
    for _ in range(factors.refinements[0]):
        _update_residual(
            plan.starts, plan.positions, factors.matrix, x, scaled_right, residual, terms
        )
        _substitute(
            lower_starts, lower_rows, lower, upper_starts, upper_rows, upper, inverse, residual
        )
        for k in range(len(x)):
            x[k] += residual[k]
    for k in range(len(x)):
        right[columns[k]] = x[k]


def _eliminate(plan: EliminationPlan, factors: Factors, nonzeros: Array) -> bool:
    scale, starts, positions, sources = plan.scale, plan.starts, plan.positions, plan.sources
    upper_starts, upper_rows = plan.upper_starts, plan.upper_rows
    lower_starts, lower_rows = plan.lower_starts, plan.lower_rows
    matrix, upper, lower, x = factors.matrix, factors.upper, factors.lower, factors.x
    for j in range(len(x)):
        x[j] = 0.0
    for j in range(len(x)):
        for e in range(starts[j], starts[j + 1]):
            row = positions[e]
            matrix[e] = x[row] = scale[row] * nonzeros[sources[e]]
        for p in range(upper_starts[j], upper_starts[j + 1]):
            k = upper_rows[p]
            factor = x[k]
            x[k] = 0.0
            upper[p] = factor
            for q in range(lower_starts[k], lower_starts[k + 1]):
                x[lower_rows[q]] -= lower[q] * factor
        pivot = x[j]
        if pivot == 0.0:
            return False
        inverse = 1.0 / pivot
        if not (np.isfinite(pivot) and np.isfinite(inverse)):
            return False
        factors.inverse[j] = inverse
        x[j] = 0.0
        for q in range(lower_starts[j], lower_starts[j + 1]):
            row = lower_rows[q]
            lower[q] = x[row] * inverse
            x[row] = 0.0
    return True


def _substitute(
    lower_starts: Array,
    lower_rows: Array,
    lower: Array,
    upper_starts: Array,
    upper_rows: Array,
    upper: Array,
    inverse: Array,
    x: Array,
) -> None:
    """Replace `x` by the solution, without refinement.

    Arrays are passed one by one: passing a plan to compiled code takes longer.
    """
    size = len(x)
    for k in range(size):
        value = x[k]
        for q in range(lower_starts[k], lower_starts[k + 1]):
            x[lower_rows[q]] -= lower[q] * value
    for back in range(size):
        k = size - 1 - back
        value = x[k] * inverse[k]
        x[k] = value
        for p in range(upper_starts[k], upper_starts[k + 1]):
            x[upper_rows[p]] -= upper[p] * value


def _set_refinements(plan: EliminationPlan, factors: Factors) -> bool:
    """Set the number of refinements; return False if `MAX_REFINEMENTS` are not enough.

    The measure is the backward error of Oettli & Prager, relative to the terms of each equation,
    for a solution to which all columns contribute equally.
    """
    lower_starts, lower_rows, lower = plan.lower_starts, plan.lower_rows, factors.lower
    upper_starts, upper_rows, upper = plan.upper_starts, plan.upper_rows, factors.upper
    starts, positions, matrix = plan.starts, plan.positions, factors.matrix
    inverse, x, right, residual = factors.inverse, factors.x, factors.right, factors.residual
    for k in range(len(x)):
        x[k] = right[k] = 0.0
    for j in range(len(x)):
        largest = 0.0
        for e in range(starts[j], starts[j + 1]):
            largest = max(largest, _estimate_modulus(matrix[e]))
        exact = 1.0 / largest
        for e in range(starts[j], starts[j + 1]):
            right[positions[e]] += matrix[e] * exact
    for k in range(len(x)):
        residual[k] = right[k]
    for refinements in range(MAX_REFINEMENTS + 1):
        _substitute(
            lower_starts, lower_rows, lower, upper_starts, upper_rows, upper, inverse, residual
        )
        for k in range(len(x)):
            x[k] += residual[k]
        if _update_residual(starts, positions, matrix, x, right, residual, factors.terms):
            factors.refinements[0] = refinements
            return True
    return False


def _update_residual(
    starts: Array,
    positions: Array,
    matrix: Array,
    x: Array,
    right: Array,
    residual: Array,
    terms: Array,
) -> bool:
    """Set `residual` to right - matrix @ x; return True if `x` is accurate.

    Also set `terms` to the sums of the magnitudes of all terms in each equation.
    """
    for k in range(len(x)):
        residual[k] = right[k]
        terms[k] = _estimate_modulus(right[k])
    for j in range(len(x)):
        value = x[j]
        size = _estimate_modulus(value)
        for e in range(starts[j], starts[j + 1]):
            row = positions[e]
            residual[row] -= matrix[e] * value
            terms[row] += _estimate_modulus(matrix[e]) * size
    is_solved = True
    for k in range(len(x)):
        # This comparison is False for NaN.
        is_solved &= _estimate_modulus(residual[k]) <= MAX_BACKWARD_ERROR * terms[k]
    return is_solved


def _estimate_modulus(value: complex) -> float:
    """Return |real| + |imaginary|: 1 to 1.42 times the modulus, but much cheaper to compute."""
    return abs(value.real) + abs(value.imag)
