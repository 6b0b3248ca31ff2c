"""Where a quantity crosses its value: on which side it is, and when it changes sides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from beamdae.results.event_records import DOWN, UP

Array = np.ndarray

# Where in a step it is looked for a quantity that crosses its value: two crossings closer to each
# other than a quarter of a step may go unseen.
_LOOKS = np.array([0.25, 0.5, 0.75, 1.0])
# A quantity nearer to its value than this share of the largest it was is on it.
_ROUNDING = 1e-13
# Times are located to rounding, of themselves or of their step.
_TIME_ROUNDING = 4.0 * float(np.finfo(float).eps)
# A quantity that begins on its value has left it at so many times what it was off by, and at this
# share of its size: joints that hold it there do so to the tolerance of the run.
_LEAVING, _HELD = 4.0, 1e-6


@dataclass
class Side:
    """On which side of its value a quantity is, where that is known (else 0).

    Attributes
    ----------
    largest
        The largest it was, or what is natural, to tell rounding by.
    near
        Within this much of its value it is on no side, until it has left it.
    """

    sign: float = 0.0
    largest: float = 0.0
    near: float = 0.0

    def signs(self, beyond: Array) -> Array:
        """Sides of further values; what is not finite is on none."""
        finite = np.nan_to_num(beyond, nan=0.0)
        self.largest = max(self.largest, float(np.max(np.abs(finite), initial=0.0)))
        away = np.abs(finite) > max(_ROUNDING * self.largest, self.near)
        if away.any():
            self.near = 0.0
        return np.where(away, np.sign(finite), 0.0)

    def begin_near(self, beyond: float) -> None:
        """Begin on the value, up to rounding and what a consistent start changes."""
        self.near = max(_LEAVING * abs(beyond), _HELD * self.largest)

    def begin_from(self, sign: float, beyond: float) -> None:
        """Begin on the side where a run before ended, which may be on the value up to rounding."""
        self.sign = sign
        if abs(beyond) <= _HELD * self.largest:
            self.begin_on(sign, beyond)

    def begin_on(self, sign: float, beyond: float) -> None:
        """Begin on the value, up to rounding, on a side that is known: however short that is."""
        self.sign, self.near = sign, _LEAVING * abs(beyond)


def looks(steps: Array) -> Array:
    """Ascending times of the steps, the first one included, and between them."""
    inside = steps[:-1, None] + np.diff(steps)[:, None] * _LOOKS
    inside[:, -1] = steps[1:]
    return np.concatenate([steps[:1], inside.ravel()])


def crossings(
    t: Array, values: Array, signs: Array, before: float, beyond: Callable[[float], float]
) -> list[tuple[float, str]]:
    """When the side changes from the one it was on before, and which way."""
    found = []
    for k in np.flatnonzero(signs):
        sign = float(signs[k])
        if before == -sign:
            found.append((_located(t, values, int(k), sign, beyond), UP if sign > 0.0 else DOWN))
        before = sign
    return found


def _located(
    t: Array, values: Array, k: int, sign: float, beyond: Callable[[float], float]
) -> float:
    """When a quantity that has changed sides at look `k` did so."""
    if k == 0:
        return float(t[0])
    a, b = float(t[k - 1]), float(t[k])
    # It was on its value there already, or jumped.
    if not values[k - 1] * sign < 0.0:
        return a
    if beyond(a) * sign >= 0.0 or beyond(b) * sign <= 0.0:
        return b
    # Here, for importing it takes as long as a short run.
    from scipy.optimize import brentq

    return float(brentq(beyond, a, b, xtol=_TIME_ROUNDING * max(abs(b), b - a), rtol=1e-15))
