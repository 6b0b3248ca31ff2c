"""Choice of pivots for a sparsity pattern, and the resulting fill.

Pivots are chosen once for many matrices with the same pattern; for each matrix, `elimination` only
computes the values of the factors. Row scales and pivots depend on the values of the matrix for
which they were chosen. The fill depends only on the pattern and the pivots and is therefore cached.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU

from beamdae.bounded_cache import array_bytes, bounded_cache
from beamdae.linear.elimination import N_EXTRA_ENTRIES, EliminationPlan, empty_plan
from beamdae.linear.factorizations import (
    SingularMatrixError,
    compute_bordered_ordering,
    factorize_in_order,
    factorize_with_partial_pivoting,
    invert_to_power_of_two,
)
from beamdae.linear.lane_blocks import BlockElimination, find_blocks

Array = np.ndarray

# Largest memory of the cached orderings, and of the cached plans [bytes]. A run needs a few
# patterns; those of 3000 unknowns take about 1 MB each.
_MAX_CACHED_BYTES = 8 * 2**20


def propose_plans(pattern: sp.csc_array, nonzeros: Array) -> Iterator[EliminationPlan]:
    """Yield elimination plans for a matrix and similar matrices, the preferred plan first.

    The first plan eliminates blocks first (`lane_blocks`), if there are enough of them. The next
    plan takes pivots from the band if possible and from the border otherwise (see
    `compute_bordered_ordering`); it is sparse but may be inaccurate. The last plan uses the column
    order of SuperLU and partial pivoting.

    Parameters
    ----------
    pattern
        CSC pattern of a square matrix; its values are not used.
    nonzeros
        CSC non-zeros, real or complex.

    Raises
    ------
    SingularMatrixError
        If the matrix is singular or not finite.
    """
    size = pattern.shape[0]
    if not np.isfinite(nonzeros).all():
        raise SingularMatrixError("the matrix is not finite")
    row_counts = np.bincount(pattern.indices, minlength=size)
    if (row_counts == 0).any() or (np.diff(pattern.indptr) == 0).any():
        raise SingularMatrixError("the matrix is singular")
    key = _PatternKey.of(pattern.indptr, pattern.indices)
    scale = _compute_row_scale(key, nonzeros)
    blocks = _find_blocks(key)
    # Nothing is yielded inside `with`: an interrupt while a generator is closed there is lost.
    plan = None
    if blocks is not None:
        with suppress(RuntimeError, np.linalg.LinAlgError):
            remainder = blocks.eliminate(scale[pattern.indices] * nonzeros)
            plan = _plan_blocks(key, blocks, remainder, scale)
    if plan is not None:
        yield plan
        plan = None
    # Without the largest pivots, a matrix may become singular by rounding.
    with suppress(RuntimeError):
        bordered = _order_pattern(key)
        factors = factorize_in_order(_scale_matrix(bordered, nonzeros, scale))
        plan = _plan_pivots(key, key, bordered, factors, scale)
    if plan is not None:
        yield plan
    natural = _natural_order(key)
    try:
        factors = factorize_with_partial_pivoting(_scale_matrix(natural, nonzeros, scale))
    except RuntimeError as problem:
        raise SingularMatrixError("the matrix is singular") from problem
    yield _plan_pivots(key, key, natural, factors, scale)


class _PatternKey(NamedTuple):
    """A CSC pattern as a hashable key: its `indptr` and `indices` as bytes of int64."""

    starts: bytes
    indices: bytes

    @classmethod
    def of(cls, starts: Array, indices: Array) -> _PatternKey:
        """Return the key of a CSC pattern."""
        return cls(starts.astype(np.intp).tobytes(), indices.astype(np.intp).tobytes())

    @property
    def size(self) -> int:
        """Number of columns."""
        return len(self.starts) // np.dtype(np.intp).itemsize - 1

    def entry_numbers(self) -> sp.csc_array:
        """Return a matrix with this pattern whose entries are the indices of its non-zeros."""
        starts, indices = (np.frombuffer(x, np.intp) for x in self)
        size = len(starts) - 1
        return sp.csc_array((np.arange(len(indices)), indices, starts), shape=(size, size))


class _OrderedPattern(NamedTuple):
    """A pattern with permuted rows and columns.

    Attributes
    ----------
    order
        Permutation of rows and columns.
    starts, indices, sources
        Permuted CSC pattern, and the indices of its entries in the original CSC pattern.
    weights
        Weights by which the scaled rows are multiplied.
    """

    order: Array
    starts: Array
    indices: Array
    sources: Array
    weights: Array


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _order_pattern(key: _PatternKey) -> _OrderedPattern:
    entry_numbers = key.entry_numbers()
    ordering = compute_bordered_ordering(entry_numbers)
    permuted = sp.csc_array(entry_numbers[ordering.order][:, ordering.order])
    permuted.sort_indices()
    return _OrderedPattern(
        ordering.order, permuted.indptr, permuted.indices, permuted.data, ordering.row_weights
    )


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _find_blocks(key: _PatternKey) -> BlockElimination | None:
    return find_blocks(key.entry_numbers())


def _natural_order(key: _PatternKey) -> _OrderedPattern:
    numbers = key.entry_numbers()
    size = numbers.shape[0]
    return _OrderedPattern(
        np.arange(size), numbers.indptr, numbers.indices, numbers.data, np.ones(size)
    )


def _scale_matrix(ordered: _OrderedPattern, nonzeros: Array, scale: Array) -> sp.csc_matrix:
    weights = scale[ordered.order] * ordered.weights
    values = nonzeros[ordered.sources] * weights[ordered.indices]
    return sp.csc_matrix(
        (values, ordered.indices, ordered.starts), shape=(len(weights), len(weights))
    )


def _compute_row_scale(key: _PatternKey, nonzeros: Array) -> Array:
    """Return powers of two close to 1 / the largest magnitude in each row.

    Multipliers are unknowns without diagonal entry. Their columns count in constraints alone: their
    unit would decide which other terms of an equation are rounding errors. They count as well if
    all other terms are rounding errors beside theirs, as those of a body without stiffness.
    """
    starts, rows = (np.frombuffer(x, np.intp) for x in key)
    columns = np.repeat(np.arange(key.size), np.diff(starts))
    is_diagonal = (rows == columns) & (nonzeros != 0.0)
    has_diagonal = np.bincount(columns[is_diagonal], minlength=key.size) > 0
    sizes = np.abs(nonzeros)
    counted, largest = np.zeros((2, key.size))
    np.maximum.at(counted, rows, np.where(has_diagonal[columns] | ~has_diagonal[rows], sizes, 0.0))
    np.maximum.at(largest, rows, sizes)
    is_known = counted > np.finfo(float).eps * largest
    return invert_to_power_of_two(np.where(is_known, counted, largest))


def _plan_blocks(
    key: _PatternKey, blocks: BlockElimination, remainder: Array, scale: Array
) -> EliminationPlan:
    """Return the plan that eliminates blocks first; `remainder` holds the remaining non-zeros."""
    rest = _PatternKey.of(blocks.starts, blocks.indices)
    order = _order_pattern(rest)
    rest_scale = _compute_row_scale(rest, remainder)
    factors = factorize_in_order(_scale_matrix(order, remainder, rest_scale))
    plan = _plan_pivots(key, rest, order, factors, scale)
    return plan._replace(
        batches=blocks.batches,
        block_unknowns=blocks.block_unknowns,
        block_entries=blocks.block_entries,
        corner_entries=blocks.corner_entries,
        n_entries=blocks.n_entries,
        rows=_to_unsigned(blocks.unknowns[plan.rows]),
        columns=_to_unsigned(blocks.unknowns[plan.columns]),
        sources=_to_unsigned(blocks.sources[plan.sources]),
    )


def _plan_pivots(
    key: _PatternKey, rest: _PatternKey, ordered: _OrderedPattern, factors: SuperLU, scale: Array
) -> EliminationPlan:
    """Return the plan of a matrix without blocks, or of the rest of the matrix without them."""
    rows = ordered.order[np.argsort(factors.perm_r)]
    columns = ordered.order[np.argsort(factors.perm_c)]
    starts, matrix_rows = (_to_unsigned(np.frombuffer(x, np.intp)) for x in key)
    return _analyze_pattern(rest, rows.tobytes(), columns.tobytes())._replace(
        scale=scale,
        matrix_starts=starts,
        matrix_rows=matrix_rows,
        n_entries=len(matrix_rows) + N_EXTRA_ENTRIES,
    )


def plan_in_order(pattern: sp.csc_array, order: Array) -> EliminationPlan:
    """Return the plan of symmetric patterns with pivots in this order, as `_analyze_pattern`."""
    rows = order.astype(np.intp).tobytes()
    return _analyze_pattern(_PatternKey.of(pattern.indptr, pattern.indices), rows, rows)


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _analyze_pattern(key: _PatternKey, row_bytes: bytes, column_bytes: bytes) -> EliminationPlan:
    """Return the plan for pivots in these rows and columns, without matrix and scaling."""
    rows, columns = (np.frombuffer(x, np.intp) for x in (row_bytes, column_bytes))
    position = np.empty(len(rows), int)
    position[rows] = np.arange(len(rows))
    numbers = key.entry_numbers()
    permuted = sp.csc_array(
        (numbers.data, position[numbers.indices], numbers.indptr), shape=numbers.shape
    )[:, columns]
    upper, lower = compute_fill(permuted.indptr.tolist(), permuted.indices.tolist())
    upper_starts, upper_rows = flatten_columns(upper)
    lower_starts, lower_rows = flatten_columns(lower)
    return empty_plan()._replace(
        rows=_to_unsigned(rows),
        columns=_to_unsigned(columns),
        starts=_to_unsigned(permuted.indptr),
        positions=_to_unsigned(permuted.indices),
        sources=_to_unsigned(permuted.data),
        upper_starts=upper_starts,
        upper_rows=upper_rows,
        lower_starts=lower_starts,
        lower_rows=lower_rows,
    )


def flatten_columns(columns: list[list[int]]) -> tuple[Array, Array]:
    """Return the starts of the columns of a list of columns, and their rows."""
    starts = np.cumsum([0, *map(len, columns)])
    rows = np.fromiter(chain.from_iterable(columns), int, starts[-1])
    return _to_unsigned(starts), _to_unsigned(rows)


def _to_unsigned(numbers: Array) -> Array:
    return numbers.astype(np.uint32)


def compute_fill(starts: list[int], indices: list[int]) -> tuple[list[list[int]], list[list[int]]]:
    """Return the rows above and below the diagonal of each column of the factors, ascending.

    The result holds for arbitrary values of the entries: cancellation is not considered. A column
    contains the rows that its entries reach through the preceding columns. In each preceding
    column, only the rows down to the first symmetric entry have to be followed (Eisenstat & Liu,
    SIAM J. Matrix Anal. Appl. 13 (1992) 202).

    Parameters
    ----------
    starts, indices
        CSC pattern of the matrix; its pivots are the diagonal entries, in order.
    """
    size = len(starts) - 1
    above: list[list[int]] = []
    below: list[list[int]] = []
    followed_rows: list[list[int]] = []
    is_pruned = [False] * size
    last_visit = [-1] * size
    for j in range(size):
        last_visit[j] = j
        reached_rows = []
        stack = indices[starts[j] : starts[j + 1]]
        while stack:
            row = stack.pop()
            if last_visit[row] != j:
                last_visit[row] = j
                reached_rows.append(row)
                if row < j:
                    stack.extend(followed_rows[row])
        reached_rows.sort()
        diagonal_position = bisect_left(reached_rows, j)
        above.append(reached_rows[:diagonal_position])
        below.append(reached_rows[diagonal_position:])
        followed_rows.append(below[j])
        for k in above[j]:
            if not is_pruned[k]:
                position = bisect_left(below[k], j)
                if position < len(below[k]) and below[k][position] == j:
                    followed_rows[k] = below[k][: position + 1]
                    is_pruned[k] = True
    return above, below
