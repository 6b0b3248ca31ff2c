"""What compiled loops are made of, as plain Python; `native.overloads` has each once more.

Loops of integrators are stated once, in plain Python that numba compiles. What they do with whole
arrays they do by these functions: numpy computes them where nothing is compiled.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np

from beamdae.linear.return_codes import DONE, SINGULAR

Array = np.ndarray


def combine(out: Array, factors: tuple[complex, ...], vectors: tuple[Array, ...]) -> None:
    """Out = sum of factors times vectors; `out` may be one of these."""
    out[:] = sum(factor * vector for factor, vector in zip(factors, vectors, strict=True))


def fill(out: Array, value: float) -> None:
    """Set all of `out`."""
    out[:] = value


def minimum(out: Array, vector: Array, factor: float, other: Array) -> None:
    """The smaller ones of `vector` and factor times `other`."""
    np.minimum(vector, factor * other, out=out)


def parts(real: Array, imaginary: Array, vector: Array) -> None:
    """Take a complex vector apart."""
    real[:], imaginary[:] = vector.real, vector.imag


def largest(vector: Array, weights: Array) -> float:
    """Largest |vector * weights|, 0 of none, not a number if one of them is none."""
    return float(np.max(np.abs(vector * weights), initial=0.0))


def norm(vector: Array, weights: Array) -> float:
    """Euclidean norm of vector * weights."""
    scaled = vector * weights
    return math.sqrt(scaled @ scaled)


def where_largest(vector: Array, weights: Array) -> int:
    """Index of the largest |vector * weights|."""
    return int(np.argmax(np.abs(vector * weights)))


def pick(out: Array, at: Array, vector: Array, of: Array, begin: int, end: int) -> None:
    """out[at] = vector[of], of a stretch of `at` and `of`."""
    out[at[begin:end]] = vector[of[begin:end]]


def gather(
    out: Array, at: Array, weights: Array, vector: Array, of: Array, begin: int, end: int
) -> None:
    """out[at] = weights vector[of] of a stretch, summed where `at` repeats; others stay."""
    out[at[begin:end]] = 0.0
    add_weighted(out, at, weights, vector, of, begin, end)


def add(out: Array, rows: Array, vector: Array, of: Array, begin: int, end: int) -> None:
    """out[rows] += vector[of], of a stretch of `rows` and `of`."""
    np.add.at(out, rows[begin:end], vector[of[begin:end]])


def add_weighted(
    out: Array, rows: Array, weights: Array, vector: Array, of: Array, begin: int, end: int
) -> None:
    """out[rows] += weights vector[of], of a stretch of `rows`, `weights` and `of`."""
    np.add.at(out, rows[begin:end], weights[begin:end] * vector[of[begin:end]])


def scatter(out: Array, rows: Array, weights: Array, vector: Array, of: Array) -> None:
    """Out = 0, then out[rows] += weights vector[of]."""
    out[:] = np.bincount(rows, weights * vector[of], len(out))


def call_kernel(
    kernels: Any, k: int, shared: Array, local: Array, start: int, out: Array, lanes: int
) -> None:
    """Evaluate one of the kernels of a `Sum` for its stretch, whose numbers start in `local`."""
    kernels[k](shared, local, out)


def factorize(linear: Any, nonzeros: Array) -> int:
    """Factorize a matrix: DONE, SINGULAR, or NEW_PIVOTS in machine code."""
    return DONE if linear.factorized(nonzeros) else SINGULAR


def solve(linear: Any, right: Array) -> None:
    """Solve with the last factors, in place."""
    right[:] = linear.solve(right)


def array_at(address: int, size: int) -> Array:
    """The numbers at an address, which stay there."""
    return np.ctypeslib.as_array((ctypes.c_double * size).from_address(address))


def call_for_int(address: int, arguments: tuple[float, ...]) -> int:
    """Call a C function that gives an int: of doubles, and of pointers and ints as integers."""
    return int(_c_function(ctypes.c_int32, address, arguments)(*arguments))


def call_for_pointer(address: int, arguments: tuple[float, ...]) -> int:
    """The same for one that gives a pointer."""
    return int(_c_function(ctypes.c_void_p, address, arguments)(*arguments) or 0)


def _c_function(result: Any, address: int, arguments: tuple[float, ...]) -> Any:
    kinds = (ctypes.c_double if isinstance(x, float) else ctypes.c_int64 for x in arguments)
    return ctypes.CFUNCTYPE(result, *kinds)(address)
