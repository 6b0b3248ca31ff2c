"""Polylines for symbols, relative to the symbol size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

Array = np.ndarray

# Corners of polygons that appear round.
_SYMBOL_CORNERS = 16  # at the size of a symbol
_WHEEL_CORNERS = 60  # at the size of a body

_HATCH_DISTANCE = 0.6
_HATCH_LENGTH = 0.4  # of a hatch along and across the line


def join_lines(*lines: Array) -> Array:
    """Concatenate lines (k, n), separated by rows of nan."""
    gap = np.full((1, lines[0].shape[1]), np.nan)
    return np.concatenate([x for line in lines for x in (line, gap)][:-1])


def unit_vector(direction: Sequence[float] | Array) -> Array:
    """Return the unit vector in a direction, or (0, -1) if its length is zero."""
    length = math.hypot(*direction)
    return np.array(direction, float) / length if length > 0.0 else np.array([0.0, -1.0])


def rotate_left(direction: Array) -> Array:
    """Return the direction rotated by 90 degrees counter-clockwise."""
    return np.array([-direction[1], direction[0]])


def align_points(points: Any, direction: Sequence[float] | Array) -> Array:
    """Rotate points (k, 2) so that their x axis points in the given direction."""
    c, s = unit_vector(direction)
    return np.asarray(points, float) @ np.array([(c, s), (-s, c)])


def circle(radius: float, corners: int = _SYMBOL_CORNERS) -> Array:
    """Return a closed regular polygon (corners + 1, 2) that approximates a circle."""
    angle = np.linspace(0.0, 2.0 * math.pi, corners + 1)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def wheel(radius: float) -> Array:
    """Return a circle with a spoke, (k, 2), which makes its rotation visible."""
    return join_lines(circle(radius, _WHEEL_CORNERS), np.array([(0.0, 0.0), (radius, 0.0)]))


def box(width: float, height: float) -> Array:
    """Return a closed rectangle (5, 2) centered at the origin."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], float)
    return 0.5 * corners * (width, height)


def hatched_line(low: float, high: float) -> Array:
    """Return a line (k, 2) along the x axis with hatches below it."""
    count = max(round((high - low) / _HATCH_DISTANCE), 2)
    feet = np.linspace(low, high, count + 1)[1:]
    hatches = [np.array([(x, 0.0), (x - _HATCH_LENGTH, -_HATCH_LENGTH)]) for x in feet]
    return join_lines(np.array([(low, 0.0), (high, 0.0)]), *hatches)


def arrow_head() -> Array:
    """Return a closed triangle (4, 2) pointing in the x direction, with its tip at the origin."""
    return 0.5 * np.array([(-1.0, -0.4), (0.0, 0.0), (-1.0, 0.4), (-1.0, -0.4)])
