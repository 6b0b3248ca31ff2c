"""Symbols of joints, drivers, gears and rolling contacts.

Each function listed in `symbols.py` adds the symbol of one part to a `SceneBuilder` and returns the
pose at which the name of the part is shown. Lengths are relative to the symbol size.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.rigid_body import Ground, RigidBody
from beamdae.parts.part import Part
from beamdae.report.scene.scene import (
    SceneBuilder,
    align_points,
    arrow_head,
    box,
    circle,
    hatched_line,
    join_lines,
    rotate_left,
    unit_vector,
    wheel,
)

if TYPE_CHECKING:
    from beamdae.beams.sliding import SlidingOnBeam
    from beamdae.parts.joints.drivers import Distance, Driver, TranslationalDriver
    from beamdae.parts.joints.guides import PointOnLine, Prismatic
    from beamdae.parts.joints.joint import Joint, Revolute, Weld
    from beamdae.parts.joints.rolling import (
        Gear,
        RackAndPinion,
        RollingOnCircle,
        RollingOnLine,
        Skate,
    )

Array = np.ndarray

_PIN_RADIUS = 0.26
_MARKER_RADIUS = 0.3
_SLOT_HALF_WIDTH = 0.36
_GUIDE_OVERHANG = 3.0
_WALL_HALF_LENGTH = 1.3
_WELD_WIDTH = 0.45
_DRIVER_RADIUS = 1.2
_SHAFT_LENGTH = 2.5
_TRACK_CORNERS = 60
# Number of sections at which the distance of a beam from a slider is evaluated.
_SLIDER_SECTIONS = 201
# A weld closer than this to the end of a beam is drawn as a clamp, relative to its length.
_END_TOLERANCE = 1e-6


def draw_markers(part: Part, builder: SceneBuilder) -> int | None:
    """Draw a diamond at each attachment, the default symbol of a part."""
    rows = [builder.add_attachment(attachment) for attachment in part.attachments]
    for row in rows:
        builder.add_rigid("load" if part.is_load else "joint", row, circle(_MARKER_RADIUS, 4))
    return rows[0] if rows else None


def draw_joint(part: Joint, builder: SceneBuilder) -> int:
    """Draw a diamond at the second attachment, the default symbol of a joint."""
    row = builder.add_attachment(part.b)
    builder.add_rigid("joint", row, circle(_MARKER_RADIUS, 4))
    return row


def draw_revolute(part: Revolute, builder: SceneBuilder) -> int:
    """Draw a pin at the common point."""
    return _draw_pin(builder, builder.add_attachment(part.b))


def _draw_pin(builder: SceneBuilder, row: int) -> int:
    builder.add_rigid("joint", row, circle(_PIN_RADIUS))
    return row


def draw_weld(part: Weld, builder: SceneBuilder) -> int:
    """Draw a square and, for a weld to the ground, a wall across the beam end or a support."""
    row = builder.add_attachment(part.b)
    for fixed, clamped in ((part.a, part.b), (part.b, part.a)):
        if isinstance(fixed.body, Ground):
            _draw_clamp(fixed, clamped, builder)
    builder.add_rigid("weld", row, box(_WELD_WIDTH, _WELD_WIDTH))
    return row


def _draw_clamp(fixed: Attachment, clamped: Attachment, builder: SceneBuilder) -> None:
    """Draw a wall across a clamped beam end, or a support at any other welded point."""
    length, s = getattr(clamped.body, "length", None), clamped.s
    if s is None or length is None or _END_TOLERANCE < s / length < 1.0 - _END_TOLERANCE:
        builder.add_support(fixed)
        return
    side = 1.0 if s < 0.5 * length else -1.0
    along = side * np.array([math.cos(clamped.inclination), math.sin(clamped.inclination)])
    wall = hatched_line(-_WALL_HALF_LENGTH, _WALL_HALF_LENGTH)
    row = builder.add_attachment(fixed)
    builder.add_rigid("ground", row, align_points(wall, rotate_left(-along)))


def draw_point_on_line(part: PointOnLine, builder: SceneBuilder) -> int:
    """Draw a pin in a slot that covers the travel of the pin."""
    _draw_slot(part, builder, 0.0)
    return _draw_pin(builder, builder.add_attachment(part.b))


def draw_prismatic(part: Prismatic, builder: SceneBuilder) -> int:
    """Draw a block in a slot that covers the travel of the block."""
    offset = rotate_left(unit_vector(part.direction)) @ np.subtract(part.b.point, part.a.point)
    _draw_slot(part, builder, float(offset) / builder.size)
    row = builder.add_attachment(part.b)
    builder.add_rigid("joint", row, align_points(box(1.5, 2.0 * _SLOT_HALF_WIDTH), part.direction))
    return row


def _draw_slot(part: Any, builder: SceneBuilder, offset: float) -> None:
    """Draw two walls along the travel of a guided point; one is hatched if fixed to the ground."""
    low, high = find_travel(part.a, part.b, part.direction, builder)
    upper = np.array([(low, offset + _SLOT_HALF_WIDTH), (high, offset + _SLOT_HALF_WIDTH)])
    lower = upper - (0.0, 2.0 * _SLOT_HALF_WIDTH)
    if isinstance(part.a.body, Ground):
        lower = np.add(hatched_line(low, high), (0.0, offset - _SLOT_HALF_WIDTH))
    slot = align_points(join_lines(upper, lower), part.direction)
    builder.add_rigid("guide", builder.add_attachment(part.a), slot)


def find_travel(
    a: Attachment, b: Attachment, direction: Any, builder: SceneBuilder, margin: float = 0.0
) -> tuple[float, float]:
    """Return the lowest and highest position of `b` along `direction` in the axes of `a`.

    Both limits are extended by an overhang and by `margin` [m].
    """
    position = builder.relative_position(builder.add_attachment(a), builder.add_attachment(b))
    x = position @ unit_vector(direction) / builder.size
    overhang = _GUIDE_OVERHANG + margin / builder.size
    return float(np.min(x)) - overhang, float(np.max(x)) + overhang


def draw_translational_driver(part: TranslationalDriver, builder: SceneBuilder) -> int:
    """Draw an arrow in the direction of the driver."""
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    row = builder.add_pose(np.column_stack([builder.pose(b)[:, :2], builder.pose(a)[:, 2]]))
    shaft, tip = (
        [(0.0, 0.0), (0.8 * _SHAFT_LENGTH, 0.0)],
        np.add(arrow_head(), (_SHAFT_LENGTH, 0.0)),
    )
    builder.add_rigid("driver", row, align_points(shaft, part.direction))
    builder.add_rigid("driver tip", row, align_points(tip, part.direction))
    return b


def draw_distance(part: Distance, builder: SceneBuilder) -> int:
    """Draw a link between two pins."""
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    builder.add_link("link", a, b)
    return builder.add_midpoint(_draw_pin(builder, a), _draw_pin(builder, b))


def draw_driver(part: Driver, builder: SceneBuilder) -> int:
    """Draw an arc-shaped arrow around the second attachment."""
    row = builder.add_attachment(part.b)
    angle = np.linspace(-0.25 * math.pi, 1.05 * math.pi, 24)
    arc = _DRIVER_RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    builder.add_rigid("driver", row, arc)
    tip = align_points(np.add(arrow_head(), (0.25, 0.0)), rotate_left(arc[-1]))
    builder.add_rigid("driver tip", row, tip + arc[-1])
    return row


def draw_gear(part: Gear, builder: SceneBuilder) -> int:
    """Draw a line between the points and, for meshing wheels without a shape, the pitch circles."""
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    builder.add_link("gear", a, b)
    distance = math.dist(part.a.point, part.b.point)
    share = abs(1.0 - part.ratio)
    # The pitch radii are known only if the points are the centers of two meshing wheels.
    if _is_center(part.a) and _is_center(part.b) and distance > 0.0 < share:
        radii = distance * abs(part.ratio) / share, distance / share
        for row, attachment, radius in zip((a, b), (part.a, part.b), radii, strict=True):
            if not getattr(attachment.body, "shape", ()):
                builder.add_rigid("gear", row, wheel(radius / builder.size))
    return builder.add_midpoint(a, b)


def _is_center(attachment: Attachment) -> bool:
    body = attachment.body
    return isinstance(body, Ground) or (
        isinstance(body, RigidBody) and bool(np.allclose(body.center, attachment.point))
    )


def draw_rack_and_pinion(part: RackAndPinion, builder: SceneBuilder) -> int:
    """Draw the pinion as a wheel and the rack as a line."""
    b, direction = builder.add_attachment(part.b), unit_vector(part.direction)
    # Seen along its direction, the rack is on the right of the pinion if the radius is positive.
    touch = np.subtract(part.a.point, part.b.point) - part.radius * rotate_left(direction)
    touch = (touch - (touch @ direction) * direction) / builder.size
    low, high = find_travel(part.b, part.a, part.direction, builder, abs(part.radius))
    builder.add_rigid("guide", b, align_points([(low, 0.0), (high, 0.0)], direction) + touch)
    return _draw_wheel(part.a, abs(part.radius), builder)


def draw_rolling_on_line(part: RollingOnLine, builder: SceneBuilder) -> int:
    """Draw a wheel on a hatched line that covers the travel of the wheel."""
    line = hatched_line(*find_travel(part.a, part.b, part.direction, builder, part.radius))
    side = np.subtract(part.b.point, part.a.point) @ rotate_left(unit_vector(part.direction))
    line = align_points(line * (1.0, 1.0 if side > 0.0 else -1.0), part.direction)
    builder.add_rigid("surface", builder.add_attachment(part.a), line)
    return _draw_wheel(part.b, part.radius, builder)


def draw_rolling_on_circle(part: RollingOnCircle, builder: SceneBuilder) -> int:
    """Draw a wheel on a circular track, with a spoke in the track if the track can rotate."""
    can_rotate, radius = not isinstance(part.a.body, Ground), part.radii[0] / builder.size
    track = wheel(radius) if can_rotate else circle(radius, _TRACK_CORNERS)
    builder.add_rigid("wheel" if can_rotate else "surface", builder.add_attachment(part.a), track)
    return _draw_wheel(part.b, part.radii[1], builder)


def _draw_wheel(center: Attachment, radius: float, builder: SceneBuilder) -> int:
    row = builder.add_attachment(center)
    builder.add_rigid("wheel", row, wheel(radius / builder.size))
    return row


def draw_skate(part: Skate, builder: SceneBuilder) -> int:
    """Draw the blade of the skate as a line in its direction."""
    row = builder.add_attachment(part.on)
    builder.add_rigid("skate", row, align_points([(-1.0, 0.0), (1.0, 0.0)], part.direction))
    return row


def draw_sliding_on_beam(part: SlidingOnBeam, builder: SceneBuilder) -> int:
    """Draw a sleeve at the sliding point, parallel to the beam axis at the nearest section."""
    row, beam = builder.add_attachment(part.a), part.beam
    sections = [beam.at(s) for s in np.linspace(0.0, beam.length, _SLIDER_SECTIONS)]
    axis, position = builder.positions(sections), builder.pose(row)[:, :2]
    nearest = np.argmin(np.sum((axis - position[:, None]) ** 2, axis=-1), axis=1)
    first = np.clip(nearest - 1, 0, _SLIDER_SECTIONS - 3)
    frames = np.arange(len(axis))
    along = axis[frames, first + 2] - axis[frames, first]
    angle = np.arctan2(along[:, 1], along[:, 0])
    sleeve = builder.add_pose(np.column_stack([position, angle]))
    builder.add_rigid("sleeve", sleeve, box(1.6, 1.0))
    return row
