"""A scene in matplotlib: artists that are made once and moved from frame to frame."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.scene.beam_colors import BeamColors
from beamdae.report.scene.line_styles import find_style
from beamdae.report.scene.scene import MovingCurve, Scene, bounding_box

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

Array = np.ndarray

# Of a picture [inch].
_WIDTH, _LEAST = 6.0, (2.0, 1.5)


class SceneArtists:
    """The artists of a scene on an axis.

    Parameters
    ----------
    axis
        Of equal scales.
    scene
        What is shown.
    painted
        Colors of beams, by part.
    pale
        Whether all of it is drawn in gray, behind everything else.
    """

    def __init__(
        self, axis: Axes, scene: Scene, painted: BeamColors | None = None, pale: bool = False
    ) -> None:
        self._axis, self._pale, self._painted = axis, pale, painted
        self._moving = [(self._artist(g, line), line, g) for g, line in scene.lines()]
        self.show(0)

    def _artist(self, glyph: Any, line: Array) -> Artist:
        look = find_style(glyph.kind)
        color, order = ("0.8", 0.5) if self._pale else (look.color, look.order)
        if self._paints(glyph):
            from matplotlib.collections import LineCollection

            found = LineCollection([], linewidths=1.4 * look.width, zorder=order)
            assert self._painted is not None
            found.set(cmap=self._painted.colormap, norm=self._painted.norm, capstyle="butt")
            return self._axis.add_collection(found, autolim=False)
        if look.fill is not None and line.shape[1] > 2 and not self._pale:
            from matplotlib.colors import to_rgba
            from matplotlib.patches import Polygon

            face = to_rgba(look.fill, look.opacity)
            edge: dict[str, Any] = {"fc": face, "ec": color, "lw": look.width, "zorder": order}
            return self._axis.add_patch(Polygon(line[0], closed=True, **edge))
        style: dict[str, Any] = {"color": color, "lw": look.width, "ls": look.dash, "zorder": order}
        return self._axis.plot([], [], **style, solid_capstyle="round")[0]

    def _paints(self, glyph: Any) -> bool:
        painted = self._painted
        return (
            painted is not None and isinstance(glyph, MovingCurve) and glyph.part in painted.values
        )

    def show(self, frame: int) -> list[Artist]:
        """Move everything to where it is in a frame."""
        for artist, line, glyph in self._moving:
            points = line[frame]
            if self._paints(glyph):
                assert self._painted is not None
                # Each goes on under the next one, or seams would be seen.
                beyond = np.concatenate([points[2:], points[-1:]])
                artist.set(segments=np.stack([points[:-1], points[1:], beyond], axis=1))
                artist.set(array=self._painted.of_segments(glyph.part, frame))
            elif hasattr(artist, "set_xy"):
                artist.set_xy(points)
            else:
                artist.set(data=points.T)
        return [artist for artist, _, _ in self._moving]


def create_bare_axis(corners: tuple[Array, Array], below: float = 0.0) -> tuple[Figure, Axes]:
    """A figure of nothing but equal axes between corners, with a strip [inch] below them."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, high = corners
    width, height = _WIDTH * (high - low) / np.max(high - low)
    wide, tall = max(width, _LEAST[0]), max(height, _LEAST[1]) + below
    figure = Figure(figsize=(wide, tall))
    FigureCanvasAgg(figure)
    axis = figure.add_axes((0.0, below / tall, 1.0, 1.0 - below / tall))
    axis.set_aspect("equal")
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()
    return figure, axis


def add_caption(axis: Axes) -> Text:
    """A text in the corner above."""
    look: dict[str, Any] = {"va": "top", "color": "0.4", "fontsize": 9, "parse_math": False}
    return axis.text(0.02, 0.98, "", transform=axis.transAxes, **look)


def padded_extent(scenes: Iterable[Scene], margin: float = 0.05) -> tuple[Array, Array]:
    """The corners of what is seen of scenes, with a margin of its size and of some width."""
    low, high = bounding_box(np.array([x for scene in scenes for x in scene.extent()]))
    size = float(np.max(high - low)) or 1.0
    middle = (low + high) / 2.0
    half = np.maximum((high - low) / 2.0, 0.1 * size) + margin * size
    return middle - half, middle + half
