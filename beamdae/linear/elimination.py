"""Numbers of the factors of a matrix whose pivots and entries are known.

Plain loops over arrays, which numba can compile: nothing here allocates, raises or calls Python.
The matrix is eliminated column by column from the left with the pivots of a `Plan`, as KLU does it
with a second set of numbers (Davis & Palamadai Natarajan, ACM Trans. Math. Softw. 37 (2010) 36).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.linear.return_codes import DONE, NEW_PIVOTS, SINGULAR

Array = np.ndarray

# Backward error of what counts as solved.
_ACCURATE = 1e-10
_MOST_REFINEMENTS = 2


class Plan(NamedTuple):
    """Pivots of a matrix, and what its factors hold.

    A position is one in the order of elimination. Integers are unsigned: compiled loops then need
    not ask whether an index counts from the end.

    Attributes
    ----------
    rows, columns
        Of the pivots, by position.
    scale
        By which rows are multiplied, by position.
    starts, positions, sources
        Columns of the matrix, by position: where they start, positions of their rows, and which
        of the CSC non-zeros they are.
    upper_starts, upper_rows, lower_starts, lower_rows
        Columns of the factors above and below the diagonal: where they start, and positions of
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
    """Numbers of the last matrix given, overwritten by the next one.

    Attributes
    ----------
    matrix
        Scaled entries in the order of `Plan.sources`.
    upper, lower, inverse
        Above and below the diagonal of the factors, and one over the pivots.
    x, right, left, sizes
        Work.
    refinements
        Steps of iterative refinement of each solution; one number.
    """

    matrix: Array
    upper: Array
    lower: Array
    inverse: Array
    x: Array
    right: Array
    left: Array
    sizes: Array
    refinements: Array


def refactorize(plan: Plan, factors: Factors, nonzeros: Array) -> bool:
    """Factorize the matrix with these CSC non-zeros; whether the pivots of the plan serve it.

    They do not where one is zero or not finite, nor where refinement does not make solutions
    accurate.
    """
    return _eliminate(plan, factors, nonzeros) and _is_accurate(plan, factors)


def solve(plan: Plan, factors: Factors, right: Array) -> None:
    """Replace a right-hand side by the solution."""
    rows, columns, scale = plan.rows, plan.columns, plan.scale
    x, scaled = factors.x, factors.right
    for k in range(len(x)):
        scaled[k] = x[k] = scale[k] * right[rows[k]]
    lower_starts, lower_rows, lower = plan.lower_starts, plan.lower_rows, factors.lower
    upper_starts, upper_rows, upper = plan.upper_starts, plan.upper_rows, factors.upper
    inverse = factors.inverse
    _substitute(lower_starts, lower_rows, lower, upper_starts, upper_rows, upper, inverse, x)
    for _ in range(factors.refinements[0]):
        left = factors.left
        _measure(plan.starts, plan.positions, factors.matrix, x, scaled, left, factors.sizes)
        _substitute(lower_starts, lower_rows, lower, upper_starts, upper_rows, upper, inverse, left)
        for k in range(len(x)):
            x[k] += left[k]
    for k in range(len(x)):
        right[columns[k]] = x[k]


def _eliminate(plan: Plan, factors: Factors, nonzeros: Array) -> bool:
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
    """Replace x by the solution, without refinement. Few arguments: they take time to pass."""
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


def _is_accurate(plan: Plan, factors: Factors) -> bool:
    """Set how often solutions have to be refined; whether that is seldom enough.

    Measured by the backward error of Oettli & Prager, of an equation relative to its terms, for
    a solution to which all columns contribute alike.
    """
    lower_starts, lower_rows, lower = plan.lower_starts, plan.lower_rows, factors.lower
    upper_starts, upper_rows, upper = plan.upper_starts, plan.upper_rows, factors.upper
    starts, positions, matrix = plan.starts, plan.positions, factors.matrix
    inverse, x, right, left = factors.inverse, factors.x, factors.right, factors.left
    for k in range(len(x)):
        x[k] = right[k] = 0.0
    for j in range(len(x)):
        largest = 0.0
        for e in range(starts[j], starts[j + 1]):
            largest = max(largest, _size(matrix[e]))
        known = 1.0 / largest
        for e in range(starts[j], starts[j + 1]):
            right[positions[e]] += matrix[e] * known
    for k in range(len(x)):
        left[k] = right[k]
    for refinements in range(_MOST_REFINEMENTS + 1):
        _substitute(lower_starts, lower_rows, lower, upper_starts, upper_rows, upper, inverse, left)
        for k in range(len(x)):
            x[k] += left[k]
        if _measure(starts, positions, matrix, x, right, left, factors.sizes):
            factors.refinements[0] = refinements
            return True
    return False


def _measure(
    starts: Array,
    positions: Array,
    matrix: Array,
    x: Array,
    right: Array,
    left: Array,
    sizes: Array,
) -> bool:
    """Set `left` to what x leaves of the right-hand side; whether that is little."""
    for k in range(len(x)):
        left[k] = right[k]
        sizes[k] = _size(right[k])
    for j in range(len(x)):
        value = x[j]
        size = _size(value)
        for e in range(starts[j], starts[j + 1]):
            row = positions[e]
            left[row] -= matrix[e] * value
            sizes[row] += _size(matrix[e]) * size
    little = True
    for k in range(len(x)):
        # What is not a number is not little.
        little &= _size(left[k]) <= _ACCURATE * sizes[k]
    return little


def _size(value: complex) -> float:
    """Modulus within a factor of 1.4: that of a complex number takes as long as ten products."""
    return abs(value.real) + abs(value.imag)


@dataclass(slots=True)
class Linear:
    """Factors of one matrix after the other, in a loop.

    Attributes
    ----------
    plan, factors
        Pivots and numbers.
    asks
        Whether the loop came back for other pivots.
    fresh
        Whether the pivots have yet to serve a matrix.
    singular
        Whether there are no pivots for the matrix of the step under way.
    factorizations, solves
        How many there were.
    """

    plan: Plan
    factors: Factors
    asks: int = 0
    fresh: int = 0
    singular: int = 0
    factorizations: int = 0
    solves: int = 0

    @classmethod
    def empty(cls, dtype: type) -> Linear:
        """One that asks for pivots first."""
        plan = no_plan()
        return cls(plan, factors_of(plan, dtype))

    def take(self, plan: Plan) -> None:
        """Go on with other pivots."""
        self.plan, self.factors = plan, factors_of(plan, self.factors.matrix.dtype)
        self.fresh = 1


def no_plan() -> Plan:
    """Of a matrix without rows."""
    none = np.zeros(0, np.uint32)
    return Plan(none, none, np.zeros(0), *(none for _ in range(7)))


def factors_of(plan: Plan, dtype: Any) -> Factors:
    """Room for the factors."""
    entries = (plan.sources, plan.upper_rows, plan.lower_rows)
    matrix, upper, lower = (np.zeros(len(rows), dtype) for rows in entries)
    inverse, x, right, left = np.zeros((4, len(plan.rows)), dtype)
    sizes, refinements = np.zeros(len(plan.rows)), np.zeros(1, np.int64)
    return Factors(matrix, upper, lower, inverse, x, right, left, sizes, refinements)


def factorize_linear(linear: Linear, nonzeros: Array) -> int:
    """Factorize a matrix; DONE, NEW_PIVOTS or SINGULAR."""
    if linear.singular == 1:
        return SINGULAR
    if linear.plan.rows.size == 0 or not refactorize(linear.plan, linear.factors, nonzeros):
        linear.asks = 1
        return NEW_PIVOTS
    linear.factorizations += 1
    linear.fresh = 0
    return DONE


def solve_linear(linear: Linear, right: Array) -> None:
    """Solve with the last factors, in place."""
    linear.solves += 1
    solve(linear.plan, linear.factors, right)
