"""Names in a drawing, placed so that they neither lie on each other nor on what they name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = np.ndarray

# Directions and distances [pt] at which a place for a name is looked for, the nearest first.
_DIRECTIONS, _DISTANCES = 16, (7.0, 14.0, 24.0, 38.0, 56.0, 80.0, 110.0, 150.0)
# From this distance on a line leads to what is named [pt].
_LED = 16.0
_SIZE, _GAP = 8.0, 1.5
# What it costs that a name covers points of lines, and that it leaves the axes.
_COVERED, _OUTSIDE, _AWAY = 2.0, 400.0, 0.35
_POINTS_PER_INCH = 72.0


def place_names(axis: Axes, names: Sequence[tuple[Array, str]], drawn: Array) -> None:
    """Write names beside their places, each where it covers least.

    Names are placed one after the other, those of dense neighborhoods first: where one would lie
    on another it goes further off, with a line to its place.

    Parameters
    ----------
    axis
        With its limits, where it stays in its figure.
    names
        Places (2,) in data, and texts.
    drawn
        Points (k, 2) in data that are better not covered.
    """
    figure: Any = axis.figure
    axis.apply_aspect()
    points = _POINTS_PER_INCH / figure.dpi
    to_points = axis.transData.transform
    at = to_points(np.array([place for place, _ in names])) * points
    lines = to_points(drawn) * points
    corners = axis.get_window_extent().get_points() * points
    taken = np.zeros((0, 4))
    distances = np.hypot(*np.moveaxis(at[:, None] - at[None], -1, 0))
    crowd = np.sum(distances < 60.0, axis=1)
    for k in np.argsort(-crowd, kind="stable").tolist():
        text = names[k][1]
        size = _extent(axis, text) * points
        boxes, away = _candidates(at[k], size)
        cost = _AWAY * away + _covering(boxes, lines, taken, corners)
        best = boxes[int(np.argmin(cost))]
        taken = np.vstack([taken, best])
        _write(axis, names[k][0], text, best[:2] - at[k], float(away[int(np.argmin(cost))]))


def _extent(axis: Axes, text: str) -> Array:
    """Width and height of a text in pixels."""
    written = axis.text(0.0, 0.0, text, fontsize=_SIZE, parse_math=False)
    box = written.get_window_extent()
    written.remove()
    return np.array([box.width, box.height])


def _candidates(at: Array, size: Array) -> tuple[Array, Array]:
    """Boxes (k, 4) around a place, from lower left to upper right, and how far away they are."""
    found, away = [], []
    angles = 0.25 * math.pi + 2.0 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    for distance in _DISTANCES:
        for k, angle in enumerate(angles):
            way = np.array([math.cos(angle), math.sin(angle)])
            # The side of the box that is nearest to the place touches the circle.
            low = at + distance * way + 0.5 * size * (np.clip(1.5 * way, -1.0, 1.0) - 1.0)
            found.append((*low, *(low + size)))
            away.append(distance + 0.1 * min(k, _DIRECTIONS - k))
    return np.array(found), np.array(away)


def _covering(boxes: Array, lines: Array, taken: Array, corners: Array) -> Array:
    low, high = boxes[:, None, :2] - _GAP, boxes[:, None, 2:] + _GAP
    on_lines = np.sum(np.all((lines > low) & (lines < high), axis=-1), axis=1)
    common = np.minimum(high, taken[:, 2:]) - np.maximum(low, taken[:, :2])
    overlap = np.sum(np.prod(np.clip(common, 0.0, None), axis=-1), axis=1)
    outside = np.clip(corners[0] - boxes[:, :2], 0.0, None)
    outside = outside + np.clip(boxes[:, 2:] - corners[1], 0.0, None)
    return (
        _COVERED * np.minimum(on_lines, 40)
        + np.where(overlap > 0.0, 300.0 + overlap, 0.0)
        + _OUTSIDE * (outside.sum(axis=1) > 0.0)
    )


def _write(axis: Axes, place: Array, text: str, offset: Array, away: float) -> None:
    led = {"arrowstyle": "-", "color": "0.6", "lw": 0.6, "shrinkA": 0.0, "shrinkB": 2.0}
    axis.annotate(
        text,
        (float(place[0]), float(place[1])),
        xytext=(float(offset[0]), float(offset[1])),
        textcoords="offset points",
        fontsize=_SIZE,
        color="0.2",
        parse_math=False,
        arrowprops={**led, "relpos": (0.5, 0.5)} if away > _LED else None,
        bbox={"fc": "white", "ec": "none", "alpha": 0.75, "pad": 0.4},
        zorder=7,
    )
