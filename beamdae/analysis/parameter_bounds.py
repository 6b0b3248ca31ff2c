"""Bounds of parameters, and several searches between them: first values and ends."""

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
from beamdae.model_parameters import convert_text, format_with_unit

Array = np.ndarray

MAX_STARTS = 10_000
MAX_SEED = 2**32 - 1
# Logarithm of the ratio of first values to those about zero where variables like logarithms are
# linear: they are logarithms up to 1e-12 of the first values.
LOG_ORIGIN = 30.0


class ParameterScales:
    """Map between the variables x of a search and the values v of parameters.

    Variables are 1 at first values v0. Those with an origin c are like logarithms, but linear
    through zero, 1 + asinh(v / v0 sinh(c)) - c; others are linear, 1 + (v - v0) / size.

    Attributes
    ----------
    first
        First values v0, (k,).
    sizes
        Absolute first values (k,) of parameters with an origin, and sizes of the others.
    bounds
        Lower and upper bounds of the values, (k,) each; values are clipped to them.
    limits
        Lower and upper bounds of the variables, (k,) each.
    """

    def __init__(self, first: Array, sizes: Array, origins: Array, lower: Array, upper: Array):
        self.first, self.bounds, self._origins = first, (lower, upper), origins
        self._is_linear = origins == 0.0
        self.sizes = np.where(self._is_linear, sizes, np.abs(first))
        self.limits = self.variables(lower), self.variables(upper)

    def variables(self, values: Array) -> Array:
        """Return the variables of values (k,)."""
        with np.errstate(invalid="ignore"):  # of infinite bounds
            ratio = np.sinh(self._origins) * values / self.sizes
        logarithm = np.arcsinh(ratio) - np.sign(self.first) * self._origins
        linear = (values - self.first) / self.sizes
        return 1.0 + np.where(self._is_linear, linear, logarithm)

    def values(self, x: Array) -> Array:
        """Return the values of the parameters at x."""
        linear = self.first + self.sizes * (x - 1.0)
        values = np.where(self._is_linear, linear, self.sizes * self._ratio(np.sinh, x))
        values = np.where(x <= self.limits[0], self.bounds[0], values)
        return np.where(x >= self.limits[1], self.bounds[1], values)

    def derivatives(self, x: Array) -> Array:
        """Return the derivatives of the values with respect to x, (k,)."""
        return self.sizes * np.where(self._is_linear, 1.0, self._ratio(np.cosh, x))

    def _ratio(self, function: Any, x: Array) -> Array:
        # Long steps overflow: models reject infinite values.
        with np.errstate(all="ignore"):
            changed = function(x - 1.0 + np.sign(self.first) * self._origins)
            return np.asarray(changed / np.sinh(self._origins))


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


def draw_starts(
    caller: str,
    names: Sequence[str],
    lower: Array,
    upper: Array,
    count: int,
    seed: int,
    is_log: Array | bool = False,
) -> Array:
    """Return points (count, k) of a Latin hypercube between bounds (k,), or between logarithms.

    Raises
    ------
    BeamdaeError
        If a bound is infinite, or a lower bound of logarithms is zero.
    """
    with np.errstate(divide="ignore"):
        low, high = (np.where(is_log, np.log(np.abs(x)), x) for x in (lower, upper))
    missing = [x for x, width in zip(names, high - low, strict=True) if not np.isfinite(width)]
    if missing:
        raise BeamdaeError(
            f"{caller}: several starts need finite bounds of all parameters"
            f"{', above 0 for those in log' if np.any(is_log) else ''}; pass those of "
            f"{', '.join(missing)} in bounds={{name: (lower, upper)}}."
        )
    generator = np.random.default_rng(seed)
    cells = [generator.permutation(count) for _ in names]
    shares = (np.array(cells).T + generator.uniform(size=(count, len(names)))) / max(count, 1)
    points = low + shares * (high - low)
    return np.where(is_log, np.exp(np.where(is_log, points, 0.0)), points)


def describe_ends(ends: Array, count: int, limit: float, noun: str, unit: str = "") -> str:
    """Return how many of `count` searches have ends (j,) up to a limit, and the next one."""
    text = f"{np.sum(ends <= limit)} of {count} searches end at this {noun}"
    next_one = float(np.min(ends[ends > limit], initial=np.inf))
    if np.isfinite(next_one):
        text += f"; the next best {noun} is {format_with_unit(next_one, unit)}"
    return text
