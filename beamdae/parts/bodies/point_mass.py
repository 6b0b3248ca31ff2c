"""Point masses, free or fixed to a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    optional,
    require_non_negative,
    require_point,
    require_positive,
)
from beamdae.parts.attachments import Attachment, require_movable
from beamdae.parts.part import Drawing, Part
from beamdae.read_only import read_only
from beamdae.symbolic.formula import Formula, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Variable

Array = np.ndarray

_ALL_ROWS = read_only(sp.eye_array(2, format="csr"))


def _free_particle(q: SX, numbers: Any) -> tuple[SX, SX]:
    return q, SX(0)


def _particle_kernel(local: Local, on: Any, constants: Callable[[], Any]) -> ForceKernel:
    """Return the inertia and weight of a particle; the constants are mass and gravity."""
    numbers = constants()
    mass, gravity = numbers[0], ca.vertcat(numbers[1], numbers[2])
    position, _ = on(local.q)
    load = mass * (local.ddot(position) - gravity)
    force = ca.jtimes(position, local.q, load, True)
    kinetic = 0.5 * mass * ca.sumsqr(local.dot(position))
    return ForceKernel(local, force, ca.vertcat(kinetic, 0, -mass * ca.dot(gravity, position)))


@dataclass(frozen=True, eq=False)
class PointMass(Part):
    """Particle, either fixed `on` an attachment or free, starting `at` a point.

    A free particle has the coordinates (x, y) and is joined to other parts by its `.point`. A fixed
    particle adds its inertia and weight to the body of the attachment.

    Parameters
    ----------
    name
        Unique name.
    mass
        Mass [kg]; may be zero for a fixed particle.
    on
        Attachment that carries a fixed particle.
    at
        Initial position (x, y) of a free particle [m].
    velocity
        Initial velocity (vx, vy) of a free particle [m/s]. Kept if the joints allow it, also if it
        is zero. By default, the particle follows the joints. A fixed particle moves with the part
        that carries it.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `mass` is negative, or zero for a free particle, not exactly one of
        `on` and `at` is given, `on` is not an attachment or belongs to the ground, or `at` or
        `velocity` is not a pair of finite numbers, or a fixed particle has a velocity.

    Examples
    --------
    >>> import beamdae as bd
    >>> ball = bd.PointMass("ball", 0.2, at=(0.0, 1.0), velocity=(3.0, 0.0))
    """

    name: str
    mass: float
    on: Attachment | None = None
    at: tuple[float, float] | None = None
    velocity: tuple[float, float] | None = None

    point_syntax = "its .point, if it is free"

    def __post_init__(self) -> None:
        convert_fields(self, mass=require_non_negative, velocity=optional(require_point))
        if (self.on is None) == (self.at is None):
            raise BeamdaeError(f"{self.name}: pass either on= (an attachment) or at=(x, y).")
        if self.on is not None:
            convert_fields(self, on=require_movable)
            if self.velocity is not None:
                raise BeamdaeError(
                    f"{self.name}: a mass on {self.on} has no velocity of its own; pass velocity= "
                    "of the part that carries it, or start= of the run with velocities by name."
                )
        else:
            convert_fields(self, at=require_point)
            require_positive(self.name, "mass", self.mass)

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Name and unit of x and y of a free particle; empty for a fixed particle."""
        return () if self.at is None else (Variable("x", "m"), Variable("y", "m"))

    @property
    def initial_position(self) -> Array:
        """Position of a free particle in the reference configuration, (2,) [m]; empty if fixed."""
        return np.zeros(0) if self.at is None else np.array(self.at, float)

    @property
    def initial_velocity(self) -> Array:
        """Initial velocity of a free particle, (2,) [m/s]; empty if fixed."""
        return np.zeros(0) if self.at is None else np.array(self.velocity or (0.0, 0.0))

    @property
    def outline(self) -> Array:
        """Position of a free particle, shape (1, 2) [m]; shape (0, 2) if the particle is fixed."""
        return np.zeros((0, 2)) if self.at is None else np.array([self.at], float)

    @property
    def point(self) -> Attachment:
        """Attachment of a free particle, which has no angle, or the attachment `on`."""
        if self.on is not None:
            return self.on
        assert self.at is not None
        kinematics = Formula(_free_particle)
        return Attachment(self, self.at, 0.0, _ALL_ROWS, kinematics, has_angle=False)

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return inertia and weight as one statement."""
        point = self.point
        constants = constant_formula(self.mass, *map(float, gravity))
        kernel, data = build_formula_kernel(
            _particle_kernel, (point.checked_kinematics, constants), point.size
        )
        return [ForceStatement(self.name, kernel, (point.piece,), data)]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """Return the drawing of the particle as a point."""
        return Drawing("point", [self.point])
