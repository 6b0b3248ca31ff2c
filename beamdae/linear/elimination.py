"""Plans for the elimination of sparse matrices with known pivots, and arrays of their factors.

An array of lanes holds the first entry of all lanes, then the second entry of all lanes, and so on.
Of complex lanes, it holds the real parts of an entry, then its imaginary parts.

The core factorizes and solves: `elimination.h`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

Array = np.ndarray

# Number of lanes.
LANES = 8

# Size of a cache line [bytes]; vectors that cross lines take twice as long to load and store.
_CACHE_LINE = 64


def aligned_zeros(size: int, dtype: Any = float) -> Array:
    """Return zeros that begin at a cache line, as arrays of lanes should."""
    itemsize = np.dtype(dtype).itemsize
    numbers = np.zeros(size + _CACHE_LINE // itemsize, dtype)
    first = -numbers.ctypes.data % _CACHE_LINE // itemsize
    return numbers[first : first + size]


class EliminationPlan(NamedTuple):
    """Pivots of a matrix and the pattern of its factors.

    Blocks of unknowns are eliminated first, several at a time (`lane_blocks`). The other unknowns
    are eliminated one by one; their position is their index in the order of elimination.

    Attributes
    ----------
    scale
        Scale factors of all rows.
    matrix_starts, matrix_rows
        CSC pattern of the matrix.
    batches
        One row per batch of blocks, with `N_BATCH_COLUMNS` numbers.
    block_unknowns
        Indices of the unknowns of the blocks: interior, then neighbors, each with one index per
        lane. Lanes without a block have the index after the last unknown.
    block_entries
        Indices of the entries of the blocks in `Factors.entries`, column by column: all rows of the
        interior unknowns, then the interior rows of the neighbors.
    corner_entries
        Indices of the entries in rows and columns of neighbors, which the blocks change.
    n_entries
        Number of `Factors.entries`: non-zeros of the matrix, its fill by blocks, and
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
    n_entries: int
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
N_BATCH_COLUMNS = 6
NEIGHBORS = 1
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
    fields: dict[str, Any] = dict.fromkeys(EliminationPlan._fields, np.zeros(0, np.uint32))
    batches = np.zeros((0, N_BATCH_COLUMNS), np.intp)
    fields |= {"scale": np.zeros(0), "batches": batches, "n_entries": N_EXTRA_ENTRIES}
    return EliminationPlan(**fields)


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
        entries=np.zeros(plan.n_entries, dtype),
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
