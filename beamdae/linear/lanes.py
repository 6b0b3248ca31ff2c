"""Arrays of lanes, which the core uses for several small matrices or vectors at once.

An array of lanes holds the first entry of all lanes, then the second entry of all lanes, and so on.
Of complex lanes, it holds the real parts of an entry, then its imaginary parts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

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
