"""Interface of plane curves; straight lines, circular arcs and segments of other curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    format_distinct,
    is_instance,
    require_finite,
    require_point,
    require_positive,
    short_repr,
    warn_of_degrees,
)

Array = np.ndarray

# Largest tangent angle at the start of an arc [rad]; rounding of larger angles distorts the curve.
_MAX_ANGLE = 1e6
ARC_LENGTH_TOLERANCE = 1e-9  # relative to the length; rounding of arc lengths and points
_CIRCLE_TOLERANCE = 1e-12  # relative to the circumference; rounding of a full circle

# Quadrature along curves whose points or arc lengths have no closed form: number of intervals, and
# Gauss points and weights of each interval.
ARC_LENGTH_INTERVALS = 400
ARC_LENGTH_GAUSS = np.polynomial.legendre.leggauss(8)


def rotate_points(points: Array, angle: Any) -> Array:
    """Return points or vectors (..., 2) rotated counter-clockwise by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = points[..., 0], points[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


@runtime_checkable
class PlaneCurve(Protocol):
    """Interface of a beam's reference curve; all methods accept arc lengths of any shape.

    A curve with kinks may have a property `breaks`: their ascending arc lengths [m].
    """

    @property
    def length(self) -> float:
        """Total arc length [m]."""

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m], without jumps by 2 pi."""

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature 1/R [1/m] at arc lengths s [m], positive to the left."""


class HasEnd:
    """End of a curve that is defined by its start, or by other numbers."""

    @property
    def end(self) -> tuple[float, float]:
        """End point (x, y) [m]."""
        assert isinstance(self, PlaneCurve)
        x, y = self.point(self.length).tolist()
        return x, y


def require_curve(part: str, curve: Any) -> PlaneCurve:
    """Return `curve` if it is a plane curve of positive length, or raise BeamdaeError."""
    # Curve classes, unlike instances, are rejected although they have the same methods. The check
    # of the protocol takes 20 times as long as that of a type.
    is_curve = type(curve) in (Line, Arc) or (
        not isinstance(curve, type) and is_instance(curve, PlaneCurve)
    )
    if not is_curve:
        raise BeamdaeError(
            f"{part}: curve must be a Line, Arc, Parabola, Curve, IntrinsicCurve or Segment, "
            f"got {short_repr(curve)}."
        )
    require_positive(part, "the length of the curve", curve.length)
    return curve


def curve_breaks(curve: PlaneCurve) -> tuple[float, ...]:
    """Return the ascending arc lengths [m] at which the tangent or the curvature jumps."""
    return tuple(getattr(curve, "breaks", ()))


@dataclass(frozen=True)
class Line:
    """Straight line between two points.

    Parameters
    ----------
    start
        Start point (x, y) [m].
    end
        End point (x, y) [m].

    Raises
    ------
    BeamdaeError
        If a point is not a pair of finite numbers, or both points are the same.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.Line((0.0, 0.0), (3.0, 4.0)).length
    5.0
    """

    start: tuple[float, float]
    end: tuple[float, float]

    def __post_init__(self) -> None:
        convert_fields(self, start=require_point, end=require_point)
        if self.length == 0.0:
            raise BeamdaeError(f"Line: start and end must differ, but both are {self.start} m.")

    @cached_property
    def length(self) -> float:
        """Total arc length [m]."""
        return float(np.hypot(*np.subtract(self.end, self.start)))

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""
        fraction = np.asarray(s, float)[..., None] / self.length
        return np.asarray(self.start, float) + fraction * np.subtract(self.end, self.start)

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m]."""
        dx, dy = np.subtract(self.end, self.start)
        return np.full(np.shape(s), np.arctan2(dy, dx))

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature [1/m] at arc lengths s [m]."""
        return np.zeros(np.shape(s))


@dataclass(frozen=True)
class Arc(HasEnd):
    """Circular arc of at most one full circle.

    Parameters
    ----------
    radius
        Radius [m]; positive for an arc to the left (counter-clockwise), negative for an arc to the
        right.
    length
        Arc length [m].
    start
        Start point (x, y) [m].
    angle
        Angle of the tangent at the start [rad].

    Raises
    ------
    BeamdaeError
        If an argument is invalid, the radius is zero, the length is not positive, the angle exceeds
        1e6 rad in absolute value, or the arc is longer than a full circle.

    Warns
    -----
    BeamdaeWarning
        If the angle is more than a full turn and a usual number of degrees.

    Examples
    --------
    >>> import beamdae as bd
    >>> quarter = bd.Arc(radius=2.0, length=3.14159265)
    >>> [round(x, 6) for x in quarter.end]
    [2.0, 2.0]
    """

    radius: float
    length: float
    start: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        convert_fields(
            self,
            radius=require_finite,
            length=require_positive,
            start=require_point,
            angle=require_finite,
        )
        if self.radius == 0.0:
            raise BeamdaeError("Arc: radius must not be zero; use a Line for a straight curve.")
        if abs(self.angle) > _MAX_ANGLE:
            raise BeamdaeError(
                f"Arc: angle must not exceed {_MAX_ANGLE:g} rad in absolute value, got "
                f"{self.angle:g} rad; subtract full turns of 2 pi."
            )
        warn_of_degrees("Arc", "angle", self.angle)
        circle = 2.0 * np.pi * abs(self.radius)
        if self.length > circle * (1.0 + _CIRCLE_TOLERANCE):
            length, most = format_distinct(self.length, circle)
            raise BeamdaeError(
                f"Arc: a length of {length} m folds the curve onto itself; "
                f"at most one full circle of {most} m is allowed."
            )

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""
        half = 0.5 * np.asarray(s, float) / self.radius
        # Chord length and direction: differences of sines cancel for arcs of huge radius.
        along = np.stack([np.cos(self.angle + half), np.sin(self.angle + half)], axis=-1)
        return np.asarray(self.start, float) + (2.0 * self.radius * np.sin(half))[..., None] * along

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m]."""
        return self.angle + np.asarray(s, float) / self.radius

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature [1/m] at arc lengths s [m]."""
        return np.full(np.shape(s), 1.0 / self.radius)


@dataclass(frozen=True)
class Segment:
    """Part of a curve, for example for one of several beams welded together.

    Parameters
    ----------
    curve
        The whole curve.
    start, end
        Arc lengths of `curve` at the ends of the segment [m].

    Raises
    ------
    BeamdaeError
        If `curve` is not a plane curve, or 0 <= start < end <= length of the curve does not hold.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.Segment(bd.Line((0.0, 0.0), (2.0, 0.0)), 0.5, 2.0).length
    1.5
    """

    curve: PlaneCurve
    start: float
    end: float

    def __post_init__(self) -> None:
        require_curve("Segment", self.curve)
        convert_fields(self, start=require_finite, end=require_finite)
        whole, slack = self.curve.length, ARC_LENGTH_TOLERANCE
        if not -slack * whole <= self.start < self.end <= whole * (1.0 + slack):
            raise BeamdaeError(
                f"Segment: start and end must ascend within [0, {whole:.12g}] m, "
                f"got {self.start:.12g} and {self.end:.12g} m."
            )

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        return self.end - self.start

    @property
    def facts(self) -> Mapping[str, float]:
        """Values of `curve` by name; empty if there are none."""
        return getattr(self.curve, "facts", {})

    @property
    def breaks(self) -> tuple[float, ...]:
        """Arc lengths [m] at which the tangent or the curvature of `curve` jumps."""
        return tuple(x - self.start for x in curve_breaks(self.curve) if self.start < x < self.end)

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""
        return self.curve.point(self.start + np.asarray(s, float))

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m]."""
        return self.curve.tangent_angle(self.start + np.asarray(s, float))

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature [1/m] at arc lengths s [m]."""
        return self.curve.curvature(self.start + np.asarray(s, float))
