"""Drawings of mechanisms as data, to be built in any frame and with their parts in any order."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random

from properties.bodies import GROUND, Body, Place, World
from properties.forces import FORCES
from properties.joints import JOINTS
from properties.similarity import Similarity

import beamdae as bd

BUILDERS = JOINTS | FORCES
# In which friction can act, and which of them has a radius.
FRICTION_JOINTS = {"revolute": True, "prismatic": True, "point on line": False}


@dataclass(frozen=True)
class Piece:
    """A joint or a force between two places, and its numbers."""

    name: str
    kind: str
    a: Place
    b: Place
    numbers: dict = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        return self.kind in JOINTS


@dataclass(frozen=True)
class Drawing:
    """A mechanism as data."""

    bodies: tuple[Body, ...]
    pieces: tuple[Piece, ...]
    gravity: tuple[float, float]

    @property
    def is_free(self) -> bool:
        """Whether nothing acts on it from outside."""
        return not any(self.gravity) and all(
            piece.kind not in EXTERNAL_FORCES
            and GROUND not in (piece.a.body, piece.b.body)
            and (piece.kind != "gear" or "carrier" in piece.numbers)
            for piece in self.pieces
        )

    @property
    def held(self) -> dict[str, str]:
        """The joints with the ground by name, each with its point on the body."""
        found = {}
        for piece in self.pieces:
            if piece.kind == "skate":
                found[piece.name] = "on"
            elif piece.holds and piece.a.body is GROUND:
                found[piece.name] = "b"
        return found

    def mechanism(
        self, frame: Similarity | None = None, order: Random | None = None
    ) -> bd.Mechanism:
        """Build it in a frame, its parts in the order of the drawing or in one drawn by `order`."""
        frame = frame or Similarity()
        mech = bd.Mechanism(gravity=frame.way(*self.gravity, "m/s^2"))
        world = World(mech, frame, self.bodies, {})
        bodies, pieces = list(self.bodies), list(self.pieces)
        if order is not None:
            order.shuffle(bodies)
            order.shuffle(pieces)
        for body in bodies:
            world.parts[body.name] = mech.add(body.part(frame))
        # Friction refers to its joint.
        for piece in sorted(pieces, key=lambda piece: piece.kind == "friction"):
            part = BUILDERS[piece.kind](world, piece.name, piece.a, piece.b, piece.numbers)
            world.parts[piece.name] = mech.add(part)
        return mech


EXTERNAL_FORCES = {"skate", "force", "moment", "load by length", "moving force", "drag", "Rayleigh"}
