"""Descriptions of bodies (bars, disks, particles, beams) and of places on them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from finite_elements import straight_bar
from properties.similarity import Similarity, create_section

import beamdae as bd

GROUND = None
REDUCED_ELEMENTS = 4  # of the finite-element model of a bar

# Settings of beams by name.
THEORIES = {
    "chord": {"frame": "chord"},
    "tangent": {"frame": "tangent"},
    "moderate strain": {"strain": "green"},
    "exact": {"formulation": "exact"},
}


@dataclass(frozen=True)
class Body:
    """Description of a body; `bend` is the angle by which the axis of a beam turns.

    A disk has its center at `start`, and `length` is its radius. The axis of a beam is a `curve`.
    """

    name: str
    kind: str
    start: tuple[float, float]
    heading: float
    length: float
    mass: float
    bend: float = 0.0
    curve: str = "arc"
    profile: str = "rectangle"
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
        if self.is_beam:
            x, y = self.axis.point(u * self.axis.length)
            return float(x), float(y)
        if self.kind == "reduced":
            u, w = self.node(u) / REDUCED_ELEMENTS, 0.0
        along, left = u * self.length, w * self.length
        x = self.start[0] + c * along - s * left
        return float(x), float(self.start[1] + s * along + c * left)

    def node(self, u: float) -> int:
        """Return the node of a reduced body near a fraction of the length."""
        return round(u * REDUCED_ELEMENTS)

    @cached_property
    def axis(self):
        """Axis of a beam in the drawing, before the similarity transformation."""
        return CURVES[self.curve](self, Similarity())

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
        if self.kind == "reduced":
            heading, uniform = frame.heading(self.heading), replace(self, profile="rectangle")
            section = create_section(frame, uniform, length)
            matrices = straight_bar(section, length, REDUCED_ELEMENTS, heading, start)
            more = {"damping": frame.number(self.damping, "s")} | moving
            ends = (0, REDUCED_ELEMENTS)
            return bd.ReducedBody.from_matrices(self.name, *matrices, ends, modes=2, **more)
        axis = CURVES[self.curve](self, frame)
        section = create_section(frame, self, axis.length)
        theory = THEORIES[self.theory]
        return bd.Beam(self.name, axis, section, elements=self.elements, **theory, **moving)


def line(body, frame):
    c, s = body.length * np.cos(body.heading), body.length * np.sin(body.heading)
    return bd.Line(frame.point(*body.start), frame.point(body.start[0] + c, body.start[1] + s))


def arc(body, frame, share=1.0):
    length, bend = frame.number(body.length, "m"), frame.sense * body.bend
    start, heading = frame.point(*body.start), frame.heading(body.heading)
    return bd.Arc(length / bend, share * length, start, heading)


def parabola(body, frame):
    span, bend = frame.number(body.length, "m"), frame.sense * body.bend
    start, heading = frame.point(*body.start), frame.heading(body.heading)
    return bd.Parabola(span, 0.2 * bend * span, start, heading)


def spline(body, frame):
    """Return a curve through points of an arc."""
    drawn = arc(body, Similarity())
    points = drawn.point(np.linspace(0.0, drawn.length, 7))
    return bd.Curve(points=[frame.point(*point) for point in points.tolist()])


def clothoid(body, frame):
    length, bend = frame.number(body.length, "m"), frame.sense * body.bend
    start, heading = frame.point(*body.start), frame.heading(body.heading)
    return bd.IntrinsicCurve(lambda s: 2.0 * bend * s / length**2, length, start, heading)


def segment(body, frame):
    return bd.Segment(arc(body, frame, 1.2), 0.0, frame.number(body.length, "m"))


CURVES = {
    "line": line,
    "arc": arc,
    "parabola": parabola,
    "spline": spline,
    "clothoid": clothoid,
    "segment": segment,
}


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
        if body.kind == "reduced":
            return part.at(body.node(place.u))
        return part.at(*self.frame.point(*body.point(place.u, place.w)))
