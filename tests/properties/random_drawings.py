"""Random mechanisms: chains, trees and loops of bars, disks, particles and beams, with forces.

The random numbers come from a `random.Random`: that of hypothesis, or one with a seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from random import Random

import numpy as np
from properties.bodies import CURVES, GROUND, THEORIES, Body, Place, World
from properties.connections import FORCES
from properties.drawings import BUILDERS, EXTERNAL_FORCES, FRICTION_JOINTS, Drawing, Piece
from properties.similarity import PROFILES, Similarity, Wave

# Kinds of parts, bodies, curves, sections and settings of beams.
ALL_KINDS = (*BUILDERS, "bar", "disk", "particle", "reduced", *CURVES, *PROFILES, *THEORIES)


def add_spring(builder: DrawingBuilder, a: Place, b: Place) -> None:
    kind = builder.rng.choice(["spring", "spring", "law of a spring", "damper"])
    builder.piece(
        kind,
        a,
        b,
        stiffness=builder.power(0.5, 2.5),
        damping=builder.rng.choice([0.0, builder.power(-1.0, 0.7)] if kind != "damper" else [1.0]),
        free=builder.between(0.2, 0.8),
        preload=builder.between(-2.0, 2.0),
    )


def add_bushing(builder: DrawingBuilder, a: Place, b: Place) -> None:
    builder.piece(
        "bushing",
        a,
        b,
        stiffness=builder.power(0.5, 2.5),
        damping=builder.rng.choice([0.0, builder.power(-1.0, 0.7)]),
        angle=builder.between(-3.0, 3.0),
    )


def add_force(builder: DrawingBuilder, kinds: tuple[str, ...], free: bool) -> None:
    """Add a random force of one of these kinds, if it fits the bodies."""
    rng = builder.rng
    kind = rng.choice(kinds)
    indices = list(range(len(builder.bodies)))
    with_angle = [k for k in indices if builder.bodies[k].turns]
    beams = [k for k in indices if builder.bodies[k].is_beam]
    a, b = rng.choice([*indices, *([] if free else [GROUND])]), rng.choice(indices)
    if kind in ("spring", "damper", "law of a spring", "law of two points") and a != b:
        if kind == "law of two points":
            parameters = {
                "preload": builder.between(-3.0, 3.0),
                "damping": builder.between(0.0, 1.0),
            }
            builder.piece(kind, builder.place(a), builder.place(b), **parameters)
        else:
            add_spring(builder, builder.place(a), builder.place(b))
    elif (
        kind in ("torsion spring", "bushing")
        and a != b
        and b in with_angle
        and a in (GROUND, *with_angle)
    ):
        if kind == "bushing":
            add_bushing(builder, builder.place(a), builder.place(b))
        else:
            parameters = {
                "stiffness": rng.choice([0.0, builder.power(-0.5, 1.5)]),
                "damping": builder.between(0.1, 1.0),
            }
            parameters |= {
                "free": builder.between(-0.5, 0.5),
                "preload": builder.between(-1.0, 1.0),
            }
            builder.piece(kind, builder.place(a), builder.place(b), **parameters)
    elif kind.startswith("contact") and a != b and (a is GROUND or a in with_angle):
        parameters = {
            "stiffness": builder.power(2.0, 4.0),
            "restitution": rng.choice([1.0, 0.6]),
            "friction": rng.choice([0.0, 0.3]),
        }
        if kind == "contact with a line":
            parameters["direction"] = builder.direction()
        else:
            parameters |= {
                "radius": builder.between(0.2, 0.5),
                "side": rng.choice(["outside", "inside"]),
            }
        builder.piece(kind, builder.place(a), builder.place(b), **parameters)
    elif kind == "wrapping":
        beams = [k for k in beams if k != a]
        if beams and (a is GROUND or a in with_angle):
            parameters = {
                "stiffness": builder.power(1.0, 3.0),
                "direction": builder.direction(),
                "friction": rng.choice([0.0, 0.3]),
            }
            builder.piece(kind, builder.place(a), Place(rng.choice(beams)), **parameters)
    elif kind == "friction":
        joints = [
            piece
            for piece in builder.pieces
            if piece.kind in FRICTION_JOINTS
            and (builder.outside or piece.a.body is not GROUND)
            # Friction in a bearing needs two bodies with angles.
            and not (
                piece.kind == "revolute" and {piece.a.body, piece.b.body} - {GROUND, *with_angle}
            )
        ]
        if joints:
            of = rng.choice(joints)
            parameters = {
                "of": of.name,
                "radius": FRICTION_JOINTS[of.kind],
                "static": builder.chance(0.3),
            }
            builder.piece(kind, of.a, of.b, friction=builder.between(0.05, 0.4), **parameters)
    elif free and kind in EXTERNAL_FORCES:
        return
    elif kind in ("load by length", "moving force", "Rayleigh", "drag", "relaxation"):
        if beams:
            _add_force_on_beam(builder, kind, Place(rng.choice(beams)))
    elif kind == "mass":
        builder.piece(kind, builder.place(b), builder.place(b), mass=builder.between(0.1, 1.0))
    elif kind == "force":
        axes = rng.choice(["inertial", "body"]) if b in with_angle else "inertial"
        wave = builder.wave(builder.between(0.5, 10.0))
        place = builder.place(b)
        builder.piece(kind, place, place, wave=wave, direction=builder.direction(), axes=axes)
    elif kind == "moment" and b in with_angle:
        builder.piece(
            kind, builder.place(b), builder.place(b), wave=builder.wave(builder.between(-3, 3))
        )


def _add_force_on_beam(builder: DrawingBuilder, kind: str, on: Place) -> None:
    parameters = {
        "load by length": {
            "wave": builder.wave(builder.between(0.5, 5.0)),
            "direction": builder.direction(),
            "axes": builder.rng.choice(["inertial", "section"]),
        },
        "moving force": {
            "wave": Wave(builder.between(0.5, 5.0)),
            "direction": builder.direction(),
            "speed": builder.between(0.5, 3.0),
            "start": builder.between(-0.2, 0.2),
        },
        "Rayleigh": {"mass": builder.between(0.0, 1.0)},
        "drag": {"damping": builder.between(0.1, 1.0)},
        "relaxation": {"ratio": builder.between(0.1, 1.0)},
    }
    builder.piece(kind, on, on, **parameters[kind])


@dataclass
class DrawingBuilder:
    """Draws random parameters, bodies and pieces and collects them."""

    rng: Random
    bodies: list[Body] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    outside: bool = True
    damped: bool = False

    def between(self, low: float, high: float) -> float:
        """Return a random number with three significant digits."""
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
        """Return a random place on a body, or near the origin of the ground."""
        if body is GROUND:
            return Place(GROUND, self.between(-1.0, 1.0), self.between(-1.0, 1.0))
        u = self.rng.choice([1.0, 0.5, self.between(0.05, 1.0)])
        w = self.rng.choice([0.0, self.between(-0.3, 0.3)])
        return Place(body, u, w)

    def piece(self, kind: str, a: Place, b: Place, **numbers) -> None:
        self.pieces.append(Piece(f"{kind} {len(self.pieces)}", kind, a, b, numbers))

    def body(self, start: tuple[float, float], kinds: tuple[str, ...]) -> int:
        """Add a random body and return its number."""
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
                bend=self.rng.choice([self.between(0.2, 1.5), self.between(-1.5, -0.2)]),
                curve=self.rng.choice(tuple(CURVES)),
                profile=self.rng.choice(PROFILES),
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
    containing: str = "",
) -> Drawing:
    """Return the drawing of a random mechanism, which contains a kind of part if one is named.

    Parameters
    ----------
    rng
        Source of random numbers.
    most
        Largest number of bodies.
    kinds
        Kinds of forces.
    flexible
        True to include beams.
    free
        True for a mechanism without connection to the ground; None draws it at random.
    outside
        False to allow no external actions other than joints and gravity.
    damped
        True for soft beams of damped material.
    containing
        One of `ALL_KINDS`, or "".
    """
    while True:
        drawing = _draw(rng, most, kinds, flexible, free, outside, damped)
        if not containing or containing in drawing.kinds:
            return drawing


def _draw(rng, most, kinds, flexible, free, outside, damped) -> Drawing:
    builder = DrawingBuilder(rng, outside=outside, damped=damped)
    shapes = ("bar", "disk", "particle", *(("beam", "reduced") if flexible else ()))
    free = builder.chance(0.25) if free is None else free
    for k in range(rng.choice(range(1, most + 1))):
        if free and k == 0:
            builder.body((0.0, 0.0), tuple(x for x in shapes if x != "particle"))
        else:
            _attach_body(builder, shapes, free)
    if not free or builder.chance(0.5):
        for _ in range(rng.choice([0, 0, 1])):
            _close_loop(builder, free)
    for _ in range(rng.choice([0, 1, 2, 3])):
        add_force(builder, kinds, free or not outside)
    heavy = not free and builder.chance(0.7)
    gravity = (0.0, -9.81) if heavy else (0.0, 0.0)
    share = builder.rng.choice([0.0, 0.5]) if outside else 0.0
    return Drawing(tuple(builder.bodies), tuple(builder.pieces), gravity, share)


def _attach_body(builder: DrawingBuilder, shapes: tuple[str, ...], free: bool) -> None:
    """Attach a new body to an existing one or to the ground."""
    parents = [*range(len(builder.bodies)), *([] if free else [GROUND])]
    parent = builder.rng.choice(parents)
    kind = builder.rng.choice(_TREE_KINDS)
    if parent is GROUND and not builder.outside and kind in FORCES:
        kind = "revolute"
    place = builder.place(parent)
    at = builder.world().point(place)
    of = None if parent is GROUND else builder.bodies[parent]
    if kind == "rolling on circle" and (of is None or of.kind != "disk"):
        kind = "revolute"
    if kind == "sliding" and (of is None or not of.is_beam):
        kind = "revolute"
    turns = of is None or of.turns
    if not turns and kind not in ("revolute", "distance", "spring"):
        kind = "revolute"
    _ATTACH_FUNCTIONS.get(kind, _attach_at_point)(builder, kind, place, at, shapes)


def _attach_at_point(builder, kind, place, at, shapes) -> None:
    """Attach a body at a common point, or by a guide through it."""
    of = None if place.body is GROUND else builder.bodies[place.body]
    rigidly = kind in ("weld", "prismatic", "driver", "bushing") or (of and not of.turns)
    shapes = tuple(x for x in shapes if not (rigidly and x == "particle"))
    start = at
    if kind in ("prismatic", "bushing") and builder.chance(0.5):
        start = (at[0] + builder.between(-0.3, 0.3), at[1] + builder.between(-0.3, 0.3))
    child = builder.body(start, shapes)
    here = Place(child)
    if kind in ("prismatic", "point on line"):
        direction = builder.direction()
        builder.piece(kind, place, here, direction=direction)
        if kind == "prismatic" and builder.chance(0.3):
            wave = builder.wave(builder.between(0.05, 0.3))
            builder.piece("travel", place, here, direction=direction, wave=wave)
    elif kind == "driver":
        builder.piece("revolute", place, here)
        builder.piece("driver", place, here, wave=builder.wave(builder.between(0.1, 1.0)))
    elif kind == "bushing":
        add_bushing(builder, place, here)
    else:
        builder.piece(kind, place, here)


def _attach_at_distance(builder, kind, place, at, shapes) -> None:
    """Attach a body at a distance."""
    x, y = builder.direction()
    gap = builder.between(0.2, 0.8)
    child = builder.body((at[0] + gap * x, at[1] + gap * y), shapes)
    if kind == "spring":
        add_spring(builder, place, Place(child))
    elif builder.chance(0.3):
        builder.piece("driven distance", place, Place(child), wave=builder.wave(1.0))
    else:
        builder.piece(kind, place, Place(child))


def _attach_rolling_disk(builder, kind, place, at, shapes) -> None:
    """Attach a disk that rolls on the parent."""
    x, y = builder.direction()
    child = builder.body(at, ("disk",))
    radius = builder.bodies[child].length
    if kind == "rolling on line":
        start = (at[0] + radius * x, at[1] + radius * y)
        side = builder.rng.choice([1.0, -1.0])
        numbers = {"radius": radius, "direction": (side * y, -side * x)}
    else:
        of = builder.bodies[place.body]
        place, distance = Place(place.body), radius + of.length
        start = (of.start[0] + distance * x, of.start[1] + distance * y)
        numbers = {"radii": (of.length, radius)}
    builder.bodies[child] = replace(builder.bodies[child], start=start)
    builder.piece(kind, place, Place(child), **numbers)


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


def _close_loop(builder: DrawingBuilder, free: bool) -> None:
    """Add a joint between existing bodies, or with the ground."""
    indices = list(range(len(builder.bodies)))
    with_angle = [k for k in indices if builder.bodies[k].turns]
    if not indices:
        return
    kinds = ["distance", "gear", "rack"]
    if not free:
        kinds += ["skate", "point on line", "revolute"]
    kind = builder.rng.choice(kinds)
    b = builder.place(builder.rng.choice(indices))
    others = [k for k in with_angle if k != b.body]
    world = builder.world()
    if kind == "skate" and with_angle:
        at = builder.place(builder.rng.choice(with_angle))
        builder.piece(kind, at, at, direction=builder.direction())
    elif kind in ("gear", "rack") and len(others) > 1 and builder.bodies[b.body].turns:
        a, carrier = builder.rng.sample(others, 2)
        if kind == "rack":
            radius = builder.between(0.1, 0.4) * builder.rng.choice([1.0, -1.0])
            builder.piece(kind, Place(a), b, radius=radius, direction=builder.direction())
            return
        more = (
            {"carrier": Place(carrier)}
            if free or not builder.outside or builder.chance(0.5)
            else {}
        )
        builder.piece(kind, Place(a), b, ratio=builder.rng.choice([-1.5, -0.5, 2.0]), **more)
    elif kind in ("point on line", "revolute"):
        ground = Place(GROUND, *world.point(b))
        more = {"direction": builder.direction()} if kind == "point on line" else {}
        builder.piece(kind, ground, b, **more)
    elif others:
        a = builder.place(builder.rng.choice(others))
        if world.point(a) != world.point(b):
            builder.piece("distance", a, b)
