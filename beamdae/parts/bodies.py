"""The ground, rigid bodies and point masses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import BeamdaeError, finite, keep, non_negative, point, positive
from beamdae.parts.attachments import Attachment, require_attachment, require_movable, rotate
from beamdae.parts.part import Drawing, Part, require_name
from beamdae.symbolic.formulas import Formula, combined_kernel, plain
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Named, Piece

Array = np.ndarray


_NO_ROWS = sp.csr_array((0, 0))
_ALL_ROWS = {size: sp.eye_array(size, format="csr") for size in (2, 3)}


def _fixed(q: SX, place: Any) -> tuple[SX, SX]:
    return ca.vertcat(SX(place[0]), place[1]), SX(0)


def _carried(q: SX, arm: Any) -> tuple[SX, SX]:
    return q[:2] + rotate(q[2], arm), q[2]


def _free(q: SX, none: Any) -> tuple[SX, SX]:
    return q, SX(0)


@cache
def _rigid() -> ForceKernel:
    """Inertia and weight of a rigid body; data: mass, inertia, gravity."""
    local = Local(3, 4)
    mass, inertia, weight = local.data[0], local.data[1], local.data[2:]
    force = ca.vertcat(mass * (local.a[:2] - weight), inertia * local.a[2])
    kinetic = 0.5 * (mass * ca.sumsqr(local.v[:2]) + inertia * local.v[2] ** 2)
    energies = ca.vertcat(kinetic, 0, -mass * ca.dot(weight, local.q[:2]))
    return ForceKernel(local, force, energies, reused=True)


def _particle(local: Local, on: Any, own: Callable[[], Any]) -> ForceKernel:
    """Inertia and weight of a particle; its own numbers are mass and gravity."""
    numbers = own()
    mass, weight = numbers[0], ca.vertcat(numbers[1], numbers[2])
    place, _ = on(local.q)
    load = mass * (local.ddot(place) - weight)
    force = ca.jtimes(place, local.q, load, True)
    kinetic = 0.5 * mass * ca.sumsqr(local.dot(place))
    return ForceKernel(local, force, ca.vertcat(kinetic, 0, -mass * ca.dot(weight, place)))


@dataclass(frozen=True, eq=False)
class Ground(Part):
    """The inertial frame; it has no coordinates."""

    name: str = "ground"

    def at(self, x: float, y: float) -> Attachment:
        """The fixed point (x, y) [m]."""
        place = point(self.name, "point", (x, y))
        return Attachment(self, place, 0.0, _NO_ROWS, Formula(_fixed, place))

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """The fixed points something is attached to."""
        return Drawing("ground", list(attached))


@dataclass(frozen=True, eq=False)
class RigidBody(Part):
    """Rigid body with the coordinates (x, y, angle) of its center of mass.

    Parameters
    ----------
    name
        Unique name.
    mass
        Mass [kg].
    inertia
        Moment of inertia about the center of mass [kg m^2].
    center
        Center of mass in the reference drawing [m]; the angle is zero there.
    velocity, angular_velocity
        At the start [m/s], [rad/s]; made consistent with the joints.
    """

    name: str
    mass: float
    inertia: float
    center: tuple[float, float] = (0.0, 0.0)
    velocity: tuple[float, float] = (0.0, 0.0)
    angular_velocity: float = 0.0

    def __post_init__(self) -> None:
        keep(
            self,
            name=require_name("RigidBody", self.name),
            mass=positive(self.name, "mass", self.mass),
            inertia=positive(self.name, "inertia", self.inertia),
            center=point(self.name, "center", self.center),
            velocity=point(self.name, "velocity", self.velocity),
            angular_velocity=finite(self.name, "angular_velocity", self.angular_velocity),
        )

    @property
    def coordinates(self) -> tuple[Named, ...]:
        """Place of the center of mass, and angle."""
        return (Named("x", "m"), Named("y", "m"), Named("angle", "rad"))

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        return np.array([*self.center, 0.0])

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start."""
        return np.array([*self.velocity, self.angular_velocity])

    @property
    def outline(self) -> Array:
        """The center of mass."""
        return np.array([self.center])

    def at(self, x: float, y: float) -> Attachment:
        """The material point at (x, y) of the reference drawing [m]."""
        place = point(self.name, "point", (x, y))
        arm = (place[0] - self.center[0], place[1] - self.center[1])
        return Attachment(self, place, 0.0, _ALL_ROWS[3], Formula(_carried, arm))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Inertia and weight."""
        data = np.array([[self.mass], [self.inertia], [gravity[0]], [gravity[1]]])
        return [ForceStatement(self.name, _rigid(), (Piece(self, _ALL_ROWS[3]),), data)]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """The points where something is attached, and the center if these are fewer than two."""
        places = list(attached)
        center = self.at(*self.center)
        if len(places) < 2 and center.point not in {a.point for a in places}:
            places.append(center)
        return Drawing("rigid", places)


@dataclass(frozen=True, eq=False)
class PointMass(Part):
    """Particle of `mass` [kg]: fixed `on` an attachment, or free and starting `at` a point.

    A free particle has the coordinates (x, y) and can be joined to others by its `.point`; a fixed
    one adds its inertia and weight to the body it sits on.
    """

    name: str
    mass: float
    on: Attachment | None = None
    at: tuple[float, float] | None = None
    velocity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        keep(
            self,
            name=require_name("PointMass", self.name),
            mass=non_negative(self.name, "mass", self.mass),
            velocity=point(self.name, "velocity", self.velocity),
        )
        if (self.on is None) == (self.at is None):
            raise BeamdaeError(f"{self.name}: give either on=an attachment or at=(x, y).")
        if self.on is not None:
            require_movable(self.name, require_attachment(self.name, "on", self.on))
        else:
            keep(self, at=point(self.name, "at", self.at))
            positive(self.name, "mass", self.mass)

    @property
    def coordinates(self) -> tuple[Named, ...]:
        """Place of a free particle."""
        return () if self.at is None else (Named("x", "m"), Named("y", "m"))

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        return np.zeros(0) if self.at is None else np.array(self.at, float)

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start."""
        return np.zeros(0) if self.at is None else np.array(self.velocity, float)

    @property
    def outline(self) -> Array:
        """Where a free particle is."""
        return np.zeros((0, 2)) if self.at is None else np.array([self.at], float)

    @property
    def point(self) -> Attachment:
        """The particle as an attachment; it has no angle of its own."""
        if self.on is not None:
            return self.on
        assert self.at is not None
        free = Formula(_free)
        return Attachment(self, self.at, 0.0, _ALL_ROWS[2], free, has_angle=False)

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Inertia and weight."""
        where = self.point
        own = plain(self.mass, *map(float, gravity))
        kernel, data = combined_kernel(_particle, (where.moved, own), where.size)
        return [ForceStatement(self.name, kernel, (where.piece,), data)]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """A point."""
        return Drawing("point", [self.point])
