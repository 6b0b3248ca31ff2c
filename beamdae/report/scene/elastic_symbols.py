"""The symbols of springs, dampers and bushings, which stretch and wind, and of contacts."""

from __future__ import annotations

import math

import numpy as np

from beamdae.parts.forces.bushing import Bushing
from beamdae.parts.forces.contact import Contact
from beamdae.parts.forces.springs import Damper, SpringDamper, TorsionSpring
from beamdae.parts.forces.surfaces import CircleSurface
from beamdae.report.scene.joint_symbols import grounded, middle, symbol, travel
from beamdae.report.scene.scene_builder import (
    SceneBuilder,
    circle,
    hatched_line,
    join_lines,
    rotate_points,
)

Array = np.ndarray

_COILS, _WINDINGS, _TICKS = 6, 2.25, 36
# Of the shortest length, the longest one at which a cup still ends before the other point.
_STROKE = 1.35


@symbol.register
def _between(part: SpringDamper, sketch: SceneBuilder) -> None:
    """A coil, a dashpot, or both side by side; where the points always meet, a spiral."""
    grounded(part, sketch)
    a, b, size = sketch.at(part.a), sketch.at(part.b), sketch.size
    lengths = np.hypot(*sketch.way(a, b).T)
    longest = float(np.max(lengths))
    shortest = max(float(np.min(lengths)), 0.2 * longest)
    damps = isinstance(part, Damper) or part.damping > 0.0
    if longest < 0.1 * size:
        sketch.between("spring", a, b, _spiral(size))
    elif damps and part.stiffness > 0.0:
        end, apart = 0.12 * shortest, 0.55 * size
        sketch.stretched("spring", a, b, _coil(end, 0.2 * shortest, apart, size))
        sketch.stretched("damper", a, b, _dashpot(end, shortest, longest, -apart, size))
        bars = [[(k, x, -apart), (k, x, apart)] for k, x in ((0, end), (1, -end))]
        stubs = [[(k, 0.0, 0.0), (k, x, 0.0)] for k, x in ((0, end), (1, -end))]
        sketch.stretched("spring", a, b, join_lines(*map(np.array, (*bars, *stubs))))
    elif damps:
        sketch.stretched("damper", a, b, _dashpot(0.0, shortest, longest, 0.0, size))
    else:
        sketch.stretched("spring", a, b, _coil(0.0, 0.2 * shortest, 0.0, size))
    sketch.name(middle(a, b, sketch))


def _coil(end: float, stub: float, side: float, size: float) -> Array:
    """A zigzag between two stubs, of `Symbol.points`, beside the line between the points."""
    share = np.linspace(0.0, 1.0, 4 * _COILS + 1)[1::2]
    inner = [(u, stub * (1.0 - 2.0 * u)) for u in (0.0, *share, 1.0)]
    across = [0.0, *(0.45 * size * (-1.0) ** np.arange(len(share))), 0.0]
    zigzag = [(*x, side + y) for x, y in zip(inner, across, strict=True)]
    return np.array([(0.0, end, side), *zigzag, (1.0, -end, side)])


def _dashpot(end: float, shortest: float, longest: float, side: float, size: float) -> Array:
    """A cup of the first point and a piston of the other that stays inside, as above.

    Both keep their lengths, unless the way is too long for that.
    """
    half = 0.42 * size
    bottom, piston = (0.0, 0.3 * shortest), (1.0, -0.5 * shortest)
    mouth = (0.0, longest - 0.35 * shortest)
    if longest > _STROKE * shortest:
        bottom, piston, mouth = (0.3, 0.0), (0.5, 0.0), (0.7, 0.0)
    cup = [(mouth, half), (bottom, half), (bottom, -half), (mouth, -half)]
    lines = [
        [(0.0, end, side), (*bottom, side)],
        [(*at, side + y) for at, y in cup],
        [(*piston, side - 0.75 * half), (*piston, side + 0.75 * half)],
        [(*piston, side), (1.0, -end, side)],
    ]
    return join_lines(*map(np.array, lines))


def _spiral(size: float) -> Array:
    """From the axes of one body to those of another: it winds as they turn."""
    share = np.linspace(0.0, 1.0, 90)
    angle = 2.0 * math.pi * _WINDINGS * (1.0 - share)
    radius = (1.3 - 1.05 * share) * size
    return np.column_stack([share, radius * np.cos(angle), radius * np.sin(angle)])


@symbol.register
def _torsion(part: TorsionSpring, sketch: SceneBuilder) -> None:
    grounded(part, sketch)
    a, b = sketch.at(part.a), sketch.at(part.b)
    # Any points of the bodies do: it is drawn at one of them.
    inner = np.column_stack([sketch.pose(a)[:, :2], sketch.pose(b)[:, 2]])
    sketch.between("spring", a, sketch.follow(inner), _spiral(sketch.size))
    if np.max(np.hypot(*sketch.way(a, b).T)) > sketch.size:
        sketch.link("link", a, b)
    sketch.name(a)


@symbol.register
def _bushing(part: Bushing, sketch: SceneBuilder) -> None:
    """A ring of the one body around a pin of the other."""
    grounded(part, sketch)
    a, b, size = sketch.at(part.a), sketch.at(part.b), sketch.size
    drawn = np.subtract(part.b.point, part.a.point)
    sketch.carried("spring", a, circle(0.85 * size, 40) + drawn)
    for angle in np.arange(4) * math.pi / 2.0 + math.pi / 4.0:
        way = np.array([math.cos(angle), math.sin(angle)])
        outer, inner = drawn + 0.85 * size * way, 0.3 * size * way
        sketch.between("spring", a, b, np.array([(0.0, *outer), (1.0, *inner)]))
    sketch.carried("weld", b, circle(0.3 * size))
    sketch.name(b)


@symbol.register
def _contact(part: Contact, sketch: SceneBuilder) -> None:
    surface, touching = part.surface, sketch.at(part.point)
    on = sketch.at(surface.on)
    if isinstance(surface, CircleSurface):
        sketch.carried("surface", on, _hatched_circle(surface, sketch.size))
    else:
        low, high = travel(surface.on, part.point, surface.direction, sketch)
        wall = hatched_line(low, high, sketch.size)
        sketch.carried("surface", on, rotate_points(wall, surface.direction))
    sketch.carried("contact", touching, circle(0.2 * sketch.size))
    sketch.name(touching)


def _hatched_circle(surface: CircleSurface, size: float) -> Array:
    """A circle with hatches on the side where nothing can be."""
    angle = np.linspace(0.0, 2.0 * math.pi, _TICKS + 1)[1:]
    feet = surface.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    away = feet / surface.radius * (-1.0 if surface.side == "outside" else 1.0)
    length = 0.4 * min(size, surface.radius)
    ends = feet + length * (away + np.column_stack([-away[:, 1], away[:, 0]]))
    return join_lines(circle(surface.radius, 90), *np.stack([feet, ends], axis=1))
