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
        If an argument is invalid, if the law fails or does not return a finite number, or if the
        tangent turns by 0.5 rad or more within 1/400 of the length.

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
        turn = float(np.max(np.abs(np.diff(self.tangent_angle(self._grid)))))
        if not turn < _MAX_TURN_PER_INTERVAL:
            raise BeamdaeError(
                f"IntrinsicCurve: law turns the tangent by {turn:.3g} rad within "
                f"1/{ARC_LENGTH_INTERVALS} of the length, but must turn it by less than "
                f"{_MAX_TURN_PER_INTERVAL:g} rad; reduce the curvature or the length."
            )

    @cached_property
    def _grid(self) -> Array:
        return np.linspace(0.0, self.length, ARC_LENGTH_INTERVALS + 1)

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
    def _splines(self) -> tuple[Any, Any]:
        """Splines of the curvature and of its integral, the tangent angle minus `angle`."""
        # Imported here because the import takes as long as a short run, and few models need it.
        from scipy.interpolate import make_interp_spline

        values = np.array([self._curvature_at(s) for s in self._grid.tolist()])
        curvature = make_interp_spline(self._grid, values, k=5)
        return curvature, curvature.antiderivative()

    @cached_property
    def _grid_points(self) -> Array:
        """Points (n, 2) [m] at the arc lengths `_grid`."""
        steps = self._integrate_tangent(self._grid[:-1], self._grid[1:])
        return np.concatenate([[self.start], self.start + np.cumsum(steps, axis=0)])

    def _integrate_tangent(self, a: Array, b: Array) -> Array:
        """Return the vectors (..., 2) [m] from the points at arc lengths `a` to those at `b`."""
        nodes, weights = ARC_LENGTH_GAUSS
        half = 0.5 * (b - a)
        angle = self.tangent_angle(0.5 * (a + b)[..., None] + half[..., None] * nodes)
        return half[..., None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], -1)

    def point(self, s: Any) -> Array:
        """Return points (..., 2) [m] at arc lengths s [m]."""
        s = np.asarray(s, float)
        interval = np.clip(
            np.searchsorted(self._grid, s, side="right") - 1, 0, ARC_LENGTH_INTERVALS - 1
        )
        return self._grid_points[interval] + self._integrate_tangent(self._grid[interval], s)

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the tangent [rad] at arc lengths s [m]."""
        return self.angle + self._splines[1](np.asarray(s, float))

    def curvature(self, s: Any) -> Array:
        """Return the signed curvature [1/m] at arc lengths s [m]."""
        return self._splines[0](np.asarray(s, float))
