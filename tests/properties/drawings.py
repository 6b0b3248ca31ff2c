"""Descriptions of mechanisms, built under any similarity and with parts in any order."""

from dataclasses import dataclass, field
from random import Random

from properties.bodies import GROUND, Body, Place, World
from properties.connections import FORCES, JOINTS
from properties.similarity import Similarity, Wave

import beamdae as bd

BUILDERS = JOINTS | FORCES
# Joints with friction, and whether friction needs a radius.
FRICTION_JOINTS = {"revolute": True, "prismatic": True, "point on line": False}


@dataclass(frozen=True)
class Piece:
    """Description of a joint or a force between two places, with its parameters."""

    name: str
    kind: str
    a: Place
    b: Place
    numbers: dict = field(default_factory=dict)

    @property
    def is_joint(self) -> bool:
        return self.kind in JOINTS


@dataclass(frozen=True)
class Drawing:
    """Description of a mechanism."""

    bodies: tuple[Body, ...]
    pieces: tuple[Piece, ...]
    gravity: tuple[float, float]
    # Share of the gravity that changes in time; its value is that of the start.
    gravity_share: float = 0.0

    @property
    def kinds(self) -> set[str]:
        """Kinds of the parts, and of the curves, sections and theories of the beams."""
        beams = [body for body in self.bodies if body.is_beam]
        kinds = {part.kind for part in (*self.bodies, *self.pieces)}
        return kinds.union(*((beam.curve, beam.profile, beam.theory) for beam in beams))

    @property
    def is_free(self) -> bool:
        """True if no gravity, external force or joint with the ground acts."""
        return not any(self.gravity) and all(
            piece.kind not in EXTERNAL_FORCES
            and GROUND not in (piece.a.body, piece.b.body)
            and (piece.kind != "gear" or "carrier" in piece.numbers)
            for piece in self.pieces
        )

    @property
    def ground_joints(self) -> dict[str, str]:
        """Names of the joints with the ground, and the name of the attachment on the body."""
        joints = {}
        for piece in self.pieces:
            if piece.kind == "skate":
                joints[piece.name] = "on"
            elif piece.is_joint and piece.a.body is GROUND:
                joints[piece.name] = "b"
        return joints

    def mechanism(
        self, frame: Similarity | None = None, order: Random | None = None
    ) -> bd.Mechanism:
        """Build the mechanism, its parts in the order of the drawing or shuffled by `order`."""
        frame = frame or Similarity()
        wave = Wave(1.0, self.gravity_share, 3.0)
        mech = bd.Mechanism(gravity=frame.laws(wave, self.gravity, "m/s^2"))
        world = World(mech, frame, self.bodies, {})
        bodies, pieces = list(self.bodies), list(self.pieces)
        if order is not None:
            order.shuffle(bodies)
            order.shuffle(pieces)
        for body in bodies:
            world.parts[body.name] = mech.add(body.part(frame))
        # Friction refers to its joint, which must be added before.
        for piece in sorted(pieces, key=lambda piece: piece.kind == "friction"):
            part = BUILDERS[piece.kind](world, piece.name, piece.a, piece.b, piece.numbers)
            world.parts[piece.name] = mech.add(part)
        return mech


EXTERNAL_FORCES = {"skate", "force", "moment", "load by length", "moving force", "drag", "Rayleigh"}
