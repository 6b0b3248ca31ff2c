"""What draws at random: numbers as somebody would write them, bodies and places on them."""

from __future__ import annotations

from dataclasses import dataclass, field
from random import Random

import numpy as np
from properties.bodies import GROUND, THEORIES, Body, Place, World
from properties.drawings import Piece
from properties.frames import Frame, Wave


@dataclass
class Pencil:
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
        return World(None, Frame(), tuple(self.bodies), {})

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
