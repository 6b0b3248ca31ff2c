"""Plane curves without a closed arc length: parabolas, any y = f(x), points."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.curves.plane_curves import PlaneCurve, rotate_points
from beamdae.errors import (
    BeamdaeError,
    BeamdaeWarning,
    as_real,
    format_exception,
    require_finite,
    require_point,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
)

Array = np.ndarray

# Second differences of the curvature from point to point, over the curvature, as root mean squares:
# 0.03 to 0.8 of 40 to 8 points of smooth curves, 1 to 3.7 where noise is most of the curvature.
_MAX_CURVATURE_JUMP = 1.0
# Curvature times length of curves that are straight but for rounding.
_STRAIGHT_CURVATURE = 1e-6
# Knots to tell a curvature from its jumps by.
_MIN_INNER_KNOTS = 4
_DISTANCE_SAMPLES = 2001


def fit_smoothing_spline(parameter: Array, points: Array, noise: float) -> Any:
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


def measure_fit(curve: PlaneCurve, points: Array) -> Mapping[str, float]:
    """Distances of points from a curve [m], and its largest curvature [1/m]."""
    s = np.linspace(0.0, curve.length, _DISTANCE_SAMPLES)
    on_curve, tangent = curve.point(s), curve.tangent_angle(s)
    away = np.array([_distance_to_curve(p, on_curve, tangent) for p in points])
    return {
        "root mean square distance of its points [m]": float(np.sqrt(np.mean(away**2))),
        "largest distance of its points [m]": float(away.max()),
        "largest curvature [1/m]": float(np.abs(curve.curvature(s)).max()),
    }


def _distance_to_curve(p: Array, on_curve: Array, tangent: Array) -> float:
    """Of a point from the tangent of the nearest of the candidates."""
    nearest = int(np.argmin(np.sum((on_curve - p) ** 2, axis=1)))
    apart = p - on_curve[nearest]
    if nearest in (0, len(on_curve) - 1):
        return float(np.hypot(*apart))
    return abs(float(-np.sin(tangent[nearest]) * apart[0] + np.cos(tangent[nearest]) * apart[1]))


def warn_about_curvature_jumps(spline: Any, length: float) -> None:
    """Warn of points whose noise is most of the curvature of the spline through them."""
    # The second and the last but one point are no knots, and at the ends nothing holds the spline.
    at = np.unique(spline.t)[1:-1]
    if len(at) < _MIN_INNER_KNOTS:
        return
    d1, d2 = spline(at, 1), spline(at, 2)
    speed = np.linalg.norm(d1, axis=-1)
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / speed**3
    size = float(np.sqrt(np.mean(curvature**2)))
    if size * length < _STRAIGHT_CURVATURE:
        return
    jumping = float(np.sqrt(np.mean(np.diff(curvature, 2) ** 2))) / size
    if jumping > _MAX_CURVATURE_JUMP:
        sentence = (
            f"Curve: the curvature of the spline through its points jumps by {jumping:.2g} times "
            "its size from point to point, as that of points that scatter or are too few does; "
            "give noise= [m], by how much they scatter, or more points."
        )
        warnings.warn(sentence, BeamdaeWarning, stacklevel=4)


_INTERVALS = 400
_FUNCTION_SAMPLES = 601
# What the spline may miss a function by between two samples, over their distance: at a kink of the
# slope by 1 it is some hundredths.
_MAX_INTERPOLATION_ERROR = 1e-3
_GAUSS = np.polynomial.legendre.leggauss(8)


def _interpolating_spline(parameter: Array, points: Array, degree: int) -> Any:
    """The spline of this degree through points."""
    # Here, for it takes as long to import as a short run, and few models have such curves.
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(parameter, points, k=degree)


class _SplineCurve:
    """Arc length, angle and curvature of a curve given by `_spline`: parameter -> (x, y).

    The arc length is integrated by Gauss quadrature on fine intervals; the parameter of an arc
    length is found from that table and two Newton corrections.
    """

    _spline: Any

    @cached_property
    def _table(self) -> tuple[Array, Array]:
        knots = np.unique(self._spline.t)
        grid = np.unique(np.concatenate([np.linspace(knots[0], knots[-1], _INTERVALS + 1), knots]))
        lengths = self._stretches(grid[:-1], grid[1:])
        return grid, np.concatenate([[0.0], np.cumsum(lengths)])

    def _stretches(self, a: Array, b: Array) -> Array:
        nodes, weights = _GAUSS
        half = 0.5 * (b - a)
        at = 0.5 * (a + b)[..., None] + half[..., None] * nodes
        speed = np.linalg.norm(self._spline(at, 1), axis=-1)
        return half * (speed @ weights)

    def _check_regular(self, part: str) -> None:
        grid, _ = self._table
        tangent = self._spline(grid, 1)
        speed = np.linalg.norm(tangent, axis=-1)
        if not np.all(np.isfinite(speed)) or speed.min() <= 1e-8 * speed.max():
            at = self._spline(grid[int(np.argmin(np.nan_to_num(speed)))])
            raise BeamdaeError(
                f"{part}: the curve folds onto itself or has a cusp near "
                f"({at[0]:.6g}, {at[1]:.6g}), it must run on in one direction."
            )
        turn = np.einsum("ij,ij->i", tangent[:-1], tangent[1:]) / (speed[:-1] * speed[1:])
        if turn.min() < 0.5:
            at = self._spline(grid[int(np.argmin(turn))])
            raise BeamdaeError(
                f"{part}: the curve folds onto itself near ({at[0]:.6g}, {at[1]:.6g}), "
                "its tangent must turn gradually."
            )

    def _parameter(self, s: Any) -> Array:
        grid, table = self._table
        s = np.clip(np.asarray(s, float), 0.0, table[-1])
        interval = np.clip(np.searchsorted(table, s, side="right") - 1, 0, grid.size - 2)
        tau = np.interp(s, table, grid)
        for _ in range(3):
            at = table[interval] + self._stretches(grid[interval], tau)
            tau = tau - (at - s) / np.linalg.norm(self._spline(tau, 1), axis=-1)
        return tau

    @property
    def length(self) -> float:
        return float(self._table[1][-1])

    def point(self, s: Any) -> Array:
        return self._spline(self._parameter(s))

    @cached_property
    def _unwrapped(self) -> Array:
        """Angle of the tangent at the parameters of the table, continuous."""
        dense = self._spline(self._table[0], 1)
        return np.unwrap(np.arctan2(dense[:, 1], dense[:, 0]))

    def tangent_angle(self, s: Any) -> Array:
        tau = self._parameter(s)
        here = self._spline(tau, 1)
        wrapped = np.arctan2(here[..., 1], here[..., 0])
        return wrapped + 2.0 * np.pi * np.round(
            (np.interp(tau, self._table[0], self._unwrapped) - wrapped) / (2.0 * np.pi)
        )

    def curvature(self, s: Any) -> Array:
        tau = self._parameter(s)
        d1, d2 = self._spline(tau, 1), self._spline(tau, 2)
        cross = d1[..., 0] * d2[..., 1] - d1[..., 1] * d2[..., 0]
        return cross / np.linalg.norm(d1, axis=-1) ** 3


@dataclass(frozen=True)
class Parabola(_SplineCurve):
    """Parabola y = 4 d x (l - x) / l^2 of span l and rise d [m] (eq. 26).

    It starts at `start`; `angle` [rad] is the direction of its chord. A positive rise lies to
    the left of the chord, a negative one to the right.
    """

    span: float
    rise: float
    start: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        set_fields(
            self,
            span=require_positive("Parabola", "span", self.span),
            rise=require_finite("Parabola", "rise", self.rise),
            start=require_point("Parabola", "start", self.start),
            angle=require_finite("Parabola", "angle", self.angle),
        )
        self._check_regular("Parabola")

    @cached_property
    def _spline(self) -> Any:
        x = np.linspace(0.0, self.span, 3)
        y = 4.0 * self.rise * x * (self.span - x) / self.span**2
        points = rotate_points(np.stack([x, y], axis=-1), self.angle)
        return _interpolating_spline(x, points + np.asarray(self.start, float), 2)


@dataclass(frozen=True)
class Curve(_SplineCurve):
    """Any smooth curve: y = f(x) over an interval, or a spline through points.

    Parameters
    ----------
    function
        Callable y = f(x) [m] of the drawing; needs `x`.
    x
        The interval (x_start, x_end) [m]; the curve runs from the first to the second.
    points
        Points (n, 2) [m], n >= 4, joined by a cubic spline over the chord length.
    noise
        By how much measured points scatter about the curve: the standard deviation of x and of y
        [m]. The spline is then the smoothest that passes them at that distance in the mean
        (Dierckx 1993); without it the curvature of the curve is mostly that of the noise.

    Examples
    --------
    >>> import numpy as np
    >>> import beamdae as bd
    >>> wave = bd.Curve(lambda x: 0.1 * np.sin(x), x=(0.0, 3.0))
    >>> drawn = bd.Curve(points=[(0.0, 0.0), (0.5, 0.1), (1.0, 0.1), (1.5, 0.0)])
    """

    function: Callable[[float], float] | None = None
    x: tuple[float, float] | None = None
    points: Any = None
    noise: float | None = None

    def __post_init__(self) -> None:
        if (self.function is None) == (self.points is None):
            raise BeamdaeError("Curve: give either a function with its interval x, or points.")
        if self.noise is not None:
            set_fields(self, noise=require_positive("Curve", "noise", self.noise))
            if self.points is None:
                raise BeamdaeError("Curve: noise is that of points, a function has none.")
        if self.function is not None and not callable(self.function):
            raise BeamdaeError(
                f"Curve: function must be a function of x, got {short_repr(self.function)}."
            )
        # What is too large for a curve is told by a sentence.
        with np.errstate(over="ignore", invalid="ignore"):
            self._check_regular("Curve")
            if self.function is not None:
                self._check_smooth()
            elif self.noise is None:
                warn_about_curvature_jumps(self._spline, self.length)

    @property
    def facts(self) -> Mapping[str, float]:
        """How far the points of a measured curve lie from it, and how sharply it bends."""
        return {} if self.points is None else measure_fit(self, np.array(self.points, float))

    @cached_property
    def _spline(self) -> Any:
        return self._through_points() if self.function is None else self._of_function()

    def _of_function(self) -> Any:
        assert self.function is not None
        if self.x is None:
            raise BeamdaeError("Curve: a function needs its interval x=(x_start, x_end).")
        x_start, x_end = require_point("Curve", "x", self.x)
        if x_start == x_end:
            raise BeamdaeError(
                f"Curve: the interval x must not be empty, got {short_repr(self.x)}."
            )
        share = np.linspace(0.0, 1.0, _FUNCTION_SAMPLES)
        x = np.linspace(x_start, x_end, _FUNCTION_SAMPLES)
        y = np.array([self._height(xi) for xi in x.tolist()])
        return _interpolating_spline(share, np.stack([x, y], axis=-1), 5)

    def _check_smooth(self) -> None:
        knots = np.linspace(0.0, 1.0, _FUNCTION_SAMPLES)
        between = self._spline(0.5 * (knots[:-1] + knots[1:]))
        missed = np.abs(between[:, 1] - [self._height(x) for x in between[:, 0].tolist()])
        worst = int(np.argmax(missed))
        if missed[worst] > _MAX_INTERPOLATION_ERROR * abs(between[1, 0] - between[0, 0]):
            raise BeamdaeError(
                "Curve: the function must be smooth, it has a kink, a jump, an almost vertical "
                f"tangent or too short a wave near x = {between[worst, 0]:.6g}; beams that meet in "
                "a kink are joined by a Weld."
            )

    def _height(self, x: float) -> float:
        assert self.function is not None
        try:
            y = self.function(x)
        except Exception as problem:
            raise BeamdaeError(
                f"Curve: the function must return a number for every x in {short_repr(self.x)}, "
                f"but at x = {x:.6g} it failed: {format_exception(problem)}."
            ) from problem
        found = as_real(y)
        if found is None:
            raise BeamdaeError(
                f"Curve: the function must return a number, at x = {x:.6g} it is {short_repr(y)}."
            )
        if not np.isfinite(found):
            raise BeamdaeError(f"Curve: the function must be finite, at x = {x:.6g} it is not.")
        return found

    def _through_points(self) -> Any:
        wanted = "at least 4 pairs (x, y)"
        given = require_sequence("Curve", "points", self.points, wanted)
        if len(given) < 4:
            raise BeamdaeError(f"Curve: points must be {wanted}, got {len(given)}.")
        points = np.array([require_point("Curve", f"point {k}", xy) for k, xy in enumerate(given)])
        step = np.linalg.norm(np.diff(points, axis=0), axis=-1)
        if step.min() == 0.0:
            at = points[int(np.argmin(step))]
            raise BeamdaeError(f"Curve: the point ({at[0]:g}, {at[1]:g}) comes twice in a row.")
        parameter = np.concatenate([[0.0], np.cumsum(step)])
        if self.noise is not None:
            return fit_smoothing_spline(parameter, points, self.noise)
        self._check_reversal(points)
        return _interpolating_spline(parameter, points, 3)

    @staticmethod
    def _check_reversal(points: Array) -> None:
        step = np.diff(points, axis=0)
        along = np.einsum("ij,ij->i", step[:-1], step[1:])
        along /= np.linalg.norm(step[:-1], axis=1) * np.linalg.norm(step[1:], axis=1)
        if along.min() < -0.5:
            at = points[int(np.argmin(along)) + 1]
            raise BeamdaeError(
                f"Curve: the curve folds onto itself at the point ({at[0]:g}, {at[1]:g}), "
                "it must run on in one direction."
            )
