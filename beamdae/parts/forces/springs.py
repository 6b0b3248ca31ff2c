"""Springs, dampers and bushings between two points, and torsion springs between two bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    require_finite,
    require_non_negative,
    set_fields,
)
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.forces.force_element import (
    ElementResponse,
    ForceElement,
    LinearLaw,
)
from beamdae.parts.part import LOAD
from beamdae.symbolic.statements import SX, Quantity, Variable

# Length added under the square root of the distance, relative to the reference length. It makes the
# distance differentiable where the points coincide; elsewhere the change is below rounding.
_COINCIDENT_RATIO = 1e-8


def _elongation(a: Any, b: Any, numbers: Any) -> SX:
    """Return the elongation; `numbers` are the free length and the regularization length."""
    (position_a, _), (position_b, _) = a, b
    return ca.sqrt(ca.sumsqr(position_b - position_a) + numbers[1] ** 2) - numbers[0]


def _displacement(a: Any, b: Any, numbers: Any) -> SX:
    (position_a, _), (position_b, _) = a, b
    return position_b - position_a


def _relative_angle(a: Any, b: Any, numbers: Any) -> SX:
    """Return the relative rotation minus the free angle, which is the only entry of `numbers`."""
    (_, rotation_a), (_, rotation_b) = a, b
    return rotation_b - rotation_a - numbers[0]


class _SpringLaw(ForceElement):
    """Force element with stiffness, damping and preload, or with a law instead."""

    stiffness: float
    damping: float
    preload: float
    law: Callable[..., Any] | None
    energy: Callable[..., Any] | None

    _coefficients = ("stiffness", "damping", "preload")

    def _check_law(self, size: float) -> None:
        """Check the coefficients or the law; `size` is the typical size of the deformation."""
        convert_fields(
            self,
            stiffness=require_non_negative,
            damping=require_non_negative,
            preload=require_finite,
        )
        self._require_law(size)


@dataclass(frozen=True, eq=False)
class Spring(_SpringLaw):
    """Spring, damper or both in parallel, along the line between two points.

    The force is stiffness * e + damping * e' + preload, where e is the elongation beyond the free
    length; tension is positive and pulls the points together. The potential is part of the strain
    energy. Where the points coincide, the direction of the force is undefined; the force decreases
    to zero at distances below 1e-8 times the distance in the reference configuration. A spring of
    free length zero without preload, damping or a law has no such singularity: its force is the
    stiffness times the vector between the points.

    Parameters
    ----------
    name
        Unique name.
    a, b
        The two points.
    stiffness
        Stiffness [N/m].
    damping
        Damping coefficient [N s/m].
    free_length
        Free length [m]. Defaults to the distance between the points in the reference configuration.
    preload
        Tension at the free length [N].
    law
        Tension [N] as a formula `law(elongation, rate)` in place of the coefficients, or a `table`
        of the elongation or of both. In the energy balance, the value at zero rate is a load, and
        the remainder is damping.
    energy
        Potential [J] of the law at zero rate, a formula of the elongation. If given, the value at
        zero rate is elastic instead of a load.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment, neither can move, a coefficient or
        `free_length` is negative or not finite, or `preload` is not finite; if the points coincide
        in the reference configuration, unless `stiffness` with `free_length=0` is the only term; if
        `law` is combined with a coefficient or `preload`; if `law` or `energy` is not a continuous
        formula that returns one number; or if `energy` is given without `law` or its derivative
        differs from the law at zero rate.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(0.0, -1.0)))
    >>> top = mech.ground.at(0.0, 0.0)
    >>> strut = bd.Spring("strut", top, ball.point, stiffness=50.0, damping=0.1)
    >>> mech.observe("strut", mech.add(strut).force)
    """

    symbol = "spring-damper"
    stiffness: float = 0.0
    damping: float = 0.0
    free_length: float | None = None
    preload: float = 0.0
    law: Callable[..., Any] | None = None
    energy: Callable[..., Any] | None = None

    _force_columns = (Variable("", "N"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        reference_length = math.dist(self.a.point, self.b.point)
        length = reference_length if self.free_length is None else self.free_length
        set_fields(self, free_length=require_non_negative(self.name, "free_length", length))
        self._check_law(reference_length)
        if reference_length == 0.0 and not self._is_vector_spring:
            raise BeamdaeError(
                f"{self.name}: {self.a} and {self.b} coincide in the reference "
                "configuration, so the direction of the force is undefined; pass only "
                "stiffness with free_length=0, or use a Bushing."
            )

    @property
    def _is_vector_spring(self) -> bool:
        """True if the force is the stiffness times the vector between the points."""
        others = (self.free_length, self.damping, self.preload)
        return self.law is None and not any(others) and self.stiffness > 0.0

    @property
    def _deformation(self) -> Callable[..., SX]:
        return _displacement if self._is_vector_spring else _elongation

    @property
    def _law(self) -> tuple[Callable[..., ElementResponse], tuple[float, ...]]:
        if self._is_vector_spring:
            return LinearLaw(2), (self.stiffness, self.stiffness, 0.0, 0.0, 0.0, 0.0)
        return super()._law

    @property
    def _deformation_numbers(self) -> tuple[float, ...]:
        assert self.free_length is not None
        return (self.free_length, _COINCIDENT_RATIO * math.dist(self.a.point, self.b.point))

    @property
    def elongation(self) -> Quantity:
        """Elongation beyond the free length [m]."""
        return self._observe_columns("deformation", (Variable("", "m"),))


@dataclass(frozen=True, eq=False)
class TorsionSpring(_SpringLaw):
    """Torsion spring, damper or both between two bodies.

    The moment stiffness * phi + damping * phi' + preload opposes an increase of phi, the rotation
    of the body of `b` relative to the body of `a` from the reference configuration, minus the free
    angle. A positive moment acts on `a` counter-clockwise and on `b` clockwise. Angles are not
    reduced to one revolution.

    Parameters
    ----------
    name
        Unique name.
    a, b
        A point of each of the two bodies.
    stiffness
        Torsional stiffness [N m/rad].
    damping
        Torsional damping coefficient [N m s/rad].
    free_angle
        Relative rotation [rad] at which the moment of the stiffness is zero.
    preload
        Moment at the free angle [N m].
    law, energy
        As in `Spring`, for the moment [N m] as a function of angle [rad] and rate [rad/s] and
        the potential [J] as a function of the angle.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `a` or `b` is not an attachment or is a particle, neither can move, a
        coefficient is negative or not finite, or `free_angle` or `preload` is not finite. The
        errors of `law` and `energy` are those of `Spring`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> flap = mech.add(bd.RigidBody("flap", mass=0.3, inertia=1e-3, center=(0.1, 0.0)))
    >>> foot = mech.ground.at(0.0, 0.0)
    >>> spring = bd.TorsionSpring("spring", foot, flap.at(0.0, 0.0), stiffness=2.0, preload=0.5)
    """

    symbol = "torsion spring"
    stiffness: float = 0.0
    damping: float = 0.0
    free_angle: float = 0.0
    preload: float = 0.0
    law: Callable[..., Any] | None = None
    energy: Callable[..., Any] | None = None

    _force_columns = (Variable("", "N m"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        convert_fields(self, free_angle=require_finite)
        self._check_law(1.0)

    @property
    def _deformation(self) -> Callable[..., SX]:
        return _relative_angle

    @property
    def _deformation_numbers(self) -> tuple[float, ...]:
        return (self.free_angle,)

    @property
    def angle(self) -> Quantity:
        """Relative rotation beyond the free angle [rad]."""
        return self._observe_columns("deformation", (Variable("", "rad"),))


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
