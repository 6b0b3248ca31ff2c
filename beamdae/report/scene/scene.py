"""A scene: poses over frames, curves, and symbols that are attached to the poses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray

# Symbols that fit into what is seen.
_LEAST = 20.0


@dataclass(frozen=True, eq=False)
class MovingCurve:
    """A line through points that move each on its own.

    Attributes
    ----------
    part, kind
        Name of the part, and how it looks, see `looks`.
    places
        (frames, k, 2) [m].
    """

    part: str
    kind: str
    places: Array


@dataclass(frozen=True, eq=False)
class Symbol:
    """A line of fixed points in axes that move.

    Attributes
    ----------
    part, kind
        Name of the part, and how it looks, see `looks`.
    at, to
        Two poses of the scene, perhaps the same.
    along
        Whether the axes are those of the way from one to the other. Otherwise they turn as the
        poses do, or as much in between as the point is.
    points
        (k, 3): how far from the one (0) to the other (1) a point is, and what is added to that
        along and across the axes [m]. Lines break where it is not finite.
    """

    part: str
    kind: str
    at: int
    to: int
    along: bool
    points: Array


Glyph = MovingCurve | Symbol


@dataclass(frozen=True, eq=False)
class Scene:
    """What is seen of a mechanism over frames.

    Attributes
    ----------
    poses
        (poses, frames, 3): x, y [m] and turn [rad].
    glyphs
        Curves and symbols, in the order of the parts.
    names
        A pose, and the name of the part that is there.
    size
        Of a symbol [m].
    absent
        Of parts that are not always active: in which frames they are not, (frames,).
    """

    poses: Array
    glyphs: tuple[Glyph, ...]
    names: tuple[tuple[int, str], ...]
    size: float
    absent: Mapping[str, Array] = field(default_factory=dict)

    def line(self, glyph: Glyph) -> Array:
        """Where the points of a glyph are in each frame, (frames, k, 2); nan where it is not."""
        line = self._line(glyph)
        if glyph.part in self.absent:
            return np.where(self.absent[glyph.part][:, None, None], np.nan, line)
        return line

    def _line(self, glyph: Glyph) -> Array:
        if isinstance(glyph, MovingCurve):
            return glyph.places
        share, along, across = glyph.points.T
        start, way = self.poses[glyph.at][:, None], self.poses[glyph.to] - self.poses[glyph.at]
        pose = start + share[:, None] * way[:, None]
        angle = np.arctan2(way[:, 1], way[:, 0])[:, None] if glyph.along else pose[..., 2]
        c, s = np.cos(angle), np.sin(angle)
        arm = np.stack([c * along - s * across, s * along + c * across], axis=-1)
        return pose[..., :2] + arm

    def lines(self) -> Iterator[tuple[Glyph, Array]]:
        """All glyphs, and where their points are."""
        return zip(self.glyphs, map(self.line, self.glyphs), strict=False)

    def extent(self) -> tuple[Array, Array]:
        """The lower left and the upper right corner of all that is seen [m]; symbols stay small."""
        seen = [line.reshape(-1, 2) for _, line in self.lines()]
        low, high = bounding_box(np.concatenate(seen or [self.poses[..., :2].reshape(-1, 2)]))
        more = 0.5 * max(_LEAST * self.size - float(np.max(high - low)), 0.0)
        return low - more, high + more


def bounding_box(points: Array) -> tuple[Array, Array]:
    """Lower left and upper right corner of those of the points (k, 2) that are finite."""
    known = points[np.isfinite(points).all(axis=1)]
    return known.min(axis=0), known.max(axis=0)


def join_lines(*lines: Array) -> Array:
    """Several lines (k, n) as one."""
    gap = np.full((1, lines[0].shape[1]), np.nan)
    return np.concatenate([x for line in lines for x in (line, gap)][:-1])
