"""Springs and dampers between two points, and between the angles of two bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from beamdae.errors import BeamdaeError, require_finite, require_non_negative, set_fields
from beamdae.parts.attachments import require_angle
from beamdae.parts.forces.elastic import (
    Deformation,
    ElementResponse,
    ForceElement,
    LinearLaw,
    UserLaw,
)
from beamdae.symbolic.statements import SX, Named, Quantity

# Of the drawn length: where two points meet their distance has no slope, and this much under the
# root gives it one; it is below rounding wherever they are apart.
_COINCIDENT_RATIO = 1e-8


def _elongation(a: Any, b: Any, numbers: Any) -> SX:
    """How much longer than free the distance of two points is."""
    return ca.sqrt(ca.sumsqr(b[0] - a[0]) + numbers[1] ** 2) - numbers[0]


def _displacement(a: Any, b: Any, numbers: Any) -> SX:
    """The way from one point to the other."""
    return b[0] - a[0]


def _relative_angle(a: Any, b: Any, numbers: Any) -> SX:
    """The turn of the second body relative to the first, less the free one."""
    return b[1] - a[1] - numbers[0]


class _SpringLaw(ForceElement):
    """A stiffness, a damping and a preload, or a law in their place."""

    stiffness: float
    damping: float
    preload: float
    law: Callable[..., Any] | None
    energy: Callable[..., Any] | None

    def _keep_numbers(self, size: float) -> None:
        set_fields(
            self,
            stiffness=require_non_negative(self.name, "stiffness", self.stiffness),
            damping=require_non_negative(self.name, "damping", self.damping),
            preload=require_finite(self.name, "preload", self.preload),
        )
        if self.law is None:
            if self.energy is not None:
                raise BeamdaeError(f"{self.name}: energy belongs to a law, give that as well.")
        elif self.stiffness or self.damping or self.preload:
            raise BeamdaeError(
                f"{self.name}: give either a law or stiffness, damping and preload, not both."
            )
        else:
            UserLaw(self.name, 1, self.law, self.energy).require_sound(size)

    @property
    def _response(self) -> tuple[Callable[..., ElementResponse], tuple[float, ...]]:
        if self.law is not None:
            return UserLaw(self.name, 1, self.law, self.energy), ()
        return LinearLaw(1), (self.stiffness, self.damping, self.preload)


@dataclass(frozen=True, eq=False)
class SpringDamper(_SpringLaw):
    """Spring and damper side by side on the line between two points.

    The tension is stiffness e + damping e' + preload, e the elongation beyond the free length;
    tension is positive and draws the points together. Its potential is in the books as strain
    energy. Points that meet have no line between them: there the tension fades within 1e-8 of the
    drawn length, and a spring without free length, preload, damping and law, whose force is
    stiffness times the way between its points, needs no line at all.

    Parameters
    ----------
    name
        Unique name.
    a, b
        The two points.
    stiffness
        [N/m].
    damping
        [N s/m].
    free_length
        [m]; default: the distance of the points in the drawing.
    preload
        Tension at the free length [N].
    law
        Tension [N] as a formula `law(elongation, rate)` in place of the numbers. What is left of it
        at rest is booked as the work of a load, the rest as damping.
    energy
        Potential [J] of the law at rest, a formula of the elongation: then that is booked.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(0.0, -1.0)))
    >>> top = mech.ground.at(0.0, 0.0)
    >>> strut = bd.SpringDamper("strut", top, ball.point, stiffness=50.0, damping=0.1)
    >>> mech.observe("strut", mech.add(strut).force)
    """

    symbol = "spring-damper"
    stiffness: float = 0.0
    damping: float = 0.0
    free_length: float | None = None
    preload: float = 0.0
    law: Callable[..., Any] | None = None
    energy: Callable[..., Any] | None = None

    _forces = (Named("", "N"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        drawn = math.dist(self.a.point, self.b.point)
        free = drawn if self.free_length is None else self.free_length
        set_fields(self, free_length=require_non_negative(self.name, "free_length", free))
        self._keep_numbers(drawn)
        if drawn == 0.0 and not self._needs_no_line:
            raise BeamdaeError(
                f"{self.name}: {self.a} and {self.b} are drawn at one place and have no line "
                "between them; give a spring stiffness alone with free_length=0, or take a Bushing."
            )

    @property
    def _needs_no_line(self) -> bool:
        own = (self.free_length, self.damping, self.preload)
        return self.law is None and not any(own) and self.stiffness > 0.0

    @property
    def _measure(self) -> Callable[..., SX]:
        return _displacement if self._needs_no_line else _elongation

    @property
    def _response(self) -> tuple[Callable[..., ElementResponse], tuple[float, ...]]:
        if self._needs_no_line:
            return LinearLaw(2), (self.stiffness, self.stiffness, 0.0, 0.0, 0.0, 0.0)
        return super()._response

    @property
    def _drawn(self) -> tuple[float, ...]:
        assert self.free_length is not None
        return (self.free_length, _COINCIDENT_RATIO * math.dist(self.a.point, self.b.point))

    @property
    def elongation(self) -> Quantity:
        """How much longer than free it is [m]."""
        return self.observed(Deformation, (Named("", "m"),))


@dataclass(frozen=True, eq=False)
class Spring(SpringDamper):
    """A `SpringDamper` without damper."""

    damping: float = field(default=0.0, init=False, repr=False)


@dataclass(frozen=True, eq=False)
class Damper(SpringDamper):
    """A `SpringDamper` without spring: `damping` [N s/m], or a law whose second number is the rate.

    Its `elongation` is counted from the drawn length.
    """

    stiffness: float = field(default=0.0, init=False, repr=False)
    free_length: float | None = field(default=None, init=False, repr=False)
    preload: float = field(default=0.0, init=False, repr=False)
    energy: Callable[..., Any] | None = field(default=None, init=False, repr=False)


@dataclass(frozen=True, eq=False)
class TorsionSpring(_SpringLaw):
    """Spring and damper between the angles of two bodies.

    The moment stiffness phi + damping phi' + preload resists the growth of phi, the turn of the
    body of `b` relative to that of `a` since the drawing, less the free one; it acts on `a`
    counter-clockwise and on `b` clockwise. Angles are not reduced to one turn.

    Parameters
    ----------
    name
        Unique name.
    a, b
        A point of each of the two bodies.
    stiffness
        [N m/rad].
    damping
        [N m s/rad].
    free_angle
        Turn since the drawing at which it is free [rad].
    preload
        Moment there [N m].
    law, energy
        As of `SpringDamper`: moment [N m] by (angle, rate), potential [J] by the angle.

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

    _forces = (Named("", "N m"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_angle(self.name, self.a)
        require_angle(self.name, self.b)
        set_fields(self, free_angle=require_finite(self.name, "free_angle", self.free_angle))
        self._keep_numbers(1.0)

    @property
    def _measure(self) -> Callable[..., SX]:
        return _relative_angle

    @property
    def _drawn(self) -> tuple[float, ...]:
        return (self.free_angle,)

    @property
    def angle(self) -> Quantity:
        """How far it is turned from where it is free [rad]."""
        return self.observed(Deformation, (Named("", "rad"),))


@dataclass(frozen=True, eq=False)
class TorsionDamper(TorsionSpring):
    """A `TorsionSpring` without spring: `damping` [N m s/rad], or a law of angle and rate."""

    stiffness: float = field(default=0.0, init=False, repr=False)
    free_angle: float = field(default=0.0, init=False, repr=False)
    preload: float = field(default=0.0, init=False, repr=False)
    energy: Callable[..., Any] | None = field(default=None, init=False, repr=False)
