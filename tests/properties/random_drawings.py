"""Random mechanisms: chains, trees and loops of bars, disks, particles and beams, with forces.

Drawn by a `random.Random`, that of hypothesis or one with a seed.
"""

from __future__ import annotations

from dataclasses import replace
from random import Random

from properties.acting import act, bushing, spring
from properties.bodies import GROUND, Place
from properties.drawings import Drawing
from properties.forces import FORCES
from properties.pencil import Pencil


def draw(
    rng: Random,
    most: int = 4,
    kinds: tuple[str, ...] = tuple(FORCES),
    flexible: bool = True,
    free: bool | None = None,
    outside: bool = True,
    damped: bool = False,
) -> Drawing:
    """Draw a mechanism of up to so many bodies.

    Of these `kinds` of forces, with beams where `flexible`, hung in space where `free`, where not
    `outside` held by joints and gravity alone; where `damped` beams are soft and of damped
    material.
    """
    pencil = Pencil(rng, outside=outside, damped=damped)
    shapes = ("bar", "disk", "beam", "particle") if flexible else ("bar", "disk", "particle")
    free = pencil.chance(0.25) if free is None else free
    for k in range(rng.choice(range(1, most + 1))):
        if free and k == 0:
            pencil.body((0.0, 0.0), tuple(x for x in shapes if x != "particle"))
        else:
            _grow(pencil, shapes, free)
    if not free or pencil.chance(0.5):
        for _ in range(rng.choice([0, 0, 1])):
            _close(pencil, free)
    for _ in range(rng.choice([0, 1, 2, 3])):
        act(pencil, kinds, free or not outside)
    heavy = not free and pencil.chance(0.7)
    gravity = (0.0, -9.81) if heavy else (0.0, 0.0)
    return Drawing(tuple(pencil.bodies), tuple(pencil.pieces), gravity)


def _grow(pencil: Pencil, shapes: tuple[str, ...], free: bool) -> None:
    """Join a new body to one there is, or to the ground."""
    parents = [*range(len(pencil.bodies)), *([] if free else [GROUND])]
    parent = pencil.rng.choice(parents)
    kind = pencil.rng.choice(_TREE)
    if parent is GROUND and not pencil.outside and kind in FORCES:
        kind = "revolute"
    place = pencil.place(parent)
    at = pencil.world().point(place)
    of = None if parent is GROUND else pencil.bodies[parent]
    if kind == "rolling on circle" and (of is None or of.kind != "disk"):
        kind = "revolute"
    if kind == "sliding" and (of is None or not of.is_beam):
        kind = "revolute"
    turns = of is None or of.turns
    if not turns and kind not in ("revolute", "distance", "spring"):
        kind = "revolute"
    _TREE_PIECES.get(kind, _joined)(pencil, kind, place, at, shapes)


def _joined(pencil, kind, place, at, shapes) -> None:
    """At a common point, or with a guide through it."""
    of = None if place.body is GROUND else pencil.bodies[place.body]
    rigidly = kind in ("weld", "prismatic", "driver", "bushing") or (of and not of.turns)
    shapes = tuple(x for x in shapes if not (rigidly and x == "particle"))
    start = at
    if kind in ("prismatic", "bushing") and pencil.chance(0.5):
        start = (at[0] + pencil.between(-0.3, 0.3), at[1] + pencil.between(-0.3, 0.3))
    child = pencil.body(start, shapes)
    here = Place(child)
    if kind in ("prismatic", "point on line"):
        direction = pencil.direction()
        pencil.piece(kind, place, here, direction=direction)
        if kind == "prismatic" and pencil.chance(0.3):
            wave = pencil.wave(pencil.between(0.05, 0.3))
            pencil.piece("travel", place, here, direction=direction, wave=wave)
    elif kind == "driver":
        pencil.piece("revolute", place, here)
        pencil.piece("driver", place, here, wave=pencil.wave(pencil.between(0.1, 1.0)))
    elif kind == "bushing":
        bushing(pencil, place, here)
    else:
        pencil.piece(kind, place, here)


def _apart(pencil, kind, place, at, shapes) -> None:
    """With a gap between."""
    x, y = pencil.direction()
    gap = pencil.between(0.2, 0.8)
    child = pencil.body((at[0] + gap * x, at[1] + gap * y), shapes)
    if kind == "spring":
        spring(pencil, place, Place(child))
    elif pencil.chance(0.3):
        pencil.piece("driven distance", place, Place(child), wave=pencil.wave(1.0))
    else:
        pencil.piece(kind, place, Place(child))


def _rolling(pencil, kind, place, at, shapes) -> None:
    """A disk that touches."""
    x, y = pencil.direction()
    child = pencil.body(at, ("disk",))
    radius = pencil.bodies[child].length
    if kind == "rolling on line":
        start = (at[0] + radius * x, at[1] + radius * y)
        side = pencil.rng.choice([1.0, -1.0])
        numbers = {"radius": radius, "direction": (side * y, -side * x)}
    else:
        of = pencil.bodies[place.body]
        place, apart = Place(place.body), radius + of.length
        start = (of.start[0] + apart * x, of.start[1] + apart * y)
        numbers = {"radii": (of.length, radius)}
    pencil.bodies[child] = replace(pencil.bodies[child], start=start)
    pencil.piece(kind, place, Place(child), **numbers)


_TREE = (
    *("revolute", "revolute", "revolute", "weld", "prismatic", "point on line", "distance"),
    *("driver", "bushing", "spring", "rolling on line", "rolling on circle", "sliding"),
)
_TREE_PIECES = {
    "distance": _apart,
    "spring": _apart,
    "rolling on line": _rolling,
    "rolling on circle": _rolling,
}


def _close(pencil: Pencil, free: bool) -> None:
    """One more joint between what there is."""
    numbers = list(range(len(pencil.bodies)))
    turning = [k for k in numbers if pencil.bodies[k].turns]
    if not numbers:
        return
    kinds = ["distance", "gear", "rack"]
    if not free:
        kinds += ["skate", "point on line", "revolute"]
    kind = pencil.rng.choice(kinds)
    b = pencil.place(pencil.rng.choice(numbers))
    others = [k for k in turning if k != b.body]
    world = pencil.world()
    if kind == "skate" and turning:
        at = pencil.place(pencil.rng.choice(turning))
        pencil.piece(kind, at, at, direction=pencil.direction())
    elif kind in ("gear", "rack") and len(others) > 1 and pencil.bodies[b.body].turns:
        a, carrier = pencil.rng.sample(others, 2)
        if kind == "rack":
            radius = pencil.between(0.1, 0.4) * pencil.rng.choice([1.0, -1.0])
            pencil.piece(kind, Place(a), b, radius=radius, direction=pencil.direction())
            return
        more = (
            {"carrier": Place(carrier)} if free or not pencil.outside or pencil.chance(0.5) else {}
        )
        pencil.piece(kind, Place(a), b, ratio=pencil.rng.choice([-1.5, -0.5, 2.0]), **more)
    elif kind in ("point on line", "revolute"):
        ground = Place(GROUND, *world.point(b))
        more = {"direction": pencil.direction()} if kind == "point on line" else {}
        pencil.piece(kind, ground, b, **more)
    elif others:
        pencil.piece("distance", pencil.place(pencil.rng.choice(others)), b)
