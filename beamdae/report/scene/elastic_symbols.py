"""Symbols of springs, dampers, bushings and contacts.

The length constants are relative to the symbol size. Classes of parts are imported in the functions
that draw them: mechanisms without these parts are drawn faster.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from beamdae.report.scene.joint_symbols import draw_supports, find_travel
from beamdae.report.scene.scene_builder import SceneBuilder
from beamdae.report.scene.shapes import align_points, circle, hatched_line, join_lines

if TYPE_CHECKING:
    from beamdae.parts.forces.bushing import Bushing
    from beamdae.parts.forces.contact import Contact
    from beamdae.parts.forces.springs import SpringDamper, TorsionSpring
    from beamdae.parts.forces.surfaces import CircleSurface

Array = np.ndarray

_COIL_COUNT = 6
_COIL_HALF_WIDTH = 0.45
_DASHPOT_HALF_WIDTH = 0.42
# Distance of coil and dashpot from the line between the points if they are drawn side by side.
_SIDE_BY_SIDE_OFFSET = 0.55
# Cup and piston of a dashpot have fixed lengths up to this ratio of largest to smallest distance.
_MAX_RIGID_STROKE = 1.35
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


def draw_spring_damper(part: SpringDamper, builder: SceneBuilder) -> None:
    """Draw a coil, a dashpot or both side by side, or a spiral if the points stay close."""
    from beamdae.parts.forces.springs import Damper

    draw_supports(part, builder)
    a, b, size = builder.add_attachment(part.a), builder.add_attachment(part.b), builder.size
    distances = np.hypot(*builder.relative_position(a, b).T)
    longest = float(np.max(distances))
    shortest = max(float(np.min(distances)), 0.2 * longest)
    has_damper = isinstance(part, Damper) or part.damping > 0.0
    if longest < _COINCIDENT_DISTANCE * size:
        builder.add_between("spring", a, b, _spiral(size))
    elif has_damper and part.stiffness > 0.0:
        end, offset = 0.12 * shortest, _SIDE_BY_SIDE_OFFSET * size
        builder.add_stretched("spring", a, b, _coil(end, 0.2 * shortest, offset, size))
        builder.add_stretched("damper", a, b, _dashpot(end, shortest, longest, -offset, size))
        bars = [[(k, x, -offset), (k, x, offset)] for k, x in ((0, end), (1, -end))]
        stubs = [[(k, 0.0, 0.0), (k, x, 0.0)] for k, x in ((0, end), (1, -end))]
        builder.add_stretched("spring", a, b, join_lines(*map(np.array, (*bars, *stubs))))
    elif has_damper:
        builder.add_stretched("damper", a, b, _dashpot(0.0, shortest, longest, 0.0, size))
    else:
        builder.add_stretched("spring", a, b, _coil(0.0, 0.2 * shortest, 0.0, size))
    builder.add_name(builder.add_midpoint(a, b))


def _coil(end: float, stub: float, side: float, size: float) -> Array:
    """Return the points of a zigzag line between two stubs, see `Symbol.points`."""
    share = np.linspace(0.0, 1.0, 4 * _COIL_COUNT + 1)[1::2]
    inner = [(u, stub * (1.0 - 2.0 * u)) for u in (0.0, *share, 1.0)]
    across = [0.0, *(_COIL_HALF_WIDTH * size * (-1.0) ** np.arange(len(share))), 0.0]
    zigzag = [(*x, side + y) for x, y in zip(inner, across, strict=True)]
    return np.array([(0.0, end, side), *zigzag, (1.0, -end, side)])


def _dashpot(end: float, shortest: float, longest: float, side: float, size: float) -> Array:
    """Return the points of a cup with a piston inside, see `Symbol.points`.

    Cup and piston have fixed lengths unless the distance of the points varies too much.
    """
    half = _DASHPOT_HALF_WIDTH * size
    bottom, piston = (0.0, 0.3 * shortest), (1.0, -0.5 * shortest)
    mouth = (0.0, longest - 0.35 * shortest)
    if longest > _MAX_RIGID_STROKE * shortest:
        bottom, piston, mouth = (0.3, 0.0), (0.5, 0.0), (0.7, 0.0)
    cup = [(mouth, half), (bottom, half), (bottom, -half), (mouth, -half)]
    lines = [
        [(0.0, end, side), (*bottom, side)],
        [(*corner, side + y) for corner, y in cup],
        [(*piston, side - 0.75 * half), (*piston, side + 0.75 * half)],
        [(*piston, side), (1.0, -end, side)],
    ]
    return join_lines(*map(np.array, lines))


def _spiral(size: float) -> Array:
    """Return the points of a spiral that winds up as its end poses rotate, see `Symbol.points`."""
    share = np.linspace(0.0, 1.0, _SPIRAL_POINTS)
    angle = 2.0 * math.pi * _SPIRAL_WINDINGS * (1.0 - share)
    radius = (1.3 - 1.05 * share) * size
    return np.column_stack([share, radius * np.cos(angle), radius * np.sin(angle)])


def draw_torsion_spring(part: TorsionSpring, builder: SceneBuilder) -> None:
    """Draw a spiral, or a drum with a vane for a damper, and a line between distant points.

    The line is drawn if the points are farther apart than a symbol.
    """
    from beamdae.parts.forces.springs import TorsionDamper

    draw_supports(part, builder)
    a, b = builder.add_attachment(part.a), builder.add_attachment(part.b)
    # The moment depends only on the angles of the bodies; the part is drawn at the first point.
    inner = builder.add_pose(np.column_stack([builder.pose(a)[:, :2], builder.pose(b)[:, 2]]))
    has_damper = isinstance(part, TorsionDamper) or part.damping > 0.0
    if has_damper and part.stiffness == 0.0:
        angle = np.linspace(_DRUM_HALF_OPENING, 2.0 * math.pi - _DRUM_HALF_OPENING, _SPIRAL_POINTS)
        drum = _DRUM_RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
        vane = _VANE_HALF_LENGTH * np.array([(0.0, -1.0), (0.0, 1.0)])
        builder.add_rigid("damper", a, builder.size * drum)
        builder.add_rigid("damper", inner, builder.size * vane)
    else:
        builder.add_between("spring", a, inner, _spiral(builder.size))
    if np.max(np.hypot(*builder.relative_position(a, b).T)) > builder.size:
        builder.add_link("link", a, b)
    builder.add_name(a)


def draw_bushing(part: Bushing, builder: SceneBuilder) -> None:
    """Draw a ring on the first body and a pin on the second body, connected by four spokes."""
    draw_supports(part, builder)
    a, b, size = builder.add_attachment(part.a), builder.add_attachment(part.b), builder.size
    center = np.subtract(part.b.point, part.a.point)
    builder.add_rigid("spring", a, circle(_BUSHING_RADIUS * size, 40) + center)
    for angle in np.arange(4) * math.pi / 2.0 + math.pi / 4.0:
        direction = np.array([math.cos(angle), math.sin(angle)])
        outer = center + _BUSHING_RADIUS * size * direction
        inner = _BUSHING_PIN_RADIUS * size * direction
        builder.add_between("spring", a, b, np.array([(0.0, *outer), (1.0, *inner)]))
    builder.add_rigid("weld", b, circle(_BUSHING_PIN_RADIUS * size))
    builder.add_name(b)


def draw_contact(part: Contact, builder: SceneBuilder) -> None:
    """Draw the surface, with hatches on its inaccessible side, and the contact point."""
    from beamdae.parts.forces.surfaces import CircleSurface

    surface, point = part.surface, builder.add_attachment(part.point)
    on = builder.add_attachment(surface.on)
    if isinstance(surface, CircleSurface):
        builder.add_rigid("surface", on, _hatched_circle(surface, builder.size))
    else:
        low, high = find_travel(surface.on, part.point, surface.direction, builder)
        wall = hatched_line(low, high, builder.size)
        builder.add_rigid("surface", on, align_points(wall, surface.direction))
    builder.add_rigid("contact", point, circle(_CONTACT_RADIUS * builder.size))
    builder.add_name(point)


def _hatched_circle(surface: CircleSurface, size: float) -> Array:
    angle = np.linspace(0.0, 2.0 * math.pi, _SURFACE_HATCHES + 1)[1:]
    feet = surface.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    inward = feet / surface.radius * (-1.0 if surface.side == "outside" else 1.0)
    length = 0.4 * min(size, surface.radius)
    ends = feet + length * (inward + np.column_stack([-inward[:, 1], inward[:, 0]]))
    hatches = np.stack([feet, ends], axis=1)
    return join_lines(circle(surface.radius, _SURFACE_CORNERS), *hatches)
