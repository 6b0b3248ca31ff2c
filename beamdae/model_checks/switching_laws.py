"""Laws of sampled controllers that jump between their limits, such as relays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from beamdae.errors import BeamdaeError

Array = np.ndarray

# Values with fewer levels than this besides the limits may be those of a switch. Then the law is
# called between two samples of different values, and this often bisected towards its transition.
_MIN_VALUES_BETWEEN = 3
_BISECTIONS = 40
_ROUNDING = 1e-9  # relative to the larger limit


def has_few_levels(held: Array, limits: tuple[float, float]) -> bool:
    """Return True if a value has hardly any levels between its limits, as that of a switch."""
    rounding = _ROUNDING * max(map(abs, limits))
    between = held[(held > limits[0] + rounding) & (held < limits[1] - rounding)]
    return len(np.unique(between)) < _MIN_VALUES_BETWEEN


def is_switch(
    evaluate: Callable[[Array], float], begin: Array, end: Array, limits: tuple[float, float]
) -> bool:
    """Return True if a law jumps between two values, or fails between them.

    A law with limits, such as a saturated PID controller, has values between them.

    Parameters
    ----------
    evaluate
        The law as a function of its arguments; it may raise BeamdaeError.
    begin, end
        Arguments with different values.
    limits
        Values at `begin` and `end`.
    """
    levels = []
    for _ in range(_BISECTIONS):
        middle = 0.5 * (begin + end)
        try:
            value = evaluate(middle)
        except BeamdaeError:
            return True
        levels.append(value)
        is_begin = abs(value - limits[0]) < abs(value - limits[1])
        begin, end = (middle, end) if is_begin else (begin, middle)
    return has_few_levels(np.array(levels), (min(limits), max(limits)))
