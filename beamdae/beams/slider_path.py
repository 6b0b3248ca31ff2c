"""The smooth curve through equidistant points that a slider follows.

Elements meet at small angles. A curve that every second derivative of a constraint exists on needs
two continuous derivatives: quintics between points, whose slopes and curvatures at the points are
central differences of five of them. Two points more at either end come from the quartic through the
last five, or from the polynomial through all where there are fewer.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from beamdae.curves.plane_curves import PlaneCurve
from beamdae.symbolic.statements import SX

Array = np.ndarray

# Points that the slopes and curvatures of one between two of them are taken from.
_SUPPORT = 6
_BEYOND = 2
_SAMPLES = 257


@cache
def _quintics() -> Array:
    """Coefficients of the share of each of six points, (power, point), between the middle two."""
    slope = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
    bend = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
    f0, f1 = np.eye(_SUPPORT)[2:4]
    d0, d1, c0, c1 = (np.pad(x, pad) for x in (slope, bend) for pad in ((0, 1), (1, 0)))
    rise = f1 - f0
    return np.array(
        [
            f0,
            d0,
            0.5 * c0,
            10.0 * rise - 6.0 * d0 - 4.0 * d1 - 1.5 * c0 + 0.5 * c1,
            -15.0 * rise + 8.0 * d0 + 7.0 * d1 + 1.5 * c0 - c1,
            6.0 * rise - 3.0 * (d0 + d1) - 0.5 * (c0 - c1),
        ]
    )


@cache
def _padding(count: int) -> Array:
    """From so many points to these and two more at either end, (count + 4, count)."""
    last = min(count, 5)
    at = np.arange(last)
    found = np.zeros((count + 2 * _BEYOND, count))
    found[_BEYOND:-_BEYOND] = np.eye(count)
    for k in range(_BEYOND):
        where = k - _BEYOND
        share = [
            np.prod([(where - j) / (i - j) for j in range(last) if j != i], initial=1.0) for i in at
        ]
        found[k, :last] = share
        found[-1 - k, -last:] = share[::-1]
    return found


def _shares(at: SX) -> list[SX]:
    """Of the six points, at 0 to 1 between the middle two; beyond that along the tangent."""
    found = []
    for c in _quintics().T:
        slopes = c[1:] * np.arange(1.0, _SUPPORT)
        inside = sum((float(x) * at**k for k, x in enumerate(c)), SX(0))
        before = float(c[0]) + float(c[1]) * at
        after = float(c.sum()) + float(slopes.sum()) * (at - 1.0)
        found.append(ca.if_else(at < 0.0, before, ca.if_else(at > 1.0, after, inside)))
    return found


def track_point(points: SX, along: SX) -> SX:
    """The curve through `points` (2, count), at `along` from 0 to count - 1."""
    count = points.shape[1]
    cell = ca.fmin(ca.fmax(ca.floor(along), 0.0), count - 2.0)
    here = [cell == k for k in range(count - 1)]
    weights = SX.zeros(count + 2 * _BEYOND)
    for i, share in enumerate(_shares(along - cell)):
        for k, chosen in enumerate(here):
            weights[k + i] += chosen * share
    return points @ (ca.DM(_padding(count)).T @ weights)


def nearest_arc_length(curve: PlaneCurve, place: tuple[float, float]) -> float:
    """Arc length [m] of the point of a curve that is nearest to a place on it, or near it."""
    samples = np.linspace(0.0, curve.length, _SAMPLES)
    s = float(samples[np.argmin(np.linalg.norm(curve.point(samples) - place, axis=1))])
    for _ in range(10):
        angle = float(curve.tangent_angle(s))
        ahead = np.subtract(place, curve.point(s)) @ (np.cos(angle), np.sin(angle))
        s = float(np.clip(s + ahead, 0.0, curve.length))
    return s
