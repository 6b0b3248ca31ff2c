"""Curves represented by splines: parabolas, functions y = f(x) and curves through points."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.curves.plane_curves import (
    ARC_LENGTH_GAUSS,
    ARC_LENGTH_INTERVALS,
    HasEnd,
    PlaneCurve,
    rotate_points,
)
from beamdae.errors import (
    BeamdaeError,
    as_real,
    convert_fields,
    format_exception,
    require_finite,
    require_point,
    require_positive,
    require_sequence,
    short_repr,
    warn_user,
)
from beamdae.read_only import read_only

Array = np.ndarray

_FUNCTION_SAMPLES = 601
# Largest accepted difference between the spline and the function midway between two samples,
# relative to their spacing. At a kink with a slope change of 1, the difference is a few hundredths.
_MAX_INTERPOLATION_ERROR = 1e-3

_MIN_POINTS = 4  # of a cubic spline

# Number of Newton corrections of the curve parameter at an arc length.
_PARAMETER_ITERATIONS = 3
# Cached parameters of one curve: arrays of at most this size, and their number. Building a beam
# needs about 15 small arrays.
_MAX_CACHED_SIZE = 1000
_MAX_CACHED_RESULTS = 50
# Smallest accepted ratio of the minimum to the maximum derivative of the arc length with respect to
# the parameter; at a cusp, the ratio is smaller.
_MIN_SPEED_RATIO = 1e-8
# Smallest accepted cosines of the angles between successive tangents and between successive steps
# from point to point; smaller cosines indicate sharp bends or folds.
_MIN_TANGENT_COSINE = 0.5
_MIN_STEP_COSINE = -0.5

# RMS of the second differences of the curvature from point to point, relative to the RMS of the
# curvature: 0.03 to 0.8 for 40 to 8 points of smooth curves, 1 to 3.7 if the curvature is mostly
# noise.
_MAX_CURVATURE_JUMP = 1.0
_STRAIGHT_CURVATURE = 1e-6  # times length; smaller values are rounding errors of a straight curve
_MIN_INNER_KNOTS = 4  # needed to distinguish a curvature from its jumps
_DISTANCE_SAMPLES = 2001


class _SplineCurve(HasEnd):
    """Arc length, tangent angle and curvature of a curve defined by a spline.

    `_spline` maps a parameter to (x, y). The arc length is integrated by Gauss quadrature on fine
    intervals. The parameter at an arc length is interpolated in the resulting table and corrected
    by Newton's method.
    """

    _spline: Any

    @cached_property
    def _arc_length_table(self) -> tuple[Array, Array]:
        """Spline parameters and the arc lengths [m] at these parameters."""
        knots = np.unique(self._spline.t)
        uniform = np.linspace(knots[0], knots[-1], ARC_LENGTH_INTERVALS + 1)
        grid = np.unique(np.concatenate([uniform, knots]))
        lengths = self._integrate_speed(grid[:-1], grid[1:])
        return grid, np.concatenate([[0.0], np.cumsum(lengths)])

    def _integrate_speed(self, a: Array, b: Array) -> Array:
        """Return the arc lengths [m] from parameters `a` to `b`, by Gauss quadrature."""
        nodes, weights = ARC_LENGTH_GAUSS
        half = 0.5 * (b - a)
        parameters = 0.5 * (a + b)[..., None] + half[..., None] * nodes
        speed = np.linalg.norm(self._spline(parameters, 1), axis=-1)
        return half * (speed @ weights)

    def _require_regular(self, part: str) -> None:
        """Reject a curve with a cusp, a sharp bend or coordinates that are not finite."""
        grid, _ = self._arc_length_table
        tangent = self._spline(grid, 1)
        speed = np.linalg.norm(tangent, axis=-1)
        if not np.all(np.isfinite(speed)) or speed.min() <= _MIN_SPEED_RATIO * speed.max():
            x, y = self._spline(grid[int(np.argmin(np.nan_to_num(speed)))])
            raise BeamdaeError(
                f"{part}: the curve folds onto itself, has a cusp or overflows near ({x:.6g}, "
                f"{y:.6g}) m; use a smooth curve with finite coordinates."
            )
        cosine = np.einsum("ij,ij->i", tangent[:-1], tangent[1:]) / (speed[:-1] * speed[1:])
        if cosine.min() < _MIN_TANGENT_COSINE:
            x, y = self._spline(grid[int(np.argmin(cosine))])
            raise BeamdaeError(
                f"{part}: the curve folds onto itself or bends sharply near ({x:.6g}, {y:.6g}) "
                "m; use a curve whose tangent turns gradually."
            )

    def _parameter(self, s: Any) -> Array:
        """Return the spline parameters at arc lengths s [m], clipped to the ends of the curve."""
        s = np.asarray(s, float)
        if s.size > _MAX_CACHED_SIZE:
            return self._solve_for_parameter(s)
        # A beam evaluates points, angles and curvatures at the same arc lengths.
        known, key = self._known_parameters, (s.shape, s.tobytes())
        parameter = known.get(key)
        if parameter is None:
            if len(known) >= _MAX_CACHED_RESULTS:
                known.clear()
            parameter = known[key] = read_only(self._solve_for_parameter(s))
        return parameter

    @cached_property
    def _known_parameters(self) -> dict[tuple[tuple[int, ...], bytes], Array]:
        return {}

    def _solve_for_parameter(self, s: Array) -> Array:
        grid, table = self._arc_length_table
        s = np.clip(s, 0.0, table[-1])
        interval = np.clip(np.searchsorted(table, s, side="right") - 1, 0, grid.size - 2)
        tau = np.interp(s, table, grid)
        for _ in range(_PARAMETER_ITERATIONS):
            arc_length = table[interval] + self._integrate_speed(grid[interval], tau)
            tau = tau - (arc_length - s) / np.linalg.norm(self._spline(tau, 1), axis=-1)
        return tau

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        return float(self._arc_length_table[1][-1])

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""
        return self._spline(self._parameter(s))

    @cached_property
    def _continuous_angles(self) -> Array:
        """Tangent angles [rad] at the parameters of the arc length table, without jumps by 2 pi."""
        tangent = self._spline(self._arc_length_table[0], 1)
        return np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m]."""
        tau = self._parameter(s)
        tangent = self._spline(tau, 1)
        principal = np.arctan2(tangent[..., 1], tangent[..., 0])
        continuous = np.interp(tau, self._arc_length_table[0], self._continuous_angles)
        return principal + 2.0 * np.pi * np.round((continuous - principal) / (2.0 * np.pi))

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature [1/m] at arc lengths s [m]."""
        tau = self._parameter(s)
        d1, d2 = self._spline(tau, 1), self._spline(tau, 2)
        cross = d1[..., 0] * d2[..., 1] - d1[..., 1] * d2[..., 0]
        return cross / np.linalg.norm(d1, axis=-1) ** 3


@dataclass(frozen=True)
class Parabola(_SplineCurve):
    """Parabola y = 4 d x (l - x) / l^2 (eq. 26 of Pan & Liu 2012).

    Parameters
    ----------
    span
        Length l of the chord [m].
    rise
        Distance d of the vertex from the chord [m]; positive to the left of the chord, negative to
        the right.
    start
        Start point (x, y) [m].
    angle
        Angle of the chord [rad].

    Raises
    ------
    BeamdaeError
        If an argument is invalid, or the vertex is too sharp.

    Examples
    --------
    >>> import beamdae as bd
    >>> rod = bd.Parabola(span=4.0, rise=1.0)
    >>> rod.point(0.5 * rod.length).round(9)
    array([2., 1.])
    """

    span: float
    rise: float
    start: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        convert_fields(
            self,
            span=require_positive,
            rise=require_finite,
            start=require_point,
            angle=require_finite,
        )
        self._require_regular("Parabola")

    @cached_property
    def _spline(self) -> Any:
        x = np.linspace(0.0, self.span, 3)
        y = 4.0 * self.rise * x * (self.span - x) / self.span**2
        points = rotate_points(np.stack([x, y], axis=-1), self.angle)
        return _interpolating_spline(x, points + np.asarray(self.start, float), 2)


@dataclass(frozen=True)
class Curve(_SplineCurve):
    """Smooth curve: a function y = f(x) over an interval, or a spline defined by points.

    Parameters
    ----------
    function
        Smooth function y = f(x) [m]; requires `x`.
    x
        Interval (x_start, x_end) [m]; the curve runs from x_start to x_end.
    points
        At least 4 points, shape (n, 2) [m]. Without `noise`, a cubic spline parametrized by chord
        length joins them.
    noise
        Standard deviation of x and of y of measured points [m]. If given, the curve is a smoothing
        spline (Dierckx 1993). The RMS of the differences between the coordinates of the points and
        of the curve is `noise`, less if a single cubic is closer, or more if the fit does not
        converge for a very small `noise`. Without `noise`, the curvature of a curve through
        measured points is often mostly noise.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the function fails, is not smooth or not finite, the noise is too
        large for the points, or the curve folds onto itself or bends sharply.

    Warns
    -----
    BeamdaeWarning
        If `points` are given without `noise`, and the curvature of the spline is mostly noise.

    Examples
    --------
    >>> import numpy as np
    >>> import beamdae as bd
    >>> wave = bd.Curve(lambda x: 0.1 * np.sin(x), x=(0.0, 3.0))
    >>> measured = bd.Curve(points=[(0.0, 0.0), (0.5, 0.1), (1.0, 0.1), (1.5, 0.0)])
    """

    function: Callable[[float], float] | None = None
    x: tuple[float, float] | None = None
    points: Any = None
    noise: float | None = None

    def __post_init__(self) -> None:
        if (self.function is None) == (self.points is None):
            raise BeamdaeError(
                "Curve: either function or points must be given; pass function and x, or points."
            )
        if self.noise is not None:
            convert_fields(self, noise=require_positive)
            if self.points is None:
                raise BeamdaeError(
                    "Curve: noise applies only to points; omit noise with a function."
                )
        if self.function is not None and not callable(self.function):
            raise BeamdaeError(
                f"Curve: function must be a function of x, got {short_repr(self.function)}."
            )
        # `_require_regular` raises an error for overflows.
        with np.errstate(over="ignore", invalid="ignore"):
            self._require_regular("Curve")
            if self.function is not None:
                self._require_smooth_function()
            elif self.noise is None:
                warn_about_curvature_jumps(self._spline, self.length)

    @property
    def facts(self) -> Mapping[str, float]:
        """RMS and largest distance of the points from the curve [m], and largest curvature [1/m].

        The dictionary is empty for a curve y = f(x).
        """
        return {} if self.points is None else measure_fit(self, np.array(self.points, float))

    @cached_property
    def _spline(self) -> Any:
        return self._point_spline() if self.function is None else self._function_spline()

    def _function_spline(self) -> Any:
        assert self.function is not None
        if self.x is None:
            raise BeamdaeError("Curve: a function requires an interval; pass x=(x_start, x_end).")
        x_start, x_end = require_point("Curve", "x", self.x)
        if x_start == x_end:
            raise BeamdaeError(
                f"Curve: the interval x must not be empty, got {short_repr(self.x)} m."
            )
        parameter = np.linspace(0.0, 1.0, _FUNCTION_SAMPLES)
        x = np.linspace(x_start, x_end, _FUNCTION_SAMPLES)
        y = np.array([self._evaluate_function(xi) for xi in x.tolist()])
        return _interpolating_spline(parameter, np.stack([x, y], axis=-1), 5)

    def _require_smooth_function(self) -> None:
        """Reject a function from which the spline deviates midway between the samples."""
        knots = np.linspace(0.0, 1.0, _FUNCTION_SAMPLES)
        midpoints = self._spline(0.5 * (knots[:-1] + knots[1:]))
        exact = [self._evaluate_function(x) for x in midpoints[:, 0].tolist()]
        error = np.abs(midpoints[:, 1] - exact)
        worst = int(np.argmax(error))
        if error[worst] > _MAX_INTERPOLATION_ERROR * abs(midpoints[1, 0] - midpoints[0, 0]):
            raise BeamdaeError(
                "Curve: the function must be smooth, but has a kink, a jump, an "
                "almost vertical tangent or a very short wave near x = "
                f"{midpoints[worst, 0]:.6g} m; if this is a kink, join two beams there by a Weld."
            )

    def _evaluate_function(self, x: float) -> float:
        assert self.function is not None
        try:
            value = self.function(x)
        except Exception as problem:
            raise BeamdaeError(
                "Curve: the function must return a number for every x in "
                f"{short_repr(self.x)}, but the call failed at x = {x:.6g} m: "
                f"{format_exception(problem)}."
            ) from problem
        y = as_real(value)
        if y is None:
            raise BeamdaeError(
                f"Curve: the function must return a number, got {short_repr(value)} at "
                f"x = {x:.6g} m."
            )
        if not math.isfinite(y):
            raise BeamdaeError(
                f"Curve: the function is {y} at x = {x:.6g} m; the value must be finite for "
                f"every x in {short_repr(self.x)}."
            )
        return y

    def _point_spline(self) -> Any:
        expected = f"at least {_MIN_POINTS} pairs (x, y)"
        pairs = require_sequence("Curve", "points", self.points, expected)
        if len(pairs) < _MIN_POINTS:
            raise BeamdaeError(f"Curve: points must be {expected}, got {len(pairs)}.")
        points = np.array([require_point("Curve", f"point {k}", xy) for k, xy in enumerate(pairs)])
        distances = np.linalg.norm(np.diff(points, axis=0), axis=-1)
        if distances.min() == 0.0:
            x, y = points[int(np.argmin(distances))]
            raise BeamdaeError(
                f"Curve: the point ({x:g}, {y:g}) m is repeated; give each point once."
            )
        parameter = np.concatenate([[0.0], np.cumsum(distances)])
        if self.noise is not None:
            return fit_smoothing_spline(parameter, points, self.noise)
        self._require_one_direction(points)
        return _interpolating_spline(parameter, points, 3)

    @staticmethod
    def _require_one_direction(points: Array) -> None:
        step = np.diff(points, axis=0)
        cosine = np.einsum("ij,ij->i", step[:-1], step[1:])
        cosine /= np.linalg.norm(step[:-1], axis=1) * np.linalg.norm(step[1:], axis=1)
        if cosine.min() < _MIN_STEP_COSINE:
            x, y = points[int(np.argmin(cosine)) + 1]
            raise BeamdaeError(
                f"Curve: the curve folds onto itself at the point ({x:g}, {y:g}) m; list "
                "the points in their order along the curve."
            )


def _interpolating_spline(parameter: Array, points: Array, degree: int) -> Any:
    # Imported here because the import takes as long as a short run, and few models need it.
    from scipy.interpolate import make_interp_spline

    return make_interp_spline(parameter, points, k=degree)


def fit_smoothing_spline(parameter: Array, points: Array, noise: float) -> Any:
    """Return the smoothing spline whose deviations from the points have the RMS `noise` [m].

    The RMS is taken over both coordinates of all points. It is smaller than `noise` if a single
    cubic is closer to the points, and larger if the fit does not converge for a very small `noise`.

    Parameters
    ----------
    parameter
        Ascending spline parameters of the points, shape (n,).
    points
        Points (n, 2) [m].
    noise
        Standard deviation of the coordinates [m].

    Raises
    ------
    BeamdaeError
        If the noise is too large for the points.
    """
    # Imported here because the import takes as long as a short run, and few models need it.
    from scipy.interpolate import BSpline, splprep

    count = len(points)
    with warnings.catch_warnings():
        # splprep warns if it does not reach a small noise level; `Curve.facts` reports the
        # distances.
        warnings.simplefilter("ignore", RuntimeWarning)
        (knots, values, degree), _ = splprep(points.T, u=parameter, s=2.0 * count * noise**2, k=3)
    spline = BSpline(knots, np.stack(values, axis=-1), degree)
    if not np.all(np.isfinite(spline.c)):
        raise BeamdaeError(f"Curve: noise = {noise:g} m is too large for the points; reduce noise.")
    return spline


def measure_fit(curve: PlaneCurve, points: Array) -> Mapping[str, float]:
    """Return RMS and largest distance of points from a curve, and the largest |curvature|.

    `points` has the shape (n, 2) [m]. The keys of the result contain the units.
    """
    s = np.linspace(0.0, curve.length, _DISTANCE_SAMPLES)
    on_curve, tangent = curve.point(s), curve.tangent_angle(s)
    distances = np.array([_distance_to_curve(p, on_curve, tangent) for p in points])
    return {
        "RMS distance of the points from the curve [m]": float(np.sqrt(np.mean(distances**2))),
        "largest distance of the points from the curve [m]": float(distances.max()),
        "largest curvature [1/m]": float(np.abs(curve.curvature(s)).max()),
    }


def _distance_to_curve(p: Array, on_curve: Array, tangent: Array) -> float:
    """Return the distance [m] to the nearest sample if this is an end, else to its tangent."""
    nearest = int(np.argmin(np.sum((on_curve - p) ** 2, axis=1)))
    dx, dy = p - on_curve[nearest]
    if nearest in (0, len(on_curve) - 1):
        return float(np.hypot(dx, dy))
    return abs(float(-np.sin(tangent[nearest]) * dx + np.cos(tangent[nearest]) * dy))


def warn_about_curvature_jumps(spline: Any, length: float) -> None:
    """Warn if the curvature of a spline through points is mostly noise.

    `length` is the arc length of the spline [m]. Splines with fewer than four inner knots are not
    checked.
    """
    # Cubic interpolation has no knots at the second and the second-to-last point; the end knots are
    # omitted, because no condition determines the curvature there.
    knots = np.unique(spline.t)[1:-1]
    if len(knots) < _MIN_INNER_KNOTS:
        return
    d1, d2 = spline(knots, 1), spline(knots, 2)
    speed = np.linalg.norm(d1, axis=-1)
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / speed**3
    size = float(np.sqrt(np.mean(curvature**2)))
    if size * length < _STRAIGHT_CURVATURE:
        return
    jump = float(np.sqrt(np.mean(np.diff(curvature, 2) ** 2))) / size
    if jump > _MAX_CURVATURE_JUMP:
        message = (
            "Curve: the curvature of the spline jumps from point to point by an RMS value of "
            f"{jump:.2g} times the RMS curvature, which indicates scattered or too few points; "
            "pass their standard deviation as noise= [m], or more points."
        )
        warn_user(message)
