"""Factorization of several matrices with the same pivots, one matrix per vector lane.

The matrices of successive steps of a known run do not depend on each other. In compiled code, one
vector instruction therefore eliminates the same entry of `LANES` matrices: blocks and other pivots
in the order of `elimination`, whose `solve` then uses the factors of one matrix at a time. The
functions are plain loops over arrays, as in `elimination`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from beamdae.linear.elimination import (
    FIRST_CORNER,
    FIRST_ENTRY,
    FIRST_UNKNOWN,
    INTERIOR,
    N_EXTRA_ENTRIES,
    NEIGHBORS,
    ONE_ENTRY,
    EliminationPlan,
    Factors,
    empty_plan,
    find_refinements,
)
from beamdae.linear.lane_operations import (
    LANES,
    aligned_zeros,
    invert_lanes,
    multiply_lanes,
    subtract_lanes,
    subtract_products,
    subtract_unit_triangle,
)
from beamdae.native.linear_solver import LinearSolver
from beamdae.native.loop_functions import TILE_ROWS, add_tiles, combine, fill, pick_tiles
from beamdae.native.return_codes import DONE, NEW_PIVOTS, SINGULAR

Array = np.ndarray

# Entries of `BatchFactors.numbers`.
_ZERO = 0
_ONE = 1
_MINUS_ONE = 2
_NEGATIVE_INVERSE = 3
_COUNT = 4


class BatchFactors(NamedTuple):
    """Factors of `LANES` matrices; arrays of lanes have one matrix per lane.

    Attributes
    ----------
    scales
        Scale factors of the non-zeros.
    matrices
        Non-zeros of the matrices with scaled rows, one matrix after the other, each of `widths[0]`
        numbers.
    entries, x
        As in `Factors`, with lanes.
    blocks, corner
        Factors of one batch of blocks, and their contributions to other equations, block by block,
        with lanes.
    pivots
        `Factors.upper`, `lower` and `inverse`, one after the other, with lanes.
    numbers
        0, 1, -1, and the negative reciprocal of the current pivot, with lanes.
    results
        `Factors.blocks`, `upper`, `lower` and `inverse` of one matrix after the other, each of
        `widths[1]` numbers.
    widths
        See above, shape (2,).
    matrix_tiles, block_tiles, pivot_tiles
        Tiles that move numbers between `matrices` and `entries`, `blocks` and `results`, `pivots`
        and `results`; see `loop_functions.pick_tiles`.
    """

    scales: Array
    matrices: Array
    entries: Array
    x: Array
    blocks: Array
    corner: Array
    pivots: Array
    numbers: Array
    results: Array
    widths: Array
    matrix_tiles: Array
    block_tiles: Array
    pivot_tiles: Array


def allocate_batch(plan: EliminationPlan) -> BatchFactors:
    """Return zero arrays for the factors of real matrices with the pivots of a plan."""
    batches = plan.batches
    neighbors = int(batches[:, NEIGHBORS].max(initial=0))
    counts = _count_entries(batches)
    n_pivots = len(plan.upper_rows) + len(plan.lower_rows) + len(plan.rows)
    n_blocks = len(plan.block_entries)
    # Tiles read and write all their rows, also those beyond the last number.
    width = len(plan.matrix_rows) + TILE_ROWS
    result_width = n_blocks + n_pivots + TILE_ROWS
    numbers = aligned_zeros(LANES * _COUNT)
    numbers[LANES * _ONE : LANES * (_ONE + 1)] = 1.0
    numbers[LANES * _MINUS_ONE : LANES * (_MINUS_ONE + 1)] = -1.0
    return BatchFactors(
        scales=plan.scale[plan.matrix_rows],
        matrices=np.zeros(LANES * width),
        entries=aligned_zeros(LANES * int(plan.n_entries[0])),
        corner=aligned_zeros(LANES * LANES * neighbors * neighbors),
        x=aligned_zeros(LANES * len(plan.rows)),
        blocks=aligned_zeros(LANES * LANES * int(counts.max(initial=0))),
        pivots=aligned_zeros(LANES * n_pivots),
        numbers=numbers,
        results=np.zeros(LANES * result_width),
        widths=np.array([width, result_width]),
        matrix_tiles=_tile_rows(len(plan.matrix_rows), 0, width),
        block_tiles=_tile_blocks(batches, counts, result_width),
        pivot_tiles=_tile_rows(n_pivots, n_blocks, result_width),
    )


def _count_entries(batches: Array) -> Array:
    """Return the number of entries of one block of each batch."""
    interior, neighbors = batches[:, INTERIOR], batches[:, NEIGHBORS]
    return interior * (interior + 2 * neighbors)


def _tile_rows(count: int, first: int, width: int) -> Array:
    """Return tiles for `count` numbers of each lane, from `first` on in rows of `width` numbers."""
    begin = np.arange(0, count, TILE_ROWS)
    lanes = first + begin[:, None] + width * np.arange(LANES)
    heights = np.minimum(TILE_ROWS, count - begin)
    return np.column_stack([LANES * begin, heights, lanes]).astype(np.uint32)


def _tile_blocks(batches: Array, counts: Array, width: int) -> Array:
    """Return tiles of the blocks of all batches: `TILE_ROWS` blocks of an entry each."""
    tables = [np.zeros((0, 2 + LANES), int)]
    for first, count in zip(batches[:, FIRST_ENTRY], counts, strict=True):
        entry, block = (
            x.ravel() for x in np.mgrid[0:count, 0 : LANES // TILE_ROWS] * [[[1]], [[TILE_ROWS]]]
        )
        lanes = (LANES * (first + entry) + block)[:, None] + width * np.arange(LANES)
        starts = LANES * (block * count + entry)
        tables.append(np.column_stack([starts, np.full(len(entry), TILE_ROWS), lanes]))
    return np.ascontiguousarray(np.vstack(tables), np.uint32)


def stage_matrix(batch: BatchFactors, lane: int, nonzeros: Array) -> None:
    """Set the matrix of a lane to the one with these CSC non-zeros."""
    scales, first = batch.scales, lane * batch.widths[0]
    matrix = batch.matrices[first : first + len(scales)]
    for e in range(len(scales)):
        matrix[e] = scales[e] * nonzeros[e]


def restore_matrix(batch: BatchFactors, lane: int, nonzeros: Array) -> None:
    """Set `nonzeros` to the matrix of a lane; exact, because scale factors are powers of two."""
    scales, first = batch.scales, lane * batch.widths[0]
    matrix = batch.matrices[first : first + len(scales)]
    for e in range(len(scales)):
        nonzeros[e] = matrix[e] / scales[e]


def eliminate_batch(
    plan: EliminationPlan, factors: Factors, batch: BatchFactors, count: int, is_tested: bool
) -> int:
    """Factorize all staged matrices, and select the factors of the first one.

    Return the index of the first of `count` matrices for which the pivots are unsuitable, see
    `refactorize`, or -1. If `is_tested`, the accuracy of solutions with the first matrix is tested;
    it changes as slowly as the matrices.
    """
    entries, tiles = batch.entries, batch.matrix_tiles
    pick_tiles(entries, 0, LANES, batch.matrices, tiles, 0, len(tiles))
    n_entries, n_nonzeros = plan.n_entries[0], len(plan.matrix_rows)
    fill(entries[LANES * n_nonzeros :], 0.0)
    _add_entry(entries, n_entries - N_EXTRA_ENTRIES + ONE_ENTRY, batch.numbers, _ONE, batch.numbers)
    fill(batch.results, 0.0)
    _eliminate_blocks(plan, batch)
    _eliminate(plan, batch)
    tiles = batch.pivot_tiles
    add_tiles(batch.results, batch.pivots, LANES, tiles, 0, len(tiles))
    for lane in range(count):
        if not _is_finite(plan, batch, lane):
            return lane
    select_factors(plan, factors, batch, 0)
    if not is_tested:
        return -1
    combine(factors.matrix, (1.0,), (batch.matrices[: len(factors.matrix)],))
    return -1 if find_refinements(plan, factors) else 0


def select_factors(plan: EliminationPlan, factors: Factors, batch: BatchFactors, lane: int) -> None:
    """Set `factors` to those of a lane, with the refinements of the last test."""
    begin = lane * batch.widths[1]
    end = begin + len(factors.blocks)
    combine(factors.blocks, (1.0,), (batch.results[begin:end],))
    begin, end = end, end + len(factors.upper)
    combine(factors.upper, (1.0,), (batch.results[begin:end],))
    begin, end = end, end + len(factors.lower)
    combine(factors.lower, (1.0,), (batch.results[begin:end],))
    begin, end = end, end + len(factors.inverse)
    combine(factors.inverse, (1.0,), (batch.results[begin:end],))
    if factors.refinements[0] > 0:
        first = lane * batch.widths[0]
        matrix = batch.matrices[first : first + len(factors.matrix)]
        combine(factors.matrix, (1.0,), (matrix,))


def _add_entry(out: Array, k: int, lanes: Array, j: int, numbers: Array) -> None:
    """Add entry `j` of `lanes` to entry `k` of `out`."""
    subtract_products(out, k, 1, lanes, j, 1, numbers, _MINUS_ONE, 1)


def _signed(index: Any) -> Any:
    """Return an unsigned index as a signed one: numba would convert their sums to floats."""
    return np.int64(index)


def _eliminate_blocks(plan: EliminationPlan, batch: BatchFactors) -> None:
    """Factorize all blocks, one after the other; see `elimination`."""
    entries, blocks, corner = batch.entries, batch.blocks, batch.corner
    numbers, block_entries, corner_entries = batch.numbers, plan.block_entries, plan.corner_entries
    batches, block_unknowns = plan.batches, plan.block_unknowns
    padding, tile = len(plan.scale), 0
    for k in range(batches.shape[0]):
        interior, neighbors = batches[k, INTERIOR], batches[k, NEIGHBORS]
        size, count = interior + neighbors, interior * (interior + 2 * neighbors)
        entry = LANES * batches[k, FIRST_ENTRY]
        corner_size = neighbors * neighbors
        fill(blocks[: LANES * LANES * count], 0.0)
        fill(corner[: LANES * LANES * corner_size], 0.0)
        for block in range(LANES):
            first = block * count
            for i in range(count):
                source = _signed(block_entries[entry + LANES * i + block])
                _add_entry(blocks, first + i, entries, source, numbers)
            # Lanes without a block contain the identity.
            if block_unknowns[LANES * batches[k, FIRST_UNKNOWN] + block] == padding:
                continue
            left = first + interior
            for j in range(interior):
                column = first + j * size
                subtract_unit_triangle(blocks, column, j, interior, blocks, first, size)
                below = column + interior
                subtract_products(blocks, below, neighbors, blocks, left, size, blocks, column, j)
                invert_lanes(blocks, column + j)
                multiply_lanes(blocks, column + j + 1, size - j - 1, blocks, column + j)
            for j in range(neighbors):
                column = first + interior * size + j * interior
                below = block * corner_size + j * neighbors
                subtract_unit_triangle(blocks, column, interior, interior, blocks, first, size)
                subtract_products(
                    corner, below, neighbors, blocks, left, size, blocks, column, interior
                )
        # In the order of `elimination`, so that rounding errors are the same.
        start = LANES * batches[k, FIRST_CORNER]
        for i in range(corner_size):
            for block in range(LANES):
                target = _signed(corner_entries[start + LANES * i + block])
                _add_entry(entries, target, corner, block * corner_size + i, numbers)
        end = tile + LANES // TILE_ROWS * count
        add_tiles(batch.results, blocks, LANES * count, batch.block_tiles, tile, end)
        tile = end


def _eliminate(plan: EliminationPlan, batch: BatchFactors) -> None:
    """Factorize the equations of the unknowns outside blocks; see `elimination`."""
    starts, positions, sources = plan.starts, plan.positions, plan.sources
    upper_starts, upper_rows = plan.upper_starts, plan.upper_rows
    lower_starts, lower_rows = plan.lower_starts, plan.lower_rows
    entries, pivots, x, numbers = batch.entries, batch.pivots, batch.x, batch.numbers
    first_lower = len(upper_rows)
    first_inverse, size = first_lower + len(lower_rows), len(plan.rows)
    fill(pivots, 0.0)
    fill(x, 0.0)
    for j in range(size):
        for e in range(_signed(starts[j]), _signed(starts[j + 1])):
            _add_entry(x, _signed(positions[e]), entries, _signed(sources[e]), numbers)
        for p in range(_signed(upper_starts[j]), _signed(upper_starts[j + 1])):
            k = _signed(upper_rows[p])
            for q in range(_signed(lower_starts[k]), _signed(lower_starts[k + 1])):
                subtract_lanes(x, _signed(lower_rows[q]), 1, pivots, first_lower + q, k)
            _add_entry(pivots, p, x, k, numbers)
            multiply_lanes(x, k, 1, numbers, _ZERO)
        fill(numbers[LANES * _NEGATIVE_INVERSE : LANES * (_NEGATIVE_INVERSE + 1)], 0.0)
        subtract_products(numbers, _NEGATIVE_INVERSE, 1, x, j, 1, numbers, _ONE, 1)
        invert_lanes(numbers, _NEGATIVE_INVERSE)
        subtract_products(
            pivots, first_inverse + j, 1, numbers, _NEGATIVE_INVERSE, 1, numbers, _ONE, 1
        )
        multiply_lanes(x, j, 1, numbers, _ZERO)
        for q in range(_signed(lower_starts[j]), _signed(lower_starts[j + 1])):
            row = _signed(lower_rows[q])
            subtract_products(pivots, first_lower + q, 1, x, row, 1, numbers, _NEGATIVE_INVERSE, 1)
            multiply_lanes(x, row, 1, numbers, _ZERO)


def _is_finite(plan: EliminationPlan, batch: BatchFactors, lane: int) -> bool:
    """Return True if all pivots of a lane and their reciprocals are finite."""
    end = lane * batch.widths[1] + len(plan.block_entries)
    end += len(plan.upper_rows) + len(plan.lower_rows) + len(plan.rows)
    for k in range(end - len(plan.rows), end):
        inverse = batch.results[k]
        # The reciprocal of an infinite pivot is 0.
        if inverse == 0.0 or not np.isfinite(inverse):
            return False
    return True


@dataclass(slots=True)
class BatchSolver(LinearSolver):
    """Linear solver that can factorize the matrices of `LANES` steps together.

    Attributes
    ----------
    batch
        Factors of several matrices.
    """

    batch: BatchFactors = field(default_factory=lambda: allocate_batch(empty_plan()))

    def set_plan(self, plan: EliminationPlan) -> None:
        """Use the pivots of another plan, and allocate its factors."""
        LinearSolver.set_plan(self, plan)
        self.batch = allocate_batch(plan)


def factorize_staged(linear: BatchSolver, nonzeros: Array, count: int, is_tested: bool) -> int:
    """Factorize the first `count` staged matrices; return DONE, NEW_PIVOTS or SINGULAR.

    If `is_tested`, the accuracy of the first factors is tested, see `eliminate_batch`. If new
    pivots are needed, `nonzeros` is set to the matrix that needs them.
    """
    if linear.singular == 1:
        return SINGULAR
    lane = eliminate_batch(linear.plan, linear.factors, linear.batch, count, is_tested)
    if lane >= 0:
        restore_matrix(linear.batch, lane, nonzeros)
        linear.needs_pivots = 1
        return NEW_PIVOTS
    linear.factorizations += count
    linear.is_untried = 0
    return DONE
