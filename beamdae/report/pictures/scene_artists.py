"""Matplotlib artists and line styles of scenes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.report.pictures.figures import COLORS
from beamdae.report.scene.scene import Glyph, MovingCurve, Scene, bounding_box

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from beamdae.report.scene.beam_colors import BeamColors

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
_OUTLINE_WIDTH = 0.7  # of beams with drawn heights [pt]
_COLORED_WIDTH = 1.4  # line width of colored beams, relative to uncolored beams

# Margin around a drawing, relative to the larger of width and height.
_MARGIN = 0.05


class LineStyle(NamedTuple):
    """Appearance of a line in a figure.

    Attributes
    ----------
    color, width, dash
        Color, width [pt] and dash pattern, as defined by Matplotlib.
    fill, opacity
        Fill color of a closed line (None for no fill), and opacity of the fill.
    order
        Drawing order; lines of higher order cover lines of lower order.
    """

    color: str
    width: float = 1.2
    dash: Any = "-"
    fill: str | None = None
    opacity: float = 1.0
    order: int = 3


_STYLES = {
    "ground": LineStyle("0.5", 1.0, order=1),
    "guide": LineStyle("0.55", 1.0, order=1),
    "surface": LineStyle("0.45", 1.1, order=1),
    "gear": LineStyle("0.4", 0.9, _CHAIN_LINE, order=1),
    "wheel": LineStyle("0.3", 1.0, order=1),
    "trail": LineStyle("0.45", 0.9, order=1),
    "rigid": LineStyle(_ORANGE, 2.2, fill=_ORANGE, opacity=0.18, order=2),
    "beam": LineStyle(_BLUE, 2.4, order=3),
    "link": LineStyle("0.2", 1.2, _DOTTED_LINE, order=3),
    "spring": LineStyle(_GREEN, 1.3, order=3),
    "damper": LineStyle("0.3", 1.3, order=3),
    "point": LineStyle(_RED, 1.0, fill=_RED, order=4),
    "sleeve": LineStyle("0.2", 1.1, fill="white", order=3),
    "joint": LineStyle("0.2", 1.1, fill="white", order=5),
    "weld": LineStyle("0.2", 1.1, fill="0.2", order=5),
    "skate": LineStyle("0.2", 3.0, order=5),
    "contact": LineStyle(_RED, 1.0, fill="white", order=5),
    "driver": LineStyle("0.2", 1.3, order=5),
    "driver tip": LineStyle("0.2", 1.0, fill="0.2", order=5),
    "load": LineStyle(_RED, 1.5, order=6),
    "load tip": LineStyle(_RED, 1.0, fill=_RED, order=6),
}
# Style of unknown kinds, which user-defined parts may return from `Part.draw`.
_DEFAULT_STYLE = LineStyle(_ORANGE, 1.2)


def find_style(kind: str) -> LineStyle:
    """Return the line style of a kind, or the default style if the kind is unknown."""
    return _STYLES.get(kind, _DEFAULT_STYLE)


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
        self._artists = [(self._create(g, line), line, g) for g, line in scene.outlines()]
        self.show(0)

    def _create(self, glyph: Glyph, line: Array) -> Artist:
        style = find_style(glyph.kind)
        color, order = style.color, float(style.order)
        if self._is_pale:
            color, order = _PALE_COLOR, _PALE_ORDER
        if _has_heights(glyph):
            from matplotlib.collections import PolyCollection

            # Thin sections remain visible as lines.
            fill: dict[str, Any] = {"linewidths": _OUTLINE_WIDTH, "zorder": order}
            if self._is_colored(glyph):
                assert self._colors is not None
                fill["cmap"] = create_colormap(self._colors)
                fill["norm"] = create_norm(self._colors)
                fill["edgecolors"] = "face"
            else:
                fill["facecolors"] = fill["edgecolors"] = color
            return self._axis.add_collection(PolyCollection([], **fill), autolim=False)
        if self._is_colored(glyph):
            from matplotlib.collections import LineCollection

            lines = LineCollection([], linewidths=_COLORED_WIDTH * style.width, zorder=order)
            assert self._colors is not None
            colormap, norm = create_colormap(self._colors), create_norm(self._colors)
            lines.set(cmap=colormap, norm=norm, capstyle="butt")
            return self._axis.add_collection(lines, autolim=False)
        if style.fill is not None and line.shape[1] > 2 and not self._is_pale:
            from matplotlib.colors import to_rgba
            from matplotlib.patches import Polygon

            face = to_rgba(style.fill, style.opacity)
            edge: dict[str, Any] = {"fc": face, "ec": color, "lw": style.width, "zorder": order}
            return self._axis.add_patch(Polygon(line[0], closed=True, **edge))
        options: dict[str, Any] = {
            "color": color,
            "lw": style.width,
            "ls": style.dash,
            "zorder": order,
        }
        return self._axis.plot([], [], **options, solid_capstyle="round")[0]

    def _is_colored(self, glyph: Glyph) -> bool:
        colors = self._colors
        return colors is not None and isinstance(glyph, MovingCurve) and glyph.part in colors.values

    def show(self, frame: int) -> list[Artist]:
        """Update all artists to a frame and return them."""
        for artist, line, glyph in self._artists:
            points = line[frame]
            if _has_heights(glyph):
                is_colored = self._is_colored(glyph)
                artist.set(verts=_split_outline(points) if is_colored else [points])
                if is_colored:
                    assert self._colors is not None
                    artist.set(array=self._colors.segment_values(glyph.part, frame))
            elif self._is_colored(glyph):
                assert self._colors is not None
                # Each segment extends below the next segment to hide the seams.
                next_points = np.concatenate([points[2:], points[-1:]])
                segments = np.stack([points[:-1], points[1:], next_points], axis=1)
                artist.set(segments=segments)
                artist.set(array=self._colors.segment_values(glyph.part, frame))
            elif hasattr(artist, "set_xy"):
                artist.set_xy(points)
            else:
                artist.set(data=points.T)
        return [artist for artist, _, _ in self._artists]


def _has_heights(glyph: Glyph) -> bool:
    return isinstance(glyph, MovingCurve) and glyph.heights is not None


def _split_outline(outline: Array) -> Array:
    """Return the quadrilaterals (k - 1, 4, 2) between neighboring sections of an outline."""
    count = len(outline) // 2
    upper, lower = outline[:count], outline[count:-1][::-1]
    return np.stack([upper[:-1], upper[1:], lower[1:], lower[:-1]], axis=1)


def describe_heights(scene: Scene) -> str:
    """Return a caption with the factor of the drawn section heights, or "" if there is none."""
    scale = scene.height_scale
    return "" if scale == 1.0 else f"section heights \u00d7 {scale:.4g}"


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
