"""Factorization of sparse matrices with known pivots and fill, and solution of systems.

`refactorize` and `solve` are plain loops over arrays that numba can compile: they do not allocate,
raise or call Python. The matrix is eliminated column by column from the left with the pivots of an
`EliminationPlan`, as in the refactorization of KLU (Davis & Palamadai Natarajan, ACM Trans. Math.
Softw. 37 (2010) 36).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from beamdae.linear.lane_operations import (
    LANES,
    add_entry,
    add_lanes,
    aligned_zeros,
    clear_lanes,
    gather_lanes,
    invert_lanes,
    multiply_lanes,
    set_entry,
    substitute_backward,
    substitute_forward,
    subtract_products,
    subtract_unit_triangle,
)

Array = np.ndarray

# A solution is accurate if its backward error does not exceed this value.
MAX_BACKWARD_ERROR = 1e-10
# Pivots that require more steps of iterative refinement are rejected.
MAX_REFINEMENTS = 2


class EliminationPlan(NamedTuple):
    """Pivots of a matrix and the pattern of its factors.

    Blocks of unknowns are eliminated first, several at a time (`lane_blocks`). The other unknowns
    are eliminated one by one; their position is their index in the order of elimination. Integers
    are unsigned, so that compiled loops need not check for negative indices.

    Attributes
    ----------
    scale
        Scale factors of all rows.
    matrix_starts, matrix_rows
        CSC pattern of the matrix.
    batches
        One row per batch of blocks, with the columns `INTERIOR` to `FIRST_CORNER`.
    block_unknowns
        Indices of the unknowns of the blocks: interior, then neighbors, each with one index per
        lane. Lanes without a block have the index after the last unknown.
    block_entries
        Indices of the entries of the blocks in `Factors.entries`, column by column: all rows of the
        interior unknowns, then the interior rows of the neighbors.
    corner_entries
        Indices of the entries in rows and columns of neighbors, which the blocks change.
    n_entries
        Number of `Factors.entries`, shape (1,): non-zeros of the matrix, its fill by blocks, and
        `N_EXTRA_ENTRIES` that stand for zeros, ones and unused entries.
    rows, columns
        Rows and columns of the other pivots, by position.
    starts, positions, sources
        Columns of the matrix after the elimination of the blocks, by position: their starts, the
        positions of their rows, and their indices in `Factors.entries`.
    upper_starts, upper_rows, lower_starts, lower_rows
        Columns of the factors above and below the diagonal: their starts, and the positions of
        their rows, ascending.
    """

    scale: Array
    matrix_starts: Array
    matrix_rows: Array
    batches: Array
    block_unknowns: Array
    block_entries: Array
    corner_entries: Array
    n_entries: Array
    rows: Array
    columns: Array
    starts: Array
    positions: Array
    sources: Array
    upper_starts: Array
    upper_rows: Array
    lower_starts: Array
    lower_rows: Array


# Columns of `EliminationPlan.batches`: numbers of interior unknowns and of neighbors of each block;
# number of neighbors, the last ones, that all blocks of the batch share; and the first index of the
# batch, divided by the number of lanes, in `block_unknowns` (and `Factors.block_x`), in
# `block_entries` (and `Factors.blocks`) and in `corner_entries`.
INTERIOR = 0
NEIGHBORS = 1
SHARED = 2
FIRST_UNKNOWN = 3
FIRST_ENTRY = 4
FIRST_CORNER = 5
# Last entries of `Factors.entries`: a zero, a one, and an entry for numbers that are not used.
ZERO_ENTRY = 0
ONE_ENTRY = 1
UNUSED_ENTRY = 2
N_EXTRA_ENTRIES = 3


class Factors(NamedTuple):
    """Factors of the last matrix; the next factorization overwrites them.

    Attributes
    ----------
    matrix
        Non-zeros of the matrix with scaled rows.
    entries
        The same entries after the elimination of the blocks, see `EliminationPlan.n_entries`.
    blocks, corner, block_x
        Factors of the blocks, contributions of a batch to other equations, and solutions of the
        equations of the blocks.
    upper, lower, inverse
        Entries of the factors above and below the diagonal, and the reciprocals of the pivots.
    x
        Work array by position.
    solution, right, residual, terms
        Work arrays by row or unknown, with one more entry.
    refinements
        Number of steps of iterative refinement per solution, shape (1,).
    """

    matrix: Array
    entries: Array
    blocks: Array
    corner: Array
    block_x: Array
    upper: Array
    lower: Array
    inverse: Array
    x: Array
    solution: Array
    right: Array
    residual: Array
    terms: Array
    refinements: Array


def empty_plan() -> EliminationPlan:
    """Return the plan of a matrix without rows."""
    none = np.zeros(0, np.uint32)
    batches, n_entries = np.zeros((0, 6), np.intp), np.array([N_EXTRA_ENTRIES])
    plan = EliminationPlan(*(none for _ in EliminationPlan._fields))
    return plan._replace(scale=np.zeros(0), batches=batches, n_entries=n_entries)


def allocate_factors(plan: EliminationPlan, dtype: Any) -> Factors:
    """Return zero arrays for the factors of a plan."""
    patterns = (plan.matrix_rows, plan.block_entries, plan.block_unknowns)
    matrix, blocks, block_x = (aligned_zeros(len(rows), dtype) for rows in patterns)
    upper, lower = (np.zeros(len(rows), dtype) for rows in (plan.upper_rows, plan.lower_rows))
    inverse, x = np.zeros((2, len(plan.rows)), dtype)
    solution, right, residual = np.zeros((3, len(plan.scale) + 1), dtype)
    largest = int(plan.batches[:, NEIGHBORS].max(initial=0))
    return Factors(
        matrix=matrix,
        entries=np.zeros(int(plan.n_entries[0]), dtype),
        blocks=blocks,
        corner=aligned_zeros(LANES * largest * largest, dtype),
        block_x=block_x,
        upper=upper,
        lower=lower,
        inverse=inverse,
        x=x,
        solution=solution,
        right=right,
        residual=residual,
        terms=np.zeros(len(plan.scale)),
        refinements=np.zeros(1, np.intp),
    )


def refactorize(plan: EliminationPlan, factors: Factors, nonzeros: Array) -> bool:
    """Factorize the matrix with these CSC non-zeros; return False if the pivots are unsuitable.

    Pivots are unsuitable if one of them or its reciprocal is not finite, or if refinement does not
    make solutions accurate. Each matrix is tested: a pivot may vanish at any step of a motion.
    """
    _scale_matrix(plan, factors, nonzeros)
    _eliminate_blocks(plan, factors)
    is_finite = eliminate_columns(plan, factors, factors.entries)
    return is_finite and find_refinements(plan, factors)


def solve(plan: EliminationPlan, factors: Factors, right: Array) -> None:
    """Replace `right` by the solution; apply the refinements that `refactorize` found necessary."""
    scale, solution, residual = plan.scale, factors.solution, factors.residual
    size = len(scale)
    for i in range(size):
        solution[i] = scale[i] * right[i]
    if factors.refinements[0] > 0:
        for i in range(size):
            factors.right[i] = solution[i]
    _solve_scaled(plan, factors, solution)
    for _ in range(factors.refinements[0]):
        _update_residual(
            plan.matrix_starts,
            plan.matrix_rows,
            factors.matrix,
            solution,
            factors.right,
            residual,
            factors.terms,
        )
        _solve_scaled(plan, factors, residual)
        for i in range(size):
            solution[i] += residual[i]
    for i in range(size):
        right[i] = solution[i]


def _scale_matrix(plan: EliminationPlan, factors: Factors, nonzeros: Array) -> None:
    scale, rows, matrix, entries = plan.scale, plan.matrix_rows, factors.matrix, factors.entries
    for e in range(len(matrix)):
        entries[e] = matrix[e] = scale[rows[e]] * nonzeros[e]
    for e in range(len(matrix), len(entries)):
        entries[e] = 0.0
    entries[len(entries) - N_EXTRA_ENTRIES + ONE_ENTRY] = 1.0


def eliminate_interior(
    blocks: Array, first: int, interior: int, neighbors: int, corner: Array, corner_first: int
) -> None:
    """Factorize one block per lane without pivoting, and add its contribution to `corner`.

    The factors replace the entries from `first` on: columns of the interior unknowns, then interior
    rows of the neighbors. Pivots are inverted.
    """
    size, left = interior + neighbors, first + interior
    for j in range(interior):
        column = first + j * size
        subtract_unit_triangle(blocks, column, j, interior, blocks, first, size)
        below = column + interior
        subtract_products(blocks, below, neighbors, blocks, left, size, blocks, column, j)
        invert_lanes(blocks, column + j)
        multiply_lanes(blocks, column + j + 1, size - j - 1, blocks, column + j)
    for j in range(neighbors):
        column, below = first + interior * size + j * interior, corner_first + j * neighbors
        subtract_unit_triangle(blocks, column, interior, interior, blocks, first, size)
        subtract_products(corner, below, neighbors, blocks, left, size, blocks, column, interior)


def _eliminate_blocks(plan: EliminationPlan, factors: Factors) -> None:
    """Factorize the blocks without pivoting, and subtract their contributions from `entries`."""
    entries, blocks, corner, at = (
        factors.entries,
        factors.blocks,
        factors.corner,
        plan.block_entries,
    )
    for batch in range(plan.batches.shape[0]):
        interior, neighbors = plan.batches[batch, INTERIOR], plan.batches[batch, NEIGHBORS]
        first, size = plan.batches[batch, FIRST_ENTRY], interior + neighbors
        gather_lanes(blocks, first, interior * (size + neighbors), entries, at, first)
        clear_lanes(corner, 0, neighbors * neighbors)
        eliminate_interior(blocks, first, interior, neighbors, corner, 0)
        target = plan.batches[batch, FIRST_CORNER]
        add_lanes(entries, plan.corner_entries, target, corner, 0, neighbors * neighbors)


def _solve_scaled(plan: EliminationPlan, factors: Factors, right: Array) -> None:
    """Replace the scaled right-hand side by the solution, without refinement."""
    blocks, block_x, at, batches = (
        factors.blocks,
        factors.block_x,
        plan.block_unknowns,
        plan.batches,
    )
    rows, columns, x = plan.rows, plan.columns, factors.x
    # Read and written by lanes without a block.
    right[len(right) - 1] = 0.0
    for batch in range(batches.shape[0]):
        substitute_forward(
            right,
            at,
            block_x,
            batches[batch, FIRST_UNKNOWN],
            blocks,
            batches[batch, FIRST_ENTRY],
            batches[batch, INTERIOR],
            batches[batch, NEIGHBORS],
            batches[batch, SHARED],
        )
    for k in range(len(x)):
        x[k] = right[rows[k]]
    substitute_triangles(
        plan.lower_starts,
        plan.lower_rows,
        factors.lower,
        plan.upper_starts,
        plan.upper_rows,
        factors.upper,
        factors.inverse,
        x,
    )
    for k in range(len(x)):
        right[columns[k]] = x[k]
    for back in range(batches.shape[0]):
        batch = batches.shape[0] - 1 - back
        substitute_backward(
            right,
            at,
            block_x,
            batches[batch, FIRST_UNKNOWN],
            blocks,
            batches[batch, FIRST_ENTRY],
            batches[batch, INTERIOR],
            batches[batch, NEIGHBORS],
            batches[batch, SHARED],
        )


def eliminate_columns(plan: Any, factors: Any, entries: Array) -> bool:
    """Factorize the columns of a plan, with numbers `entries`; return False if impossible.

    `plan` and `factors` are an `EliminationPlan` and `Factors`, whose unknowns outside blocks are
    eliminated, or have their attributes. A pivot and its reciprocal must be finite.
    """
    starts, positions, sources = plan.starts, plan.positions, plan.sources
    upper_starts, upper_rows = plan.upper_starts, plan.upper_rows
    lower_starts, lower_rows = plan.lower_starts, plan.lower_rows
    upper, lower, x = factors.upper, factors.lower, factors.x
    for j in range(len(x)):
        x[j] = 0.0
    for j in range(len(x)):
        for e in range(starts[j], starts[j + 1]):
            x[positions[e]] = entries[sources[e]]
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


def substitute_triangles(
    lower_starts: Array,
    lower_rows: Array,
    lower: Array,
    upper_starts: Array,
    upper_rows: Array,
    upper: Array,
    inverse: Array,
    x: Array,
) -> None:
    """Replace `x` by the solution with the factors `lower`, `upper` and the inverses of pivots.

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


def substitute_triangles_in_lanes(plan: EliminationPlan, factors: Factors, x: Array) -> None:
    """Replace all lanes of `x` by the solutions of systems without blocks, by position."""
    lower_starts, lower_rows, lower = plan.lower_starts, plan.lower_rows, factors.lower
    upper_starts, upper_rows, upper = plan.upper_starts, plan.upper_rows, factors.upper
    size = len(plan.rows)
    for k in range(size):
        for q in range(lower_starts[k], lower_starts[k + 1]):
            add_entry(x, lower_rows[q], x, k, -lower[q])
    for back in range(size):
        k = size - 1 - back
        set_entry(x, k, x, k, factors.inverse[k])
        for p in range(upper_starts[k], upper_starts[k + 1]):
            add_entry(x, upper_rows[p], x, k, -upper[p])


def find_refinements(plan: EliminationPlan, factors: Factors) -> bool:
    """Set the number of refinements; return False if `MAX_REFINEMENTS` are not enough.

    The measure is the backward error of Oettli & Prager, relative to the terms of each equation,
    for a solution to which all columns contribute equally.
    """
    starts, rows, matrix = plan.matrix_starts, plan.matrix_rows, factors.matrix
    x, right, residual = factors.solution, factors.right, factors.residual
    size = len(plan.scale)
    for i in range(size):
        x[i] = right[i] = 0.0
    for j in range(size):
        largest = 0.0
        for e in range(starts[j], starts[j + 1]):
            largest = max(largest, _estimate_modulus(matrix[e]))
        exact = 1.0 / largest
        for e in range(starts[j], starts[j + 1]):
            right[rows[e]] += matrix[e] * exact
    for i in range(size):
        residual[i] = right[i]
    for refinements in range(MAX_REFINEMENTS + 1):
        _solve_scaled(plan, factors, residual)
        for i in range(size):
            x[i] += residual[i]
        if _update_residual(starts, rows, matrix, x, right, residual, factors.terms):
            factors.refinements[0] = refinements
            return True
    return False


def _update_residual(
    starts: Array,
    rows: Array,
    matrix: Array,
    x: Array,
    right: Array,
    residual: Array,
    terms: Array,
) -> bool:
    """Set `residual` to right - matrix @ x; return True if `x` is accurate.

    Also set `terms` to the sums of the magnitudes of all terms in each equation.
    """
    count = len(terms)
    for k in range(count):
        residual[k] = right[k]
        terms[k] = _estimate_modulus(right[k])
    for j in range(count):
        value = x[j]
        size = _estimate_modulus(value)
        for e in range(starts[j], starts[j + 1]):
            row = rows[e]
            residual[row] -= matrix[e] * value
            terms[row] += _estimate_modulus(matrix[e]) * size
    is_solved = True
    for k in range(count):
        # This comparison is False for NaN.
        is_solved &= _estimate_modulus(residual[k]) <= MAX_BACKWARD_ERROR * terms[k]
    return is_solved


def _estimate_modulus(value: complex) -> float:
    """Return |real| + |imaginary|: 1 to 1.42 times the modulus, but much cheaper to compute."""
    return abs(value.real) + abs(value.imag)
