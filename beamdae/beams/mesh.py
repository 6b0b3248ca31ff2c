"""Meshes of beams: elements and their bounds, given or chosen by the program."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.shape_functions import (
    MAX_EQUIDISTANT_NODES,
    gauss_points,
    node_positions,
    shape_functions,
)
from beamdae.curves.plane_curves import ARC_LENGTH_TOLERANCE, PlaneCurve, rotate_points
from beamdae.errors import BeamdaeError
from beamdae.read_only import read_only_data

Array = np.ndarray

_MIN_POLYGON_LENGTH = 0.5  # of the polygon through an element's nodes, relative to the arc length
# Attachments closer to each other or to an end of the beam share an element end; relative to the
# length of elements of equal length. A clamp at this distance from an element end changes
# deflections by less than 2e-4; shorter elements would amplify rounding errors of strains.
_MIN_END_DISTANCE = 1e-4
# Number of elements up to which a beam is divided at its attachments: factor times the requested
# number, plus a constant. More attachments, such as the springs of an elastic foundation, act like
# a distributed load.
_MAX_GROWTH_FACTOR, _MAX_GROWTH = 2, 8
# Meshes cached for later beams, and the largest number of nodes of such a mesh.
_MAX_CACHED_MESHES = 32
_MAX_CACHED_NODES = 1000
_OUTLINE_POINTS = 33
# Distance between an element end, which belongs to the next element, and the section just before.
# Relative to the length of the beam; larger than the distance of equal arc lengths, so that loads
# at the element end are beyond this section.
_SIDE_DISTANCE = 4.0 * ARC_LENGTH_TOLERANCE
# Distance from an element end, relative to the element, within which a point is at this end.
_LOCATION_ROUNDING = 1e-11


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


@read_only_data
@dataclass(frozen=True)
class Mesh:
    """Mesh of elements on a curve, of equal arc length unless `bounds` are given.

    Parameters
    ----------
    curve
        The reference curve.
    elements
        Number of elements.
    nodes
        Nodes per element, equidistant in arc length.
    shape
        "curved": each element interpolates the curve through its nodes (eq. 13 of Pan & Liu, 2012);
        "straight": each element is the chord between its end nodes.
    origin, angle
        Origin [m] and inclination [rad] of the axes to which points and angles refer. Default to
        the inertial axes.
    bounds
        Ascending arc lengths of the element ends [m], from 0 to the length of the curve; None for
        elements of equal length.
    """

    curve: PlaneCurve
    elements: int
    nodes: int
    shape: str
    origin: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0
    bounds: tuple[float, ...] | None = None

    def in_axes(self, origin: tuple[float, float], angle: float) -> Mesh:
        """Return the mesh, expressed in axes with the given origin [m] and inclination [rad]."""
        return replace(self, origin=origin, angle=angle)

    def divided_at(self, bounds: Sequence[float]) -> Mesh:
        """Return a mesh whose elements end at the arc lengths `bounds` [m]; see `Mesh`."""
        return replace(self, elements=len(bounds) - 1, bounds=tuple(map(float, bounds)))

    def with_degree(self, degree: int) -> Mesh:
        """Return the mesh with elements of another degree and the same ends."""
        return replace(self, nodes=degree + 1)

    def with_divided_elements(self, count: int) -> Mesh:
        """Return the mesh with each element divided into `count` ones of equal arc length."""
        places = np.arange(count * self.elements + 1) / count
        bounds = np.interp(places, np.arange(self.elements + 1), self.element_bounds)
        return self.divided_at(bounds.tolist())

    def has_end_at(self, s: float) -> bool:
        """Return True if an element ends at the arc length `s` [m], up to rounding errors."""
        gaps = np.abs(self.element_bounds - s) / self.curve.length
        return bool(gaps.min() <= ARC_LENGTH_TOLERANCE)

    def with_ends_at(self, arc_lengths: Sequence[float]) -> Mesh:
        """Return a mesh with element ends at the given ascending arc lengths [m].

        This mesh must have n elements of equal length. Return it if its elements already end at all
        arc lengths, or if more than 2 n + 8 elements would be needed; see `divide`.
        """
        if all(map(self.has_end_at, arc_lengths)):
            return self
        mesh = self.divide(arc_lengths)
        is_small = mesh.elements <= _MAX_GROWTH_FACTOR * self.elements + _MAX_GROWTH
        return mesh if is_small else self

    def divide(self, arc_lengths: Sequence[float]) -> Mesh:
        """Return a mesh with ends at arc lengths [m] and elements at most as long as equal ones.

        An arc length is skipped if its distance from an end of the beam, or from the preceding arc
        length that is not skipped, is at most 1e-4 of the element length.
        """
        length, spacing = self.curve.length, self.curve.length / self.elements
        stops, nearest = [0.0], _MIN_END_DISTANCE * spacing
        for s in arc_lengths:
            if s - stops[-1] > nearest and length - s > nearest:
                stops.append(s)
        spans = np.diff([*stops, length])
        counts = np.ceil(spans / spacing * (1.0 - ARC_LENGTH_TOLERANCE)).astype(int)
        bounds = [
            start + span / count * np.arange(count)
            for start, span, count in zip(stops, spans, counts, strict=True)
        ]
        return self.divided_at([*np.concatenate(bounds), length])

    @cached_property
    def element_bounds(self) -> Array:
        """Arc lengths of the element ends [m], shape (elements + 1,)."""
        if self.bounds is None:
            return np.linspace(0.0, self.curve.length, self.elements + 1)
        return np.array(self.bounds)

    @cached_property
    def element_lengths(self) -> Array:
        """Arc length of each element [m], shape (elements,)."""
        if self.bounds is None:
            return np.full(self.elements, self.curve.length / self.elements)
        return np.diff(self.element_bounds)

    def just_before(self, s: Array) -> Array:
        """Return arc lengths [m] slightly before `s` (n,), in the element that ends at `s`.

        The start and the end of the beam belong to a single element and do not change.
        """
        preceding = np.searchsorted(self.element_bounds[1:-1], s)
        distance = _SIDE_DISTANCE * self.curve.length
        is_inside = (s > distance) & (s < self.curve.length - distance)
        return np.where(
            is_inside, s - np.minimum(distance, 0.5 * self.element_lengths[preceding]), s
        )

    def sides_of(self, s: float) -> tuple[float, ...]:
        """Return `s` [m], preceded by the arc length just before it if two elements meet there."""
        is_end = self.has_end_at(s)
        return tuple(dict.fromkeys([*(self.just_before(np.array([s])).tolist() * is_end), s]))

    def arc_lengths(self, element: Array, xi: Array) -> Array:
        """Return the arc lengths [m] at coordinates `xi` of the elements `element`, shape (n,)."""
        if self.bounds is None:
            # Fewer roundings than with the element ends.
            return (element + 0.5 * (xi + 1.0)) * (self.curve.length / self.elements)
        return self.element_bounds[element] + 0.5 * (xi + 1.0) * self.element_lengths[element]

    @property
    def node_count(self) -> int:
        """Number of nodes of the beam."""
        return self.elements * (self.nodes - 1) + 1

    @property
    def element_nodes(self) -> Array:
        """Indices of the nodes of each element, shape (elements, nodes)."""
        step = self.nodes - 1
        return step * np.arange(self.elements)[:, None] + np.arange(self.nodes)

    @property
    def has_equidistant_nodes(self) -> bool:
        """True if all nodes of the beam have equal distances along the curve."""
        return self.bounds is None and self.nodes <= MAX_EQUIDISTANT_NODES

    @property
    def _node_fractions(self) -> Array:
        return 0.5 * (1.0 + node_positions(self.nodes))

    @cached_property
    def node_arc_lengths(self) -> Array:
        """Arc length of each node [m], shape (node_count,)."""
        if self.has_equidistant_nodes:
            return np.linspace(0.0, self.curve.length, self.node_count)
        start, last = self.element_bounds[:-1, None], self.curve.length
        fractions = self._node_fractions[:-1]
        return np.append(start + fractions * self.element_lengths[:, None], last)

    def tangent_angle(self, s: Any) -> Array:
        """Return the tangent angle of the curve [rad] at s [m], in the axes of the mesh."""
        return self.curve.tangent_angle(s) - self.angle

    @cached_property
    def node_points(self) -> Array:
        """Positions of the nodes of each element [m], shape (elements, nodes, 2)."""
        relative = self.curve.point(self.node_arc_lengths) - np.asarray(self.origin, float)
        points = rotate_points(relative, -self.angle)[self.element_nodes]
        if self.shape == "straight":
            fraction = self._node_fractions[:, None]
            points = points[:, :1] + fraction * (points[:, -1:] - points[:, :1])
        return points

    def require_resolved_curve(self, part: str) -> None:
        """Reject elements that are much shorter than the part of the curve that they represent.

        Raises
        ------
        BeamdaeError
            If the polygon through the nodes of an element is less than half as long as the part of
            the curve between its ends. The message names the beam, `part`.
        """
        polygon, arc = self._worst_polygon
        if not polygon >= _MIN_POLYGON_LENGTH * arc:
            raise BeamdaeError(
                f"{part}: elements={self.elements} with {self.nodes} nodes each are "
                f"too few for the curve, where a polygon of {polygon:.3g} m through the "
                f"nodes replaces an arc of {arc:.3g} m; use more elements."
            )

    @cached_property
    def _worst_polygon(self) -> tuple[float, float]:
        """Lengths [m] of the relatively shortest polygon through nodes and of its element."""
        steps = np.diff(self.node_points, axis=1)
        polygons = np.hypot(steps[..., 0], steps[..., 1]).sum(axis=1)
        worst = int(np.argmin(polygons / self.element_lengths))
        return float(polygons[worst]), float(self.element_lengths[worst])

    @cached_property
    def outline(self) -> Array:
        """Equidistant points along the curve [m], in inertial axes, shape (k, 2)."""
        return self.curve.point(np.linspace(0.0, self.curve.length, _OUTLINE_POINTS))

    @cached_property
    def gauss_curvature(self) -> Array:
        """Absolute curvature of the curve [1/m] at `nodes` Gauss points of each element."""
        return np.abs(self.curve.curvature(self.gauss_arc_lengths(self.nodes)))

    def axis(self, element: Array, xi: Array) -> AxisPoints:
        """Return points on the interpolated axes (eqs. 2, 13 and 14 of Pan & Liu, 2012).

        `element` (indices of the elements) and the local coordinates `xi` have the shape (n,).
        Angles are continuous along the curve.
        """
        nodes = self.node_points[element]
        # Differences of nodes are exact, so that derivatives do not depend on the origin.
        first, changes = nodes[:, 0], nodes - nodes[:, :1]
        relative, d1, d2 = (
            np.einsum("ei,eik->ek", shape_functions(self.nodes, xi, k), changes) for k in range(3)
        )
        ds = np.hypot(d1[:, 0], d1[:, 1])
        curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / ds**3
        s = self.arc_lengths(element, xi)
        angle = np.arctan2(d1[:, 1], d1[:, 0])
        angle = angle + 2.0 * np.pi * np.round((self.tangent_angle(s) - angle) / (2.0 * np.pi))
        return AxisPoints(first + relative, angle, curvature, ds)

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
        return self.arc_lengths(element, np.tile(xi, self.elements))

    def locate(self, s: float) -> tuple[int, float]:
        """Return the index of the element and the local coordinate xi at arc length s [m].

        Points between two elements, up to rounding, belong to the second one. Otherwise, rounding
        would choose between their angles and between patterns of operators, which must not differ
        among the neighboring models of derivatives.
        """
        if self.bounds is None:
            elements_passed = s / self.curve.length * self.elements
            element = min(int(elements_passed + _LOCATION_ROUNDING), self.elements - 1)
            xi = 2.0 * (elements_passed - element) - 1.0
        else:
            inner_bounds = self.element_bounds[1:-1] - _LOCATION_ROUNDING * self.element_lengths[1:]
            element = int(np.searchsorted(inner_bounds, s, side="right"))
            xi = 2.0 * (s - self.element_bounds[element]) / self.element_lengths[element] - 1.0
        if abs(xi) > 1.0 - 2.0 * _LOCATION_ROUNDING:
            xi = math.copysign(1.0, xi)
        return element, float(xi)

    def curvature_error(self, points: int) -> float:
        """Return the largest curvature error at the Gauss points, times the length of the curve."""
        _, axis = self.gauss(points)
        error = np.abs(axis.curvature - self.curve.curvature(self.gauss_arc_lengths(points)))
        return float(error.max() * self.curve.length)


def intern_mesh(mesh: Mesh) -> Mesh:
    """Return an equal mesh of an earlier beam, whose derived arrays are known, or else `mesh`.

    Models are often built again with other numbers but the same meshes.
    """
    return _intern_equal(mesh) if is_shareable(mesh) else mesh


@lru_cache(maxsize=_MAX_CACHED_MESHES)
def _intern_equal(mesh: Mesh) -> Mesh:
    return mesh


def is_shareable(mesh: Mesh) -> bool:
    """Return True if the mesh is small, and equal meshes have equal points.

    Curves given by functions are excluded, because a function may depend on variables.
    """
    return mesh.node_count <= _MAX_CACHED_NODES and consists_of_numbers(mesh.curve)


def consists_of_numbers(value: object) -> bool:
    """Return True if a value is immutable and consists of numbers, texts and None only."""
    if isinstance(value, tuple):
        return all(map(consists_of_numbers, value))
    if value is None or isinstance(value, (int, float, str)):
        return True
    kind: Any = type(value)
    names = _names_of_frozen_fields(kind)
    return names is not None and all(consists_of_numbers(getattr(value, x)) for x in names)


@cache
def _names_of_frozen_fields(kind: type) -> tuple[str, ...] | None:
    """Return the names of the fields of a frozen dataclass; None for other types."""
    if not is_dataclass(kind) or not kind.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        return None
    return tuple(field.name for field in fields(kind))


# Numbers and degrees of elements of beams without attachments that have similar errors.
_MESHES = ((1, 7), (2, 6), (3, 5), (8, 3))
_MAX_ELEMENTS = 24  # beyond, attachments act like a distributed load
_MAX_CURVATURE_ERROR = 0.05  # of elements, relative to the largest curvature or to 1 / length
_INTERVALS_OF_MODES = 24


def choose_mesh(curve: PlaneCurve, arc_lengths: Sequence[float], has_moving_load: bool) -> Mesh:
    """Return the mesh of a beam with element ends at ascending arc lengths [m].

    It is the smallest one of elements of degree 7, 6, 5 or 3 that are at most as long as the beam,
    a half, a third and an eighth of it, or shorter on curves that they would not resolve. With more
    than about 20 arc lengths, it has eight elements of degree 3; with a moving load, at which
    section forces jump or have kinks, at least as many.
    """
    candidates = _MESHES[-1:] if has_moving_load else _MESHES
    meshes = [Mesh(curve, n, p + 1, "curved") for n, p in candidates]
    if meshes[-1].divide(arc_lengths).elements > _MAX_ELEMENTS:
        return meshes[-1]
    resolved = [_resolve_curve(mesh, arc_lengths) for mesh in meshes]
    return min(resolved, key=lambda x: x.node_count)


def _resolve_curve(mesh: Mesh, arc_lengths: Sequence[float]) -> Mesh:
    divided = mesh.divide(arc_lengths)
    turn = max(float(divided.gauss_curvature.max()) * mesh.curve.length, 1.0)
    while divided.elements <= _MAX_ELEMENTS:
        if divided.curvature_error(divided.nodes - 1) <= _MAX_CURVATURE_ERROR * turn:
            break
        mesh = replace(mesh, elements=mesh.elements + 1 + mesh.elements // 4)
        divided = mesh.divide(arc_lengths)
    return divided


def mesh_of_modes(mesh: Mesh) -> Mesh:
    """Return a mesh that resolves ten modes of a beam: of at least 24 intervals between nodes."""
    intervals = mesh.node_count - 1
    return mesh.with_divided_elements(math.ceil(_INTERVALS_OF_MODES / intervals))
