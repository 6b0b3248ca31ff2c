"""Placement of labels in a drawing, avoiding overlaps with lines and other labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray

_DIRECTION_COUNT = 16
_DISTANCES = (7.0, 14.0, 24.0, 38.0, 56.0, 80.0, 110.0, 150.0)  # of a label from its point [pt]
_MIN_LEADER_DISTANCE = 16.0  # of labels that a line connects to their points [pt]
_FONT_SIZE = 8.0  # [pt]
_LABEL_BOX = {"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.4}
_LEADER = {"arrowstyle": "-", "color": "0.6", "lw": 0.6, "shrinkA": 0.0, "shrinkB": 2.0}
_GAP = 1.5  # free space around a label [pt]
_POINTS_PER_INCH = 72.0
# Cost of a label position.
_COVERED_POINT_COST = 2.0  # per covered point of a line
_MAX_COVERED_POINTS = 40  # further points add no cost
_OVERLAP_COST = 300.0  # for each covered label
_OUTSIDE_COST = 400.0  # for a label that extends beyond the axes
_DISTANCE_COST = 0.35  # per distance from the preferred position [1/pt]


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
    points_per_pixel = _POINTS_PER_INCH / axis.figure.dpi
    corners = axis.get_window_extent().get_points() * points_per_pixel
    covered = axis.transData.transform(obstacles) * points_per_pixel
    # The first candidate is on the upper right.
    angles = 0.25 * math.pi + 2.0 * math.pi * np.arange(_DIRECTION_COUNT) / _DIRECTION_COUNT
    directions = np.tile(np.column_stack([np.cos(angles), np.sin(angles)]), (len(_DISTANCES), 1))
    distances = np.repeat(_DISTANCES, _DIRECTION_COUNT)
    occupied = np.zeros((0, 4))  # middles and sizes of the labels before
    for point, text in labels:
        label = axis.annotate(
            text,
            (float(point[0]), float(point[1])),
            xytext=(0.0, 0.0),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=_FONT_SIZE,
            color="0.2",
            parse_math=False,
            arrowprops=_LEADER,
            bbox=_LABEL_BOX,
            zorder=7,
        )
        box = label.get_window_extent()
        size = np.array([box.width, box.height]) * points_per_pixel
        # The side of the box that faces the point touches a circle around the point.
        shifts = distances[:, None] * directions + 0.5 * size * np.clip(1.5 * directions, -1.0, 1.0)
        middles = axis.transData.transform(point) * points_per_pixel + shifts
        reach = 0.5 * size + _GAP
        is_covered = np.all(np.abs(covered - middles[:, None]) < reach, axis=-1)
        gaps = np.abs(occupied[:, :2] - middles[:, None]) - 0.5 * occupied[:, 2:]
        is_outside = (middles - reach < corners[0]) | (middles + reach > corners[1])
        cost = (
            _DISTANCE_COST * distances
            + _COVERED_POINT_COST * np.minimum(is_covered.sum(axis=1), _MAX_COVERED_POINTS)
            + _OVERLAP_COST * np.all(gaps < reach, axis=-1).sum(axis=1)
            + _OUTSIDE_COST * is_outside.any(axis=1)
        )
        best = int(np.argmin(cost))
        occupied = np.vstack([occupied, [*middles[best], *size]])
        label.set_position(shifts[best].tolist())
        if label.arrow_patch is not None:
            label.arrow_patch.set_visible(bool(distances[best] > _MIN_LEADER_DISTANCE))
