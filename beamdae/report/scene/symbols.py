"""Symbols of all parts but bodies, by name.

Each function adds the symbol of one part to a `SceneBuilder` and returns the pose at which the name
of the part is shown. Lengths are relative to the symbol size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import require_choice
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
    from beamdae.beams.beam_loads import DistributedForce, MovingForce
    from beamdae.beams.sliding import SlidingOnBeam
    from beamdae.parts.forces.contact import Contact
    from beamdae.parts.forces.force_law import ForceLaw
    from beamdae.parts.forces.loads import Force, Moment
    from beamdae.parts.forces.springs import Bushing, Spring, TorsionSpring
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
    from beamdae.parts.laws import Law


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
    a, b = map(builder.add_attachment, (part.a, part.b))
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
    a, b = map(builder.add_attachment, (part.a, part.b))
    builder.add_link("link", a, b)
    return builder.add_midpoint(_draw_pin(builder, a), _draw_pin(builder, b))


def draw_driver(part: Driver, builder: SceneBuilder) -> int:
    """Draw an arc-shaped arrow around the second attachment."""
    row = builder.add_attachment(part.b)
    arc = circle(_DRIVER_RADIUS, 23, -0.25 * math.pi, 1.05 * math.pi)
    builder.add_rigid("driver", row, arc)
    tip = align_points(np.add(arrow_head(), (0.25, 0.0)), rotate_left(arc[-1]))
    builder.add_rigid("driver tip", row, tip + arc[-1])
    return row


def draw_gear(part: Gear, builder: SceneBuilder) -> int:
    """Draw a line between the points and, for meshing wheels without a shape, the pitch circles."""
    a, b = map(builder.add_attachment, (part.a, part.b))
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


Array = np.ndarray

_COIL_COUNT = 6
_COIL_HALF_WIDTH = 0.45
_DASHPOT_HALF_WIDTH = 0.42
# Distance of coil and dashpot from the line between the points if they are drawn side by side.
_SIDE_BY_SIDE_OFFSET = 0.55
_STUB = 0.12  # at both ends of elements side by side, relative to the distance of the points
# A spring is drawn as a spiral if the distance of its points never exceeds this.
_COINCIDENT_DISTANCE = 0.1
_SPIRAL_WINDINGS = 2.25
_SPIRAL_POINTS = 90
# Rotary dampers: an open drum with a vane.
_DRUM_RADIUS = 0.85
_DRUM_HALF_OPENING = math.pi / 6.0
_VANE_HALF_LENGTH = 0.6
_BUSHING_RADIUS = 0.85
_BUSHING_PIN_RADIUS = 0.3
_CONTACT_RADIUS = 0.2
_SURFACE_HATCHES = 36
_SURFACE_CORNERS = 90
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

# Symbols with a support at each point of the ground.
_SUPPORTED = ("joint", "hinge", "link", "driver", "spring-damper", "torsion spring", "bushing")


def draw_spring_damper(part: Spring, builder: SceneBuilder) -> int:
    """Draw a coil, a dashpot or both side by side, or a spiral if the points stay close."""
    a, b = map(builder.add_attachment, (part.a, part.b))
    longest = np.max(np.hypot(*builder.relative_position(a, b).T))
    has_damper = part.damping > 0.0
    if longest < _COINCIDENT_DISTANCE * builder.size:
        builder.add_between("spring", a, b, _spiral())
    elif has_damper and part.stiffness > 0.0:
        side = _SIDE_BY_SIDE_OFFSET
        builder.add_between("spring", a, b, _coil(_STUB, side), along=True)
        builder.add_between("damper", a, b, _dashpot(_STUB, -side), along=True)
        ends = ((0.0, _STUB), (1.0, 1.0 - _STUB))
        bars = [[(x, 0.0, -side), (x, 0.0, side)] for _, x in ends]
        stubs = [[(end, 0.0, 0.0), (x, 0.0, 0.0)] for end, x in ends]
        builder.add_between("spring", a, b, join_lines(*map(np.array, (*bars, *stubs))), along=True)
    elif has_damper:
        builder.add_between("damper", a, b, _dashpot(), along=True)
    else:
        builder.add_between("spring", a, b, _coil(), along=True)
    return builder.add_midpoint(a, b)


def _coil(end: float = 0.0, side: float = 0.0) -> Array:
    """Return the points of a zigzag line between two stubs, see `Symbol.points`."""
    share = np.linspace(0.2, 0.8, 4 * _COIL_COUNT + 1)[1::2]
    along = np.array([0.0, 0.2, *share, 0.8, 1.0])
    across = [0.0, 0.0, *(_COIL_HALF_WIDTH * (-1.0) ** np.arange(len(share))), 0.0, 0.0]
    share = end + (1.0 - 2.0 * end) * along
    return np.column_stack([share, np.zeros(len(share)), side + np.array(across)])


def _dashpot(end: float = 0.0, side: float = 0.0) -> Array:
    """Return the points of a cup with a piston inside, see `Symbol.points`."""
    half, bottom, piston, mouth = _DASHPOT_HALF_WIDTH, 0.3, 0.5, 0.7
    lines = [
        [(end, 0.0), (bottom, 0.0)],
        [(mouth, half), (bottom, half), (bottom, -half), (mouth, -half)],
        [(piston, -0.75 * half), (piston, 0.75 * half)],
        [(piston, 0.0), (1.0 - end, 0.0)],
    ]
    return join_lines(*(np.array([(x, 0.0, side + y) for x, y in line]) for line in lines))


def _spiral() -> Array:
    """Return the points of a spiral that winds up as its end poses rotate, see `Symbol.points`."""
    share = np.linspace(0.0, 1.0, _SPIRAL_POINTS)
    angle = 2.0 * math.pi * _SPIRAL_WINDINGS * (1.0 - share)
    radius = 1.3 - 1.05 * share
    return np.column_stack([share, radius * np.cos(angle), radius * np.sin(angle)])


def draw_torsion_spring(part: TorsionSpring, builder: SceneBuilder) -> int:
    """Draw a spiral, or a drum with a vane for a damper, and a line between distant points."""
    a, b = map(builder.add_attachment, (part.a, part.b))
    # The moment depends only on the angles of the bodies; the part is drawn at the first point.
    inner = builder.add_pose(np.column_stack([builder.pose(a)[:, :2], builder.pose(b)[:, 2]]))
    if part.damping > 0.0 and part.stiffness == 0.0:
        opening = _DRUM_HALF_OPENING
        drum = circle(_DRUM_RADIUS, _SPIRAL_POINTS, opening, 2.0 * math.pi - opening)
        builder.add_rigid("damper", a, drum)
        builder.add_rigid("damper", inner, [(0.0, -_VANE_HALF_LENGTH), (0.0, _VANE_HALF_LENGTH)])
    else:
        builder.add_between("spring", a, inner, _spiral())
    if np.max(np.hypot(*builder.relative_position(a, b).T)) > builder.size:
        builder.add_link("link", a, b)
    return a


def draw_bushing(part: Bushing, builder: SceneBuilder) -> int:
    """Draw a ring on the first body and a pin on the second body, connected by four spokes."""
    a, b = map(builder.add_attachment, (part.a, part.b))
    center = np.subtract(part.b.point, part.a.point) / builder.size
    builder.add_rigid("spring", a, circle(_BUSHING_RADIUS, 40) + center)
    for direction in circle(1.0, 4)[:4] @ [(0.5**0.5, 0.5**0.5), (-(0.5**0.5), 0.5**0.5)]:
        outer, inner = center + _BUSHING_RADIUS * direction, _BUSHING_PIN_RADIUS * direction
        builder.add_between("spring", a, b, [(0.0, *outer), (1.0, *inner)])
    builder.add_rigid("weld", b, circle(_BUSHING_PIN_RADIUS))
    return b


def draw_contact(part: Contact, builder: SceneBuilder) -> int:
    """Draw the surface, with hatches on its inaccessible side, and the contact point."""
    from beamdae.parts.forces.contact import CircleSurface

    surface, point = part.surface, builder.add_attachment(part.point)
    if isinstance(surface, CircleSurface):
        radius = surface.radius / builder.size
        outward = circle(1.0, _SURFACE_HATCHES)[1:]
        inward = outward * (-1.0 if surface.side == "outside" else 1.0)
        feet, length = radius * outward, 0.4 * min(1.0, radius)
        ends = feet + length * (inward + np.column_stack([-inward[:, 1], inward[:, 0]]))
        hatches = np.stack([feet, ends], axis=1)
        line = join_lines(circle(radius, _SURFACE_CORNERS), *hatches)
    else:
        travel = find_travel(surface.on, part.point, surface.direction, builder)
        line = align_points(hatched_line(*travel), surface.direction)
    builder.add_rigid("surface", builder.add_attachment(surface.on), line)
    builder.add_rigid("contact", point, circle(_CONTACT_RADIUS))
    return point


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
    builder.add_between(
        "load tip", start, row, np.column_stack([np.ones(4), arrow_head()]), along=True
    )
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


# A function may use any field of the built-in parts with its symbol, such as `a` and `direction`.
_SYMBOLS: dict[str, Callable[[Any, SceneBuilder], int | None]] = {
    "marker": draw_markers,
    # Joints.
    "joint": draw_joint,
    "hinge": draw_revolute,
    "weld": draw_weld,
    "slot": draw_point_on_line,
    "slider": draw_prismatic,
    "link": draw_distance,
    "driver": draw_driver,
    "translational driver": draw_translational_driver,
    "gear": draw_gear,
    "rack and pinion": draw_rack_and_pinion,
    "rolling on line": draw_rolling_on_line,
    "rolling on circle": draw_rolling_on_circle,
    "skate": draw_skate,
    "sleeve": draw_sliding_on_beam,
    # Springs, dampers and contacts.
    "spring-damper": draw_spring_damper,
    "torsion spring": draw_torsion_spring,
    "bushing": draw_bushing,
    "contact": draw_contact,
    # Loads.
    "force": draw_force,
    "moment": draw_moment,
    "force law": draw_force_law,
    "distributed force": draw_distributed_force,
    "moving force": draw_moving_force,
}


def require_symbol(owner: str, name: object) -> str:
    """Return the name of a symbol; raise an error if there is none of this name."""
    return require_choice(owner, "symbol", name, tuple(_SYMBOLS))


def draw_symbol(part: Part, builder: SceneBuilder) -> None:
    """Add the symbol of a part.

    Raises
    ------
    BeamdaeError
        If the symbol of the part does not exist.
    """
    symbol = require_symbol(part.name, part.symbol)
    if symbol in _SUPPORTED:
        for attachment in part.attachments:
            builder.add_support(attachment)
    row = _SYMBOLS[symbol](part, builder)
    if row is not None:
        builder.add_name(row)
