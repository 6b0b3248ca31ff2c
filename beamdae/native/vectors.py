"""What compiled loops are made of, as plain Python; `native.overloads` has each once more.

Loops of integrators are stated once, in plain Python that numba compiles. What they do with whole
arrays they do by these functions: numpy computes them where nothing is compiled.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np

from beamdae.native.codes import DONE, SINGULAR

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


def pick(out: Array, at: Array, vector: Array, of: Array) -> None:
    """out[at] = vector[of]."""
    out[at] = vector[of]


def gather(out: Array, at: Array, weights: Array, vector: Array, of: Array) -> None:
    """out[at] = weights vector[of], summed where `at` repeats; other entries stay."""
    out[at] = 0.0
    np.add.at(out, at, weights * vector[of])


def scatter(out: Array, rows: Array, weights: Array, vector: Array, of: Array) -> None:
    """Out = 0, then out[rows] += weights vector[of]."""
    out[:] = np.bincount(rows, weights * vector[of], len(out))


def call_kernels(kernels: Any, shared: Array, local: Array, out: Array) -> None:
    """Evaluate the kernels of a `Sum`."""
    for kernel in kernels:
        kernel(shared, local, out)


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
