"""Bounds of parameters, and starting points of several searches between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, require_pair, short_repr
from beamdae.model_parameters import convert_text

Array = np.ndarray

MAX_STARTS = 10_000
MAX_SEED = 2**32 - 1


def convert_bounds(caller: str, name: str, bounds: Any, unit: str) -> tuple[Any, Any]:
    """Return (lower, upper) with texts converted to a unit, and None replaced by infinity."""
    pair = require_pair(caller, f"bounds of {name}", bounds, "(lower, upper)")
    lower, upper = (convert_text(caller, f"bounds of {name}", x, unit) for x in pair)
    return -np.inf if lower is None else lower, np.inf if upper is None else upper


def require_bounds_around(
    caller: str, name: str, first: Any, lower: Array, upper: Array, given: Any
) -> None:
    """Raise BeamdaeError unless bounds (k,) ascend and contain the first values of a parameter.

    `given` are the bounds for the message.
    """
    texts = f"bounds of {name}", f"got {short_repr(given)}"
    if np.any(lower == upper):
        raise BeamdaeError(
            f"{caller}: {texts[0]} must differ, {texts[1]}; remove {name} from by to keep "
            "its value."
        )
    if np.any(lower > upper):
        raise BeamdaeError(
            f"{caller}: {texts[0]} must ascend, (lower, upper), {texts[1]}; exchange them."
        )
    if not np.all((lower <= first) & (first <= upper)):
        raise BeamdaeError(
            f"{caller}: {texts[0]} must be (lower, upper) around its first value "
            f"{short_repr(first)}, {texts[1]}; change the bounds, or pass another first value, "
            f"parameters={{{name!r}: value}}."
        )


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
