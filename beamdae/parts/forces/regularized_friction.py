"""Law of regularized friction, common to contacts and joints, as numbers."""

from __future__ import annotations

from typing import NamedTuple

# Default regularization velocity of contacts [m/s], and its recommended fraction of the Stribeck
# velocity. With this fraction, the largest friction is up to 0.1 % below the static friction, and
# the normal force of an arm at 92 % of self-locking is 0.7 % too small; with a twentieth, it is
# 17 % too small, and adaptive integrators need 0.7 to 1 times the steps.
_DEFAULT_SPEED = 1e-4
_RECOMMENDED_STRIBECK_SHARE = 0.005


def default_friction_speed(stribeck: float | None) -> float:
    """Return 1e-4 m/s, or 1/200 of the Stribeck velocity [m/s] if this is less."""
    if stribeck is None:
        return _DEFAULT_SPEED
    return min(_DEFAULT_SPEED, _RECOMMENDED_STRIBECK_SHARE * stribeck)


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
