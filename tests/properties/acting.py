"""Drawing what acts on bodies: springs, contacts, friction, loads."""

from __future__ import annotations

from properties.bodies import GROUND, Place
from properties.drawings import OUTSIDE, RUBBING
from properties.frames import Wave
from properties.pencil import Pencil


def spring(pencil: Pencil, a: Place, b: Place) -> None:
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


def bushing(pencil: Pencil, a: Place, b: Place) -> None:
    pencil.piece(
        "bushing",
        a,
        b,
        stiffness=pencil.power(0.5, 2.5),
        damping=pencil.rng.choice([0.0, pencil.power(-1.0, 0.7)]),
        angle=pencil.between(-3.0, 3.0),
    )


def act(pencil: Pencil, kinds: tuple[str, ...], free: bool) -> None:
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
            spring(pencil, pencil.place(a), pencil.place(b))
    elif (
        kind in ("torsion spring", "bushing")
        and a != b
        and b in turning
        and a in (GROUND, *turning)
    ):
        if kind == "bushing":
            bushing(pencil, pencil.place(a), pencil.place(b))
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
            if piece.kind in RUBBING
            and (pencil.outside or piece.a.body is not GROUND)
            # What rubs in a bearing has to turn.
            and not (piece.kind == "revolute" and {piece.a.body, piece.b.body} - {GROUND, *turning})
        ]
        if joints:
            of = rng.choice(joints)
            own = {"of": of.name, "radius": RUBBING[of.kind], "static": pencil.chance(0.3)}
            pencil.piece(kind, of.a, of.b, friction=pencil.between(0.05, 0.4), **own)
    elif free and kind in OUTSIDE:
        return
    elif kind in ("load by length", "moving force", "Rayleigh", "drag"):
        if beams:
            _on_beam(pencil, kind, Place(rng.choice(beams)))
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


def _on_beam(pencil: Pencil, kind: str, on: Place) -> None:
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
