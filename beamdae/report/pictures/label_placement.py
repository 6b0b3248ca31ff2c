"""Placement of labels in a drawing, avoiding overlaps with lines and other labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray

_DIRECTION_COUNT = 16
_DISTANCES = (7.0, 14.0, 24.0, 38.0, 56.0, 80.0, 110.0, 150.0)  # of a label from its point [pt]
_MIN_LEADER_DISTANCE = 16.0  # of labels that a line connects to their points [pt]
_FONT_SIZE = 8.0  # [pt]
_LABEL_BOX = {"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.4}
_GAP = 1.5  # free space around a label [pt]
_LINE_SAMPLES = 200  # candidate positions along a line
_LINE_OFFSET = 2.5  # between a line and a label above or below it [pt]
_POINTS_PER_INCH = 72.0
# Cost of a label position.
_COVERED_POINT_COST = 2.0  # per covered point of a line
_MAX_COVERED_POINTS = 40  # further points add no cost
_OVERLAP_COST = 300.0  # for each covered label
_OUTSIDE_COST = 400.0  # for a label that extends beyond the axes
_DISTANCE_COST = 0.35  # per distance from the preferred position [1/pt]


@dataclass(frozen=True)
class LineLabel:
    """Label of a line.

    Attributes
    ----------
    path
        Points (k, 2) of the line in data coordinates. The label is as near as possible to the
        first one.
    text, color
        Text and color of the label.
    is_beside
        True for a label above or below the line, False for a label on the line.
    """

    path: Array
    text: str
    color: Any
    is_beside: bool


def place_labels(axis: Axes, labels: Sequence[tuple[Array, str]], obstacles: Array) -> None:
    """Add labels near their points, each at the position of lowest cost.

    Labels that are far from their points are connected to them by leader lines.

    Parameters
    ----------
    axis
        Axis with its final limits and position in the figure.
    labels
        Pairs of a point (2,) in data coordinates and a text.
    obstacles
        Points (k, 2) in data coordinates that labels should not cover.
    """
    axis.apply_aspect()
    # The first candidate is on the upper right.
    angles = 0.25 * math.pi + 2.0 * math.pi * np.arange(_DIRECTION_COUNT) / _DIRECTION_COUNT
    directions = np.tile(np.column_stack([np.cos(angles), np.sin(angles)]), (len(_DISTANCES), 1))
    distances = np.repeat(_DISTANCES, _DIRECTION_COUNT)
    occupied = np.zeros((0, 4))
    for point, text in labels:
        anchor, size = _to_points(axis, point), _measure_text(axis, text)
        # The side of the box that faces the point touches a circle around the point.
        middles = distances[:, None] * directions + 0.5 * size * np.clip(
            1.5 * directions, -1.0, 1.0
        )
        cost = _DISTANCE_COST * distances
        cost = cost + _cover_cost(axis, anchor + middles, size, obstacles, occupied)
        best = int(np.argmin(cost))
        occupied = np.vstack([occupied, [*(anchor + middles[best]), *size]])
        has_leader = distances[best] > _MIN_LEADER_DISTANCE
        _write_label(axis, point, text, middles[best], "0.2", has_leader)


def label_lines(axis: Axes, labels: Sequence[LineLabel], markers: Array) -> None:
    """Add labels on or beside lines, each where it covers least of the markers and other labels.

    Parameters
    ----------
    axis
        Axis with its final limits.
    labels
        The labels, in the order in which they are placed.
    markers
        Points (k, 2) in data coordinates.
    """
    figure: Any = axis.figure
    figure.draw_without_rendering()  # for the position of the axis
    paths = [_sample_path(label.path) for label in labels]
    occupied = np.zeros((0, 4))
    for k, label in enumerate(labels):
        size = _measure_text(axis, label.text)
        lift = 0.5 * size[1] + _LINE_OFFSET
        shifts = [(0.0, lift), (0.0, -lift)] if label.is_beside else [(0.0, 0.0)]
        path = _to_points(axis, paths[k])
        middles = np.vstack([path + np.array(shift) for shift in shifts])
        obstacles = np.vstack([np.reshape(markers, (-1, 2)), *paths[:k], *paths[k + 1 :]])
        cost = _DISTANCE_COST * np.hypot(*(middles - path[0]).T)
        cost = cost + _cover_cost(axis, middles, size, obstacles, occupied)
        best = int(np.argmin(cost))
        occupied = np.vstack([occupied, [*middles[best], *size]])
        sample = best % len(path)
        offset = middles[best] - path[sample]
        _write_label(axis, paths[k][sample], label.text, offset, label.color, False)


def _sample_path(path: Array) -> Array:
    """Return points on a line at equal distances in the numbers of its points."""
    numbers = np.linspace(0, len(path) - 1, _LINE_SAMPLES)
    return np.column_stack([np.interp(numbers, np.arange(len(path)), x) for x in path.T])


def _to_points(axis: Axes, data: Array) -> Array:
    """Return positions in the figure [pt] of points (..., 2) in data coordinates."""
    return axis.transData.transform(data) * (_POINTS_PER_INCH / axis.figure.dpi)


def _measure_text(axis: Axes, text: str) -> Array:
    """Return width and height of a text [pt]."""
    label = axis.text(0.0, 0.0, text, fontsize=_FONT_SIZE, parse_math=False)
    box = label.get_window_extent()
    label.remove()
    return np.array([box.width, box.height]) * (_POINTS_PER_INCH / axis.figure.dpi)


def _cover_cost(
    axis: Axes, middles: Array, size: Array, obstacles: Array, occupied: Array
) -> Array:
    """Return the costs of labels around `middles` (k, 2) [pt].

    `occupied` contains the middles and sizes (n, 4) of the labels before.
    """
    corners = axis.get_window_extent().get_points() * (_POINTS_PER_INCH / axis.figure.dpi)
    points = _to_points(axis, obstacles)
    reach = 0.5 * size + _GAP
    is_covered = np.all(np.abs(points - middles[:, None]) < reach, axis=-1)
    gaps = np.abs(occupied[:, :2] - middles[:, None]) - 0.5 * occupied[:, 2:]
    overlaps = np.all(gaps < reach, axis=-1)
    is_outside = np.any((middles - reach < corners[0]) | (middles + reach > corners[1]), axis=-1)
    return (
        _COVERED_POINT_COST * np.minimum(is_covered.sum(axis=1), _MAX_COVERED_POINTS)
        + _OVERLAP_COST * overlaps.sum(axis=1)
        + _OUTSIDE_COST * is_outside
    )


def _write_label(
    axis: Axes, point: Array, text: str, offset: Array, color: Any, has_leader: bool
) -> None:
    leader = {"arrowstyle": "-", "color": "0.6", "lw": 0.6, "shrinkA": 0.0, "shrinkB": 2.0}
    axis.annotate(
        text,
        (float(point[0]), float(point[1])),
        xytext=(float(offset[0]), float(offset[1])),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=_FONT_SIZE,
        color=color,
        parse_math=False,
        arrowprops=leader if has_leader else None,
        bbox=_LABEL_BOX,
        zorder=7,
    )
