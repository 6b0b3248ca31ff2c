"""Law of regularized friction, common to contacts and joints, as numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Default regularization velocity of contacts [m/s], and its recommended fraction of the Stribeck
# velocity. With this fraction, the largest friction is up to 0.1 % below the static friction, and
# the normal force of an arm at 92 % of self-locking is 0.7 % too small; with a twentieth, it is
# 17 % too small, and adaptive integrators need 0.7 to 1 times the steps.
_DEFAULT_SPEED = 1e-4
_RECOMMENDED_STRIBECK_SHARE = 0.005
# Speeds at which the largest friction is searched, relative to the Stribeck velocity.
_SPEEDS = np.geomspace(1e-4, 10.0, 2001)


def default_friction_speed(stribeck: float | None) -> float:
    """Return 1e-4 m/s, or 1/200 of the Stribeck velocity [m/s] if this is less."""
    return _DEFAULT_SPEED if stribeck is None else min(_DEFAULT_SPEED, suggest_speed(stribeck))


def suggest_speed(stribeck: float) -> float:
    """Return the recommended regularization velocity for a Stribeck velocity [m/s]."""
    return _RECOMMENDED_STRIBECK_SHARE * stribeck


class RegularizedFriction(NamedTuple):
    """Coulomb friction of a part with the Stribeck effect, regularized near zero velocity.

    Attributes
    ----------
    coefficient, static, stribeck
        Coefficients of friction [-], and Stribeck velocity [m/s] or None.
    speed
        Regularization velocity [m/s].
    """

    coefficient: float
    static: float | None
    stribeck: float | None
    speed: float

    def friction_coefficient(self, velocity: np.ndarray) -> np.ndarray:
        """Return friction force / normal force at sliding velocities [m/s]."""
        regularized = np.tanh(velocity / self.speed)
        if self.static is None or self.stribeck is None:
            return self.coefficient * regularized
        peak = (self.static - self.coefficient) * np.exp(-((velocity / self.stribeck) ** 2))
        return (self.coefficient + peak) * regularized

    @property
    def largest_coefficient(self) -> float:
        """Largest `friction_coefficient` [-]; the static coefficient is never quite reached."""
        if self.static is None or self.stribeck is None:
            return self.coefficient
        velocities = _SPEEDS * self.stribeck
        return max(self.coefficient, float(np.max(self.friction_coefficient(velocities))))
