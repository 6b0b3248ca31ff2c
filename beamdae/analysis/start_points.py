"""Starting points of several searches between bounds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beamdae.errors import BeamdaeError

Array = np.ndarray

MAX_STARTS = 10_000
MAX_SEED = 2**32 - 1


def spread_starts(lower: Array, upper: Array, count: int, seed: int) -> Array:
    """Return points (count, k) of a Latin hypercube between finite bounds (k,)."""
    generator = np.random.default_rng(seed)
    cells = [generator.permutation(count) for _ in lower]
    shares = (np.array(cells).T + generator.uniform(size=(count, len(lower)))) / max(count, 1)
    return np.asarray(lower + shares * (upper - lower))


def require_start_bounds(
    caller: str, names: Sequence[str], lower: Array, upper: Array, condition: str = ""
) -> None:
    """Raise BeamdaeError unless all bounds (k,) are finite; a further condition may be named."""
    is_bounded = np.isfinite(lower) & np.isfinite(upper)
    missing = [name for name, x in zip(names, is_bounded, strict=True) if not x]
    if missing:
        raise BeamdaeError(
            f"{caller}: several starts need finite bounds of all parameters{condition}; pass those "
            f"of {', '.join(missing)} in bounds={{name: (lower, upper)}}."
        )
