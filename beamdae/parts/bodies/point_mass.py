"""Point masses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    BeamdaeError,
    require_name,
    require_non_negative,
    require_point,
    require_positive,
    set_fields,
)
from beamdae.parts.attachments import Attachment, require_attachment, require_movable
from beamdae.parts.part import Drawing, Part
from beamdae.symbolic.formulas import Formula, build_formula_kernel, constant_formula
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Named

Array = np.ndarray

_ALL_ROWS = sp.eye_array(2, format="csr")


def _free(q: SX, none: Any) -> tuple[SX, SX]:
    return q, SX(0)


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
class PointMass(Part):
    """Particle of `mass` [kg]: fixed `on` an attachment, or free and starting `at` a point.

    A free particle has the coordinates (x, y) and can be joined to others by its `.require_point`; a fixed
    one adds its inertia and weight to the body it sits on.

    Examples
    --------
    >>> import beamdae as bd
    >>> ball = bd.PointMass("ball", 0.2, at=(0.0, 1.0), velocity=(3.0, 0.0))
    """

    name: str
    mass: float
    on: Attachment | None = None
    at: tuple[float, float] | None = None
    velocity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        set_fields(
            self,
            name=require_name("PointMass", self.name),
            mass=require_non_negative(self.name, "mass", self.mass),
            velocity=require_point(self.name, "velocity", self.velocity),
        )
        if (self.on is None) == (self.at is None):
            raise BeamdaeError(f"{self.name}: give either on=an attachment or at=(x, y).")
        if self.on is not None:
            require_movable(self.name, require_attachment(self.name, "on", self.on))
        else:
            set_fields(self, at=require_point(self.name, "at", self.at))
            require_positive(self.name, "mass", self.mass)

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
        return Attachment(self, self.at, 0.0, _ALL_ROWS, free, has_angle=False)

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Inertia and weight."""
        where = self.point
        own = constant_formula(self.mass, *map(float, gravity))
        kernel, data = build_formula_kernel(_particle, (where.checked_kinematics, own), where.size)
        return [ForceStatement(self.name, kernel, (where.piece,), data)]

    def draw(self, attached: Sequence[Attachment], points: int) -> Drawing:
        """A point."""
        return Drawing("point", [self.point])
