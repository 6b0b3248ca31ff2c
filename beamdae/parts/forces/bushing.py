"""Bushings: what holds two bodies together elastically in every direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_finite, require_non_negative, set_fields
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.forces.elastic import (
    Deformation,
    ElementResponse,
    ForceElement,
    LinearLaw,
    UserLaw,
)
from beamdae.symbolic.statements import SX, Named, Quantity

_NUMBERS = ("kx", "ky", "ktheta", "cx", "cy", "ctheta")


def _bushing_displacement(a: Any, b: Any, numbers: Any) -> SX:
    """Displacement since the drawing in axes that turn with the first body, and relative turn."""
    way = rotate(-a[1] - numbers[0], b[0] - a[0])
    return ca.vertcat(way - ca.vertcat(numbers[1], numbers[2]), b[1] - a[1])


@dataclass(frozen=True, eq=False)
class Bushing(ForceElement):
    """Stiffness and damping between two points along and across an axis, and about them.

    Its measure is the displacement (x, y) of the point `b` since the drawing, seen from the body of
    `a`, and the turn of `b` relative to `a`; forces act at `b` and its opposites on the body of
    `a`, at the place of `b`. The potential is in the books as strain energy.

    Parameters
    ----------
    name
        Unique name.
    a, b
        The two points; they may be drawn apart.
    kx, ky
        [N/m], along the axes of `a`.
    ktheta
        [N m/rad].
    cx, cy
        [N s/m].
    ctheta
        [N m s/rad].
    angle
        Of its x axis in the drawing, from where it turns with the body of `a` [rad]; default: the
        direction of the section of a beam, the x axis of the drawing on a rigid body.
    law
        Formula `law(x, rate)` in place of the numbers: (Fx, Fy, M) that resist the growth of
        x = (x, y, turn). Booked as that of `SpringDamper`.
    energy
        Potential [J] of the law at rest, a formula of x.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> motor = mech.add(bd.RigidBody("motor", mass=8.0, inertia=0.1, center=(0.0, 0.1)))
    >>> foot = mech.ground.at(0.0, 0.0)
    >>> mount = bd.Bushing("mount", foot, motor.at(0.0, 0.0), kx=5e4, ky=2e5, ktheta=30.0, cy=200.0)
    """

    symbol = "bushing"
    kx: float = 0.0
    ky: float = 0.0
    ktheta: float = 0.0
    cx: float = 0.0
    cy: float = 0.0
    ctheta: float = 0.0
    angle: float | None = None
    law: Callable[..., Any] | None = None
    energy: Callable[..., Any] | None = None

    _forces = (Named("Fx", "N"), Named("Fy", "N"), Named("M", "N m"))

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        for number in _NUMBERS:
            set_fields(
                self, **{number: require_non_negative(self.name, number, getattr(self, number))}
            )
        angle = self.a.inclination if self.angle is None else self.angle
        set_fields(self, angle=require_finite(self.name, "angle", angle))
        if self.law is None:
            if self.energy is not None:
                raise BeamdaeError(f"{self.name}: energy belongs to a law, give that as well.")
        elif any(getattr(self, number) for number in _NUMBERS):
            raise BeamdaeError(
                f"{self.name}: give either a law or {', '.join(_NUMBERS)}, not both."
            )
        else:
            UserLaw(self.name, 3, self.law, self.energy).require_sound(1e-2)

    @property
    def _measure(self) -> Callable[..., SX]:
        return _bushing_displacement

    @property
    def _response(self) -> tuple[Callable[..., ElementResponse], tuple[float, ...]]:
        if self.law is not None:
            return UserLaw(self.name, 3, self.law, self.energy), ()
        numbers = tuple(float(getattr(self, number)) for number in _NUMBERS)
        return LinearLaw(3), (*numbers, 0.0, 0.0, 0.0)

    @property
    def _drawn(self) -> tuple[float, ...]:
        assert self.angle is not None
        c, s = float(np.cos(self.angle)), float(np.sin(self.angle))
        x, y = np.subtract(self.b.point, self.a.point).tolist()
        return (self.angle, c * x + s * y, c * y - s * x)

    @property
    def displacement(self) -> Quantity:
        """Displacement (x, y) [m] in the axes of `a`, and turn [rad]."""
        columns = (Named("x", "m"), Named("y", "m"), Named("turn", "rad"))
        return self.observed(Deformation, columns)
