"""Bushings: elastic connections between two bodies in all directions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import convert_fields, require_finite, require_non_negative, set_fields
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.forces.force_element import ForceElement
from beamdae.parts.point_parts import LOAD
from beamdae.symbolic.statements import SX, Quantity, Variable

# Typical deformation at which a user's energy and law are compared [m] or [rad].
_TYPICAL_DEFORMATION = 1e-2


def _bushing_displacement(a: Any, b: Any, numbers: Any) -> SX:
    """Return the displacement in the axes of the bushing, and the relative rotation.

    `numbers` are the angle of the axes and the components of b - a along these axes, all in the
    reference configuration.
    """
    (position_a, rotation_a), (position_b, rotation_b) = a, b
    vector = rotate(-rotation_a - numbers[0], position_b - position_a)
    displacement = vector - ca.vertcat(numbers[1], numbers[2])
    return ca.vertcat(displacement, rotation_b - rotation_a)


@dataclass(frozen=True, eq=False)
class Bushing(ForceElement):
    """Elastic, damped connection between two points along two axes and in rotation.

    The deformation is the displacement (x, y) of point `b` from the reference configuration, in
    axes fixed to the body of `a`, and the rotation of `b` relative to `a`. The forces act on the
    body of `b` at point `b`, and the opposite forces on the body of `a` at the same position. The
    potential is part of the strain energy.

    Parameters
    ----------
    name
        Unique name.
    a, b
        The two points; they need not coincide in the reference configuration.
    kx, ky
        Stiffnesses along the axes of the bushing [N/m].
    ktheta
        Torsional stiffness [N m/rad].
    cx, cy
        Damping coefficients along the axes of the bushing [N s/m].
    ctheta
        Torsional damping coefficient [N m s/rad].
    angle
        Angle of the x axis in the reference configuration [rad]; the axes rotate with the body or
        section of `a`. Defaults to the angle of the section if `a` is on a beam, otherwise to zero.
    law
        Formula `law(deformation, rate)` in place of the coefficients, with the deformation
        (x, y, rotation) [m, m, rad] and its rate. The law returns (Fx, Fy, M) [N, N, N m], which
        oppose an increase of the deformation. The energy balance treats the law as in
        `Spring`.
    energy
        Potential [J] of the law at zero rate, a formula of the deformation.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, neither can move, a
        coefficient is negative or not finite, or `angle` is not finite; if `law` is combined with a
        coefficient or is not a continuous formula that returns three numbers; or if `energy` is
        given without `law`, is not a continuous formula that returns one number, or has a gradient
        that differs from the law at zero rate.

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

    _force_columns = LOAD
    _coefficients = ("kx", "ky", "ktheta", "cx", "cy", "ctheta")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        convert_fields(self, **dict.fromkeys(self._coefficients, require_non_negative))
        angle = self.a.inclination if self.angle is None else self.angle
        set_fields(self, angle=require_finite(self.name, "angle", angle))
        self._require_law(_TYPICAL_DEFORMATION)

    @property
    def _deformation(self) -> Callable[..., SX]:
        return _bushing_displacement

    @property
    def _deformation_numbers(self) -> tuple[float, ...]:
        assert self.angle is not None
        c, s = float(np.cos(self.angle)), float(np.sin(self.angle))
        x, y = np.subtract(self.b.point, self.a.point).tolist()
        return (self.angle, c * x + s * y, c * y - s * x)

    @property
    def displacement(self) -> Quantity:
        """Displacement (x, y) [m] along the axes of the bushing, and relative rotation [rad]."""
        columns = (Variable("x", "m"), Variable("y", "m"), Variable("turn", "rad"))
        return self._observe_columns("deformation", columns)
