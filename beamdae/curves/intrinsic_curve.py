"""Plane curves defined by their curvature, such as clothoids."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.curves.plane_curves import ARC_LENGTH_GAUSS, ARC_LENGTH_INTERVALS, HasEnd
from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    format_exception,
    require_finite,
    require_point,
    require_positive,
    short_repr,
)

Array = np.ndarray

_MAX_TURN_PER_INTERVAL = 0.5  # [rad]; the splines cannot resolve sharper bends
_MAX_ANGLE_CHANGE = 1e-5  # [rad], of tangents by half as many intervals
_MAX_INTERVALS = 64 * ARC_LENGTH_INTERVALS  # of the splines


@dataclass(frozen=True)
class IntrinsicCurve(HasEnd):
    """Curve defined by its curvature as a function of arc length (Cesàro's equation).

    Parameters
    ----------
    law
        Smooth function of arc length s [m] that returns the signed curvature [1/m], positive to the
        left.
    length
        Arc length [m].
    start
        Start point (x, y) [m].
    angle
        Angle of the tangent at the start [rad].

    Raises
    ------
    BeamdaeError
        If an argument is invalid, if the law fails, does not return a finite number or jumps, or if
        the tangent turns by 0.5 rad or more within 1/25600 of the length.

    Examples
    --------
    >>> import beamdae as bd
    >>> clothoid = bd.IntrinsicCurve(lambda s: 2.0 * s, length=1.0)
    >>> round(float(clothoid.tangent_angle(1.0)), 9)
    1.0
    """

    law: Callable[[float], float]
    length: float
    start: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def __post_init__(self) -> None:
        convert_fields(self, length=require_positive, start=require_point, angle=require_finite)
        if not callable(self.law):
            raise BeamdaeError(
                f"IntrinsicCurve: law must be a function of s, got {short_repr(self.law)}."
            )
        # Raises the errors of the law.
        _ = self._splines

    def _curvature_at(self, s: float) -> float:
        try:
            value = self.law(s)
        except Exception as problem:
            raise BeamdaeError(
                "IntrinsicCurve: law must return a number for every s in [0, "
                f"{self.length:g}] m, but the call failed at s = {s:.6g} m: "
                f"{format_exception(problem)}."
            ) from problem
        return require_finite("IntrinsicCurve", f"the curvature at s = {s:.6g} m", value)

    @cached_property
    def _splines(self) -> tuple[Array, Any, Any]:
        """Arc lengths, and splines of the curvature and of its integral, the turn of the tangent.

        There are so many arc lengths that the tangent turns little between them, and that half as
        many lead to the same tangents.
        """
        # Imported here because the import takes as long as a short run, and few models need it.
        from scipy.interpolate import make_interp_spline

        count, before = ARC_LENGTH_INTERVALS // 2, None
        while True:
            grid = np.linspace(0.0, self.length, count + 1)
            values = np.array([self._curvature_at(s) for s in grid.tolist()])
            curvature = make_interp_spline(grid, values, k=5)
            integral = curvature.antiderivative()
            angles = integral(grid)
            turn = float(np.max(np.abs(np.diff(angles))))
            changes = np.full(2, np.inf) if before is None else angles[::2] - before
            if turn < _MAX_TURN_PER_INTERVAL and np.max(np.abs(changes)) < _MAX_ANGLE_CHANGE:
                return grid, curvature, integral
            if count >= _MAX_INTERVALS:
                break
            count, before = 2 * count, angles
        if turn >= _MAX_TURN_PER_INTERVAL:
            raise BeamdaeError(
                f"IntrinsicCurve: law turns the tangent by {turn:.3g} rad within 1/{count} of "
                f"the length, but must turn it by less than {_MAX_TURN_PER_INTERVAL:g} rad; "
                "reduce the curvature or the length."
            )
        place = 2.0 * float(np.argmax(np.abs(np.diff(changes)))) / count * self.length
        raise BeamdaeError(
            "IntrinsicCurve: law must be smooth, but it bends sharply or jumps near s = "
            f"{place:.4g} m; divide the beam there, and weld its parts."
        )

    @cached_property
    def _grid_points(self) -> Array:
        """Points (n, 2) [m] at the arc lengths of the splines."""
        grid = self._splines[0]
        steps = self._integrate_tangent(grid[:-1], grid[1:])
        return np.concatenate([[self.start], self.start + np.cumsum(steps, axis=0)])

    def _integrate_tangent(self, a: Array, b: Array) -> Array:
        """Return the vectors (..., 2) [m] from the points at arc lengths `a` to those at `b`."""
        nodes, weights = ARC_LENGTH_GAUSS
        half = 0.5 * (b - a)
        angle = self.tangent_angle(0.5 * (a + b)[..., None] + half[..., None] * nodes)
        return half[..., None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], -1)

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""
        s, grid = np.asarray(s, float), self._splines[0]
        interval = np.clip(np.searchsorted(grid, s, side="right") - 1, 0, len(grid) - 2)
        return self._grid_points[interval] + self._integrate_tangent(grid[interval], s)

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m]."""
        return self.angle + self._splines[2](np.asarray(s, float))

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature [1/m] at arc lengths s [m]."""
        return self._splines[1](np.asarray(s, float))
