"""Operations on several small matrices or vectors, one per vector lane, in plain Python.

An array of lanes holds the first entry of all lanes, then the second entry of all lanes, and so on.
`native.overloads` has compiled versions with vector instructions. In machine code, an array of
complex lanes holds the real parts of an entry, then its imaginary parts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

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


def index_lanes(indices: Array) -> Array:
    """Return the flat, unsigned indices of all lanes of these entries."""
    return (LANES * indices.astype(np.uint32)[:, None] + np.arange(LANES, dtype=np.uint32)).ravel()


def gather_lanes(out: Array, begin: int, count: int, vector: Array, at: Array, first: int) -> None:
    """Set `count` entries of all lanes of `out`, from `begin` on, to vector[at].

    `at` has `LANES` indices for each entry; those of `begin` are at entry `first`.
    """
    _lane_range(out, begin, count)[:] = vector[_lane_range(at, first, count)]


def scatter_lanes(
    vector: Array, at: Array, first: int, lanes: Array, begin: int, count: int
) -> None:
    """Set vector[at] to `count` entries of all lanes; indices as in `gather_lanes`."""
    vector[_lane_range(at, first, count)] = _lane_range(lanes, begin, count)


def add_lanes(vector: Array, at: Array, first: int, lanes: Array, begin: int, count: int) -> None:
    """Add `count` entries of all lanes to vector[at]; indices as in `gather_lanes`."""
    np.add.at(vector, _lane_range(at, first, count), _lane_range(lanes, begin, count))


def add_lane_sums(
    vector: Array, at: Array, first: int, lanes: Array, begin: int, count: int
) -> None:
    """Add the sums over all lanes of `count` entries to vector[at]; lanes share their indices."""
    sums = _lane_range(lanes, begin, count).reshape(-1, LANES)
    # By halves, as in machine code.
    while sums.shape[1] > 1:
        half = sums.shape[1] // 2
        sums = sums[:, :half] + sums[:, half:]
    np.add.at(vector, _lane_range(at, first, count)[::LANES], sums[:, 0])


def broadcast_lanes(
    out: Array, begin: int, count: int, vector: Array, at: Array, first: int
) -> None:
    """Set `count` entries of all lanes of `out` to vector[at]; lanes share their indices."""
    values = vector[_lane_range(at, first, count)[::LANES]]
    _lane_range(out, begin, count).reshape(-1, LANES)[:] = values[:, None]


def clear_lanes(lanes: Array, begin: int, count: int) -> None:
    """Set `count` entries of all lanes to zero."""
    _lane_range(lanes, begin, count)[:] = 0.0


def invert_lanes(lanes: Array, k: int) -> None:
    """Replace entry `k` of all lanes by its reciprocal."""
    _lane_range(lanes, k, 1)[:] = 1.0 / _lane_range(lanes, k, 1)


def multiply_lanes(lanes: Array, begin: int, count: int, factors: Array, k: int) -> None:
    """Multiply `count` entries of all lanes, from `begin` on, by entry `k` of `factors`."""
    _lane_range(lanes, begin, count).reshape(-1, LANES)[:] *= _lane_range(factors, k, 1)


def set_entry(out: Array, k: int, lanes: Array, j: int, factor: float) -> None:
    """Set entry `k` of all lanes of `out` to `factor` times entry `j` of `lanes`."""
    _lane_range(out, k, 1)[:] = factor * _lane_range(lanes, j, 1)


def add_entry(out: Array, k: int, lanes: Array, j: int, factor: float) -> None:
    """Add `factor` times entry `j` of `lanes` to entry `k` of all lanes of `out`."""
    _lane_range(out, k, 1)[:] += factor * _lane_range(lanes, j, 1)


def multiply_rows(
    out: Array, starts: Array, columns: Array, nonzeros: Array, sources: Array, lanes: Array
) -> None:
    """Set all lanes of `out` to the product of a sparse matrix and `lanes`.

    Row i of the matrix has the entries nonzeros[sources[e]] in columns[e] for e from starts[i] to
    starts[i + 1].
    """
    factors = lanes.reshape(-1, LANES)
    shape = (len(starts) - 1, len(factors))
    matrix = sp.csr_array((nonzeros[sources], columns, starts), shape)
    out[:] = (matrix @ factors).ravel()


def subtract_lanes(lanes: Array, begin: int, count: int, column: Array, first: int, k: int) -> None:
    """Subtract `count` entries of `column`, from `first` on, times entry `k` of `lanes`."""
    products = _lane_range(column, first, count).reshape(-1, LANES) * _lane_range(lanes, k, 1)
    _lane_range(lanes, begin, count)[:] -= products.ravel()


def subtract_products(
    lanes: Array,
    begin: int,
    rows: int,
    matrix: Array,
    first: int,
    stride: int,
    factors: Array,
    k: int,
    columns: int,
) -> None:
    """Subtract a matrix times `columns` entries of `factors`, from `k` on, from `rows` entries.

    Entry (0, 0) of the matrix is at `first`, and its columns are `stride` entries apart.
    """
    result = _lane_range(lanes, begin, rows).reshape(-1, LANES)
    for j in range(columns):
        column = _lane_range(matrix, first + j * stride, rows).reshape(-1, LANES)
        result -= column * _lane_range(factors, k + j, 1)


def subtract_unit_triangle(
    lanes: Array, begin: int, count: int, rows: int, blocks: Array, first: int, size: int
) -> None:
    """Subtract `count` columns of a unit lower triangle from `rows` entries of `lanes`.

    The columns of the triangle start at `first` and are `size` entries apart.
    """
    for k in range(count):
        below = first + k * size + k + 1
        subtract_lanes(lanes, begin + k + 1, rows - k - 1, blocks, below, begin + k)


def substitute_forward(
    right: Array,
    at: Array,
    block_x: Array,
    begin: int,
    blocks: Array,
    first: int,
    interior: int,
    neighbors: int,
    shared: int,
) -> None:
    """Eliminate the interior unknowns of a batch of blocks from a right-hand side.

    Parameters
    ----------
    right
        Right-hand side, to whose entries of the neighbors the results are added.
    at, begin
        Indices of the unknowns, interior first; those of the batch begin at entry `begin`.
    block_x
        Interior entries of the eliminated right-hand side, from `begin` on.
    blocks, first
        Factors of the batch, which begin at `first`, see `EliminationPlan.block_entries`.
    interior, neighbors, shared
        Numbers of interior unknowns, of neighbors, and of neighbors that all lanes share.
    """
    size = interior + neighbors
    gather_lanes(block_x, begin, interior, right, at, begin)
    clear_lanes(block_x, begin + interior, neighbors)
    subtract_unit_triangle(block_x, begin, interior, interior, blocks, first, size)
    below, left = begin + interior, first + interior
    subtract_products(block_x, below, neighbors, blocks, left, size, block_x, begin, interior)
    separate, end = neighbors - shared, begin + size
    add_lanes(right, at, begin + interior, block_x, begin + interior, separate)
    add_lane_sums(right, at, end - shared, block_x, end - shared, shared)


def substitute_backward(
    right: Array,
    at: Array,
    block_x: Array,
    begin: int,
    blocks: Array,
    first: int,
    interior: int,
    neighbors: int,
    shared: int,
) -> None:
    """Replace the interior entries of `right` by the solution, given that of the neighbors.

    For the parameters, see `substitute_forward`, which computes `block_x`.
    """
    size = interior + neighbors
    separate, end = neighbors - shared, begin + size
    gather_lanes(block_x, begin + interior, separate, right, at, begin + interior)
    broadcast_lanes(block_x, end - shared, shared, right, at, end - shared)
    upper, below = first + interior * size, begin + interior
    subtract_products(block_x, begin, interior, blocks, upper, interior, block_x, below, neighbors)
    for from_last in range(interior):
        k = interior - 1 - from_last
        column = first + k * size
        multiply_lanes(block_x, begin + k, 1, blocks, column + k)
        subtract_lanes(block_x, begin, k, blocks, column, begin + k)
    scatter_lanes(right, at, begin, block_x, begin, interior)


def _lane_range(lanes: Array, begin: int, count: int) -> Array:
    return lanes[LANES * begin : LANES * (begin + count)]
