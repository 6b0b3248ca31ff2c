"""Tiles of kernel inputs and outputs, which the core moves by vectors.

The coordinates of a node are neighbors in the input vector, and neighbors in the inputs of a copy.
A tile consists of up to `TILE_ROWS` such components of `LANE_WIDTH` copies side by side: one run of
numbers per lane outside, one row per component inside a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from beamdae.native.lane_code import LANE_WIDTH

Array = np.ndarray

# Largest number of rows of a tile.
TILE_ROWS = 4
# Least number of copies in a vector for which a tile of inputs takes less time than its numbers.
_MIN_COPIES = 4


class BatchRows(NamedTuple):
    """Rows of a batch, inputs or outputs: (height, lanes) numbers.

    The last lanes beyond `copies` are padding.
    """

    height: int
    lanes: int
    copies: int


class Tiles(NamedTuple):
    """Tiles of all batches of a sum.

    Attributes
    ----------
    table
        One row per tile, in the order of the batches and of their lanes: position of its first
        number among the rows of all batches, number of its rows, and index of the first number of
        each lane.
    ends
        Ends of the batches in `table`.
    covered
        Mask of the entries that belong to a tile.
    order
        Entries that belong to a tile, in the order of the tiles and of their lanes.
    """

    table: Array
    ends: Array
    covered: Array
    order: Array


def find_tiles(
    batches: Sequence[BatchRows], positions: Array, indices: Array, fills_padding: bool
) -> Tiles:
    """Return the tiles of entries that connect positions in batches with indices of a vector.

    Parameters
    ----------
    batches
        Rows of all batches, one batch after the other.
    positions, indices
        Position of each entry among the rows of all batches, and its index in the vector. Of
        entries with the same position, only the first can belong to a tile.
    fills_padding
        True if tiles may also assign numbers to padding.
    """
    count = len(positions)
    none = Tiles(
        np.zeros((0, 2 + LANE_WIDTH), np.int64),
        np.zeros(len(batches), np.intp),
        np.zeros(count, bool),
        np.zeros(0, np.intp),
    )
    least = _MIN_COPIES if fills_padding else LANE_WIDTH
    if not count or max(batch.copies for batch in batches) < least:
        return none
    vectors, vector_batch, is_first_row, copies = _order_vectors(batches)
    entry = np.full(LANE_WIDTH * len(vectors), -1)
    entry[positions[::-1]] = np.arange(count)[::-1]
    entry = entry.reshape(-1, LANE_WIDTH)[vectors]
    is_copy = np.arange(LANE_WIDTH) < copies[:, None]
    is_complete = (copies >= least) & ((entry >= 0) | ~is_copy).all(axis=1)
    last_copy = entry[np.arange(len(entry)), np.maximum(copies - 1, 0)]
    index = indices[np.where(is_copy, entry, last_copy[:, None])]
    # A run of rows whose indices ascend by one in all lanes is divided into tiles.
    continues = ~is_first_row
    continues[1:] &= is_complete[1:] & is_complete[:-1] & (index[1:] == index[:-1] + 1).all(axis=1)
    begins = np.flatnonzero(~continues)
    lengths = np.diff(np.append(begins, len(continues)))
    offset = np.arange(len(continues)) - np.repeat(begins, lengths)
    rows = np.minimum(np.repeat(lengths, lengths) - offset, TILE_ROWS)
    is_tile = is_complete & (offset % TILE_ROWS == 0)
    # All `TILE_ROWS` numbers of a lane are read, also those that are not used.
    is_tile &= index.max(axis=1) + TILE_ROWS <= indices.max() + 1
    first = np.flatnonzero(is_tile)
    if not len(first):
        return none
    rows = rows[first]
    table = np.column_stack([LANE_WIDTH * vectors[first], rows, index[first]])
    ends = np.searchsorted(vector_batch[first], np.arange(len(batches)), "right")
    # (tile, lane, row), without rows that the tile does not have and padding.
    members = entry[np.minimum(first[:, None] + np.arange(TILE_ROWS), len(entry) - 1)]
    members[np.arange(TILE_ROWS) >= rows[:, None]] = -1
    order = members.transpose(0, 2, 1).ravel()
    order = order[order >= 0]
    covered = np.zeros(count, bool)
    covered[order] = True
    return Tiles(table, ends, covered, order)


def _order_vectors(batches: Sequence[BatchRows]) -> tuple[Array, Array, Array, Array]:
    """Return the vectors of all batches, ordered by batch, lanes and row.

    Also return the batch of each vector, True for those of a first row, and the number of copies.
    """
    vectors, copies, start = [], [], 0
    for batch in batches:
        width = batch.lanes // LANE_WIDTH
        numbers = start + np.arange(batch.height * width)
        vectors.append(numbers.reshape(batch.height, width).T.ravel())
        first_copies = np.arange(0, batch.lanes, LANE_WIDTH)
        copies.append(np.repeat(np.clip(batch.copies - first_copies, 0, LANE_WIDTH), batch.height))
        start += batch.height * width
    sizes = [len(part) for part in vectors]
    vector_batch = np.repeat(np.arange(len(batches)), sizes)
    heights = np.repeat([max(batch.height, 1) for batch in batches], sizes)
    starts = np.repeat(np.cumsum(sizes) - sizes, sizes)
    is_first_row = (np.arange(sum(sizes)) - starts) % heights == 0
    return np.concatenate(vectors), vector_batch, is_first_row, np.concatenate(copies)
