"""Plane curves by their curvature: clothoids and the like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    format_exception,
    require_finite,
    require_point,
    require_positive,
    set_fields,
    short_repr,
)

Array = np.ndarray

_INTERVALS = 400
_GAUSS = np.polynomial.legendre.leggauss(8)


@dataclass(frozen=True)
class IntrinsicCurve:
    """Curve of a given curvature by arc length, as by Cesàro's equation.

    Parameters
    ----------
    law
        Arc length s [m] -> signed curvature [1/m], positive to the left; smooth.
    length
        Arc length [m].
    start
        Where it begins [m].
    angle
        Its tangent there [rad].

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
        set_fields(
            self,
            length=require_positive("IntrinsicCurve", "length", self.length),
            start=require_point("IntrinsicCurve", "start", self.start),
            angle=require_finite("IntrinsicCurve", "angle", self.angle),
        )
        if not callable(self.law):
            raise BeamdaeError(
                f"IntrinsicCurve: law must be a function of s, got {short_repr(self.law)}."
            )
        turn = float(np.max(np.abs(np.diff(self.tangent_angle(self._grid)))))
        if not turn < 0.5:
            raise BeamdaeError(
                f"IntrinsicCurve: law must give a curvature by which the curve turns gradually, it "
                f"turns by {turn:.3g} rad within 1/{_INTERVALS} of its length."
            )

    @cached_property
    def _grid(self) -> Array:
        return np.linspace(0.0, self.length, _INTERVALS + 1)

    def _curvature_at(self, s: float) -> float:
        try:
            value = self.law(s)
        except Exception as problem:
            raise BeamdaeError(
                f"IntrinsicCurve: law must give a number for every s in [0, {self.length:g}], at "
                f"s = {s:.6g} it failed, {format_exception(problem)}."
            ) from problem
        return require_finite("IntrinsicCurve", f"the curvature at s = {s:.6g}", value)

    @cached_property
    def _splines(self) -> tuple[Any, Any]:
        """Curvature and tangent angle."""
        # Here, for it takes as long to import as a short run, and few models have such curves.
        from scipy.interpolate import make_interp_spline

        values = np.array([self._curvature_at(s) for s in self._grid.tolist()])
        curvature = make_interp_spline(self._grid, values, k=5)
        return curvature, curvature.antiderivative()

    @cached_property
    def _places(self) -> Array:
        """Points at the grid."""
        steps = self._stretches(self._grid[:-1], self._grid[1:])
        return np.concatenate([[self.start], self.start + np.cumsum(steps, axis=0)])

    def _stretches(self, a: Array, b: Array) -> Array:
        nodes, weights = _GAUSS
        half = 0.5 * (b - a)
        angle = self.tangent_angle(0.5 * (a + b)[..., None] + half[..., None] * nodes)
        return half[..., None] * np.stack([np.cos(angle) @ weights, np.sin(angle) @ weights], -1)

    def point(self, s: Any) -> Array:
        """Points (..., 2) [m] at arc lengths s [m]."""
        s = np.asarray(s, float)
        before = np.clip(np.searchsorted(self._grid, s, side="right") - 1, 0, _INTERVALS - 1)
        return self._places[before] + self._stretches(self._grid[before], s)

    def tangent_angle(self, s: Any) -> Array:
        """Angle of the tangent [rad] at s."""
        return self.angle + self._splines[1](np.asarray(s, float))

    def curvature(self, s: Any) -> Array:
        """Signed curvature [1/m] at s."""
        return self._splines[0](np.asarray(s, float))
