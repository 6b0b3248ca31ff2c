"""Area, center of mass, inertia and outline of plane shapes of rigid bodies."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_point,
    require_positive,
    require_sequence,
)

Array = np.ndarray

# Number of segments of a circle in drawings.
_CIRCLE_SEGMENTS = 48
# Smallest area of a polygon, relative to its bounding box; smaller areas are rounding errors.
_MIN_AREA_RATIO = 1e-12


class Shape(NamedTuple):
    """Plane shape of a rigid body.

    Attributes
    ----------
    area
        Area [m^2]; for a rod, the length [m].
    gyration2
        Inertia about the center of mass, divided by the mass [m^2].
    center
        Center of mass [m].
    outline
        Points of the outline [m].
    """

    area: float
    gyration2: float
    center: tuple[float, float]
    outline: tuple[tuple[float, float], ...]

    def mass_of(
        self, part: str, mass: Any, density: Any, thickness: Any, name: str = "thickness"
    ) -> float:
        """Return `mass` [kg], or the density [kg/m^3] times the volume.

        Parameters
        ----------
        part
            Name of the body, for messages.
        mass, density, thickness
            None if not given. For a rod, `thickness` is the area of the cross-section [m^2].
        name
            Name of the argument `thickness` in messages.

        Raises
        ------
        BeamdaeError
            If the values are neither the mass alone nor both density and thickness, or a value is
            not positive.
        """
        if (mass is None) == (density is None) or (density is None) != (thickness is None):
            raise BeamdaeError(f"{part}: pass either mass=, or both density= and {name}=.")
        if mass is not None:
            return require_positive(part, "mass", mass)
        return (
            require_positive(part, "density", density)
            * require_positive(part, name, thickness)
            * self.area
        )


def rod(part: str, a: Any, b: Any) -> Shape:
    """Return a thin straight rod from `a` to `b`, of length l and inertia m l^2 / 12.

    Raises
    ------
    BeamdaeError
        If the points coincide or a value is invalid.
    """
    start, end = require_point(part, "a", a), require_point(part, "b", b)
    length = float(np.hypot(*np.subtract(end, start)))
    if length == 0.0:
        raise BeamdaeError(f"{part}: a and b must differ, but both are {start} m.")
    center = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1])
    return Shape(length, length**2 / 12.0, center, (start, end))


def disk(part: str, center: Any, radius: Any) -> Shape:
    """Return a solid disk; mass m and radius r give the inertia m r^2 / 2.

    Raises
    ------
    BeamdaeError
        If a value is invalid.
    """
    (x, y), radius = require_point(part, "center", center), require_positive(part, "radius", radius)
    angle = 2.0 * np.pi * np.arange(_CIRCLE_SEGMENTS) / _CIRCLE_SEGMENTS
    rim = np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1)
    # The radius to the first corner shows the rotation of the disk.
    outline = ((x, y), *map(tuple, rim.tolist()), tuple(rim[0].tolist()))
    return Shape(np.pi * radius**2, 0.5 * radius**2, (x, y), outline)


def plate(part: str, center: Any, width: Any, height: Any, angle: Any) -> Shape:
    """Return a rectangular plate rotated by `angle` [rad].

    Mass m, width w and height h give the inertia m (w^2 + h^2) / 12.

    Raises
    ------
    BeamdaeError
        If a value is invalid.
    """
    angle = require_finite(part, "angle", angle)
    (x, y), width = require_point(part, "center", center), require_positive(part, "width", width)
    height = require_positive(part, "height", height)
    c, s = np.cos(angle), np.sin(angle)
    corners = 0.5 * np.array(
        [(-width, -height), (width, -height), (width, height), (-width, height)]
    )
    rotated = corners @ np.array([(c, s), (-s, c)]) + (x, y)
    outline = tuple(map(tuple, rotated.tolist()))
    return Shape(width * height, (width**2 + height**2) / 12.0, (x, y), outline)


def polygon(part: str, points: Any) -> Shape:
    """Return a polygonal plate with corners in either orientation.

    The mass properties follow from Green's theorem.

    Raises
    ------
    BeamdaeError
        If the corners are fewer than 3, enclose no area, repeat or are not in order around the
        polygon.
    """
    entries = require_sequence(part, "points", points, "at least 3 pairs (x, y)")
    if len(entries) < 3:
        raise BeamdaeError(f"{part}: points must be at least 3 pairs (x, y), got {len(entries)}.")
    corners = np.array([require_point(part, f"point {k}", xy) for k, xy in enumerate(entries)])
    # Relative to the mean of the corners, to avoid cancellation for a body far from the origin.
    middle = corners.mean(axis=0)
    x, y = (corners - middle).T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    size = float(np.ptp(x)) * float(np.ptp(y))
    area = 0.5 * float(cross.sum())
    if not abs(area) > _MIN_AREA_RATIO * size:
        raise BeamdaeError(f"{part}: points must enclose an area, got {area:g} m^2.")
    _require_simple(part, corners)
    center = np.array([((x + nx) * cross).sum(), ((y + ny) * cross).sum()]) / (6.0 * area)
    polar = float(((x * x + x * nx + nx * nx + y * y + y * ny + ny * ny) * cross).sum()) / 12.0
    gyration2 = polar / area - float(center @ center)
    cx, cy = (center + middle).tolist()
    return Shape(abs(area), gyration2, (cx, cy), tuple(map(tuple, corners.tolist())))


def _require_simple(part: str, corners: Array) -> None:
    """Raise BeamdaeError if corners repeat, or edges meet at points other than common corners."""
    edges = np.roll(corners, -1, axis=0) - corners
    if (repeated := np.flatnonzero(~edges.any(axis=1))).size:
        x, y = corners[repeated[0]]
        raise BeamdaeError(
            f"{part}: the point ({x:g}, {y:g}) m is repeated; give each corner once."
        )
    # Rows: edges; columns: edges whose start and end are left (1), right (-1) or on the line (0).
    starts = np.sign(_cross(edges[:, None], corners - corners[:, None]))
    ends = np.roll(starts, -1, axis=1)
    low, high = (f(corners, corners + edges) for f in (np.minimum, np.maximum))
    overlap = np.all((low[:, None] <= high) & (low <= high[:, None]), axis=-1)
    meet = (starts * ends <= 0.0) & (starts * ends <= 0.0).T & overlap
    n = len(corners)
    distance = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    # Neighbors share a corner; they overlap if the second one goes back.
    folds = (starts == 0.0) & (ends == 0.0) & (edges @ edges.T < 0.0)
    meet = np.where((distance > 1) & (distance < n - 1), meet, folds)
    pairs = np.argwhere(np.triu(meet, 1))
    if len(pairs):
        a, c = corners[pairs[0]]
        raise BeamdaeError(
            f"{part}: the edges that begin at ({a[0]:g}, {a[1]:g}) m and ({c[0]:g}, "
            f"{c[1]:g}) m meet; list the points in order around the polygon."
        )


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
