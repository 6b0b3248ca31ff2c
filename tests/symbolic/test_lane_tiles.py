"""Tiles move the same numbers as the entries they replace."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from beamdae.native.lane_kernels import pad_copies
from beamdae.native.loop_functions import add_tiles, pick_tiles
from beamdae.symbolic.sums.lane_tiles import BatchRows, find_tiles

NODE = 3  # coordinates


def element_entries(batches, first_elements, missing):
    """Return positions and indices of elements of four nodes, without some coordinates."""
    positions, indices, start = [], [], 0
    for batch, first in zip(batches, first_elements, strict=True):
        row, copy = np.divmod(np.arange(batch.height * batch.copies), batch.copies)
        index = 3 * NODE * (first + copy) + row
        exists = ~np.isin(index, missing)
        positions.append((start + row * batch.lanes + copy)[exists])
        indices.append(index[exists])
        start += batch.height * batch.lanes
    return np.concatenate(positions), np.concatenate(indices), start


def make_batches(*copies):
    return [BatchRows(4 * NODE, pad_copies(count), count) for count in copies]


CASES = [
    (make_batches(72, 72, 20), [0, 72, 144], [0, 1, 2]),
    (make_batches(8), [0], []),
    (make_batches(8), [0], [40, 41]),
    (make_batches(5), [0], [1]),
    (make_batches(16, 3), [3, 0], [80, 100]),
]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("shuffled", [False, True])
def test_inputs(case, shuffled):
    batches, first_elements, missing = case
    positions, indices, size = element_entries(batches, first_elements, missing)
    random = np.random.default_rng(0)
    if shuffled:
        order = random.permutation(len(positions))
        positions, indices = positions[order], indices[order]
    tiles = find_tiles(batches, positions, indices, fills_padding=True)
    vector = random.normal(size=indices.max() + 1)
    expected, out = np.zeros((2, size))
    expected[positions] = vector[indices]
    begin = start = 0
    for batch, end in zip(batches, tiles.ends, strict=True):
        table = tiles.table.copy()
        table[:, 0] -= start
        pick_tiles(out, start, batch.lanes, vector, table, begin, end)
        begin, start = end, start + batch.height * batch.lanes
    rest = ~tiles.covered
    out[positions[rest]] = vector[indices[rest]]
    is_copy = np.concatenate([np.tile(np.arange(b.lanes) < b.copies, b.height) for b in batches])
    assert_array_equal(out[is_copy], expected[is_copy])
    assert np.mean(tiles.covered) > 0.5


@pytest.mark.parametrize("case", CASES)
def test_outputs(case):
    batches, first_elements, missing = case
    positions, indices, size = element_entries(batches, first_elements, missing)
    # An output that is added twice, and one that all copies add to the same row.
    positions = np.append(positions, positions[7])
    indices = np.append(np.where(indices % 30 == 5, 5, indices), 2)
    tiles = find_tiles(batches, positions, indices, fills_padding=False)
    values = np.random.default_rng(0).normal(size=size)
    out = np.zeros(indices.max() + 1)
    begin = start = 0
    for batch, end in zip(batches, tiles.ends, strict=True):
        add_tiles(out, values, batch.lanes, tiles.table, begin, end)
        begin, start = end, start + batch.height * batch.lanes
    assert_array_equal(np.sort(tiles.order), np.flatnonzero(tiles.covered))
    expected = np.zeros_like(out)
    np.add.at(expected, indices[tiles.order], values[positions[tiles.order]])
    assert_array_equal(out, expected)
    assert (len(tiles.table) > 0) == (batches[0].copies >= 8)


def test_single_copies_have_no_tiles():
    batches = make_batches(1, 2)
    positions, indices, _ = element_entries(batches, [0, 1], [])
    tiles = find_tiles(batches, positions, indices, fills_padding=True)
    assert len(tiles.table) == 0
    assert not tiles.covered.any()
    assert tiles.ends.tolist() == [0, 0]
