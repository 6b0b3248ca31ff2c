"""Polylines that symbols are composed of: circles, boxes, hatched lines, arrow heads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

Array = np.ndarray

# Corners of polygons that look round at the size of a symbol, and at the size of a body.
_SYMBOL_CORNERS = 16
_WHEEL_CORNERS = 60

# Distance of hatches, in sizes of a symbol.
_HATCH_DISTANCE = 0.6
# Length of a hatch along and across the line, in sizes of a symbol.
_HATCH_LENGTH = 0.4


def join_lines(*lines: Array) -> Array:
    """Return several lines (k, n) as one, with a row of nan between them."""
    gap = np.full((1, lines[0].shape[1]), np.nan)
    return np.concatenate([x for line in lines for x in (line, gap)][:-1])


def unit_vector(direction: Sequence[float] | Array) -> Array:
    """Return the direction scaled to length one; (0, -1) if its length is zero."""
    length = math.hypot(*direction)
    return np.array(direction, float) / length if length > 0.0 else np.array([0.0, -1.0])


def rotate_left(direction: Array) -> Array:
    """Return the direction rotated by a quarter turn counter-clockwise."""
    return np.array([-direction[1], direction[0]])


def align_points(points: Any, direction: Sequence[float] | Array) -> Array:
    """Rotate points (k, 2) such that their x axis points in a direction."""
    c, s = unit_vector(direction)
    return np.asarray(points, float) @ np.array([(c, s), (-s, c)])


def circle(radius: float, corners: int = _SYMBOL_CORNERS) -> Array:
    """Return a closed regular polygon that approximates a circle; four corners are a diamond."""
    angle = np.linspace(0.0, 2.0 * math.pi, corners + 1)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def wheel(radius: float) -> Array:
    """Return a circle with a spoke, which makes its rotation visible."""
    return join_lines(circle(radius, _WHEEL_CORNERS), np.array([(0.0, 0.0), (radius, 0.0)]))


def box(width: float, height: float) -> Array:
    """Return a closed rectangle about the origin."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], float)
    return 0.5 * corners * (width, height)


def hatched_line(low: float, high: float, size: float) -> Array:
    """Return a line along the x axis with hatches below it."""
    count = max(round((high - low) / (_HATCH_DISTANCE * size)), 2)
    feet = np.linspace(low, high, count + 1)[1:]
    length = _HATCH_LENGTH * size
    hatches = [np.array([(x, 0.0), (x - length, -length)]) for x in feet]
    return join_lines(np.array([(low, 0.0), (high, 0.0)]), *hatches)


def arrow_head(size: float) -> Array:
    """Return a closed triangle that points in x direction and ends at the origin."""
    return 0.5 * size * np.array([(-1.0, -0.4), (0.0, 0.0), (-1.0, 0.4), (-1.0, -0.4)])
