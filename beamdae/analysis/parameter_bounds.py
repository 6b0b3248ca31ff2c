"""Bounds of parameters, and starting points of several searches between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_mapping,
    require_pair,
    require_sequence,
    short_repr,
)
from beamdae.model_parameters import convert_text

Array = np.ndarray

MAX_STARTS = 10_000
MAX_SEED = 2**32 - 1


def read_bounds(
    caller: str, bounds: Any, first: Mapping[str, Any], units: Mapping[str, str]
) -> dict[str, tuple[Array, Array]]:
    """Return lower and upper bounds, one per entry, by name of a parameter.

    Parameters
    ----------
    caller
        The calling function, for messages.
    bounds
        (lower, upper) by name: numbers, texts with units, lists of numbers, or None.
    first, units
        First values of the parameters, numbers or lists of numbers, and their units by name.

    Raises
    ------
    BeamdaeError
        If bounds are invalid, do not ascend, or do not contain the first values.
    """
    given = {} if bounds is None else bounds
    given = require_mapping(caller, "bounds", given, "a dict of (lower, upper) by name")
    result = {}
    for name, value in given.items():
        part = f"bounds of {name}"
        if name not in first:
            raise BeamdaeError(
                f"{caller}: bounds contains {short_repr(name)}, which is not in by; name one of "
                f"{', '.join(first)}."
            )
        ends = require_pair(caller, part, value, "(lower, upper)")
        lower, upper = (
            _read_bound(
                caller, part, default if x is None else x, np.size(first[name]), units[name]
            )
            for x, default in zip(ends, (-np.inf, np.inf), strict=True)
        )
        got = f"got {short_repr(value)}"
        if np.any(lower == upper):
            raise BeamdaeError(
                f"{caller}: {part} must differ, {got}; remove {name} from by to keep its value."
            )
        if np.any(lower > upper):
            raise BeamdaeError(
                f"{caller}: {part} must ascend, (lower, upper), {got}; exchange them."
            )
        if not np.all((lower <= first[name]) & (first[name] <= upper)):
            raise BeamdaeError(
                f"{caller}: {part} must be (lower, upper) around its first value "
                f"{short_repr(first[name])}, {got}; change the bounds, or pass another first "
                f"value, parameters={{{name!r}: value}}."
            )
        result[name] = lower, upper
    return result


def _read_bound(caller: str, part: str, bound: Any, count: int, unit: str) -> Array:
    """Return a bound (count,) of the entries of a parameter."""
    bound = convert_text(caller, part, bound, unit)
    entries = [bound] * count if as_real(bound) is not None else bound
    what = "a number, or one per entry"
    numbers = [as_real(x) for x in require_sequence(caller, part, entries, what)]
    if len(numbers) != count or any(x is None or np.isnan(x) for x in numbers):
        raise BeamdaeError(f"{caller}: {part} must be {what} ({count}), got {short_repr(bound)}.")
    return np.array(numbers, float)


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
