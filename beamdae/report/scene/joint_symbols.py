"""The symbols joints have; those of springs and contacts are in `elastic`, of loads in `loads`."""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

import numpy as np

from beamdae.beams.sliding import SlidingOnBeam
from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.rigid_body import Ground, RigidBody
from beamdae.parts.joints.distance import Distance
from beamdae.parts.joints.drivers import Driver, TranslationalDriver
from beamdae.parts.joints.gears import Gear, RackAndPinion
from beamdae.parts.joints.guides import PointOnLine, Prismatic
from beamdae.parts.joints.joint import Joint, Revolute, Weld
from beamdae.parts.joints.rolling import RollingOnCircle, RollingOnLine
from beamdae.parts.joints.skate import Skate
from beamdae.parts.part import Part
from beamdae.report.scene.scene_builder import (
    SceneBuilder,
    box,
    circle,
    hatched_line,
    join_lines,
    rotate_points,
    unit_vector,
    wheel,
)

Array = np.ndarray

# Of the size of a symbol: radius of a pin, half of a slot, how far a guide goes on.
_PIN, _SLOT, _BEYOND = 0.26, 0.36, 3.0
# Sections of a beam the nearest one to a slider is looked for among.
_NEAREST = 201


@singledispatch
def symbol(part: Part, sketch: SceneBuilder) -> None:
    """Sketch what is no body: by default a diamond where it is attached, with its name."""
    rows = [sketch.at(attachment) for attachment in part.attachments]
    for row in rows:
        sketch.carried("load" if part.is_load else "joint", row, circle(0.3 * sketch.size, 4))
    if rows:
        sketch.name(rows[0])


def grounded(part: Any, sketch: SceneBuilder) -> None:
    """The ground under its points, as far as they are of the ground."""
    for attachment in part.attachments:
        sketch.support(attachment)


def _pin(sketch: SceneBuilder, row: int) -> None:
    sketch.carried("joint", row, circle(_PIN * sketch.size))


@symbol.register
def _joint(part: Joint, sketch: SceneBuilder) -> None:
    grounded(part, sketch)
    row = sketch.at(part.b)
    sketch.carried("joint", row, circle(0.3 * sketch.size, 4))
    sketch.name(row)


@symbol.register
def _revolute(part: Revolute, sketch: SceneBuilder) -> None:
    grounded(part, sketch)
    row = sketch.at(part.b)
    _pin(sketch, row)
    sketch.name(row)


@symbol.register
def _weld(part: Weld, sketch: SceneBuilder) -> None:
    row = sketch.at(part.b)
    for fixed, held in ((part.a, part.b), (part.b, part.a)):
        if isinstance(fixed.body, Ground):
            _clamp(fixed, held, sketch)
    sketch.carried("weld", row, box(0.45 * sketch.size, 0.45 * sketch.size))
    sketch.name(row)


def _clamp(fixed: Attachment, held: Attachment, sketch: SceneBuilder) -> None:
    """A wall across the end of a beam; the ground under anything else."""
    length = getattr(held.body, "length", None)
    if held.s is None or length is None or 1e-6 < held.s / length < 1.0 - 1e-6:
        sketch.support(fixed)
        return
    side = 1.0 if held.s < 0.5 * length else -1.0
    along = side * np.array([math.cos(held.inclination), math.sin(held.inclination)])
    wall = rotate_points(
        hatched_line(-1.3 * sketch.size, 1.3 * sketch.size, sketch.size), _left(-along)
    )
    sketch.carried("ground", sketch.at(fixed), wall)


def _left(direction: Array) -> Array:
    return np.array([-direction[1], direction[0]])


@symbol.register
def _on_line(part: PointOnLine, sketch: SceneBuilder) -> None:
    _slot(part, sketch, 0.0)
    row = sketch.at(part.b)
    _pin(sketch, row)
    sketch.name(row)


@symbol.register
def _prismatic(part: Prismatic, sketch: SceneBuilder) -> None:
    a, b = np.array(part.a.point), np.array(part.b.point)
    _slot(part, sketch, float(_left(unit_vector(part.direction)) @ (b - a)))
    row = sketch.at(part.b)
    block = rotate_points(box(1.5 * sketch.size, 2.0 * _SLOT * sketch.size), part.direction)
    sketch.carried("joint", row, block)
    sketch.name(row)


def _slot(part: Any, sketch: SceneBuilder, offset: float) -> None:
    """Two walls as long as the way that is gone between them; hatched on the ground."""
    low, high = travel(part.a, part.b, part.direction, sketch)
    half = _SLOT * sketch.size
    walls = [np.array([(low, offset + half), (high, offset + half)])]
    if isinstance(part.a.body, Ground):
        walls.append(np.add(hatched_line(low, high, sketch.size), (0.0, offset - half)))
    else:
        walls.append(np.subtract(walls[0], (0.0, 2.0 * half)))
    sketch.carried("guide", sketch.at(part.a), rotate_points(join_lines(*walls), part.direction))


def travel(
    a: Attachment, b: Attachment, direction: Any, sketch: SceneBuilder, more: float = 0.0
) -> tuple[float, float]:
    """From where to where one point goes along a direction of the other's body, and beyond."""
    x = sketch.way(sketch.at(a), sketch.at(b)) @ unit_vector(direction)
    beyond = _BEYOND * sketch.size + more
    return float(np.min(x)) - beyond, float(np.max(x)) + beyond


@symbol.register
def _driven_along(part: TranslationalDriver, sketch: SceneBuilder) -> None:
    a, b = sketch.at(part.a), sketch.at(part.b)
    pose = np.column_stack([sketch.pose(b)[:, :2], sketch.pose(a)[:, 2]])
    row, reach = sketch.follow(pose), 2.5 * sketch.size
    shaft = np.array([(0.0, 0.0), (0.8 * reach, 0.0)])
    sketch.carried("driver", row, rotate_points(shaft, part.direction))
    sketch.carried(
        "driver tip", row, rotate_points(np.add(tip(sketch.size), (reach, 0.0)), part.direction)
    )
    sketch.name(b)


def tip(size: float) -> Array:
    """The head of an arrow that ends at the origin."""
    return 0.5 * size * np.array([(-1.0, -0.4), (0.0, 0.0), (-1.0, 0.4), (-1.0, -0.4)])


@symbol.register
def _distance(part: Distance, sketch: SceneBuilder) -> None:
    grounded(part, sketch)
    a, b = sketch.at(part.a), sketch.at(part.b)
    sketch.link("link", a, b)
    _pin(sketch, a)
    _pin(sketch, b)
    sketch.name(middle(a, b, sketch))


def middle(a: int, b: int, sketch: SceneBuilder) -> int:
    """The pose halfway between two."""
    return sketch.follow(0.5 * (sketch.pose(a) + sketch.pose(b)))


@symbol.register
def _driver(part: Driver, sketch: SceneBuilder) -> None:
    grounded(part, sketch)
    row = sketch.at(part.b)
    angle = np.linspace(-0.25 * math.pi, 1.05 * math.pi, 24)
    arc = 1.2 * sketch.size * np.column_stack([np.cos(angle), np.sin(angle)])
    sketch.carried("driver", row, arc)
    end = (
        rotate_points(np.add(tip(sketch.size), (0.25 * sketch.size, 0.0)), _left(arc[-1])) + arc[-1]
    )
    sketch.carried("driver tip", row, end)
    sketch.name(row)


@symbol.register
def _gear(part: Gear, sketch: SceneBuilder) -> None:
    a, b = sketch.at(part.a), sketch.at(part.b)
    sketch.link("gear", a, b)
    distance = math.dist(part.a.point, part.b.point)
    share = abs(1.0 - part.ratio)
    # Where the points are the centers of wheels that mesh, their pitch circles are known.
    if _centered(part.a) and _centered(part.b) and distance > 0.0 < share:
        radii = distance * abs(part.ratio) / share, distance / share
        for row, place, radius in zip((a, b), (part.a, part.b), radii, strict=True):
            if not getattr(place.body, "shape", ()):
                sketch.carried("gear", row, wheel(radius))
    sketch.name(middle(a, b, sketch))


def _centered(place: Attachment) -> bool:
    body = place.body
    return isinstance(body, Ground) or (
        isinstance(body, RigidBody) and bool(np.allclose(body.center, place.point))
    )


@symbol.register
def _rack(part: RackAndPinion, sketch: SceneBuilder) -> None:
    a, b = sketch.at(part.a), sketch.at(part.b)
    sketch.carried("wheel", a, wheel(abs(part.radius)))
    e = unit_vector(part.direction)
    # The rack passes the pinion on its left.
    touch = np.subtract(part.a.point, part.b.point) - part.radius * _left(e)
    low, high = travel(part.b, part.a, part.direction, sketch, abs(part.radius))
    line = rotate_points([(low, 0.0), (high, 0.0)], e) + (touch - (touch @ e) * e)
    sketch.carried("guide", b, line)
    sketch.name(a)


@symbol.register
def _rolling(part: RollingOnLine, sketch: SceneBuilder) -> None:
    low, high = travel(part.a, part.b, part.direction, sketch, part.radius)
    side = np.subtract(part.b.point, part.a.point) @ _left(unit_vector(part.direction))
    line = hatched_line(low, high, sketch.size) * (1.0, 1.0 if side > 0.0 else -1.0)
    sketch.carried("surface", sketch.at(part.a), rotate_points(line, part.direction))
    _wheel(part.b, part.radius, sketch)


@symbol.register
def _rolling_on_circle(part: RollingOnCircle, sketch: SceneBuilder) -> None:
    turns = not isinstance(part.a.body, Ground)
    track = wheel(part.radii[0]) if turns else circle(part.radii[0], 60)
    sketch.carried("wheel" if turns else "surface", sketch.at(part.a), track)
    _wheel(part.b, part.radii[1], sketch)


def _wheel(center: Attachment, radius: float, sketch: SceneBuilder) -> None:
    row = sketch.at(center)
    sketch.carried("wheel", row, wheel(radius))
    sketch.name(row)


@symbol.register
def _skate(part: Skate, sketch: SceneBuilder) -> None:
    row, reach = sketch.at(part.on), sketch.size
    sketch.carried("skate", row, rotate_points([(-reach, 0.0), (reach, 0.0)], part.direction))
    sketch.name(row)


@symbol.register
def _sliding(part: SlidingOnBeam, sketch: SceneBuilder) -> None:
    """A sleeve along the beam, where the point is nearest to it."""
    row, beam = sketch.at(part.a), part.beam
    sections = [beam.at(s) for s in np.linspace(0.0, beam.length, _NEAREST)]
    axis, place = sketch.through(sections), sketch.pose(row)[:, :2]
    nearest = np.argmin(np.sum((axis - place[:, None]) ** 2, axis=-1), axis=1)
    first = np.clip(nearest - 1, 0, _NEAREST - 3)
    frames = np.arange(len(axis))
    along = axis[frames, first + 2] - axis[frames, first]
    angle = np.arctan2(along[:, 1], along[:, 0])
    sleeve = sketch.follow(np.column_stack([place, angle]))
    sketch.carried("sleeve", sleeve, box(1.6 * sketch.size, 1.0 * sketch.size))
    sketch.name(row)
