"""What scenes are made with: poses by attachment, symbols in sizes of the drawing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.rigid_body import Ground
from beamdae.report.scene.poses import Poses
from beamdae.report.scene.scene import Glyph, MovingCurve, Scene, Symbol, join_lines
from beamdae.symbolic.statements import Quantity

Array = np.ndarray
# Quantity -> its columns (frames, k), where velocities and reactions are known.
Measure = Callable[[Quantity], Array]


class SceneBuilder:
    """Collects what is seen of the parts, one after the other.

    Parameters
    ----------
    poses
        Where points are in the frames.
    times
        Of the frames [s].
    measure
        What quantities are in the frames; None: only poses are known.
    """

    def __init__(self, poses: Poses, times: Array, measure: Measure | None = None) -> None:
        self.times, self.measure, self.size, self.part = times, measure, 0.0, ""
        self._of, self._poses = poses, list[Array]()
        self._rows: dict[Any, int] = {}
        self._glyphs, self._names = list[Glyph](), list[tuple[int, str]]()
        self._supported: set[tuple[float, float]] = set()

    def at(self, place: Attachment) -> int:
        """The pose of an attachment."""
        key = (id(place.body), place.point, place.s)
        if key not in self._rows:
            self._rows[key] = self.follow(self._of([place])[:, 0])
        return self._rows[key]

    def through(self, places: Sequence[Attachment]) -> Array:
        """Where points are, (frames, points, 2)."""
        return self._of(places)[..., :2]

    def follow(self, pose: Array) -> int:
        """A pose (frames, 3) that is that of no attachment."""
        self._poses.append(np.broadcast_to(pose, (len(self.times), 3)))
        return len(self._poses) - 1

    def pose(self, row: int) -> Array:
        """A pose, (frames, 3)."""
        return self._poses[row]

    def way(self, a: int, b: int) -> Array:
        """From one pose to another in the axes of the first, (frames, 2)."""
        x, y, _ = (self._poses[b] - self._poses[a]).T
        c, s = np.cos(self._poses[a][:, 2]), np.sin(self._poses[a][:, 2])
        return np.stack([c * x + s * y, c * y - s * x], axis=-1)

    def curve(self, kind: str, places: Array) -> None:
        """A line through points (frames, k, 2)."""
        self._glyphs.append(MovingCurve(self.part, kind, places))

    def carried(self, kind: str, at: int, points: Array) -> None:
        """Points (k, 2) [m] that turn with a pose; drawn as they are where it has no turn."""
        self._add(kind, at, points)

    def between(self, kind: str, at: int, to: int, points: Array) -> None:
        """Points (k, 3) of a `Symbol` whose axes turn as the poses do."""
        self._add(kind, at, points, to)

    def stretched(self, kind: str, at: int, to: int, points: Array) -> None:
        """Points (k, 3) of a `Symbol` along the way between two poses."""
        self._add(kind, at, points, to, along=True)

    def link(self, kind: str, at: int, to: int) -> None:
        """A straight line between two poses."""
        self.stretched(kind, at, to, np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]))

    def _add(
        self,
        kind: str,
        at: int,
        points: Array,
        to: int | None = None,
        along: bool = False,
        part: str = "",
    ) -> None:
        points = np.asarray(points, float)
        if to is None:
            to, points = at, np.column_stack([np.zeros(len(points)), points])
        self._glyphs.append(Symbol(part or self.part, kind, at, to, along, points))

    def name(self, row: int) -> None:
        """Have the name of the part at a pose."""
        self._names.append((row, self.part))

    def support(self, place: Attachment) -> None:
        """The ground under a place, once, if it is one of the ground."""
        if not isinstance(place.body, Ground) or place.point in self._supported:
            return
        self._supported.add(place.point)
        half, below = 0.9 * self.size, -1.1 * self.size
        feet = np.linspace(-1.0, 1.2, 5) * half
        hatch = [np.array([(x, below), (x - 0.4 * half, below - 0.4 * half)]) for x in feet]
        base = np.array([(-1.2 * half, below), (1.2 * half, below)])
        cone = np.array([(-0.7 * half, below), (0.0, 0.0), (0.7 * half, below)])
        # It stays where a part is no longer active.
        self._add("ground", self.at(place), join_lines(cone, base, *hatch), part=place.body.name)

    def scene(self) -> Scene:
        """All that was collected."""
        poses = np.array(self._poses).reshape(-1, len(self.times), 3)
        return Scene(poses, tuple(self._glyphs), tuple(self._names), self.size)


def unit_vector(direction: Sequence[float] | Array) -> Array:
    """The direction in length one, downward where it has none."""
    length = math.hypot(*direction)
    return np.array(direction, float) / length if length > 0.0 else np.array([0.0, -1.0])


def rotate_points(points: Any, direction: Sequence[float] | Array) -> Array:
    """Points (k, 2) with the x axis in a direction."""
    c, s = unit_vector(direction)
    return np.asarray(points, float) @ np.array([(c, s), (-s, c)])


def circle(radius: float, corners: int = 16) -> Array:
    """A closed circle."""
    angle = np.linspace(0.0, 2.0 * math.pi, corners + 1)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def wheel(radius: float) -> Array:
    """A circle with a spoke, which shows how it turns."""
    return join_lines(circle(radius, 60), np.array([(0.0, 0.0), (radius, 0.0)]))


def box(width: float, height: float) -> Array:
    """A closed rectangle."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)], float)
    return 0.5 * corners * (width, height)


def hatched_line(low: float, high: float, size: float) -> Array:
    """A line along the x axis with hatches below it."""
    feet = np.linspace(low, high, max(round((high - low) / (0.6 * size)), 2) + 1)[1:]
    hatch = [np.array([(x, 0.0), (x - 0.4 * size, -0.4 * size)]) for x in feet]
    return join_lines(np.array([(low, 0.0), (high, 0.0)]), *hatch)
