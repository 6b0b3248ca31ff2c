"""Curves through measured points: smoothing by their noise, and what it leaves of them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import BeamdaeError, BeamdaeWarning

Array = np.ndarray

# Second differences of the curvature from point to point, over the curvature, as root mean squares:
# 0.03 to 0.8 of 40 to 8 points of smooth curves, 1 to 3.7 where noise is most of the curvature.
_MOST_JUMPING = 1.0
# Curvature times length of curves that are straight but for rounding.
_STRAIGHT = 1e-6
# Knots to tell a curvature from its jumps by.
_FEWEST = 4
_CANDIDATES = 2001


def smoothed(parameter: Array, points: Array, noise: float) -> Any:
    """The smoothing spline that misses points by `noise` [m] in each coordinate."""
    # Here, for it takes as long to import as a short run, and few models have such curves.
    from scipy.interpolate import BSpline, splprep

    count = len(points)
    with warnings.catch_warnings():
        # Of noise too small for its iterations; how far points lie from the curve is a fact.
        warnings.simplefilter("ignore", RuntimeWarning)
        (knots, values, degree), _ = splprep(points.T, u=parameter, s=2.0 * count * noise**2, k=3)
    spline = BSpline(knots, np.stack(values, axis=-1), degree)
    if not np.all(np.isfinite(spline.c)):
        raise BeamdaeError(f"Curve: noise {noise:g} m is too large for its points.")
    return spline


def fit_facts(curve: PlaneCurve, points: Array) -> Mapping[str, float]:
    """Distances of points from a curve [m], and its largest curvature [1/m]."""
    s = np.linspace(0.0, curve.length, _CANDIDATES)
    on_curve, tangent = curve.point(s), curve.tangent_angle(s)
    away = np.array([_distance(p, on_curve, tangent) for p in points])
    return {
        "root mean square distance of its points [m]": float(np.sqrt(np.mean(away**2))),
        "largest distance of its points [m]": float(away.max()),
        "largest curvature [1/m]": float(np.abs(curve.curvature(s)).max()),
    }


def _distance(p: Array, on_curve: Array, tangent: Array) -> float:
    """Of a point from the tangent of the nearest of the candidates."""
    nearest = int(np.argmin(np.sum((on_curve - p) ** 2, axis=1)))
    apart = p - on_curve[nearest]
    if nearest in (0, len(on_curve) - 1):
        return float(np.hypot(*apart))
    return abs(float(-np.sin(tangent[nearest]) * apart[0] + np.cos(tangent[nearest]) * apart[1]))


def warn_of_jumps(spline: Any, length: float) -> None:
    """Warn of points whose noise is most of the curvature of the spline through them."""
    # The second and the last but one point are no knots, and at the ends nothing holds the spline.
    at = np.unique(spline.t)[1:-1]
    if len(at) < _FEWEST:
        return
    d1, d2 = spline(at, 1), spline(at, 2)
    speed = np.linalg.norm(d1, axis=-1)
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / speed**3
    size = float(np.sqrt(np.mean(curvature**2)))
    if size * length < _STRAIGHT:
        return
    jumping = float(np.sqrt(np.mean(np.diff(curvature, 2) ** 2))) / size
    if jumping > _MOST_JUMPING:
        sentence = (
            f"Curve: the curvature of the spline through its points jumps by {jumping:.2g} times "
            "its size from point to point, as that of points that scatter or are too few does; "
            "give noise= [m], by how much they scatter, or more points."
        )
        warnings.warn(sentence, BeamdaeWarning, stacklevel=4)
