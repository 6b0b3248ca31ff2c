"""Placement of labels in a drawing, avoiding overlaps with lines and other labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray

# Candidate positions around a point.
_DIRECTION_COUNT = 16
_DISTANCES = (7.0, 14.0, 24.0, 38.0, 56.0, 80.0, 110.0, 150.0)  # [pt]
# Distance beyond which a label is connected to its point by a leader line [pt].
_MIN_LEADER_DISTANCE = 16.0
# Labels within this distance are neighbors; labels with the most neighbors are placed first [pt].
_NEIGHBOR_DISTANCE = 60.0
_FONT_SIZE = 8.0  # [pt]
_LABEL_BOX = {"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.4}
_GAP = 1.5  # free space around a label [pt]
_POINTS_PER_INCH = 72.0
_LINE_STEP = 3.0  # between candidate positions along a line [pt]
_MAX_LINE_STEPS = 500  # of one segment
_LINE_OFFSET = 2.5  # between a line and a label above or below it [pt]
_MARKER_RADIUS = 4.0  # of markers that labels of lines do not cover [pt]

# Cost of a label position.
_COVERED_POINT_COST = 2.0  # per covered point of a line
_MAX_COVERED_POINTS = 40  # further points add no cost
_OVERLAP_COST = 300.0  # for an overlap with labels, in addition to the area of overlap [pt^2]
_OUTSIDE_COST = 400.0  # for a label that extends beyond the axes
_DISTANCE_COST = 0.35  # per distance from the point [1/pt]


def place_labels(axis: Axes, labels: Sequence[tuple[Array, str]], obstacles: Array) -> None:
    """Add labels near their points, each at the position of lowest cost.

    Labels are placed sequentially, beginning with the labels that have the most neighbors. Labels
    that are far from their points are connected to them by leader lines.

    Parameters
    ----------
    axis
        Axis with its final limits and position in the figure.
    labels
        Pairs of a point (2,) in data coordinates and a text.
    obstacles
        Points (k, 2) in data coordinates that labels should not cover.
    """
    figure: Any = axis.figure
    axis.apply_aspect()
    points_per_pixel = _POINTS_PER_INCH / figure.dpi
    to_pixels = axis.transData.transform
    anchors = to_pixels(np.array([point for point, _ in labels])) * points_per_pixel
    lines = to_pixels(obstacles) * points_per_pixel
    corners = axis.get_window_extent().get_points() * points_per_pixel
    occupied = np.zeros((0, 4))
    distances = np.hypot(*np.moveaxis(anchors[:, None] - anchors[None], -1, 0))
    neighbors = np.sum(distances < _NEIGHBOR_DISTANCE, axis=1)
    for k in np.argsort(-neighbors, kind="stable").tolist():
        point, text = labels[k]
        size = _measure_text(axis, text) * points_per_pixel
        boxes, distance = _candidate_boxes(anchors[k], size)
        cost = _DISTANCE_COST * distance + _cover_cost(boxes, lines, occupied, corners)
        best = int(np.argmin(cost))
        occupied = np.vstack([occupied, boxes[best]])
        _write_label(axis, point, text, boxes[best, :2] - anchors[k], float(distance[best]))


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
    scale = _POINTS_PER_INCH / figure.dpi
    to_pixels = axis.transData.transform
    corners = axis.get_window_extent().get_points() * scale
    paths = [_sample_path(to_pixels(label.path) * scale, corners) for label in labels]
    centers = to_pixels(np.reshape(markers, (-1, 2))) * scale
    occupied = np.hstack([centers - _MARKER_RADIUS, centers + _MARKER_RADIUS])
    for k, label in enumerate(labels):
        path = paths[k]
        if not len(path):
            continue
        size = _measure_text(axis, label.text) * scale
        lift = 0.5 * size[1] + _LINE_OFFSET
        shifts = (lift, -lift) if label.is_beside else (0.0,)
        middles = np.vstack([path + np.array([0.0, shift]) for shift in shifts])
        boxes = np.hstack([middles - 0.5 * size, middles + 0.5 * size])
        others = np.vstack([other for j, other in enumerate(paths) if j != k] or [path[:0]])
        distance = np.hypot(*np.moveaxis(middles - path[0], -1, 0))
        cost = _DISTANCE_COST * distance + _cover_cost(boxes, others, occupied, corners)
        best = int(np.argmin(cost))
        occupied = np.vstack([occupied, boxes[best]])
        x, y = axis.transData.inverted().transform(middles[best] / scale)
        axis.text(
            x,
            y,
            label.text,
            color=label.color,
            ha="center",
            va="center",
            fontsize=_FONT_SIZE,
            parse_math=False,
            bbox=_LABEL_BOX,
            zorder=7,
        )


def _sample_path(path: Array, corners: Array) -> Array:
    """Return points at equal distances on a line, of those inside the axis [pt]."""
    samples = [path[:1]]
    for start, end in pairwise(path):
        length = float(np.hypot(*(end - start)))
        count = int(np.clip(math.ceil(length / _LINE_STEP), 1, _MAX_LINE_STEPS))
        samples.append(start + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - start))
    points = np.vstack(samples)
    return points[np.all((points >= corners[0]) & (points <= corners[1]), axis=1)]


def _measure_text(axis: Axes, text: str) -> Array:
    """Return width and height of a text in pixels."""
    label = axis.text(0.0, 0.0, text, fontsize=_FONT_SIZE, parse_math=False)
    box = label.get_window_extent()
    label.remove()
    return np.array([box.width, box.height])


def _candidate_boxes(anchor: Array, size: Array) -> tuple[Array, Array]:
    """Return candidate boxes (k, 4), as lower left and upper right corner, and distances [pt].

    The distances include a small penalty for directions away from the upper right.
    """
    boxes, distances = [], []
    angles = 0.25 * math.pi + 2.0 * math.pi * np.arange(_DIRECTION_COUNT) / _DIRECTION_COUNT
    for distance in _DISTANCES:
        for k, angle in enumerate(angles):
            direction = np.array([math.cos(angle), math.sin(angle)])
            # The side of the box that faces the point touches a circle around the point.
            shift = 0.5 * size * (np.clip(1.5 * direction, -1.0, 1.0) - 1.0)
            low = anchor + distance * direction + shift
            boxes.append((*low, *(low + size)))
            distances.append(distance + 0.1 * min(k, _DIRECTION_COUNT - k))
    return np.array(boxes), np.array(distances)


def _cover_cost(boxes: Array, lines: Array, occupied: Array, corners: Array) -> Array:
    low, high = boxes[:, None, :2] - _GAP, boxes[:, None, 2:] + _GAP
    covered_points = np.sum(np.all((lines > low) & (lines < high), axis=-1), axis=1)
    common = np.minimum(high, occupied[:, 2:]) - np.maximum(low, occupied[:, :2])
    overlap = np.sum(np.prod(np.clip(common, 0.0, None), axis=-1), axis=1)
    outside = np.clip(corners[0] - boxes[:, :2], 0.0, None)
    outside = outside + np.clip(boxes[:, 2:] - corners[1], 0.0, None)
    return (
        _COVERED_POINT_COST * np.minimum(covered_points, _MAX_COVERED_POINTS)
        + np.where(overlap > 0.0, _OVERLAP_COST + overlap, 0.0)
        + _OUTSIDE_COST * (outside.sum(axis=1) > 0.0)
    )


def _write_label(axis: Axes, point: Array, text: str, offset: Array, distance: float) -> None:
    leader = {
        "arrowstyle": "-",
        "color": "0.6",
        "lw": 0.6,
        "shrinkA": 0.0,
        "shrinkB": 2.0,
        "relpos": (0.5, 0.5),
    }
    axis.annotate(
        text,
        (float(point[0]), float(point[1])),
        xytext=(float(offset[0]), float(offset[1])),
        textcoords="offset points",
        fontsize=_FONT_SIZE,
        color="0.2",
        parse_math=False,
        arrowprops=leader if distance > _MIN_LEADER_DISTANCE else None,
        bbox=_LABEL_BOX,
        zorder=7,
    )
