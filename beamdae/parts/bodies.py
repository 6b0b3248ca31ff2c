"""Attachments, the ground, rigid bodies and point masses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import BeamdaeError, finite, non_negative, point, positive
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Piece

Array = np.ndarray


class Body(Protocol):
    """What a mechanism asks of a body: coordinates and the forces it states in them."""

    name: str

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """One name a coordinate."""

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing, shape (size,)."""

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start, shape (size,); made consistent with the joints later."""

    @property
    def outline(self) -> Array:
        """Points (n, 2) of the reference drawing that tell how large the body is [m]."""

    def force_statements(self, gravity: Array) -> list[ForceStatement]:
        """The body's inertia, elasticity, damping and weight."""


@dataclass(frozen=True, eq=False, repr=False)
class Attachment:
    """A material point of a body, named by where it sits in the reference drawing.

    Attributes
    ----------
    body
        The body it belongs to.
    point
        Its place (x, y) in the reference drawing [m].
    inclination
        Angle of the section (or the body) there in the reference drawing [rad].
    operator
        Rows that pick its local coordinates from those of the body.
    kinematics
        Local coordinates -> (position in the inertial frame, turn since the reference drawing).
    """

    body: Any
    point: tuple[float, float]
    inclination: float
    operator: sp.csr_array
    kinematics: Callable[[SX], tuple[SX, SX]]

    @property
    def size(self) -> int:
        """Number of local coordinates."""
        return self.operator.shape[0]

    @property
    def piece(self) -> Piece:
        """Where the local coordinates come from."""
        return Piece(self.body, self.operator)

    def position(self, q: SX) -> SX:
        """Position (x, y) in the inertial frame [m] from the local coordinates."""
        return self.kinematics(q)[0]

    def turn(self, q: SX) -> SX:
        """Rotation of the section since the reference drawing [rad] from the local coordinates."""
        return self.kinematics(q)[1]

    def __repr__(self) -> str:
        return f"{self.body.name} at ({self.point[0]:.6g}, {self.point[1]:.6g})"


def require_attachment(part: str, name: str, value: Any) -> Attachment:
    """Return `value` if it is an attachment."""
    if not isinstance(value, Attachment):
        raise BeamdaeError(f"{part}: {name} must be an attachment such as beam.end, got {value!r}.")
    return value


def require_angle(part: str, attachment: Attachment) -> None:
    """Refuse a particle where an angle is held, driven or loaded."""
    if isinstance(attachment.body, PointMass):
        raise BeamdaeError(f"{part}: {attachment} is a particle and has no angle.")


def rotate(angle: Any, vector: Any) -> SX:
    """The plane vector turned by `angle` [rad]."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])


def require_name(kind: str, name: Any) -> str:
    """Return `name` if it is a text that can name a part."""
    if not isinstance(name, str) or not name.strip():
        raise BeamdaeError(f"{kind}: the name must be a non-empty text, got {name!r}.")
    return name


@dataclass(frozen=True, eq=False)
class Ground:
    """The inertial frame; it has no coordinates."""

    name: str = "ground"

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """One name a coordinate."""
        return ()

    @property
    def initial_position(self) -> Array:
        """Coordinates in the reference drawing."""
        return np.zeros(0)

    @property
    def initial_velocity(self) -> Array:
        """Their rates at the start."""
        return np.zeros(0)

    @property
    def outline(self) -> Array:
        """Points (n, 2) of the reference drawing that tell how large the body is [m]."""
        return np.zeros((0, 2))

    def force_statements(self, gravity: Array) -> list[ForceStatement]:
        """What the part adds to the equations of motion."""
        return []

    def at(self, x: float, y: float) -> Attachment:
        """The fixed point (x, y) [m]."""
        place = point(self.name, "point", (x, y))
        return Attachment(
            self, place, 0.0, sp.csr_array((0, 0)), lambda q: (SX(list(place)), SX(0))
        )


@dataclass(frozen=True, eq=False)
class RigidBody:
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
        require_name("RigidBody", self.name)
        positive(self.name, "mass", self.mass)
        positive(self.name, "inertia", self.inertia)
        point(self.name, "center", self.center)
        point(self.name, "velocity", self.velocity)
        finite(self.name, "angular_velocity", self.angular_velocity)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """One name a coordinate."""
        return ("x", "y", "angle")

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
        """Points (n, 2) of the reference drawing that tell how large the body is [m]."""
        return np.array([self.center])

    def at(self, x: float, y: float) -> Attachment:
        """The material point at (x, y) of the reference drawing [m]."""
        place = point(self.name, "point", (x, y))
        arm = np.subtract(place, self.center)
        return Attachment(
            self,
            place,
            0.0,
            sp.eye_array(3, format="csr"),
            lambda q: (q[:2] + rotate(q[2], arm), q[2]),
        )

    def force_statements(self, gravity: Array) -> list[ForceStatement]:
        """What the part adds to the equations of motion."""
        local = Local(3, 4)
        mass, inertia, weight = local.data[0], local.data[1], local.data[2:]
        force = ca.vertcat(mass * (local.a[:2] - weight), inertia * local.a[2])
        kinetic = 0.5 * (mass * ca.sumsqr(local.v[:2]) + inertia * local.v[2] ** 2)
        energies = ca.vertcat(kinetic, 0, -mass * ca.dot(weight, local.q[:2]))
        data = np.array([[self.mass], [self.inertia], [gravity[0]], [gravity[1]]])
        piece = Piece(self, sp.eye_array(3, format="csr"))
        return [ForceStatement(self.name, ForceKernel(local, force, energies), (piece,), data)]


@dataclass(frozen=True, eq=False)
class PointMass:
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
        require_name("PointMass", self.name)
        non_negative(self.name, "mass", self.mass)
        point(self.name, "velocity", self.velocity)
        if (self.on is None) == (self.at is None):
            raise BeamdaeError(f"{self.name}: give either on=an attachment or at=(x, y).")
        if self.on is not None:
            require_attachment(self.name, "on", self.on)
        else:
            point(self.name, "at", self.at)
            positive(self.name, "mass", self.mass)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """One name a coordinate."""
        return () if self.on is not None else ("x", "y")

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
        """Points (n, 2) of the reference drawing that tell how large the body is [m]."""
        return np.zeros((0, 2)) if self.at is None else np.array([self.at], float)

    @property
    def point(self) -> Attachment:
        """The particle as an attachment; it has no angle of its own."""
        if self.on is not None:
            return self.on
        assert self.at is not None
        return Attachment(self, self.at, 0.0, sp.eye_array(2, format="csr"), lambda q: (q, SX(0)))

    def force_statements(self, gravity: Array) -> list[ForceStatement]:
        """What the part adds to the equations of motion."""
        where = self.point
        local = Local(where.size, 3)
        mass, weight = local.data[0], local.data[1:]
        place = where.position(local.q)
        load = mass * (local.ddot(place) - weight)
        force = ca.jtimes(place, local.q, load, True)
        kinetic = 0.5 * mass * ca.sumsqr(local.dot(place))
        energies = ca.vertcat(kinetic, 0, -mass * ca.dot(weight, place))
        data = np.array([[self.mass], [gravity[0]], [gravity[1]]])
        kernel = ForceKernel(local, force, energies)
        return [ForceStatement(self.name, kernel, (where.piece,), data)]
