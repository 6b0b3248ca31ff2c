"""Blocks of unknowns that are eliminated before all others, several blocks at a time.

The unknowns inside a beam element are coupled with one another, with the nodes at its ends and with
few others. Such blocks are independent of each other: in compiled code, `LANES` blocks of equal
size are eliminated by the same vector instructions. After the blocks, every second node of a beam
is such a block, then every second of the remaining nodes, and so on (block cyclic reduction;
Heller, SIAM J. Numer. Anal. 13 (1976) 484). Pivots within blocks are those on the diagonal.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.linear.elimination import (
    LANES,
    N_EXTRA_ENTRIES,
    ONE_ENTRY,
    UNUSED_ENTRY,
    ZERO_ENTRY,
)
from beamdae.linear.factorizations import compute_bordered_ordering

Array = np.ndarray

# Bounds on the unknowns of a block: a single unknown costs more in a block than by itself, and the
# core has work arrays of this size (linear.c).
_MIN_INTERIOR = 2
_MAX_INTERIOR = 16
# Largest number of neighbors of a block, all of which become coupled with each other.
_MAX_NEIGHBORS = 24
# Fewer blocks of equal size leave most lanes unused.
_MIN_BLOCKS = 4
_SEED = 0


class BlockElimination(NamedTuple):
    """Blocks of a pattern, and the pattern of the other unknowns after their elimination.

    Attributes
    ----------
    batches, block_unknowns, block_entries, corner_entries, n_entries
        See `EliminationPlan`.
    counts
        Numbers of successive batches that are independent of each other.
    unknowns
        Indices of the unknowns outside blocks, ascending.
    starts, indices
        CSC pattern of their equations after the elimination of the blocks.
    sources
        Indices of its non-zeros in `Factors.entries`.
    """

    batches: Array
    block_unknowns: Array
    block_entries: Array
    corner_entries: Array
    n_entries: int
    counts: Array
    unknowns: Array
    starts: Array
    indices: Array
    sources: Array

    @np.errstate(all="ignore")
    def eliminate(self, nonzeros: Array) -> Array:
        """Return the non-zeros of the remaining equations.

        Raises
        ------
        numpy.linalg.LinAlgError
            If they are not finite.
        """
        entries = np.zeros(self.n_entries, nonzeros.dtype)
        entries[: len(nonzeros)] = nonzeros
        entries[len(entries) - N_EXTRA_ENTRIES + ONE_ENTRY] = 1.0
        for batch, count in zip(np.cumsum(self.counts) - self.counts, self.counts, strict=True):
            interior, neighbors, _, _, first, first_corner = self.batches[batch]
            size = interior + neighbors
            at = _split_lanes(self.block_entries, first, count, interior * (size + neighbors))
            left, upper = np.split(entries[at], [interior * size], axis=1)
            left = left.reshape(count, interior, size, LANES).transpose(0, 3, 2, 1)
            upper = upper.reshape(count, neighbors, interior, LANES).transpose(0, 3, 2, 1)
            inside, lower = np.split(left, [interior], axis=2)
            corner = (lower @ np.linalg.solve(inside, upper)).transpose(0, 3, 2, 1)
            at = _split_lanes(self.corner_entries, first_corner, count, neighbors * neighbors)
            np.subtract.at(entries, at, corner.reshape(at.shape))
        remainder = entries[self.sources]
        if not np.isfinite(remainder).all():
            raise np.linalg.LinAlgError
        return remainder


def _split_lanes(indices: Array, first: int, count: int, size: int) -> Array:
    """Return the indices of `count` batches of `size` entries, shape (count, size, LANES)."""
    return indices[LANES * first : LANES * (first + count * size)].reshape(count, size, LANES)


def find_blocks(pattern: sp.csc_array) -> BlockElimination | None:
    """Return the blocks of matrices with this pattern; None if too few, or with definitions."""
    ordering = compute_bordered_ordering(pattern)
    # Diagonal entries may be unsuitable pivots before definitions such as q' = v are eliminated.
    if ordering.is_definition.any():
        return None
    batches = _choose_blocks(pattern, ~ordering.in_border)
    return _number_entries(pattern, batches) if batches else None


class _Blocks(NamedTuple):
    """Blocks of equal size: indices of their unknowns and neighbors, one row per block."""

    interior: Array
    neighbors: Array


def _choose_blocks(pattern: sp.csc_array, is_candidate: Array) -> list[_Blocks]:
    """Choose blocks among the candidates until none are left, in the order of elimination."""
    size = pattern.shape[0]
    couplings = sp.csr_array(pattern + pattern.T + sp.eye_array(size))
    random = np.random.default_rng(_SEED).integers(0, 2**63, size, np.uint64)
    is_candidate = is_candidate.copy()
    choice: list[_Blocks] = []
    while True:
        level = _choose_independent(couplings, is_candidate, random)
        if not level:
            return choice
        choice += level
        remains = np.ones(size, bool)
        for blocks in level:
            remains[blocks.interior] = False
        is_candidate &= remains
        pairs = [
            (
                np.repeat(x.neighbors, x.neighbors.shape[1], axis=1),
                np.tile(x.neighbors, x.neighbors.shape[1]),
            )
            for x in level
        ]
        entries = sp.coo_array(couplings)
        rows, columns = (
            np.concatenate([old[remains[entries.coords[0]] & remains[entries.coords[1]]], *new])
            for old, new in zip(
                entries.coords, ([pair[k].ravel() for pair in pairs] for k in range(2)), strict=True
            )
        )
        couplings = sp.csr_array(sp.coo_array((np.ones(len(rows)), (rows, columns)), (size, size)))


def _choose_independent(
    couplings: sp.csr_array, is_candidate: Array, random: Array
) -> list[_Blocks]:
    """Return blocks that are not coupled with each other, by size."""
    starts, indices = couplings.indptr, couplings.indices
    ones = sp.csr_array((np.ones(len(indices), np.uint64), indices, starts), couplings.shape)
    # Unknowns with the same couplings have the same sum of random numbers.
    candidates = np.flatnonzero(is_candidate)
    _, first, groups, counts = np.unique(
        (ones @ random)[candidates], return_index=True, return_inverse=True, return_counts=True
    )
    members = candidates[np.argsort(groups, kind="stable")]
    ends = np.cumsum(counts)
    degrees = np.diff(starts)[candidates[first]]
    neighbors = degrees - counts
    is_eligible = (counts >= _MIN_INTERIOR) & (counts <= _MAX_INTERIOR)
    is_eligible &= (neighbors > 0) & (neighbors <= _MAX_NEIGHBORS)
    by_size: dict[tuple[int, int], list[list[int]]] = {}
    row_starts, row_indices = starts.tolist(), indices.tolist()
    begins, ends = (ends - counts).tolist(), ends.tolist()
    unknowns, is_free = members.tolist(), is_candidate.tolist()
    is_blocked = bytearray(len(is_free))
    order = np.lexsort((first, neighbors))
    for group in order[is_eligible[order]].tolist():
        interior = unknowns[begins[group] : ends[group]]
        if is_blocked[interior[0]]:
            continue
        coupled = row_indices[row_starts[interior[0]] : row_starts[interior[0] + 1]]
        closure = set(coupled)
        outside = []
        for k in sorted(closure.difference(interior)):
            is_blocked[k] = 1
            # Neighbors that are coupled with nothing else join the block, as they cause no fill.
            row = range(row_starts[k], row_starts[k + 1])
            if (
                is_free[k]
                and len(interior) < _MAX_INTERIOR
                and len(row) <= len(closure)
                and closure.issuperset(row_indices[row.start : row.stop])
            ):
                interior.append(k)
            else:
                outside.append(k)
        by_size.setdefault((len(interior), len(outside)), []).append(interior + outside)
    for size in sorted(by_size, reverse=True):
        smaller = [x for x in by_size if sum(x) == sum(size) and x[0] < size[0]]
        if smaller and len(by_size[size]) < _MIN_BLOCKS:
            # Unknowns that joined some blocks, such as the free end of a beam, leave them again.
            by_size[max(smaller)] += by_size.pop(size)
    return [
        _Blocks(*np.split(np.array(blocks), [size[0]], axis=1))
        for size, blocks in by_size.items()
        if len(blocks) >= _MIN_BLOCKS and size[1] > 0
    ]


def _number_entries(pattern: sp.csc_array, groups: list[_Blocks]) -> BlockElimination:
    """Return the indices of all entries; fill follows the non-zeros of the pattern."""
    size = pattern.shape[0]
    columns = np.repeat(np.arange(size), np.diff(pattern.indptr))
    keys = columns * size + pattern.indices
    pairs = [_pair_keys(blocks.neighbors, blocks.neighbors, size) for blocks in groups]
    fill = _sort_unique(np.concatenate([x.ravel() for x in pairs]))
    fill = fill[keys[np.minimum(np.searchsorted(keys, fill), len(keys) - 1)] != fill]
    all_keys = np.concatenate([keys, fill])
    by_key = np.argsort(all_keys, kind="stable")
    sorted_keys = all_keys[by_key]
    extra = len(all_keys)
    is_outside = np.ones(size, bool)
    batches, block_unknowns, block_entries, corner_entries = [], [], [], []
    first_unknown = first_entry = first_corner = 0
    for interior, neighbors in groups:
        is_outside[interior] = False
        b, s = interior.shape[1], neighbors.shape[1]
        neighbors, shared = _move_shared_last(neighbors)
        unknowns = np.concatenate([interior, neighbors], axis=1)
        keys = _pair_keys(unknowns, unknowns, size)
        position = np.minimum(np.searchsorted(sorted_keys, keys), extra - 1)
        exists = sorted_keys[position] == keys
        entries = np.where(exists, by_key[position], extra + ZERO_ENTRY)
        padding = -len(unknowns) % LANES
        no_block = np.full((1, b + s, b + s), extra + ZERO_ENTRY)
        no_block[0, np.arange(b), np.arange(b)] = extra + ONE_ENTRY
        no_block[0, b:, b:] = extra + UNUSED_ENTRY
        entries = np.concatenate([entries, np.repeat(no_block, padding, axis=0)])
        no_unknowns = np.full((padding, b + s), size)
        no_unknowns[:, b + s - shared :] = unknowns[:1, b + s - shared :]
        unknowns = np.concatenate([unknowns, no_unknowns])
        for start in range(0, len(unknowns), LANES):
            batches.append((b, s, shared, first_unknown, first_entry, first_corner))
            block_unknowns.append(unknowns[start : start + LANES].T.ravel())
            by_column = entries[start : start + LANES].transpose(1, 2, 0)
            block_entries += [by_column[:b].ravel(), by_column[b:, :b].ravel()]
            corner_entries.append(by_column[b:, b:].ravel())
            first_unknown += b + s
            first_entry += b * (b + 2 * s)
            first_corner += s * s
    outside = np.flatnonzero(is_outside)
    position_outside = np.cumsum(is_outside) - 1
    column, row = np.divmod(sorted_keys, size)
    is_rest = is_outside[row] & is_outside[column]
    counts = np.bincount(position_outside[column[is_rest]], minlength=len(outside))
    return BlockElimination(
        batches=np.array(batches, np.intp),
        block_unknowns=np.concatenate(block_unknowns).astype(np.uint32),
        block_entries=np.concatenate(block_entries).astype(np.uint32),
        corner_entries=np.concatenate(corner_entries).astype(np.uint32),
        n_entries=extra + N_EXTRA_ENTRIES,
        counts=np.array([-(-len(x.interior) // LANES) for x in groups]),
        unknowns=outside,
        starts=np.concatenate([[0], np.cumsum(counts)]),
        indices=position_outside[row[is_rest]],
        sources=by_key[is_rest],
    )


def _move_shared_last(neighbors: Array) -> tuple[Array, int]:
    """Move the neighbors that all blocks share to the end; return their number as well.

    These are the unknowns of a floating frame.
    """
    is_shared = np.isin(neighbors, neighbors[0])
    in_all = np.bincount(np.searchsorted(np.sort(neighbors[0]), neighbors[is_shared]))
    shared = np.sort(neighbors[0])[: len(in_all)][in_all == len(neighbors)]
    if not len(shared):
        return neighbors, 0
    others = neighbors[~np.isin(neighbors, shared)].reshape(len(neighbors), -1)
    return np.concatenate([others, np.tile(shared, (len(neighbors), 1))], axis=1), len(shared)


def _sort_unique(keys: Array) -> Array:
    # By sorting: the hash tables of `numpy.unique` take ten times as long.
    keys = np.sort(keys)
    return keys[np.concatenate([[True], keys[1:] != keys[:-1]])]


def _pair_keys(columns: Array, rows: Array, size: int) -> Array:
    """Return column * size + row for all pairs of each block, (blocks, column, row)."""
    return columns[:, :, None].astype(np.intp) * size + rows[:, None, :]
