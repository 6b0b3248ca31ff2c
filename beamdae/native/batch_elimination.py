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
    eliminate_interior,
    empty_plan,
    find_refinements,
)
from beamdae.linear.lane_operations import (
    LANES,
    add_entry,
    aligned_zeros,
    invert_lanes,
    multiply_lanes,
    set_entry,
    subtract_lanes,
)
from beamdae.native.linear_solver import LinearSolver
from beamdae.native.loop_functions import TILE_ROWS, combine, fill, set_tiles

Array = np.ndarray


class BatchFactors(NamedTuple):
    """Factors of `LANES` matrices; arrays of lanes have one matrix per lane.

    Attributes
    ----------
    scales
        Scale factors of the non-zeros.
    entries, x
        As in `Factors`, with lanes. Before a factorization, the first entries are set to the
        non-zeros of the matrices.
    matrices
        Non-zeros of the matrices with scaled rows, with lanes.
    blocks, corner
        Factors of one batch of blocks, and their contributions to other equations, block by block,
        with lanes.
    pivots
        `Factors.upper`, `lower` and `inverse`, one after the other, with lanes.
    results
        `Factors.blocks`, `upper`, `lower` and `inverse` of one matrix after the other, each of
        `width[0]` numbers.
    width
        See above, shape (1,).
    block_tiles, pivot_tiles
        Tiles that move numbers from `blocks` and `pivots` to `results`; see
        `loop_functions.set_tiles`.
    """

    scales: Array
    entries: Array
    matrices: Array
    x: Array
    blocks: Array
    corner: Array
    pivots: Array
    results: Array
    width: Array
    block_tiles: Array
    pivot_tiles: Array


def allocate_batch(plan: EliminationPlan) -> BatchFactors:
    """Return zero arrays for the factors of real matrices with the pivots of a plan."""
    batches = plan.batches
    neighbors = int(batches[:, NEIGHBORS].max(initial=0))
    counts = _count_entries(batches)
    n_pivots = len(plan.upper_rows) + len(plan.lower_rows) + len(plan.rows)
    n_blocks = len(plan.block_entries)
    # Tiles write all their rows, also those beyond the last number.
    width = n_blocks + n_pivots + TILE_ROWS
    return BatchFactors(
        scales=plan.scale[plan.matrix_rows],
        entries=aligned_zeros(LANES * int(plan.n_entries[0])),
        matrices=aligned_zeros(LANES * len(plan.matrix_rows)),
        corner=aligned_zeros(LANES * LANES * neighbors * neighbors),
        x=aligned_zeros(LANES * len(plan.rows)),
        blocks=aligned_zeros(LANES * LANES * int(counts.max(initial=0))),
        pivots=aligned_zeros(LANES * n_pivots),
        results=np.zeros(LANES * width),
        width=np.array([width]),
        block_tiles=_tile_blocks(batches, counts, width),
        pivot_tiles=_tile_rows(n_pivots, n_blocks, width),
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


def read_matrix(batch: BatchFactors, lane: int, matrix: Array) -> None:
    """Set `matrix` to the scaled non-zeros of a lane."""
    for e in range(len(matrix)):
        matrix[e] = batch.matrices[LANES * e + lane]


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


def factorize_batch(linear: BatchSolver) -> None:
    """Factorize the matrices in `batch.entries`; `select_factors` tests the factors."""
    plan, batch = linear.plan, linear.batch
    entries, n_entries, scales = batch.entries, plan.n_entries[0], batch.scales
    for e in range(len(scales)):
        set_entry(entries, e, entries, e, scales[e])
    combine(batch.matrices, (1.0,), (entries[: len(batch.matrices)],))
    fill(entries[len(batch.matrices) :], 0.0)
    one = n_entries - N_EXTRA_ENTRIES + ONE_ENTRY
    fill(entries[LANES * one : LANES * (one + 1)], 1.0)
    _eliminate_blocks(plan, batch)
    _eliminate(plan, batch)
    tiles = batch.pivot_tiles
    set_tiles(batch.results, batch.pivots, LANES, tiles, 0, len(tiles))
    linear.factorizations += LANES


def select_factors(linear: BatchSolver, lane: int) -> bool:
    """Use the factors of a lane; return False if the pivots are unsuitable for its matrix.

    See `elimination.refactorize`.
    """
    factors, batch = linear.factors, linear.batch
    begin = lane * batch.width[0]
    end = begin + len(factors.blocks)
    combine(factors.blocks, (1.0,), (batch.results[begin:end],))
    begin, end = end, end + len(factors.upper)
    combine(factors.upper, (1.0,), (batch.results[begin:end],))
    begin, end = end, end + len(factors.lower)
    combine(factors.lower, (1.0,), (batch.results[begin:end],))
    begin, end = end, end + len(factors.inverse)
    combine(factors.inverse, (1.0,), (batch.results[begin:end],))
    read_matrix(batch, lane, factors.matrix)
    return find_refinements(linear.plan, factors)


def _signed(index: Any) -> Any:
    """Return an unsigned index as a signed one: numba would convert their sums to floats."""
    return np.int64(index)


def _eliminate_blocks(plan: EliminationPlan, batch: BatchFactors) -> None:
    """Factorize all blocks, one after the other; see `elimination`."""
    entries, blocks, corner = batch.entries, batch.blocks, batch.corner
    block_entries, corner_entries = plan.block_entries, plan.corner_entries
    batches, block_unknowns = plan.batches, plan.block_unknowns
    padding, tile = len(plan.scale), 0
    for k in range(batches.shape[0]):
        interior, neighbors = batches[k, INTERIOR], batches[k, NEIGHBORS]
        count = interior * (interior + 2 * neighbors)
        entry = LANES * batches[k, FIRST_ENTRY]
        corner_size = neighbors * neighbors
        fill(corner[: LANES * LANES * corner_size], 0.0)
        for block in range(LANES):
            first = block * count
            for i in range(count):
                source = _signed(block_entries[entry + LANES * i + block])
                set_entry(blocks, first + i, entries, source, 1.0)
            # Lanes without a block contain the identity.
            if block_unknowns[LANES * batches[k, FIRST_UNKNOWN] + block] == padding:
                continue
            eliminate_interior(blocks, first, interior, neighbors, corner, block * corner_size)
        # In the order of `elimination`, so that rounding errors are the same.
        start = LANES * batches[k, FIRST_CORNER]
        for i in range(corner_size):
            for block in range(LANES):
                target = _signed(corner_entries[start + LANES * i + block])
                add_entry(entries, target, corner, block * corner_size + i, 1.0)
        end = tile + LANES // TILE_ROWS * count
        set_tiles(batch.results, blocks, LANES * count, batch.block_tiles, tile, end)
        tile = end


def _eliminate(plan: EliminationPlan, batch: BatchFactors) -> None:
    """Factorize the equations of the unknowns outside blocks; see `elimination`."""
    starts, positions, sources = plan.starts, plan.positions, plan.sources
    upper_starts, upper_rows = plan.upper_starts, plan.upper_rows
    lower_starts, lower_rows = plan.lower_starts, plan.lower_rows
    entries, pivots, x = batch.entries, batch.pivots, batch.x
    first_lower = len(upper_rows)
    first_inverse, size = first_lower + len(lower_rows), len(plan.rows)
    fill(x, 0.0)
    for j in range(size):
        for e in range(_signed(starts[j]), _signed(starts[j + 1])):
            set_entry(x, _signed(positions[e]), entries, _signed(sources[e]), 1.0)
        for p in range(_signed(upper_starts[j]), _signed(upper_starts[j + 1])):
            k = _signed(upper_rows[p])
            for q in range(_signed(lower_starts[k]), _signed(lower_starts[k + 1])):
                subtract_lanes(x, _signed(lower_rows[q]), 1, pivots, first_lower + q, k)
            set_entry(pivots, p, x, k, 1.0)
            set_entry(x, k, x, k, 0.0)
        set_entry(pivots, first_inverse + j, x, j, 1.0)
        invert_lanes(pivots, first_inverse + j)
        set_entry(x, j, x, j, 0.0)
        for q in range(_signed(lower_starts[j]), _signed(lower_starts[j + 1])):
            row = _signed(lower_rows[q])
            set_entry(pivots, first_lower + q, x, row, 1.0)
            multiply_lanes(pivots, first_lower + q, 1, pivots, first_inverse + j)
            set_entry(x, row, x, row, 0.0)
