"""Scenes: poses over frames, curves and symbols fixed to the poses, and their builder."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.rigid_body import Ground
from beamdae.symbolic.statements import Quantity

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
# Corners of polygons that appear round.
_SYMBOL_CORNERS = 16  # at the size of a symbol
_WHEEL_CORNERS = 60  # at the size of a body
_HATCH_DISTANCE = 0.6
_HATCH_LENGTH = 0.4  # of a hatch along and across the line
# Returns the values (frames, columns) of a quantity in all frames.
Measure = Callable[[Quantity], Array]
# Dimensions of a ground support, relative to the symbol size.
_SUPPORT_DEPTH = 1.1
_SUPPORT_HALF_WIDTH = 0.9
_SUPPORT_HATCHES = 5


class Poses(Protocol):
    """Map from attachments to x, y [m] and rotation from the reference configuration [rad]."""

    def __call__(self, attachments: Sequence[Attachment]) -> Array:
        """Return the poses, (frames, attachments, 3)."""


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
        Factors of displacements and of the section heights of beams, if they are enlarged.
    scale
        Factor of the displacements from the first frame.
    """

    poses: Array
    glyphs: tuple[Glyph, ...]
    names: tuple[tuple[int, str], ...]
    size: float
    absent: Mapping[str, Array] = field(default_factory=dict)
    caption: str = ""
    scale: float = 1.0

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


def join_lines(*lines: Array) -> Array:
    """Concatenate lines (k, n), separated by rows of nan."""
    gap = np.full((1, lines[0].shape[1]), np.nan)
    return np.concatenate([x for line in lines for x in (line, gap)][:-1])


def unit_vector(direction: Sequence[float] | Array) -> Array:
    """Return the unit vector in a direction, or (0, -1) if its length is zero."""
    length = math.hypot(*direction)
    return np.array(direction, float) / length if length > 0.0 else np.array([0.0, -1.0])


def rotate_left(direction: Array) -> Array:
    """Return the direction rotated by 90 degrees counter-clockwise."""
    return np.array([-direction[1], direction[0]])


def align_points(points: Any, direction: Sequence[float] | Array) -> Array:
    """Rotate points (k, 2) so that their x axis points in the given direction."""
    c, s = unit_vector(direction)
    return np.asarray(points, float) @ np.array([(c, s), (-s, c)])


def circle(
    radius: float, corners: int = _SYMBOL_CORNERS, first: float = 0.0, last: float = 2.0 * math.pi
) -> Array:
    """Return a polygon (corners + 1, 2) that approximates a circle, or its arc between angles."""
    angle = np.linspace(first, last, corners + 1)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def wheel(radius: float) -> Array:
    """Return a circle with a spoke, (k, 2), which makes its rotation visible."""
    return join_lines(circle(radius, _WHEEL_CORNERS), np.array([(0.0, 0.0), (radius, 0.0)]))


def box(width: float, height: float) -> Array:
    """Return a closed rectangle (5, 2) centered at the origin."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], float)
    return 0.5 * corners * (width, height)


def hatched_line(low: float, high: float) -> Array:
    """Return a line (k, 2) along the x axis with hatches below it."""
    count = max(round((high - low) / _HATCH_DISTANCE), 2)
    feet = np.linspace(low, high, count + 1)[1:]
    hatches = [np.array([(x, 0.0), (x - _HATCH_LENGTH, -_HATCH_LENGTH)]) for x in feet]
    return join_lines(np.array([(low, 0.0), (high, 0.0)]), *hatches)


def arrow_head() -> Array:
    """Return a closed triangle (4, 2) pointing in the x direction, with its tip at the origin."""
    return 0.5 * np.array([(-1.0, -0.4), (0.0, 0.0), (-1.0, 0.4), (-1.0, -0.4)])


class SceneBuilder:
    """Collects the curves, symbols and names of all parts sequentially.

    Parameters
    ----------
    poses
        Function that returns the poses of attachments in all frames.
    times
        Times of the frames [s].
    measure
        Function that evaluates a quantity in all frames. None if only poses are available.

    Attributes
    ----------
    size
        Symbol size [m].
    part
        Name of the part whose lines are being added.
    """

    def __init__(self, poses: Poses, times: Array, measure: Measure | None = None) -> None:
        self.times, self.measure, self.size, self.part = times, measure, 0.0, ""
        self._attachment_poses, self._poses = poses, list[Array]()
        self._rows: dict[Any, int] = {}
        self._glyphs, self._names = list[Glyph](), list[tuple[int, str]]()
        self._supported: set[tuple[float, float]] = set()

    def add_attachment(self, attachment: Attachment) -> int:
        """Add the pose of an attachment, if not yet added, and return its index."""
        key = (id(attachment.body), attachment.point, attachment.s)
        if key not in self._rows:
            self._rows[key] = self.add_pose(self._attachment_poses([attachment])[:, 0])
        return self._rows[key]

    def positions(self, attachments: Sequence[Attachment]) -> Array:
        """Return the positions (frames, attachments, 2) [m] of attachments."""
        return self._attachment_poses(attachments)[..., :2]

    def add_pose(self, pose: Array) -> int:
        """Add a pose (frames, 3) and return its index."""
        self._poses.append(np.broadcast_to(pose, (len(self.times), 3)))
        return len(self._poses) - 1

    def add_midpoint(self, a: int, b: int) -> int:
        """Add the pose halfway between two poses and return its index."""
        return self.add_pose(0.5 * (self.pose(a) + self.pose(b)))

    def pose(self, row: int) -> Array:
        """Return the pose (frames, 3) with the given index."""
        return self._poses[row]

    def relative_position(self, a: int, b: int) -> Array:
        """Return the position (frames, 2) [m] of pose `b` relative to pose `a`, in axes of `a`."""
        x, y, _ = (self._poses[b] - self._poses[a]).T
        c, s = np.cos(self._poses[a][:, 2]), np.sin(self._poses[a][:, 2])
        return np.stack([c * x + s * y, c * y - s * x], axis=-1)

    def add_curve(self, kind: str, positions: Array) -> None:
        """Add a line through points (frames, k, 2) [m], see `MovingCurve`."""
        self._glyphs.append(MovingCurve(self.part, kind, positions))

    def add_rigid(self, kind: str, at: int, points: Any, part: str = "") -> None:
        """Add a line through points (k, 2) that are fixed in the axes of a pose.

        Like those of all symbols, they are relative to the symbol size.
        """
        points = np.insert(np.asarray(points, float), 0, 0.0, axis=1)
        self.add_between(kind, at, at, points, part=part)

    def add_between(
        self, kind: str, start: int, end: int, points: Any, along: bool = False, part: str = ""
    ) -> None:
        """Add a `Symbol` with points (k, 3) between two poses, by default of the current part."""
        scaled = np.asarray(points, float) * (1.0, self.size, self.size)
        self._glyphs.append(Symbol(part or self.part, kind, start, end, along, scaled))

    def add_link(self, kind: str, start: int, end: int) -> None:
        """Add a straight line between two poses."""
        self.add_between(kind, start, end, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], along=True)

    def add_name(self, row: int) -> None:
        """Add the name of the current part at a pose."""
        self._names.append((row, self.part))

    def add_support(self, attachment: Attachment) -> None:
        """Add a support below an attachment if it belongs to the ground and has no support yet."""
        if not isinstance(attachment.body, Ground) or attachment.point in self._supported:
            return
        self._supported.add(attachment.point)
        half, below = _SUPPORT_HALF_WIDTH, -_SUPPORT_DEPTH
        feet = np.linspace(-1.0, 1.2, _SUPPORT_HATCHES) * half
        hatches = [np.array([(x, below), (x - 0.4 * half, below - 0.4 * half)]) for x in feet]
        base = np.array([(-1.2 * half, below), (1.2 * half, below)])
        cone = np.array([(-0.7 * half, below), (0.0, 0.0), (0.7 * half, below)])
        # The support belongs to the ground, so it stays visible while the part is inactive.
        row, name = self.add_attachment(attachment), attachment.body.name
        self.add_rigid("ground", row, join_lines(cone, base, *hatches), name)

    def build(self, caption: str, scale: float) -> Scene:
        """Return the scene with everything added so far."""
        poses = np.array(self._poses).reshape(-1, len(self.times), 3)
        names = tuple(self._names)
        return Scene(poses, tuple(self._glyphs), names, self.size, caption=caption, scale=scale)
