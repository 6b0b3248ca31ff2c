"""Matplotlib artists and line styles of scenes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.report.pictures.figures import COLORS
from beamdae.report.scene.scene import Glyph, Scene, bounding_box, find_layer

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from beamdae.report.scene.run_scene import BeamColors

Array = np.ndarray

# Length of the longer side of an animation, and its minimum width and height [inch].
_LONGER_SIDE = 6.0
_MIN_WIDTH = 2.0
_MIN_HEIGHT = 1.5

_BLUE, _ORANGE, _GREEN, _RED = COLORS[:4]
_CHAIN_LINE = (0, (6, 2, 1, 2))
_DOTTED_LINE = (0, (1, 1.5))
_PALE_COLOR = "0.8"
_PALE_ORDER = 0.5

# Margin around a drawing, relative to the larger of width and height.
_MARGIN = 0.05


class LineStyle(NamedTuple):
    """Color, width [pt] and dash pattern of a line, fill and opacity of a closed one."""

    color: str
    width: float = 1.2
    dash: Any = "-"
    fill: str | None = None
    opacity: float = 1.0


_STYLES = {
    "ground": LineStyle("0.5", 1.0),
    "guide": LineStyle("0.55", 1.0),
    "surface": LineStyle("0.45", 1.1),
    "gear": LineStyle("0.4", 0.9, _CHAIN_LINE),
    "wheel": LineStyle("0.3", 1.0),
    "trail": LineStyle("0.45", 0.9),
    "rigid": LineStyle(_ORANGE, 2.2, fill=_ORANGE, opacity=0.18),
    "beam": LineStyle(_BLUE, 2.4),
    "beam solid": LineStyle(_BLUE, 0.7, fill=_BLUE),  # thin sections remain visible
    "link": LineStyle("0.2", 1.2, _DOTTED_LINE),
    "spring": LineStyle(_GREEN, 1.3),
    "damper": LineStyle("0.3", 1.3),
    "point": LineStyle(_RED, 1.0, fill=_RED),
    "sleeve": LineStyle("0.2", 1.1, fill="white"),
    "joint": LineStyle("0.2", 1.1, fill="white"),
    "weld": LineStyle("0.2", 1.1, fill="0.2"),
    "skate": LineStyle("0.2", 3.0),
    "contact": LineStyle(_RED, 1.0, fill="white"),
    "driver": LineStyle("0.2", 1.3),
    "driver tip": LineStyle("0.2", 1.0, fill="0.2"),
    "load": LineStyle(_RED, 1.5),
    "load tip": LineStyle(_RED, 1.0, fill=_RED),
}
# Style of unknown kinds, which user-defined parts may return from `Part.draw`.
_DEFAULT_STYLE = LineStyle(_ORANGE, 1.2)


def create_colormap(colors: BeamColors) -> Colormap:
    """Return the color scale of beams as a Matplotlib colormap."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("beams", list(colors.scale))


def create_norm(colors: BeamColors) -> Normalize:
    """Return the limits of the color scale of beams as a Matplotlib norm."""
    from matplotlib.colors import Normalize

    return Normalize(*colors.limits)


class SceneArtists:
    """Artists of a scene, which are created once and updated for each frame.

    Parameters
    ----------
    axis
        Axis with equal scales.
    scene
        The scene; its first frame is shown initially.
    colors
        Colors along beams. If None, all beams have the same color.
    is_pale
        If True, all lines are drawn in gray, behind other artists.
    """

    def __init__(
        self, axis: Axes, scene: Scene, colors: BeamColors | None = None, is_pale: bool = False
    ) -> None:
        self._axis, self._is_pale, self._colors = axis, is_pale, colors
        self._artists = [(self._create(g, line), line, g) for g, line in scene.lines()]
        self.show(0)

    def _create(self, glyph: Glyph, line: Array) -> Artist:
        from matplotlib.collections import PolyCollection
        from matplotlib.colors import to_rgba
        from matplotlib.patches import Polygon

        style = _STYLES.get(glyph.kind, _DEFAULT_STYLE)
        color, order = style.color, 1.0 + find_layer(glyph.kind)
        if self._is_pale:
            color, order = _PALE_COLOR, _PALE_ORDER
        if (colors := self._colors_of(glyph)) is not None:
            pieces = PolyCollection([], edgecolors="face", linewidths=style.width, zorder=order)
            pieces.set(cmap=create_colormap(colors), norm=create_norm(colors))
            return self._axis.add_collection(pieces, autolim=False)
        if (
            style.fill is not None
            and line.shape[1] > 2
            and not (self._is_pale and style.opacity < 1.0)
        ):
            face = to_rgba(color if self._is_pale else style.fill, style.opacity)
            edge: dict[str, Any] = {"fc": face, "ec": color, "lw": style.width, "zorder": order}
            return self._axis.add_patch(Polygon(line[0], closed=True, **edge))
        looks: dict[str, Any] = {"color": color, "lw": style.width, "ls": style.dash}
        return self._axis.plot([], [], **looks, zorder=order, solid_capstyle="round")[0]

    def _colors_of(self, glyph: Glyph) -> BeamColors | None:
        values = {} if self._colors is None else self._colors.values
        return self._colors if glyph.kind.startswith("beam") and glyph.part in values else None

    def show(self, frame: int) -> list[Artist]:
        """Update all artists to a frame and return them."""
        for artist, line, glyph in self._artists:
            points = line[frame]
            if (colors := self._colors_of(glyph)) is not None:
                values = colors.segment_values(glyph.part, frame)
                artist.set(verts=_split_line(points, len(values)), array=values)
            elif hasattr(artist, "set_xy"):
                artist.set_xy(points)
            else:
                artist.set(data=points.T)
        return [artist for artist, _, _ in self._artists]


def _split_line(line: Array, count: int) -> Array:
    """Return the pieces (count, 2 or 4, 2) between the sections of a line or an outline."""
    upper = line[: count + 1]
    if len(line) == len(upper):
        # Each piece extends below the next one to hide the seams.
        return np.stack([upper[:-1], upper[1:], np.concatenate([upper[2:], upper[-1:]])], axis=1)
    lower = line[count + 1 : -1][::-1]
    return np.stack([upper[:-1], upper[1:], lower[1:], lower[:-1]], axis=1)


def show_region(axis: Axes, corners: tuple[Array, Array]) -> None:
    """Show the region between two corners [m] at equal scales, without a frame."""
    low, high = corners
    axis.set_aspect("equal")
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()


def create_bare_axis(corners: tuple[Array, Array], strip: float = 0.0) -> tuple[Figure, Axes]:
    """Create a figure with invisible axes of equal scale.

    Parameters
    ----------
    corners
        Lower left and upper right corner of the visible region [m].
    strip
        Height of an empty strip below the axis [inch].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = corners
    width, height = _LONGER_SIDE * (high - low) / np.max(high - low)
    width, height = max(width, _MIN_WIDTH), max(height, _MIN_HEIGHT) + strip
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    axis = figure.add_axes((0.0, strip / height, 1.0, 1.0 - strip / height))
    show_region(axis, corners)
    return figure, axis


def add_caption(axis: Axes) -> Text:
    """Add an empty text in the upper left corner of an axis and return it."""
    style: dict[str, Any] = {"va": "top", "color": "0.4", "fontsize": 9, "parse_math": False}
    return axis.text(0.02, 0.98, "", transform=axis.transAxes, **style)


def padded_extent(scenes: Iterable[Scene]) -> tuple[Array, Array]:
    """Return the lower left and upper right corner [m] of all scenes, with a margin.

    The margin is relative to the larger of width and height. The smaller one is first enlarged to a
    fifth of the larger one if necessary.
    """
    low, high = bounding_box(np.array([x for scene in scenes for x in scene.extent()]))
    size = float(np.max(high - low)) or 1.0
    center = (low + high) / 2.0
    half = np.maximum((high - low) / 2.0, 0.1 * size) + _MARGIN * size
    return center - half, center + half
