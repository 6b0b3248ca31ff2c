"""Scenes: poses over frames, curves, and symbols fixed to the poses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray

# Minimum extent of a scene relative to the symbol size, so that symbols appear small.
_MIN_EXTENT = 20.0
# Kinds of lines from back to front; the second layer contains all others.
_LAYERS = (
    ("ground", "guide", "surface", "gear", "wheel", "trail"),
    ("rigid",),
    ("beam", "link", "spring", "damper", "sleeve"),
    ("point",),
    ("joint", "weld", "skate", "contact", "driver"),
    ("load",),
)


@dataclass(frozen=True, eq=False)
class MovingCurve:
    """Line through points that move independently.

    Attributes
    ----------
    part
        Name of the part.
    kind
        Key of the style, see `pictures.scene_artists`.
    positions
        Positions (frames, k, 2) of the k points [m].
    """

    part: str
    kind: str
    positions: Array


@dataclass(frozen=True, eq=False)
class Symbol:
    """Line through points that are fixed in moving axes.

    Attributes
    ----------
    part
        Name of the part.
    kind
        Key of the style, see `pictures.scene_artists`.
    start, end
        Indices of two poses of the scene, which may be equal.
    along
        If True, the first axis points from the start to the end. Otherwise, the angle of the axes
        is interpolated between the two poses for each point.
    points
        Points (k, 3): relative position between start (0) and end (1), and the offsets along and
        across the first axis [m]. The line is interrupted at points that are not finite.
    """

    part: str
    kind: str
    start: int
    end: int
    along: bool
    points: Array


Glyph = MovingCurve | Symbol


@dataclass(frozen=True, eq=False)
class Scene:
    """Visible lines of a mechanism in all frames.

    Attributes
    ----------
    poses
        Poses (poses, frames, 3): x, y [m] and rotation [rad].
    glyphs
        Curves and symbols: trails, then bodies, then the other parts.
    names
        Pairs of the index of a pose and the name of the part to show at this pose.
    size
        Symbol size [m].
    absent
        Masks (frames,) that are True in frames in which a part is inactive, by part name.
    caption
        Factor of the section heights of beams, if they are enlarged.
    """

    poses: Array
    glyphs: tuple[Glyph, ...]
    names: tuple[tuple[int, str], ...]
    size: float
    absent: Mapping[str, Array] = field(default_factory=dict)
    caption: str = ""

    def line(self, glyph: Glyph) -> Array:
        """Return the points (frames, k, 2) [m] of a glyph; nan in frames without the glyph."""
        line = self._line(glyph)
        if glyph.part in self.absent:
            return np.where(self.absent[glyph.part][:, None, None], np.nan, line)
        return line

    def _line(self, glyph: Glyph) -> Array:
        if isinstance(glyph, MovingCurve):
            return glyph.positions
        share, along, across = glyph.points.T
        start = self.poses[glyph.start]
        change = self.poses[glyph.end] - start
        pose = start[:, None] + share[:, None] * change[:, None]
        angle = np.arctan2(change[:, 1], change[:, 0])[:, None] if glyph.along else pose[..., 2]
        c, s = np.cos(angle), np.sin(angle)
        arm = np.stack([c * along - s * across, s * along + c * across], axis=-1)
        return pose[..., :2] + arm

    def lines(self) -> Iterator[tuple[Glyph, Array]]:
        """Iterate over all glyphs and their points, see `line`."""
        return zip(self.glyphs, map(self.line, self.glyphs), strict=False)

    def extent(self) -> tuple[Array, Array]:
        """Return the lower left and upper right corner [m] of the scene, with a minimum size."""
        points = [line.reshape(-1, 2) for _, line in self.lines()]
        low, high = bounding_box(np.concatenate(points or [self.poses[..., :2].reshape(-1, 2)]))
        margin = 0.5 * max(_MIN_EXTENT * self.size - float(np.max(high - low)), 0.0)
        return low - margin, high + margin


def find_layer(kind: str) -> int:
    """Return the layer of lines of a kind; higher layers cover lower ones."""
    return next((k for k, kinds in enumerate(_LAYERS) if kind.split(" ")[0] in kinds), 1)


def outline(line: Array, heights: Array) -> Array:
    """Return the closed outline (frames, 2 k + 1, 2) [m] of heights (k,) across a line."""
    tangent = np.gradient(line, axis=1)
    length = np.maximum(np.hypot(*np.moveaxis(tangent, -1, 0)), np.finfo(float).tiny)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1) / length[..., None]
    arm = 0.5 * heights[:, None] * normal
    upper, lower = line + arm, line - arm
    return np.concatenate([upper, lower[:, ::-1], upper[:, :1]], axis=1)


def round_down_scale(scale: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that does not exceed `scale`."""
    power = 10.0 ** np.floor(np.log10(scale))
    return float(power * max(x for x in (1.0, 2.0, 5.0) if x * power <= scale * (1.0 + 1e-9)))


def bounding_box(points: Array) -> tuple[Array, Array]:
    """Return the lower left and upper right corner of the finite points in `points` (k, 2)."""
    finite = points[np.isfinite(points).all(axis=1)]
    return finite.min(axis=0), finite.max(axis=0)
