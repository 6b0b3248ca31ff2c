"""Geometry of a beam mesh: nodes on the curve and element axes between the nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.curves.plane_curves import PlaneCurve, rotate_points
from beamdae.errors import BeamdaeError

Array = np.ndarray

_MIN_POLYGON_LENGTH = 0.5  # of the polygon through an element's nodes, relative to the arc length
_LENGTH_GAUSS_POINTS = 8  # per element; enough to resolve the error of the arc length


class AxisPoints(NamedTuple):
    """Points on the axes of elements.

    Attributes
    ----------
    position
        Positions (n, 2) [m].
    angle
        Angle of the axis (n,) [rad].
    curvature
        Signed curvature (n,) [1/m].
    ds
        Derivative ds/dxi of the arc length (n,) [m].
    """

    position: Array
    angle: Array
    curvature: Array
    ds: Array


@dataclass(frozen=True)
class Mesh:
    """Mesh of elements of equal arc length on a curve.

    Parameters
    ----------
    curve
        The reference curve.
    elements
        Number of elements.
    nodes
        Nodes per element, equidistant in arc length.
    shape
        "curved": each element interpolates the curve through its nodes (eq. 13); "straight":
        each element is the chord between its end nodes.
    origin, angle
        Origin [m] and inclination [rad] of the axes to which points and angles refer. Default to
        the inertial axes.
    """

    curve: PlaneCurve
    elements: int
    nodes: int
    shape: str
    origin: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def in_axes(self, origin: tuple[float, float], angle: float) -> Mesh:
        """Return the mesh in axes with the given origin [m] and inclination [rad]."""
        return replace(self, origin=origin, angle=angle)

    @property
    def node_count(self) -> int:
        """Number of nodes of the beam."""
        return self.elements * (self.nodes - 1) + 1

    @property
    def element_nodes(self) -> Array:
        """Indices of the nodes of each element, shape (elements, nodes)."""
        step = self.nodes - 1
        return step * np.arange(self.elements)[:, None] + np.arange(self.nodes)

    @cached_property
    def node_arc_lengths(self) -> Array:
        """Arc length of each node [m], shape (node_count,)."""
        return np.linspace(0.0, self.curve.length, self.node_count)

    def tangent_angle(self, s: Any) -> Array:
        """Return the tangent angle of the curve [rad] at s [m], in the axes of the mesh."""
        return self.curve.tangent_angle(s) - self.angle

    @cached_property
    def node_points(self) -> Array:
        """Positions of the nodes of each element [m], shape (elements, nodes, 2)."""
        relative = self.curve.point(self.node_arc_lengths) - np.asarray(self.origin, float)
        points = rotate_points(relative, -self.angle)[self.element_nodes]
        if self.shape == "straight":
            fraction = np.linspace(0.0, 1.0, self.nodes)[:, None]
            points = points[:, :1] + fraction * (points[:, -1:] - points[:, :1])
        return points

    def require_resolved_curve(self, part: str) -> None:
        """Reject elements that are much shorter than the part of the curve that they represent.

        Raises
        ------
        BeamdaeError
            If the polygon through the nodes of an element is less than half as long as the curve.
            The message names the `part`.
        """
        steps = np.diff(self.node_points, axis=1)
        arc_length = self.curve.length / self.elements
        shortest = float(np.min(np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)))
        if not shortest >= _MIN_POLYGON_LENGTH * arc_length:
            raise BeamdaeError(
                f"{part}: elements={self.elements} with {self.nodes} nodes each are "
                f"too few for the curve, where a polygon of {shortest:.3g} m through the "
                f"nodes replaces an arc of {arc_length:.3g} m; use more elements."
            )

    def axis(self, element: Array, xi: Array) -> AxisPoints:
        """Return points on the interpolated axes (eqs. 2, 13, 14).

        `element` (indices of the elements) and the local coordinates `xi` have the shape (n,).
        Angles are continuous along the curve.
        """
        nodes = self.node_points[element]
        position, d1, d2 = (
            np.einsum("ei,eik->ek", shape_functions(self.nodes, xi, k), nodes) for k in range(3)
        )
        ds = np.hypot(d1[:, 0], d1[:, 1])
        curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / ds**3
        s = (element + 0.5 * (xi + 1.0)) * self.curve.length / self.elements
        angle = np.arctan2(d1[:, 1], d1[:, 0])
        angle = angle + 2.0 * np.pi * np.round((self.tangent_angle(s) - angle) / (2.0 * np.pi))
        return AxisPoints(position, angle, curvature, ds)

    def gauss(self, points: int) -> tuple[Array, AxisPoints]:
        """Return weights times ds/dxi [m] and axis points at the Gauss points of all elements.

        Arrays have the shape (elements * points, ...), ordered by element.
        """
        xi, weights = gauss_points(points)
        element = np.repeat(np.arange(self.elements), points)
        axis = self.axis(element, np.tile(xi, self.elements))
        return np.tile(weights, self.elements) * axis.ds, axis

    def gauss_arc_lengths(self, points: int) -> Array:
        """Return the arc lengths [m] of the Gauss points of all elements, ordered by element."""
        xi, _ = gauss_points(points)
        element = np.repeat(np.arange(self.elements), points)
        elements_passed = element + 0.5 * (np.tile(xi, self.elements) + 1.0)
        return elements_passed * (self.curve.length / self.elements)

    def locate(self, s: float) -> tuple[int, float]:
        """Return the index of the element and the local coordinate xi at arc length s [m]."""
        elements_passed = s / self.curve.length * self.elements
        element = min(int(elements_passed), self.elements - 1)
        xi = 2.0 * (elements_passed - element) - 1.0
        return element, float(np.clip(xi, -1.0, 1.0))

    @cached_property
    def length_error(self) -> float:
        """Largest relative error of the element arc lengths."""
        weighted_ds, _ = self.gauss(_LENGTH_GAUSS_POINTS)
        exact = self.curve.length / self.elements
        lengths = weighted_ds.reshape(self.elements, _LENGTH_GAUSS_POINTS).sum(axis=1)
        return float(np.max(np.abs(lengths - exact)) / exact)

    def curvature_error(self, points: int) -> float:
        """Return the largest curvature error at the Gauss points, times the length of the curve."""
        _, axis = self.gauss(points)
        error = np.abs(axis.curvature - self.curve.curvature(self.gauss_arc_lengths(points)))
        return float(error.max() * self.curve.length)
