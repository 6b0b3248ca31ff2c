"""Friction in joints: regularized Coulomb friction with Stribeck effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from beamdae.errors import (
    BeamdaeError,
    convert_fields,
    format_distinct,
    optional,
    require_finite,
    require_non_negative,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import Attachment, normalize, require_angle, rotate
from beamdae.parts.forces.loads import ForceFormula, PointForce
from beamdae.parts.joints.joint import Joint, Revolute
from beamdae.parts.part import MOMENT, PlacedPoint, RegularizedFriction
from beamdae.symbolic.formula import constant_formula
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    Local,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

# [N]; far below the weight of a cubic micrometer, 1e-14 N. Step counts are those of 1e-3 N.
_DEFAULT_SMOOTHING = 1e-18


def _rim_travel(a: Any, b: Any, numbers: Any) -> SX:
    """Return the travel of the rim of a bearing; `numbers[0]` is its radius."""
    (_, rotation_a), (_, rotation_b) = a, b
    return numbers[0] * (rotation_b - rotation_a)


def _guide_travel(a: Any, b: Any, numbers: Any) -> SX:
    """Return the travel along a line fixed to the first body.

    `numbers` are the radius of the guide and the unit vector of the line.
    """
    (position_a, rotation_a), (position_b, _) = a, b
    return ca.dot(rotate(rotation_a, (numbers[1], numbers[2])), position_b - position_a)


def _smooth_magnitude(values: SX, eps: Any) -> SX:
    """Return a smooth approximation of |values|, with error at most eps^2 / (2 |values|)."""
    square = ca.sumsqr(values)
    return square / ca.sqrt(square + eps**2)


@dataclass(frozen=True)
class _FrictionFormula:
    """Formula of friction, and the values "force", "moment" (of a bearing) and "velocity".

    Attributes
    ----------
    travel
        Function (first point, second point, numbers) -> travel [m].
    forces, moments
        Indices of the multipliers that are forces, and of the multipliers that are moments.
    """

    travel: Callable[..., SX]
    forces: tuple[int, ...]
    moments: tuple[int, ...]

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], geometry: Any, law: Any
    ) -> tuple[ForceKernel, Mapping[str, SX]]:
        travel, radius = self.travel(*points, geometry()), geometry()[0]
        smoothing, *numbers = ca.vertsplit(law())
        velocity = local.dot(travel)
        normal_force = _smooth_magnitude(local.lam[list(self.forces)], smoothing)
        if self.moments:
            moments = local.lam[list(self.moments)]
            normal_force += _smooth_magnitude(moments, smoothing * radius) / radius
        friction = friction_force(velocity, normal_force, *numbers)
        force = ca.jtimes(travel, local.q, friction, True)
        values = {"force": -friction, "moment": -friction * radius, "velocity": velocity}
        return ForceKernel(local, force, powers=ca.vertcat(0, friction * velocity)), values


@dataclass(frozen=True, eq=False)
class Friction(PointForce):
    """Regularized Coulomb friction in a hinge or a guide, with Stribeck effect.

    F = coefficient |N| tanh(v / friction_speed) (1 + (static / coefficient - 1)
    exp(-(v / stribeck)^2)), where v is the sliding velocity and N the reaction of the joint. In a
    `Revolute`, v is the velocity of the rim of the bearing, and F acts at the radius of the
    bearing. In a guide (`PointOnLine`, `Prismatic` and other joints with a `slide_direction`), v is
    the velocity along that direction. A moment M of the guide adds |M| / radius to the normal
    force, where radius is half the length of the guide. Below the regularization velocity, friction
    decreases to zero, so a sticking contact creeps.

    Stribeck effect as in Olsson, Astrom, Canudas de Wit, Gafvert & Lischinsky, Eur. J. Control 4
    (1998) 176.

    Parameters
    ----------
    name, joint
        Unique name, and the joint with friction.
    coefficient
        Kinetic coefficient of friction [-].
    friction_speed
        Sliding velocity [m/s] at which friction reaches 76 % of its full value. At a reversal,
        integrators need steps of about this velocity divided by the acceleration.
    static, stribeck
        Static coefficient of friction [-], and the velocity scale [m/s] of the decrease from the
        static to the kinetic coefficient. If both are omitted, the coefficient does not depend on
        the velocity. `friction_speed` should be at most 1/200 of `stribeck`: the largest friction
        is then up to 0.1 % below the static friction, with 1/50 up to 0.7 %, with 1/20 up to 3 %.
        Errors of forces are ten times as large near self-locking.
    radius
        Radius of the bearing, or half the length of a guide that carries a moment [m]; required for
        these joints, and not accepted for others.
    smoothing
        Reaction [N] below which the magnitude |N| is smoothed. The error of the magnitude is at
        most smoothing^2 / (2 |N|); choose a value far below the reactions that matter.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `joint` is neither a hinge nor a guide, a body of a hinge is a
        particle, `coefficient` is negative, another number is not positive, only one of `static`
        and `stribeck` is given, `static` is less than `coefficient` or combined with
        `coefficient=0`, or `radius` is missing or not accepted.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> block = mech.add(bd.RigidBody("block", mass=1.0, inertia=0.01, velocity=(2.0, 0.0)))
    >>> guide = bd.Prismatic("guide", mech.ground.at(0.0, 0.0), block.at(0.0, 0.0))
    >>> rub = bd.Friction("rub", mech.add(guide), 0.2, friction_speed=1e-3, radius=0.1)
    """

    name: str
    joint: Joint
    coefficient: float
    friction_speed: float
    static: float | None = None
    stribeck: float | None = None
    radius: float | None = None
    smoothing: float = _DEFAULT_SMOOTHING

    def __post_init__(self) -> None:
        convert_fields(self)
        name = self.name
        is_joint = isinstance(self.joint, Joint)
        if not (is_joint and (self._is_bearing or self.joint.slide_direction is not None)):
            raise BeamdaeError(
                f"{name}: joint must be a rotating or sliding joint such as Revolute "
                f"or PointOnLine, got {short_repr(self.joint)}."
            )
        if self._is_bearing:
            # A particle does not rotate, so that a moment would have no effect on it.
            require_angle(name, self.joint.a)
            require_angle(name, self.joint.b)
        convert_fields(
            self,
            friction_speed=require_positive,
            smoothing=require_positive,
            coefficient=require_non_negative,
        )
        static, stribeck = require_stribeck(
            name, "coefficient", self.coefficient, self.static, self.stribeck
        )
        set_fields(self, static=static, stribeck=stribeck)
        self._check_radius()

    def _check_radius(self) -> None:
        needs_radius = self._is_bearing or bool(self._multipliers_in("N m"))
        if needs_radius and self.radius is None:
            meaning = (
                "radius of the bearing" if self._is_bearing else "half the length of the guide"
            )
            raise BeamdaeError(
                f"{self.name}: friction in {self.joint.name} requires radius= ({meaning})."
            )
        if not needs_radius and self.radius is not None:
            raise BeamdaeError(
                f"{self.name}: radius does not apply to {self.joint.name}, which "
                "carries no moment; omit radius."
            )
        convert_fields(self, radius=optional(require_positive))

    @property
    def _is_bearing(self) -> bool:
        return isinstance(self.joint, Revolute)

    def _multipliers_in(self, unit: str) -> tuple[int, ...]:
        return tuple(k for k, x in enumerate(self.joint.multipliers) if x.unit == unit)

    @property
    def _formula(self) -> ForceFormula:
        travel = _rim_travel if self._is_bearing else _guide_travel
        return _FrictionFormula(travel, self._multipliers_in("N"), self._multipliers_in("N m"))

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        # A bearing has no direction; its kernel ignores this default.
        direction = self.joint.slide_direction or (1.0, 0.0)
        law = self.coefficient, self.friction_speed, self.static, self.stribeck
        return (
            constant_formula(1.0 if self.radius is None else self.radius, *normalize(direction)),
            constant_formula(self.smoothing, *friction_numbers(*law)),
        )

    @property
    @rebuilt_for_mesh
    def reaction(self) -> Quantity:
        """Friction force F [N] or moment M [N m] on the body of `joint.b`, and sliding velocity v.

        The unit of v is m/s.
        """
        kind, first = ("moment", MOMENT) if self._is_bearing else ("force", Variable("F", "N"))
        return self._observe_values({kind: first, "velocity": Variable("v", "m/s")})

    @property
    def regularized_friction(self) -> RegularizedFriction | None:
        """Regularization of the friction; None without friction."""
        return RegularizedFriction(self.friction_speed, self.radius) if self.coefficient else None

    @property
    def points(self) -> dict[str, Attachment]:
        """Both points of the joint, by the names "a" and "b"."""
        return {"a": self.joint.a, "b": self.joint.b}

    @property
    def _joint(self) -> Joint:
        return self.joint


def friction_numbers(
    coefficient: float, friction_speed: float, static: float | None, stribeck: float | None
) -> tuple[float, ...]:
    """Return the numbers that `friction_force` takes after the normal force."""
    if static is None or stribeck is None:
        return coefficient, friction_speed
    return coefficient, friction_speed, static / coefficient - 1.0, stribeck


def friction_force(
    velocity: SX, normal_force: SX, coefficient: SX, friction_speed: SX, *stribeck: SX
) -> SX:
    """Return the regularized friction; `stribeck` are the relative peak and the velocity of it."""
    force = coefficient * normal_force * ca.tanh(velocity / friction_speed)
    if stribeck:
        peak, speed = stribeck
        force *= 1.0 + peak * ca.exp(-((velocity / speed) ** 2))
    return force


def require_stribeck(
    part: str, name: str, kinetic: float, static: Any, stribeck: Any
) -> tuple[float | None, float | None]:
    """Return the static coefficient of friction and the Stribeck velocity [m/s], or None twice.

    Raises
    ------
    BeamdaeError
        If only one of them is given, a number is invalid, or the static coefficient is less than
        the kinetic coefficient, whose argument is called `name`, or combined with zero.
    """
    if (static is None) != (stribeck is None):
        raise BeamdaeError(
            f"{part}: static and stribeck must be given together; pass both or neither."
        )
    if static is None:
        return None, None
    static = require_finite(part, "static", static)
    stribeck = require_positive(part, "stribeck", stribeck)
    if not static >= kinetic > 0.0:
        static_text, kinetic_text = format_distinct(static, kinetic)
        raise BeamdaeError(
            f"{part}: static must be at least {name}, and {name} must be positive, got "
            f"{static_text} and {kinetic_text}."
        )
    return static, stribeck
