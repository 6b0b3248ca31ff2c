"""What Radau weighs errors with, and the steps it takes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from beamdae.integrators.error_control import ROUNDING, Scales
from beamdae.integrators.radau_newton import MAX_ITERATIONS, Collocation

Array = np.ndarray

# The largest error over a run stays below 100 rtol (30 rtol with damping) with these.
_SAFETY = 0.15
_EXPONENT = 0.9
# What Newton's iteration may leave of the local tolerance: at most this much, and less at tight
# tolerances, for the error of order 6 falls faster than the estimate of order 4 that is tested.
_FRACTION = 0.03
_FRACTION_OF_ROOT = 3.0

# One over the order of what is estimated: the embedded method is of order 3.
_POWER = 1.0 / 4.0
_MARGIN = 0.9
_SHRINK, _GROW = 0.2, 4.0
# An error below this says no more about the next step.
_LEAST_ERROR = 1e-2
# A step that would grow by less keeps its size, and with it the factors, if they shrink the
# changes of Newton's iteration to KEEP_RATE.
_HYSTERESIS = 1.2
KEEP_RATE = 0.05
# Steps too long for Newton's iteration: how far to go back, and how to return from there while it
# converges as fast as this.
_RETREAT = 0.5
_RETURN = 1.1
_SLOW_RATE = 0.2


@dataclass(frozen=True)
class Tolerance:
    """Tolerances of a step, for positions and velocities.

    Attributes
    ----------
    local
        Relative to the scales of the mechanism.
    velocities
        Whether the error test sees velocities.
    """

    local: float
    scales: Scales
    velocities: bool

    @classmethod
    def honest(cls, rtol: float, scales: Scales, velocities: bool) -> Tolerance:
        """The one that keeps the error of a whole run near `rtol`.

        The estimate falls with the fourth power of the step and the error of a run with the
        fifth, which asks for an exponent of 4/5, but with a lower one where fast modes are
        undamped: 0.9 serves both, on the cases of validation/tolerances.
        """
        return cls(_SAFETY * rtol**_EXPONENT, scales, velocities)

    @cached_property
    def weights(self) -> Array:
        """One over the tolerances of (q, v)."""
        positions = self.scales.tolerances(self.local)
        return 1.0 / np.concatenate([positions, self.scales.rate * positions])

    def iteration_weights(self, h: float) -> Array:
        """One over what Newton's iteration may leave of (q, v) in a step h.

        Velocities count whether they are tested or not: they are where the next step begins, and
        over short steps positions say nothing of them.
        """
        fraction = min(_FRACTION, _FRACTION_OF_ROOT * np.sqrt(self.local))
        size = self.scales.size
        n = len(size)
        weights = self.weights / fraction
        np.minimum(weights[:n], 1.0 / (ROUNDING * size), out=weights[:n])
        np.minimum(weights[n:], h / (ROUNDING * size), out=weights[n:])
        return weights

    def norm(self, error: Array) -> float:
        """Largest tested error, 1 at the tolerance."""
        weights = self.weights
        tested = len(weights) if self.velocities else len(weights) // 2
        return float(np.abs(error[:tested] * weights[:tested]).max())


@dataclass
class PredictiveStepSize:
    """The next step: predicted from the last two errors, and within what Newton's iteration can do.

    h_{n+1} = 0.9 h_n e_n^(-1/4) min(1, (h_n / h_{n-1}) (e_{n-1} / e_n)^(1/4)); Gustafsson, ACM
    Trans. Math. Softw. 20 (1994) 496. Slender beams bend with little and stretch with much force:
    Newton's iteration fails where a step rotates an element by more than its slenderness, often
    long before the error test does. Such a step is halved, and approached again by small steps.

    Attributes
    ----------
    next
        Step to try [s].
    longest
        Largest step allowed [s].
    """

    next: float
    longest: float
    _before: tuple[float, float] | None = None
    _repeated: bool = False
    _manageable: float = field(init=False)

    def __post_init__(self) -> None:
        self._manageable = self.longest
        self.next = min(self.next, self.longest)

    def accepted(self, h: float, error: float, newton: Collocation) -> None:
        """Go on after a step h."""
        error = max(error, _LEAST_ERROR)
        factor = self._factor(error, newton)
        if self._before is not None:
            h_before, error_before = self._before
            factor *= min(1.0, h / h_before * (error_before / error) ** _POWER)
        factor = min(max(factor, _SHRINK), 1.0 if self._repeated else _GROW)
        if newton.rate < _SLOW_RATE:
            self._manageable = min(_RETURN * self._manageable, self.longest)
        wanted = min(factor * h, self._manageable)
        keep = h <= wanted <= _HYSTERESIS * h and newton.serves(h, KEEP_RATE)
        self.next = h if keep else wanted
        self._before, self._repeated = (h, error), False

    def refused(self, h: float, error: float, newton: Collocation) -> None:
        """Try a smaller step, by the error."""
        self.next = h * min(max(self._factor(error, newton), _SHRINK), _MARGIN)
        self._repeated = True

    def diverged(self, h: float) -> None:
        """Try a smaller step, for the sake of Newton's iteration."""
        self.next = self._manageable = _RETREAT * h
        self._repeated = True

    @staticmethod
    def _factor(error: float, newton: Collocation) -> float:
        """What the error allows, less where the iteration was slow."""
        most = 2 * MAX_ITERATIONS
        return _MARGIN * (most + 1) / (most + newton.iterations) / error**_POWER
