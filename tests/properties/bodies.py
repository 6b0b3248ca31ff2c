"""Descriptions of bodies (bars, disks, particles, beams) and of places on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from properties.similarity import Similarity, create_section

import beamdae as bd

GROUND = None

# Settings of beams by name.
THEORIES = {
    "chord": {"frame": "chord"},
    "tangent": {"frame": "tangent"},
    "exact strain": {"strain": "exact"},
    "exact": {"formulation": "exact"},
}


@dataclass(frozen=True)
class Body:
    """Description of a body; `bend` is the angle by which the axis of a beam turns.

    A disk has its center at `start`, and `length` is its radius.
    """

    name: str
    kind: str
    start: tuple[float, float]
    heading: float
    length: float
    mass: float
    bend: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    spin: float = 0.0
    modulus: float = 1e8
    height: float = 0.02
    damping: float = 0.0
    elements: int = 1
    theory: str = "chord"

    @property
    def is_beam(self) -> bool:
        return self.kind == "beam"

    @property
    def turns(self) -> bool:
        return self.kind != "particle"

    def point(self, u: float, w: float = 0.0) -> tuple[float, float]:
        """Return the point at fraction `u` of the length and offset `w` to the left."""
        c, s = np.cos(self.heading), np.sin(self.heading)
        if self.kind == "particle":
            return self.start
        if self.is_beam and self.bend:
            radius, angle = self.length / self.bend, self.heading + u * self.bend
            x = self.start[0] + radius * (np.sin(angle) - s)
            return float(x), float(self.start[1] - radius * (np.cos(angle) - c))
        along, left = u * self.length, 0.0 if self.is_beam else w * self.length
        x = self.start[0] + c * along - s * left
        return float(x), float(self.start[1] + s * along + c * left)

    def part(self, frame: Similarity):
        start = frame.point(*self.start)
        moving = {
            "velocity": frame.way(*self.velocity, "m/s"),
            "angular_velocity": frame.turn(self.spin, "rad/s"),
        }
        mass, length = frame.number(self.mass, "kg"), frame.number(self.length, "m")
        if self.kind == "particle":
            return bd.PointMass(self.name, mass, at=start, velocity=moving["velocity"])
        if self.kind == "disk":
            return bd.RigidBody.disk(self.name, start, length, mass=mass, **moving)
        if self.kind == "bar":
            end = frame.point(*self.point(1.0))
            return bd.RigidBody.rod(self.name, start, end, mass=mass, **moving)
        heading, bend = frame.heading(self.heading), frame.sense * self.bend
        if bend:
            axis = bd.Arc(length / bend, length, start, heading)
        else:
            axis = bd.Line(start, frame.point(*self.point(1.0)))
        section = create_section(frame, self.modulus, 0.03, self.height, self.damping)
        theory = THEORIES[self.theory]
        return bd.Beam(self.name, axis, section, elements=self.elements, **theory, **moving)


@dataclass(frozen=True)
class Place:
    """A place on a body, given by its number, or on the ground, where (u, w) is the point."""

    body: int | None
    u: float = 0.0
    w: float = 0.0


@dataclass(frozen=True)
class World:
    """Mechanism under construction, with its parts by name."""

    mech: bd.Mechanism
    frame: Similarity
    bodies: tuple[Body, ...]
    parts: dict

    def point(self, place: Place) -> tuple[float, float]:
        """Return the point in the drawing, before the similarity transformation."""
        if place.body is GROUND:
            return place.u, place.w
        return self.bodies[place.body].point(place.u, place.w)

    def at(self, place: Place):
        """Return the attachment at a place."""
        if place.body is GROUND:
            return self.mech.ground.at(*self.frame.point(place.u, place.w))
        body = self.bodies[place.body]
        part = self.parts[body.name]
        if body.kind == "particle":
            return part.point
        if body.is_beam:
            return part.at(part.length * place.u)
        return part.at(*self.frame.point(*body.point(place.u, place.w)))
