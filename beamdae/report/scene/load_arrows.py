"""Arrows of loads: in animations, their lengths are proportional to the loads.

Lengths are relative to the symbol size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from beamdae.report.scene.joint_symbols import draw_markers
from beamdae.report.scene.scene_builder import SceneBuilder
from beamdae.report.scene.shapes import arrow_head

if TYPE_CHECKING:
    from beamdae.beams.beam_loads import DistributedForce, MovingForce
    from beamdae.parts.forces.force_law import ForceLaw
    from beamdae.parts.forces.loads import Force, Moment
    from beamdae.parts.laws import Law

Array = np.ndarray

# Length of the arrow of the largest force.
_FORCE_LENGTH = 4.0
# Loads below this fraction of the maximum load of the part are not drawn.
_MIN_VISIBLE_LOAD = 0.02
_DISTRIBUTED_ARROWS = 9  # number of arrows of a distributed load
_AXIS_SECTIONS = 101  # sections between which the position of a moving load is interpolated
_MOMENT_ANGLE = 1.3 * math.pi  # angle of the arrow of the largest moment [rad]
_MOMENT_RADIUS = 1.6
# Times at which a drawing evaluates loads that are zero at t = 0 [s].
_LATER_TIMES = (1e-3, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)


def draw_force(part: Force, builder: SceneBuilder) -> int:
    """Draw an arrow that ends at the point of application."""
    row = builder.add_attachment(part.on)
    load = _evaluate_laws(part.laws, builder)
    _draw_force_arrow(builder, row, _rotate(load, builder, row) if part.axes == "body" else load)
    return row


def _rotate(load: Array, builder: SceneBuilder, row: int, inclination: float = 0.0) -> Array:
    """Rotate components (frames, 2) from the axes of a pose to the inertial axes.

    `inclination` is the angle of the axes in the reference configuration [rad].
    """
    angle = builder.pose(row)[:, 2] + inclination
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * load[:, 0] - s * load[:, 1], s * load[:, 0] + c * load[:, 1]], axis=-1)


def draw_moment(part: Moment, builder: SceneBuilder) -> int:
    """Draw an arc-shaped arrow around each point of application."""
    rows = [builder.add_attachment(attachment) for attachment in part.attachments]
    moment = _evaluate_laws(part.laws, builder)
    for row, sign in zip(rows, (1.0, -1.0), strict=False):
        _draw_moment_arrow(builder, row, sign * moment)
    return rows[0]


def draw_force_law(part: ForceLaw, builder: SceneBuilder) -> int | None:
    """Draw arrows in animations and markers in drawings, where the load cannot be evaluated."""
    if builder.measure is None:
        return draw_markers(part, builder)
    rows = [builder.add_attachment(attachment) for attachment in part.on]
    loads = builder.measure(part.load).reshape(len(builder.times), -1, 3)
    for k, row in enumerate(rows):
        _draw_force_arrow(builder, row, loads[:, k, :2])
        _draw_moment_arrow(builder, row, loads[:, k, 2:])
    return rows[0]


def draw_distributed_force(part: DistributedForce, builder: SceneBuilder) -> int:
    """Draw arrows and a line through their tails; only heads if the load varies with s."""
    sections = [part.beam.at(s) for s in np.linspace(0.0, part.beam.length, _DISTRIBUTED_ARROWS)]
    rows = [builder.add_attachment(section) for section in sections]
    if not part.laws:
        # If the load depends on the section, it has no common direction; only heads are drawn.
        for row in rows:
            builder.add_rigid("load", row, arrow_head())
        return rows[_DISTRIBUTED_ARROWS // 2]
    load, turns = _evaluate_laws(part.laws, builder), part.axes == "section"
    tails = []
    for row, x in zip(rows, sections, strict=True):
        here = _rotate(load, builder, row, x.inclination) if turns else load
        tails.append(_draw_force_arrow(builder, row, here, 0.5 * _FORCE_LENGTH))
    builder.add_curve("load", np.stack([builder.pose(x)[:, :2] for x in tails], axis=1))
    return tails[_DISTRIBUTED_ARROWS // 2]


def draw_moving_force(part: MovingForce, builder: SceneBuilder) -> int:
    """Draw an arrow that ends on the beam axis at the current position of the force."""
    beam = part.beam
    sections = np.linspace(0.0, beam.length, _AXIS_SECTIONS)
    axis = builder.positions([beam.at(s) for s in sections])
    s = part.start + part.speed * builder.times
    pose = np.zeros((len(s), 3))
    for k in range(2):
        pose[:, k] = [np.interp(x, sections, y) for x, y in zip(s, axis[..., k], strict=True)]
    # A drawing shows the force even if it is off the beam.
    off_beam = (s < 0.0) | (s > beam.length)
    load = np.where(off_beam[:, None] & (len(s) > 1), 0.0, np.array(part.force))
    return _draw_force_arrow(builder, builder.add_pose(pose), load)


def _draw_force_arrow(
    builder: SceneBuilder, row: int, load: Array, length: float = _FORCE_LENGTH
) -> int:
    """Draw the arrow of a force (frames, 2), which ends at the pose with index `row`.

    Return the index of the pose at the tail of the arrow.
    """
    tail = builder.pose(row).copy()
    tail[:, :2] -= length * builder.size * _relative_to_largest(load)
    tail[:, 2] = np.arctan2(load[:, 1], load[:, 0])
    start = builder.add_pose(tail)
    builder.add_link("load", start, row)
    builder.add_stretched("load tip", start, row, np.column_stack([np.ones(4), arrow_head()]))
    return start


def _draw_moment_arrow(builder: SceneBuilder, row: int, moment: Array) -> None:
    """Draw the arrow of a moment (frames, 1) around a pose, counter-clockwise if positive."""
    share = _relative_to_largest(moment)[:, 0]
    if not np.any(np.isfinite(share)):
        return
    ends = np.tile(builder.pose(row), (2, 1, 1))
    ends[0, :, 2] = -0.25 * math.pi
    ends[1, :, 2] = ends[0, :, 2] + _MOMENT_ANGLE * share
    angle, head = ends[1, :, 2], ends[1].copy()
    arm = np.column_stack([np.cos(angle), np.sin(angle)])
    head[:, :2] += _MOMENT_RADIUS * builder.size * arm
    head[:, 2] = angle + np.sign(share) * 0.5 * math.pi
    first, last = map(builder.add_pose, ends)
    arc = [(x, _MOMENT_RADIUS, 0.0) for x in np.linspace(0.0, 0.95, 24)]
    builder.add_between("load", first, last, arc)
    builder.add_rigid("load tip", builder.add_pose(head), np.add(arrow_head(), (0.2, 0.0)))


def _relative_to_largest(load: Array) -> Array:
    """Divide loads (frames, k) by the largest magnitude; negligible loads become nan."""
    size = np.linalg.norm(load, axis=1)
    largest = float(np.max(size[np.isfinite(size)], initial=0.0))
    visible = size > _MIN_VISIBLE_LOAD * largest
    shares = np.full(load.shape, math.nan)
    shares[visible] = load[visible] / largest
    return shares


def _evaluate_laws(laws: Sequence[Law], builder: SceneBuilder) -> Array:
    """Return the values (frames, laws) of laws in all frames.

    In a drawing, which has a single frame, the laws are evaluated at the first of several times at
    which at least one law is not zero; if there is no such time, a unit load is returned.
    """
    is_drawing = len(builder.times) == 1
    times = (0.0, *_LATER_TIMES) if is_drawing else builder.times
    values = np.array([[law.at(t) for law in laws] for t in times])
    if not is_drawing:
        return values
    # Loads that are zero at all these times are drawn as unit loads, forces pointing downward.
    unit = np.array([[1.0] if len(laws) == 1 else [0.0, -1.0]])
    return np.concatenate([values[values.any(axis=1)], unit])[:1]
