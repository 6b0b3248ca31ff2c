"""Drawing of a mechanism in its reference configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.mechanism import Mechanism
from beamdae.report.pictures.figures import disable_math_text, draw_grid
from beamdae.report.pictures.scene_artists import SceneArtists
from beamdae.report.scene.mechanism_scene import build_scene, reference_poses
from beamdae.report.scene.scene import Scene
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = np.ndarray

# Width and limits of the height of the figure [inch].
_WIDTH = 8.0
_MIN_HEIGHT = 2.5
_MAX_HEIGHT = 8.0
# Margins around the axes for tick and axis labels [inch].
_LEFT_MARGIN = 0.8
_BOTTOM_MARGIN = 0.5
_RIGHT_MARGIN = 0.2
_TOP_MARGIN = 0.22
_SHARED_LABEL_DISTANCE = 0.012  # parts closer than this share a label, relative to the extent
_SCENE_MARGIN = 0.09  # relative to the extent
_LABEL_LETTERS = 30
_POINTS_PER_LINE = 120  # sample points of lines that labels must not cover
_COVERABLE_KINDS = ("guide", "surface", "gear")  # kinds of lines that labels may cover
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


def draw(mechanism: Mechanism) -> Plot:
    """Return the drawing of a mechanism, see `Mechanism.draw`."""
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(f"draw: the argument must be a Mechanism, got {short_repr(mechanism)}.")
    return Plot(create_drawing(mechanism))


def create_design_figure(result: Any, title: str = "") -> Figure | None:
    """Return the drawing of the best design of an `Optimization`; None if it has no shape."""
    best = result.mechanism()
    return create_drawing(best) if isinstance(best, Mechanism) else None


def create_drawing(mechanism: Mechanism, size: tuple[float, float] | None = None) -> Figure:
    """Return the drawing of a mechanism as a figure.

    Parameters
    ----------
    mechanism
        The mechanism.
    size
        Width and height [inch]. By default, the width is 8, and the height depends on the shape of
        the mechanism.

    Raises
    ------
    BeamdaeError
        If the mechanism has no parts that can be drawn.
    """
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene = build_scene(mechanism, reference_poses, np.zeros(1))
    low, high = scene.extent()
    extent = float(np.max(high - low))
    relative_width, relative_height = (high - low) / extent
    height = _WIDTH * (relative_height + 0.25) / (relative_width + 0.25)
    width, height = size or (_WIDTH, float(np.clip(height, _MIN_HEIGHT, _MAX_HEIGHT)))
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    inner = (
        1.0 - (_LEFT_MARGIN + _RIGHT_MARGIN) / width,
        1.0 - (_BOTTOM_MARGIN + _TOP_MARGIN) / height,
    )
    axis = figure.add_axes((_LEFT_MARGIN / width, _BOTTOM_MARGIN / height, *inner))
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel="x [m]", ylabel="y [m]")
    axis.tick_params(labelsize=9)
    draw_grid(axis)
    axis.set_axisbelow(True)
    SceneArtists(axis, scene)
    if caption := scene.caption:
        axis.set_title(caption, loc="right", fontsize=9, color="0.4", pad=2.0)
    labels = _collect_labels(scene, _SHARED_LABEL_DISTANCE * extent)
    if np.any(mechanism.gravity):
        # An arrow right of the upper right corner.
        gravity = float(np.hypot(*mechanism.gravity))
        center = np.add(high, (3.0 * scene.size, 0.0))
        arm = 2.0 * scene.size * mechanism.gravity / gravity
        style = {"arrowstyle": "-|>", "color": "0.55", "lw": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
        axis.annotate("", tuple(center + arm), tuple(center - arm), arrowprops=style)
        labels.append((center, f"{gravity:g} m/s²"))
        high = np.add(high, (4.0 * scene.size, 0.0))
    axis.dataLim.set_points(np.array([low, high]))
    axis.margins(_SCENE_MARGIN)
    axis.autoscale_view()
    place_labels(axis, labels, _sample_lines(scene))
    disable_math_text(figure)
    return figure


def _collect_labels(scene: Scene, distance: float) -> list[tuple[Array, str]]:
    """Return positions and texts of labels, merging names of points closer than `distance`."""
    groups: list[tuple[Array, list[str]]] = []
    for row, name in scene.names:
        position = scene.poses[row, 0, :2]
        near = (names for other, names in groups if np.hypot(*(position - other)) < distance)
        names = next(near, None)
        if names is None:
            groups.append((position, names := []))
        names.append(shorten_text(name, _LABEL_LETTERS))
    return [(position, "\n".join(names)) for position, names in groups]


def _sample_lines(scene: Scene) -> Array:
    """Return closely spaced points (k, 2) on the lines that labels must not cover."""
    samples = []
    for glyph, line in scene.lines():
        if glyph.kind not in _COVERABLE_KINDS:
            points = line[0][np.isfinite(line[0]).all(axis=1)]
            at = np.linspace(0.0, len(points) - 1.0, max(len(points), _POINTS_PER_LINE))
            samples.append(
                np.stack([np.interp(at, range(len(points)), x) for x in points.T], axis=1)
            )
    return np.concatenate(samples)


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
