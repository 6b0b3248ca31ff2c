"""Random mechanisms: chains, trees and loops of bars, disks, particles and beams, with forces.

Drawn by a `random.Random`, that of hypothesis or one with a seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from random import Random

import numpy as np
from properties.bodies import GROUND, THEORIES, Body, Place, World
from properties.drawings import EXTERNAL_FORCES, FRICTION_JOINTS, Drawing, Piece
from properties.forces import FORCES
from properties.similarity import Similarity, Wave


def add_spring(pencil: DrawingBuilder, a: Place, b: Place) -> None:
    kind = pencil.rng.choice(["spring", "spring", "law of a spring"])
    pencil.piece(
        kind,
        a,
        b,
        stiffness=pencil.power(0.5, 2.5),
        damping=pencil.rng.choice([0.0, pencil.power(-1.0, 0.7)]),
        free=pencil.between(0.2, 0.8),
        preload=pencil.between(-2.0, 2.0),
    )


def add_bushing(pencil: DrawingBuilder, a: Place, b: Place) -> None:
    pencil.piece(
        "bushing",
        a,
        b,
        stiffness=pencil.power(0.5, 2.5),
        damping=pencil.rng.choice([0.0, pencil.power(-1.0, 0.7)]),
        angle=pencil.between(-3.0, 3.0),
    )


def add_force(pencil: DrawingBuilder, kinds: tuple[str, ...], free: bool) -> None:
    """Add a force of one of these kinds."""
    rng = pencil.rng
    kind = rng.choice(kinds)
    numbers = list(range(len(pencil.bodies)))
    turning = [k for k in numbers if pencil.bodies[k].turns]
    beams = [k for k in numbers if pencil.bodies[k].is_beam]
    a, b = rng.choice([*numbers, *([] if free else [GROUND])]), rng.choice(numbers)
    if kind in ("spring", "law of a spring", "law of two points") and a != b:
        if kind == "law of two points":
            own = {"preload": pencil.between(-3.0, 3.0), "damping": pencil.between(0.0, 1.0)}
            pencil.piece(kind, pencil.place(a), pencil.place(b), **own)
        else:
            add_spring(pencil, pencil.place(a), pencil.place(b))
    elif (
        kind in ("torsion spring", "bushing")
        and a != b
        and b in turning
        and a in (GROUND, *turning)
    ):
        if kind == "bushing":
            add_bushing(pencil, pencil.place(a), pencil.place(b))
        else:
            own = {"stiffness": pencil.power(-0.5, 1.5), "damping": pencil.between(0.0, 1.0)}
            own |= {"free": pencil.between(-0.5, 0.5), "preload": pencil.between(-1.0, 1.0)}
            pencil.piece(kind, pencil.place(a), pencil.place(b), **own)
    elif kind.startswith("contact") and a != b and (a is GROUND or a in turning):
        own = {
            "stiffness": pencil.power(2.0, 4.0),
            "restitution": rng.choice([1.0, 0.6]),
            "friction": rng.choice([0.0, 0.3]),
        }
        if kind == "contact with a line":
            own["direction"] = pencil.direction()
        else:
            own |= {"radius": pencil.between(0.2, 0.5), "side": rng.choice(["outside", "inside"])}
        pencil.piece(kind, pencil.place(a), pencil.place(b), **own)
    elif kind == "friction":
        joints = [
            piece
            for piece in pencil.pieces
            if piece.kind in FRICTION_JOINTS
            and (pencil.outside or piece.a.body is not GROUND)
            # What rubs in a bearing has to turn.
            and not (piece.kind == "revolute" and {piece.a.body, piece.b.body} - {GROUND, *turning})
        ]
        if joints:
            of = rng.choice(joints)
            own = {"of": of.name, "radius": FRICTION_JOINTS[of.kind], "static": pencil.chance(0.3)}
            pencil.piece(kind, of.a, of.b, friction=pencil.between(0.05, 0.4), **own)
    elif free and kind in EXTERNAL_FORCES:
        return
    elif kind in ("load by length", "moving force", "Rayleigh", "drag"):
        if beams:
            _add_force_on_beam(pencil, kind, Place(rng.choice(beams)))
    elif kind == "mass":
        pencil.piece(kind, pencil.place(b), pencil.place(b), mass=pencil.between(0.1, 1.0))
    elif kind == "force":
        axes = rng.choice(["inertial", "body"]) if b in turning else "inertial"
        wave = pencil.wave(pencil.between(0.5, 10.0))
        place = pencil.place(b)
        pencil.piece(kind, place, place, wave=wave, direction=pencil.direction(), axes=axes)
    elif kind == "moment" and b in turning:
        pencil.piece(
            kind, pencil.place(b), pencil.place(b), wave=pencil.wave(pencil.between(-3, 3))
        )


def _add_force_on_beam(pencil: DrawingBuilder, kind: str, on: Place) -> None:
    own = {
        "load by length": {
            "wave": pencil.wave(pencil.between(0.5, 5.0)),
            "direction": pencil.direction(),
            "axes": pencil.rng.choice(["inertial", "section"]),
        },
        "moving force": {
            "wave": Wave(pencil.between(0.5, 5.0)),
            "direction": pencil.direction(),
            "speed": pencil.between(0.5, 3.0),
            "start": pencil.between(-0.2, 0.2),
        },
        "Rayleigh": {"mass": pencil.between(0.0, 1.0)},
        "drag": {"damping": pencil.between(0.1, 1.0)},
    }
    pencil.piece(kind, on, on, **own[kind])


@dataclass
class DrawingBuilder:
    """What draws one."""

    rng: Random
    bodies: list[Body] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    outside: bool = True
    damped: bool = False

    def between(self, low: float, high: float) -> float:
        """To three digits, as somebody would write it."""
        return float(f"{self.rng.uniform(low, high):.3g}")

    def power(self, low: float, high: float) -> float:
        return float(f"{10.0 ** self.rng.uniform(low, high):.3g}")

    def chance(self, share: float) -> bool:
        return self.rng.random() < share

    def direction(self) -> tuple[float, float]:
        angle = self.rng.uniform(-np.pi, np.pi)
        return float(np.cos(angle)), float(np.sin(angle))

    def wave(self, value: float) -> Wave:
        share = self.rng.choice([0.0, 0.3, 1.0])
        return Wave(value, share, self.between(1.0, 8.0))

    def world(self) -> World:
        return World(None, Similarity(), tuple(self.bodies), {})

    def place(self, body: int | None) -> Place:
        """On a body; of the ground near the origin."""
        if body is GROUND:
            return Place(GROUND, self.between(-1.0, 1.0), self.between(-1.0, 1.0))
        u = self.rng.choice([1.0, 0.5, self.between(0.05, 1.0)])
        w = self.rng.choice([0.0, self.between(-0.3, 0.3)])
        return Place(body, u, w)

    def piece(self, kind: str, a: Place, b: Place, **numbers) -> None:
        self.pieces.append(Piece(f"{kind} {len(self.pieces)}", kind, a, b, numbers))

    def body(self, start: tuple[float, float], kinds: tuple[str, ...]) -> int:
        """Add one; its number."""
        kind = self.rng.choice(kinds)
        number = len(self.bodies)
        self.bodies.append(
            Body(
                name=f"{kind} {number}",
                kind=kind,
                start=start,
                heading=self.between(-3.1, 3.1),
                length=self.between(0.3, 1.2),
                mass=self.power(-0.5, 0.7),
                bend=self.rng.choice([0.0, self.between(0.2, 1.5), self.between(-1.5, -0.2)]),
                velocity=(self.between(-1.0, 1.0), self.between(-1.0, 1.0)),
                spin=self.between(-3.0, 3.0),
                modulus=1e7 if self.damped else self.rng.choice([1e7, 1e8, 2e9]),
                height=self.rng.choice([0.02, 0.05]),
                damping=1e-3 if self.damped else self.rng.choice([0.0, 1e-3]),
                elements=self.rng.choice([1, 2]),
                theory=self.rng.choice(tuple(THEORIES)),
            )
        )
        return number


def draw_mechanism(
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
    pencil = DrawingBuilder(rng, outside=outside, damped=damped)
    shapes = ("bar", "disk", "beam", "particle") if flexible else ("bar", "disk", "particle")
    free = pencil.chance(0.25) if free is None else free
    for k in range(rng.choice(range(1, most + 1))):
        if free and k == 0:
            pencil.body((0.0, 0.0), tuple(x for x in shapes if x != "particle"))
        else:
            _attach_body(pencil, shapes, free)
    if not free or pencil.chance(0.5):
        for _ in range(rng.choice([0, 0, 1])):
            _close_loop(pencil, free)
    for _ in range(rng.choice([0, 1, 2, 3])):
        add_force(pencil, kinds, free or not outside)
    heavy = not free and pencil.chance(0.7)
    gravity = (0.0, -9.81) if heavy else (0.0, 0.0)
    return Drawing(tuple(pencil.bodies), tuple(pencil.pieces), gravity)


def _attach_body(pencil: DrawingBuilder, shapes: tuple[str, ...], free: bool) -> None:
    """Join a new body to one there is, or to the ground."""
    parents = [*range(len(pencil.bodies)), *([] if free else [GROUND])]
    parent = pencil.rng.choice(parents)
    kind = pencil.rng.choice(_TREE_KINDS)
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
    _ATTACH_FUNCTIONS.get(kind, _attach_at_point)(pencil, kind, place, at, shapes)


def _attach_at_point(pencil, kind, place, at, shapes) -> None:
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
        add_bushing(pencil, place, here)
    else:
        pencil.piece(kind, place, here)


def _attach_at_distance(pencil, kind, place, at, shapes) -> None:
    """With a gap between."""
    x, y = pencil.direction()
    gap = pencil.between(0.2, 0.8)
    child = pencil.body((at[0] + gap * x, at[1] + gap * y), shapes)
    if kind == "spring":
        add_spring(pencil, place, Place(child))
    elif pencil.chance(0.3):
        pencil.piece("driven distance", place, Place(child), wave=pencil.wave(1.0))
    else:
        pencil.piece(kind, place, Place(child))


def _attach_rolling_disk(pencil, kind, place, at, shapes) -> None:
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


_TREE_KINDS = (
    *("revolute", "revolute", "revolute", "weld", "prismatic", "point on line", "distance"),
    *("driver", "bushing", "spring", "rolling on line", "rolling on circle", "sliding"),
)
_ATTACH_FUNCTIONS = {
    "distance": _attach_at_distance,
    "spring": _attach_at_distance,
    "rolling on line": _attach_rolling_disk,
    "rolling on circle": _attach_rolling_disk,
}


def _close_loop(pencil: DrawingBuilder, free: bool) -> None:
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
