"""Scene builder: collects poses, curves and symbols of the parts of a mechanism."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.rigid_body import Ground
from beamdae.report.scene.poses import Poses
from beamdae.report.scene.scene import Glyph, MovingCurve, Scene, Symbol
from beamdae.report.scene.shapes import join_lines
from beamdae.symbolic.statements import Quantity

Array = np.ndarray
# Returns the values (frames, columns) of a quantity in all frames.
Measure = Callable[[Quantity], Array]

# Dimensions of a ground support, relative to the symbol size.
_SUPPORT_DEPTH = 1.1
_SUPPORT_HALF_WIDTH = 0.9
_SUPPORT_HATCHES = 5


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
        self._add_symbol(kind, at, at, points, False, part)

    def add_between(self, kind: str, start: int, end: int, points: Any) -> None:
        """Add a `Symbol` with points (k, 3), whose axes rotate with the two poses."""
        self._add_symbol(kind, start, end, points, False)

    def add_stretched(self, kind: str, start: int, end: int, points: Any) -> None:
        """Add a `Symbol` with points (k, 3), whose first axis points from start to end."""
        self._add_symbol(kind, start, end, points, True)

    def add_link(self, kind: str, start: int, end: int) -> None:
        """Add a straight line between two poses."""
        self.add_stretched(kind, start, end, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])

    def _add_symbol(
        self, kind: str, start: int, end: int, points: Any, along: bool, part: str = ""
    ) -> None:
        scaled = np.asarray(points, float) * (1.0, self.size, self.size)
        self._glyphs.append(Symbol(part or self.part, kind, start, end, along, scaled))

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

    def build(self, caption: str) -> Scene:
        """Return the scene with everything added so far."""
        poses = np.array(self._poses).reshape(-1, len(self.times), 3)
        names = tuple(self._names)
        return Scene(poses, tuple(self._glyphs), names, self.size, caption=caption)
