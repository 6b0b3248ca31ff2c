"""Arrows of loads: in animations, their lengths are proportional to the loads.

The length constants are relative to the symbol size.
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


def draw_force(part: Force, builder: SceneBuilder) -> None:
    """Draw an arrow that ends at the point of application."""
    row = builder.add_attachment(part.on)
    load = _evaluate_laws(part.laws, builder)
    if part.axes == "body":
        load = _rotate_to_inertial(load, row, builder)
    _draw_force_arrow(builder, row, load)
    builder.add_name(row)


def _rotate_to_inertial(
    load: Array, row: int, builder: SceneBuilder, inclination: float = 0.0
) -> Array:
    """Rotate components (frames, 2) from the axes of a pose to the inertial axes.

    `inclination` is the angle of the axes in the reference configuration [rad].
    """
    angle = builder.pose(row)[:, 2] + inclination
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * load[:, 0] - s * load[:, 1], s * load[:, 0] + c * load[:, 1]], axis=-1)


def draw_moment(part: Moment, builder: SceneBuilder) -> None:
    """Draw an arc-shaped arrow around each point of application."""
    rows = [builder.add_attachment(attachment) for attachment in part.attachments]
    moment = _evaluate_laws(part.laws, builder)[:, 0]
    for row, sign in zip(rows, (1.0, -1.0), strict=False):
        _draw_moment_arrow(builder, row, sign * moment)
    builder.add_name(rows[0])


def draw_force_law(part: ForceLaw, builder: SceneBuilder) -> None:
    """Draw arrows in animations and markers in drawings, where the load cannot be evaluated."""
    rows = [builder.add_attachment(attachment) for attachment in part.on]
    if builder.measure is None:
        draw_markers(part, builder)
        return
    loads = builder.measure(part.load).reshape(len(builder.times), -1, 3)
    for k, row in enumerate(rows):
        _draw_force_arrow(builder, row, loads[:, k, :2])
        _draw_moment_arrow(builder, row, loads[:, k, 2])
    builder.add_name(rows[0])


def draw_distributed_force(part: DistributedForce, builder: SceneBuilder) -> None:
    """Draw arrows and a line through their tails; only heads if the load varies with s."""
    sections = [part.beam.at(s) for s in np.linspace(0.0, part.beam.length, _DISTRIBUTED_ARROWS)]
    rows = [builder.add_attachment(section) for section in sections]
    middle = _DISTRIBUTED_ARROWS // 2
    if not part.laws:
        # If the load depends on the section, it has no common direction; only heads are drawn.
        for row in rows:
            builder.add_rigid("load", row, arrow_head(builder.size))
        builder.add_name(rows[middle])
        return
    load = _evaluate_laws(part.laws, builder)
    tails = []
    for row, section in zip(rows, sections, strict=True):
        rotated = _rotate_to_inertial(load, row, builder, section.inclination)
        arrow_load = rotated if part.axes == "section" else load
        tails.append(_draw_force_arrow(builder, row, arrow_load, 0.5))
    tail_positions = np.stack([builder.pose(tail)[:, :2] for tail in tails], axis=1)
    builder.add_curve("load", tail_positions)
    builder.add_name(tails[middle])


def draw_moving_force(part: MovingForce, builder: SceneBuilder) -> None:
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
    builder.add_name(_draw_force_arrow(builder, builder.add_pose(pose), load))


def _draw_force_arrow(builder: SceneBuilder, row: int, load: Array, length: float = 1.0) -> int:
    """Draw the arrow of a force (frames, 2), which ends at the pose with index `row`.

    Return the index of the pose at the tail of the arrow.
    """
    tail = builder.pose(row).copy()
    tail[:, :2] -= length * _FORCE_LENGTH * builder.size * _relative_to_largest(load)
    tail[:, 2] = np.arctan2(load[:, 1], load[:, 0])
    start = builder.add_pose(tail)
    builder.add_link("load", start, row)
    head = np.column_stack([np.ones(4), arrow_head(builder.size)])
    builder.add_stretched("load tip", start, row, head)
    return start


def _draw_moment_arrow(builder: SceneBuilder, row: int, moment: Array) -> None:
    """Draw the arrow of a moment (frames,) around a pose, counter-clockwise if positive."""
    share = _relative_to_largest(moment[:, None])[:, 0]
    if not np.any(np.isfinite(share)):
        return
    start_angle, angle = -0.25 * math.pi, _MOMENT_ANGLE * share
    radius = _MOMENT_RADIUS * builder.size
    ends = np.tile(builder.pose(row), (2, 1, 1))
    ends[0, :, 2], ends[1, :, 2] = start_angle, start_angle + angle
    head = ends[1].copy()
    head[:, :2] += radius * np.column_stack([np.cos(ends[1, :, 2]), np.sin(ends[1, :, 2])])
    head[:, 2] = ends[1, :, 2] + np.sign(angle) * 0.5 * math.pi
    first, last = map(builder.add_pose, ends)
    arc = [(x, radius, 0.0) for x in np.linspace(0.0, 0.95, 24)]
    builder.add_between("load", first, last, np.array(arc))
    tip = np.add(arrow_head(builder.size), (0.2 * builder.size, 0.0))
    builder.add_rigid("load tip", builder.add_pose(head), tip)


def _relative_to_largest(load: Array) -> Array:
    """Divide loads (frames, k) by the largest magnitude; negligible loads become nan."""
    size = np.hypot(*load.T) if load.shape[1] == 2 else np.abs(load[:, 0])
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
    if len(builder.times) > 1:
        return np.array([[law.at(t) for law in laws] for t in builder.times])
    for t in (0.0, *_LATER_TIMES):
        values = [law.at(t) for law in laws]
        if any(values):
            return np.array([values])
    # Loads that are zero at all these times are drawn as unit loads, forces pointing downward.
    return np.array([[1.0] if len(laws) == 1 else [0.0, -1.0]])
