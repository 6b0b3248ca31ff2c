"""Geometry of a beam's mesh: nodes on its curve and the axes of the elements between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.shape_functions import gauss_points, shape_functions
from beamdae.curves.plane_curves import PlaneCurve, rotate_points
from beamdae.errors import BeamdaeError

Array = np.ndarray

_MIN_POLYGON_LENGTH = 0.5  # length of the polygon through an element's nodes over its arc length
_LENGTH_GAUSS_POINTS = 8  # per element; resolves the error of the arc length


class AxisPoints(NamedTuple):
    """Points on the axes of elements.

    Attributes
    ----------
    position
        Shape (n, 2) [m].
    angle
        Angle of the axis (n,) [rad].
    curvature
        Signed curvature (n,) [1/m].
    ds
        ds/dxi (n,) [m].
    """

    position: Array
    angle: Array
    curvature: Array
    ds: Array


@dataclass(frozen=True)
class Mesh:
    """`elements` elements of equal arc length on a curve.

    Parameters
    ----------
    curve
        The reference curve.
    elements
        Number of elements.
    nodes
        Nodes of an element, equidistant in arc length.
    shape
        "curved": each element interpolates the curve through its nodes (eq. 13); "straight":
        each element is the chord between its end nodes.
    origin, angle
        Axes of the points and angles: a point of the drawing [m] and an inclination [rad]. Default
        to the axes of the drawing.
    """

    curve: PlaneCurve
    elements: int
    nodes: int
    shape: str
    origin: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def in_axes(self, origin: tuple[float, float], angle: float) -> Mesh:
        """Return the same mesh in other axes."""
        return replace(self, origin=origin, angle=angle)

    @property
    def node_count(self) -> int:
        """Number of nodes of the beam."""
        return self.elements * (self.nodes - 1) + 1

    @property
    def element_nodes(self) -> Array:
        """Node numbers of each element, shape (elements, nodes)."""
        step = self.nodes - 1
        return step * np.arange(self.elements)[:, None] + np.arange(self.nodes)

    @cached_property
    def node_arc_lengths(self) -> Array:
        """Arc length of each node [m]."""
        return np.linspace(0.0, self.curve.length, self.node_count)

    def tangent_angle(self, s: Any) -> Array:
        """Return the angle of the curve's tangent [rad] at arc lengths s [m]."""
        return self.curve.tangent_angle(s) - self.angle

    @cached_property
    def node_points(self) -> Array:
        """Nodes of each element, shape (elements, nodes, 2)."""
        relative = self.curve.point(self.node_arc_lengths) - np.asarray(self.origin, float)
        points = rotate_points(relative, -self.angle)[self.element_nodes]
        if self.shape == "straight":
            fraction = np.linspace(0.0, 1.0, self.nodes)[:, None]
            points = points[:, :1] + fraction * (points[:, -1:] - points[:, :1])
        return points

    def require_resolved_curve(self, part: str) -> None:
        """Reject elements whose nodes are much closer together than along the curve.

        Raises
        ------
        BeamdaeError
            Naming the `part`, if the polygon through the nodes of an element is less than half as
            long as the curve.
        """
        steps = np.diff(self.node_points, axis=1)
        arc_length = self.curve.length / self.elements
        shortest = float(np.min(np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)))
        if not shortest >= _MIN_POLYGON_LENGTH * arc_length:
            raise BeamdaeError(
                f"{part}: elements={self.elements} of {self.nodes} nodes are too few for its "
                f"curve, nodes {shortest:.3g} m apart stand for {arc_length:.3g} m of it; take "
                "more elements."
            )

    def axis(self, element: Array, xi: Array) -> AxisPoints:
        """Return points on the interpolated axes (eqs. 2, 13, 14).

        `element` and the local coordinates `xi` are of shape (n,). Angles are continuous along the
        curve.
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
        """Return the weights times ds/dxi and the axes at the Gauss points of all elements.

        Arrays are of shape (elements * points, ...), one element after the other.
        """
        xi, weights = gauss_points(points)
        element = np.repeat(np.arange(self.elements), points)
        axis = self.axis(element, np.tile(xi, self.elements))
        return np.tile(weights, self.elements) * axis.ds, axis

    def gauss_arc_lengths(self, points: int) -> Array:
        """Return the arc lengths [m] of the Gauss points, one element after the other."""
        xi, _ = gauss_points(points)
        element = np.repeat(np.arange(self.elements), points)
        elements_passed = element + 0.5 * (np.tile(xi, self.elements) + 1.0)
        return elements_passed * (self.curve.length / self.elements)

    def locate(self, s: float) -> tuple[int, float]:
        """Return the element and the local coordinate xi of the arc length s [m]."""
        elements_passed = s / self.curve.length * self.elements
        element = min(int(elements_passed), self.elements - 1)
        xi = 2.0 * (elements_passed - element) - 1.0
        return element, float(np.clip(xi, -1.0, 1.0))

    @cached_property
    def length_error(self) -> float:
        """Largest relative error of the arc length of an element."""
        weighted_ds, _ = self.gauss(_LENGTH_GAUSS_POINTS)
        exact = self.curve.length / self.elements
        lengths = weighted_ds.reshape(self.elements, _LENGTH_GAUSS_POINTS).sum(axis=1)
        return float(np.max(np.abs(lengths - exact)) / exact)

    def curvature_error(self, points: int) -> float:
        """Return the largest error of the curvature at Gauss points, times the curve's length."""
        _, axis = self.gauss(points)
        error = np.abs(axis.curvature - self.curve.curvature(self.gauss_arc_lengths(points)))
        return float(error.max() * self.curve.length)
