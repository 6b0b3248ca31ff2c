"""Drawing of a mechanism in its reference configuration."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.parts.mechanism import Mechanism
from beamdae.report.pictures.figures import disable_math_text
from beamdae.report.pictures.label_placement import place_labels
from beamdae.report.pictures.scene_artists import SceneArtists
from beamdae.report.scene.mechanism_scene import build_scene
from beamdae.report.scene.poses import reference_poses
from beamdae.report.scene.scene import Scene
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot

if TYPE_CHECKING:
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
    scene = build_scene(mechanism, reference_poses, np.zeros(1))
    low, high = scene.extent()
    figure, axis = _create_axis(high - low, size)
    SceneArtists(axis, scene)
    if caption := scene.caption:
        axis.set_title(caption, loc="right", fontsize=9, color="0.4", pad=2.0)
    labels = _collect_labels(scene, _SHARED_LABEL_DISTANCE * float(np.max(high - low)))
    if np.any(mechanism.gravity):
        labels.append(_draw_gravity(mechanism.gravity, high, scene.size, axis))
        high = np.add(high, (4.0 * scene.size, 0.0))
    axis.dataLim.set_points(np.array([low, high]))
    axis.margins(_SCENE_MARGIN)
    axis.autoscale_view()
    place_labels(axis, labels, _sample_lines(scene))
    disable_math_text(figure)
    return figure


def _create_axis(extent: Array, size: tuple[float, float] | None) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    relative_width, relative_height = extent / np.max(extent)
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
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.tick_params(labelsize=9)
    axis.grid(color="0.93", lw=0.6)
    axis.set_axisbelow(True)
    return figure, axis


def _draw_gravity(gravity: Array, high: Array, size: float, axis: Any) -> tuple[Array, str]:
    """Draw the gravity arrow right of the upper right corner; return its position and label."""
    along = gravity / np.hypot(*gravity)
    center = np.array([high[0] + 3.0 * size, high[1]])
    start, end = center - 2.0 * size * along, center + 2.0 * size * along
    style = {"arrowstyle": "-|>", "color": "0.55", "lw": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
    axis.annotate("", tuple(end.tolist()), tuple(start.tolist()), arrowprops=style)
    return center, f"{np.hypot(*gravity):g} m/s²"


def _collect_labels(scene: Scene, distance: float) -> list[tuple[Array, str]]:
    """Return positions and texts of labels, merging names of points closer than `distance`."""
    groups: list[tuple[Array, list[str]]] = []
    for row, name in scene.names:
        position = scene.poses[row, 0, :2]
        for other, names in groups:
            if np.hypot(*(position - other)) < distance:
                names.append(shorten_text(name, _LABEL_LETTERS))
                break
        else:
            groups.append((position, [shorten_text(name, _LABEL_LETTERS)]))
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
