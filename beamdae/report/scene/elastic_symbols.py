"""Symbols of springs, dampers, bushings and contacts.

Lengths are relative to the symbol size. Classes of parts are imported in the functions that draw
them: mechanisms without these parts are drawn faster.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from beamdae.report.scene.joint_symbols import find_travel
from beamdae.report.scene.scene_builder import SceneBuilder
from beamdae.report.scene.shapes import align_points, circle, hatched_line, join_lines

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact
    from beamdae.parts.forces.springs import Bushing, Spring, TorsionSpring
    from beamdae.parts.forces.surfaces import CircleSurface

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


def draw_spring_damper(part: Spring, builder: SceneBuilder) -> int:
    """Draw a coil, a dashpot or both side by side, or a spiral if the points stay close."""
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    longest = np.max(np.hypot(*builder.relative_position(a, b).T))
    has_damper = part.damping > 0.0
    if longest < _COINCIDENT_DISTANCE * builder.size:
        builder.add_between("spring", a, b, _spiral())
    elif has_damper and part.stiffness > 0.0:
        side = _SIDE_BY_SIDE_OFFSET
        builder.add_stretched("spring", a, b, _coil(_STUB, side))
        builder.add_stretched("damper", a, b, _dashpot(_STUB, -side))
        ends = ((0.0, _STUB), (1.0, 1.0 - _STUB))
        bars = [[(x, 0.0, -side), (x, 0.0, side)] for _, x in ends]
        stubs = [[(end, 0.0, 0.0), (x, 0.0, 0.0)] for end, x in ends]
        builder.add_stretched("spring", a, b, join_lines(*map(np.array, (*bars, *stubs))))
    elif has_damper:
        builder.add_stretched("damper", a, b, _dashpot())
    else:
        builder.add_stretched("spring", a, b, _coil())
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
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    # The moment depends only on the angles of the bodies; the part is drawn at the first point.
    inner = builder.add_pose(np.column_stack([builder.pose(a)[:, :2], builder.pose(b)[:, 2]]))
    if part.damping > 0.0 and part.stiffness == 0.0:
        angle = np.linspace(_DRUM_HALF_OPENING, 2.0 * math.pi - _DRUM_HALF_OPENING, _SPIRAL_POINTS)
        drum = _DRUM_RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
        builder.add_rigid("damper", a, drum)
        builder.add_rigid("damper", inner, [(0.0, -_VANE_HALF_LENGTH), (0.0, _VANE_HALF_LENGTH)])
    else:
        builder.add_between("spring", a, inner, _spiral())
    if np.max(np.hypot(*builder.relative_position(a, b).T)) > builder.size:
        builder.add_link("link", a, b)
    return a


def draw_bushing(part: Bushing, builder: SceneBuilder) -> int:
    """Draw a ring on the first body and a pin on the second body, connected by four spokes."""
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    center = np.subtract(part.b.point, part.a.point) / builder.size
    builder.add_rigid("spring", a, circle(_BUSHING_RADIUS, 40) + center)
    for direction in circle(1.0, 4)[:4] @ [(0.5**0.5, 0.5**0.5), (-(0.5**0.5), 0.5**0.5)]:
        outer, inner = center + _BUSHING_RADIUS * direction, _BUSHING_PIN_RADIUS * direction
        builder.add_between("spring", a, b, [(0.0, *outer), (1.0, *inner)])
    builder.add_rigid("weld", b, circle(_BUSHING_PIN_RADIUS))
    return b


def draw_contact(part: Contact, builder: SceneBuilder) -> int:
    """Draw the surface, with hatches on its inaccessible side, and the contact point."""
    from beamdae.parts.forces.surfaces import CircleSurface

    surface, point = part.surface, builder.add_attachment(part.point)
    if isinstance(surface, CircleSurface):
        line = _hatched_circle(surface, builder.size)
    else:
        travel = find_travel(surface.on, part.point, surface.direction, builder)
        line = align_points(hatched_line(*travel), surface.direction)
    builder.add_rigid("surface", builder.add_attachment(surface.on), line)
    builder.add_rigid("contact", point, circle(_CONTACT_RADIUS))
    return point


def _hatched_circle(surface: CircleSurface, size: float) -> Array:
    radius = surface.radius / size
    outward = circle(1.0, _SURFACE_HATCHES)[1:]
    inward = outward * (-1.0 if surface.side == "outside" else 1.0)
    feet, length = radius * outward, 0.4 * min(1.0, radius)
    ends = feet + length * (inward + np.column_stack([-inward[:, 1], inward[:, 0]]))
    return join_lines(circle(radius, _SURFACE_CORNERS), *np.stack([feet, ends], axis=1))
