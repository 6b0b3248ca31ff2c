"""Operations of integrator loops in plain Python; `overloads` has their compiled versions.

The loops of integrators are written once, in plain Python that numba compiles. Through these
functions, they operate on whole arrays, evaluate kernels, solve linear systems and call C
functions. Empty slices are skipped: many are empty, and NumPy needs microseconds for each.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np

from beamdae.linear.fixed_order import FixedOrderFactors, eliminate_by_scipy
from beamdae.linear.lane_operations import LANES
from beamdae.native.return_codes import DONE, SINGULAR

Array = np.ndarray

# Largest number of rows of a tile, see `pick_tiles`.
TILE_ROWS = 4
# Columns of the table of tiles before the index of each lane.
_TILE_START = 0
_TILE_HEIGHT = 1
_TILE_LANES = 2


def combine(out: Array, factors: tuple[complex, ...], vectors: tuple[Array, ...]) -> None:
    """Set `out` to the sum of factor * vector over all pairs; `out` may be one of the vectors."""
    out[:] = sum(factor * vector for factor, vector in zip(factors, vectors, strict=True))


def multiply(out: Array, one: Array, other: Array) -> None:
    """Set `out` to the entrywise product of two vectors."""
    np.multiply(one, other, out=out)


def rotate(x: Array, y: Array, angles: Array) -> None:
    """Rotate the vectors with the components `x` and `y` by `angles` [rad], in place."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x[:], y[:] = cosine * x - sine * y, sine * x + cosine * y


def accumulate(out: Array, targets: Array, sources: Array, steps: Array) -> None:
    """Set out[targets] = out[sources] + steps, entry by entry, so that targets may be sources."""
    for target, source, step in zip(*(x.tolist() for x in (targets, sources, steps)), strict=True):
        out[target] = out[source] + step


def fill(out: Array, value: float) -> None:
    """Set all entries of `out` to `value`."""
    out[:] = value


def minimum(out: Array, vector: Array, factor: float, other: Array) -> None:
    """Set `out` to the entrywise minimum of `vector` and `factor` * `other`; NaN is kept."""
    np.minimum(vector, factor * other, out=out)


def split_complex(real: Array, imaginary: Array, vector: Array) -> None:
    """Write the real and imaginary parts of a complex vector to `real` and `imaginary`."""
    real[:], imaginary[:] = vector.real, vector.imag


def max_norm(vector: Array, weights: Array) -> float:
    """Return the largest |vector * weights|; 0 for empty vectors, NaN if any entry is NaN."""
    return float(np.max(np.abs(vector * weights), initial=0.0))


def euclidean_norm(vector: Array, weights: Array) -> float:
    """Return the Euclidean norm of vector * weights."""
    weighted = vector * weights
    return math.sqrt(weighted @ weighted)


def inner_product(one: Array, other: Array) -> float:
    """Return the inner product of two vectors."""
    return float(one @ other)


def locate_largest(vector: Array, weights: Array) -> int:
    """Return the index of the largest |vector * weights|, or of the first NaN."""
    return int(np.argmax(np.abs(vector * weights)))


def pick(out: Array, at: Array, vector: Array, of: Array, begin: int, end: int) -> None:
    """Set out[at] = vector[of], for the slice begin:end of `at` and `of`."""
    if begin < end:
        out[at[begin:end]] = vector[of[begin:end]]


def pick_tiles(
    out: Array, start: int, stride: int, vector: Array, tiles: Array, begin: int, end: int
) -> None:
    """Set out[start + a + i * stride + l] = vector[b_l + i] for the tiles begin:end.

    A row of `tiles` contains a, the number of rows i (up to `TILE_ROWS`), and b_l for each lane l.
    `TILE_ROWS` numbers from b_l on are read.
    """
    for tile in tiles[begin:end]:
        for i in range(tile[_TILE_HEIGHT]):
            first = start + int(tile[_TILE_START]) + i * stride
            out[first : first + len(tile) - _TILE_LANES] = vector[tile[_TILE_LANES:] + i]


def add_tiles(out: Array, vector: Array, stride: int, tiles: Array, begin: int, end: int) -> None:
    """Add vector[a + i * stride + l] to out[b_l + i] for the tiles begin:end, see `pick_tiles`.

    Lanes are added in ascending order. Zeros are added to out[b_l + i] for i up to `TILE_ROWS`.
    """
    for tile in tiles[begin:end]:
        height = int(tile[_TILE_HEIGHT])
        for lane, index in enumerate(tile[_TILE_LANES:].tolist()):
            first = int(tile[_TILE_START]) + lane
            out[index : index + height] += vector[first : first + height * stride : stride]


def gather(
    out: Array, at: Array, weights: Array, vector: Array, of: Array, begin: int, end: int
) -> None:
    """Set out[at] = weights * vector[of], for the slice begin:end of `at`, `weights` and `of`.

    Terms with the same index in `at` are added.
    """
    if begin < end:
        out[at[begin:end]] = 0.0
        add_weighted(out, at, weights, vector, of, begin, end)


def add(out: Array, rows: Array, vector: Array, of: Array, begin: int, end: int) -> None:
    """Add vector[of] to out[rows], for the slice begin:end of `rows` and `of`."""
    if begin < end:
        np.add.at(out, rows[begin:end], vector[of[begin:end]])


def add_weighted(
    out: Array, rows: Array, weights: Array, vector: Array, of: Array, begin: int, end: int
) -> None:
    """Add weights * vector[of] to out[rows].

    The slice begin:end of `rows`, `weights` and `of` is used.
    """
    if begin < end:
        np.add.at(out, rows[begin:end], weights[begin:end] * vector[of[begin:end]])


def scatter(out: Array, rows: Array, weights: Array, vector: Array, of: Array) -> None:
    """Set `out` to zero, then add weights * vector[of] to out[rows]."""
    out[:] = np.bincount(rows, weights * vector[of], len(out))


def scatter_magnitudes(out: Array, rows: Array, weights: Array, vector: Array, of: Array) -> None:
    """Set `out` to zero, then add |weights * vector[of]| to out[rows]."""
    out[:] = np.bincount(rows, np.abs(weights * vector[of]), len(out))


def call_kernel(
    kernels: Any, k: int, shared: Array, local: Array, start: int, out: Array, lanes: int
) -> None:
    """Evaluate kernel `k` of a `Sum` for its batch, whose inputs begin at `start` in `local`."""
    kernels[k](shared, local, out)


def factorize(linear: Any, nonzeros: Array) -> int:
    """Factorize a matrix; return DONE, SINGULAR or, in machine code only, NEW_PIVOTS."""
    return DONE if linear.try_factorize(nonzeros) else SINGULAR


def solve(linear: Any, right: Array) -> None:
    """Replace `right` by the solution computed with the last factors."""
    right[:] = linear.solve(right)


def solve_lanes(linear: Any, right: Array) -> None:
    """Replace the right-hand sides, one per lane, by the solutions computed with the last factors.

    In machine code, solutions are not refined, and `linear` is a `LaneSolver`.
    """
    right[:] = linear.solve(right.reshape(-1, LANES)).ravel()


def count_negative_pivots(factors: FixedOrderFactors, nonzeros: Array) -> int:
    """Factorize a symmetric matrix in a fixed order; return the number of negative pivots, or -1.

    See `fixed_order.eliminate`; in plain Python, only pivots are set.
    """
    return eliminate_by_scipy(factors, nonzeros)


def array_at(address: int, size: int) -> Array:
    """Return a view of `size` floats at an address."""
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))


def call_for_int(address: int, arguments: tuple[float, ...]) -> int:
    """Call a C function that returns an int.

    Floats are passed as doubles, integers (also in place of pointers) as 64-bit integers.
    """
    return int(_c_function(ctypes.c_int32, address, arguments)(*arguments))


def call_for_pointer(address: int, arguments: tuple[float, ...]) -> int:
    """Call a C function that returns a pointer; for `arguments`, see `call_for_int`."""
    return int(_c_function(ctypes.c_void_p, address, arguments)(*arguments) or 0)


def _c_function(result: Any, address: int, arguments: tuple[float, ...]) -> Any:
    kinds = (ctypes.c_double if isinstance(x, float) else ctypes.c_int64 for x in arguments)
    return ctypes.CFUNCTYPE(result, *kinds)(address)
