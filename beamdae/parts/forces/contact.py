"""Unilateral contact of a point with a line or a circle, with restitution and friction."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import casadi as ca

from beamdae.errors import (
    BeamdaeError,
    NumberWithUnit,
    choice_of,
    convert_fields,
    optional,
    require_between,
    require_finite,
    require_non_negative,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.model_parameters import conversion_factor
from beamdae.parts.attachments import (
    Attachment,
    left_normal,
    require_angle,
    require_attachment,
    require_direction,
    rotate,
)
from beamdae.parts.forces.friction import (
    friction_force,
    friction_numbers,
    require_stribeck,
)
from beamdae.parts.forces.loads import ForceFormula, PointForce
from beamdae.parts.laws import MIN_STEPS_PER_TIME_SCALE, Law, as_law
from beamdae.parts.part import PlacedPoint, RegularizedFriction, SurfaceGap, observe_points
from beamdae.symbolic.formula import constant_formula
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    Local,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

# Length added under the square root of the distance from the center, relative to the radius. It
# makes the distance differentiable at the center.
_CENTER_RATIO = 1e-8


def perpendicular(vector: SX) -> SX:
    """Return the vector rotated counter-clockwise by 90 degrees."""
    return ca.vertcat(-vector[1], vector[0])


def _line_gap(rotation: SX, arm: SX, numbers: Any) -> tuple[SX, SX]:
    """Return the gap and the tangent of a line; `numbers` are the components of its unit normal.

    `arm` is the vector from a point of the line to the contact point.
    """
    normal = rotate(rotation, ca.vertcat(numbers[0], numbers[1]))
    return ca.dot(normal, arm), -perpendicular(normal)


def _circle_gap(rotation: SX, arm: SX, numbers: Any) -> tuple[SX, SX]:
    """Return the gap and the tangent of a circle.

    `arm` is the vector from the center to the contact point; `numbers` are the radius and the
    allowed side, 1 for outside and -1 for inside.
    """
    distance = ca.sqrt(ca.sumsqr(arm) + (_CENTER_RATIO * numbers[0]) ** 2)
    return numbers[1] * (distance - numbers[0]), perpendicular(arm) / distance


@dataclass(frozen=True)
class _SurfaceGap:
    """Smallest distance from a surface, to which the last point belongs, to the other points."""

    surface: Callable[..., tuple[SX, SX]]

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], numbers: Callable[[], Any]
    ) -> SX:
        *others, (root, rotation) = points
        gaps = [self.surface(rotation, x.position - root, numbers())[0] for x in others]
        return ca.mmin(ca.vertcat(*gaps))


class _Surface:
    """Surface fixed to an attachment; the function `kind` returns gap and tangent."""

    on: Attachment
    kind: ClassVar[Callable[..., tuple[SX, SX]]]

    @property
    def numbers(self) -> tuple[float, ...]:
        """Parameters of the surface, passed to the kernel as data."""
        raise NotImplementedError

    @property
    def size(self) -> float:
        """Radius [m]; infinite for a line."""
        return math.inf

    @rebuilt_for_mesh
    def gap(self, point: Attachment) -> Quantity:
        """Return the distance of a point from the surface [m], negative during penetration.

        Parameters
        ----------
        point
            Attachment in contact.

        Returns
        -------
        Quantity
            One column, for observables, events and `impact`.

        Raises
        ------
        BeamdaeError
            If `point` is not an attachment.
        """
        return self.smallest_gap([require_attachment("gap", "point", point)])

    def smallest_gap(self, points: Sequence[Attachment]) -> Quantity:
        """Return the smallest distance of points from the surface [m]."""
        functions, columns = [constant_formula(*self.numbers)], (Variable("", "m"),)
        build, is_smallest = _SurfaceGap(type(self).kind), len(points) > 1
        return observe_points(
            [*points, self.on], build, columns, functions, is_magnitude=is_smallest
        )


@dataclass(frozen=True, eq=False)
class LineSurface(_Surface):
    """Straight line through `on` along `direction`; contact points stay on the left side.

    `bd.LineSurface(mech.ground.at(0, 0))` is a horizontal floor.

    Parameters
    ----------
    on
        Attachment to which the line is fixed; must not be a particle.
    direction
        Direction (x, y) in the reference configuration, of any length but zero.

    Raises
    ------
    BeamdaeError
        If `on` is not an attachment or is a particle, or `direction` is not a nonzero vector.
    """

    on: Attachment
    direction: tuple[float, float] = (1.0, 0.0)

    kind: ClassVar[Callable[..., tuple[SX, SX]]] = _line_gap

    def __post_init__(self) -> None:
        convert_fields(self, on=require_attachment, direction=require_direction)
        require_angle("LineSurface", self.on)

    @property
    def remedy(self) -> str:
        """Clause of a message that explains how to avoid a penetration at the start."""
        x, y = (0.0 - component for component in self.direction)
        return (
            "move the point to the left side of the line, or turn the direction of the line to "
            f"({x:g}, {y:g})"
        )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Left unit normal of the line in the reference configuration."""
        return left_normal(self.direction)


@dataclass(frozen=True, eq=False)
class CircleSurface(_Surface):
    """Circle centered at `on`; contact points stay outside or inside.

    Parameters
    ----------
    on
        Attachment at the center of the circle.
    radius
        Radius [m].
    side
        Allowed side of the contact points: "outside" (default) or "inside".

    Raises
    ------
    BeamdaeError
        If `on` is not an attachment, `radius` is not positive, or `side` is unknown.
    """

    on: Attachment
    radius: float
    side: str = "outside"

    kind: ClassVar[Callable[..., tuple[SX, SX]]] = _circle_gap

    def __post_init__(self) -> None:
        side = choice_of("outside", "inside")
        convert_fields(self, on=require_attachment, radius=require_positive, side=side)

    @property
    def size(self) -> float:
        """Radius [m]."""
        return self.radius

    @property
    def remedy(self) -> str:
        """Clause of a message that explains how to avoid a penetration at the start."""
        other_side = "inside" if self.side == "outside" else "outside"
        return (
            "move the point to where the distance from the center is "
            f"{'more' if self.side == 'outside' else 'less'} than {self.radius:g} m, or set "
            f'side="{other_side}"'
        )

    @property
    def numbers(self) -> tuple[float, ...]:
        """Radius [m], and the allowed side: 1 for outside, -1 for inside."""
        return (self.radius, 1.0 if self.side == "outside" else -1.0)


# Default regularization velocity [m/s], and its recommended fraction of the Stribeck velocity. With
# this fraction, the largest friction is up to 0.1 % below the static friction, and the normal force
# of an arm at 92 % of self-locking is 0.7 % too small; with a twentieth, it is 17 % too small, and
# adaptive integrators need 0.7 to 1 times the steps.
_DEFAULT_FRICTION_SPEED = 1e-4
_RECOMMENDED_STRIBECK_SHARE = 0.005
# The coefficient of restitution must lie in [_MIN_RESTITUTION, 1].
_MIN_RESTITUTION = 0.05
_MIN_EXPONENT = 1.0
_MAX_EXPONENT = 10.0
# Difference of the restitution from 1 below which the hysteresis factor is computed from its
# series, which is then as accurate as the equation, whose error is dominated by rounding.
_MAX_SERIES_LOSS = 1e-5
# Number of bisection steps, more than enough to converge to rounding.
_MAX_BISECTIONS = 200


@dataclass(frozen=True)
class _ContactFormula:
    """Formula of a contact, and the values "normal", "friction" and "slip".

    Attributes
    ----------
    surface
        Function (rotation, vector from the attachment to the point, numbers) -> (gap, tangent).
    """

    surface: Callable[..., tuple[SX, SX]]

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], surface_numbers: Any, numbers: Any
    ) -> tuple[ForceKernel, Mapping[str, SX]]:
        (position, _), (root, rotation) = points
        arm = position - root
        gap, tangent = self.surface(rotation, arm, surface_numbers())
        surface_velocity = local.dot(root) + local.dot(rotation) * perpendicular(arm)
        slip = ca.dot(tangent, local.dot(position) - surface_velocity)
        stiffness, exponent, hysteresis, *law = ca.vertsplit(numbers())
        elastic_force = stiffness * ca.fmax(-gap, 0) ** exponent
        normal_force = elastic_force * ca.fmax(1 - hysteresis * local.dot(gap), 0)
        friction = friction_force(slip, normal_force, *law) if law else SX(0)
        force = ca.jtimes(slip, local.v, friction, True) - ca.jtimes(
            gap, local.q, normal_force, True
        )
        energy = elastic_force * ca.fmax(-gap, 0) / (exponent + 1)
        dissipated = (elastic_force - normal_force) * local.dot(gap) + friction * slip
        energies, powers = ca.vertcat(0, energy, 0), ca.vertcat(0, dissipated)
        values = {"normal": normal_force, "friction": -friction, "slip": slip}
        return ForceKernel(local, force, energies, powers=powers), values


def require_unit_of_stiffness(
    name: str, stiffness: Any, exponent: float, is_per_length: bool = False
) -> None:
    """Reject a parameter in N/m if the law of the contact is not linear, or is per length."""
    power = exponent + is_per_length
    if (
        isinstance(stiffness, NumberWithUnit)
        and conversion_factor(stiffness.unit, "N/m") is not None
        and power != 1
    ):
        linear = "" if is_per_length else "exponent=1 for a linear contact, or "
        raise BeamdaeError(
            f"{name}: stiffness must be in N/m^{power:g} with exponent={exponent:g}, got the "
            f"parameter {stiffness.parameter} in {stiffness.unit}; pass {linear}a stiffness in "
            f"N/m^{power:g}."
        )


def hysteresis_factor(restitution: float, speed: float) -> float:
    """Return X [s/m] in the contact force N = k d^n (1 + X d') at penetration d.

    For a mass m with m d'' = -N, the speeds v = `speed` [m/s] before and e v after an impact, with
    e = `restitution`, satisfy X v (1 + e) = ln((1 + X v) / (1 - e X v)) for any m, k and n
    (Gonthier et al., Multibody System Dynamics 11, 2004). As e approaches 1, X approaches
    3 (1 - e) / (2 v) of Hunt and Crossley.
    """
    if 1.0 - restitution < _MAX_SERIES_LOSS:
        return 1.5 * (1.0 - restitution) / speed
    low, high = 0.5 * (1.0 - restitution), 1.0 / restitution
    for _ in range(_MAX_BISECTIONS):
        middle = 0.5 * (low + high)
        logarithms = math.log1p(middle) - math.log(1.0 - restitution * middle)
        if logarithms > middle * (1.0 + restitution):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high) / speed


@dataclass(frozen=True, eq=False)
class Contact(PointForce):
    """Contact of a point with a surface, modeled by a penalty force that never pulls.

    At a penetration d, the normal force is N = stiffness d^exponent max(0, 1 + X d') (Hunt and
    Crossley, J. Appl. Mech. 42, 1975). It is nonlinear by default, k d^1.5 with k in N/m^1.5; pass
    exponent=1 for a spring, k d with k in N/m. The factor X follows from the restitution
    (`hysteresis`). The friction force is -mu N tanh(slip / friction_speed), where mu = friction or,
    with the Stribeck effect (Olsson et al., Eur. J. Control 4, 1998, 176), mu = friction + (static
    - friction) exp(-(slip / stribeck)^2). At the onset of contact, N is as
    smooth as max(0, d)^exponent. The energy of the elastic force stiffness d^exponent is part of
    the strain energy; the work of the remainder and of friction is dissipated.

    Parameters
    ----------
    name
        Unique name.
    point
        Attachment in contact.
    surface
        `bd.LineSurface` or `bd.CircleSurface`.
    stiffness
        Penalty stiffness [N/m^exponent], positive: in N/m^1.5 by default, in N/m with exponent=1.
        Model parameters in N/m are rejected with other exponents.
    exponent
        Exponent of the penetration, 1 to 10. Defaults to 1.5, that of Hertzian contact of spheres.
        With 1, the force is linear and has a kink at the onset of contact.
    restitution
        Coefficient of restitution of an impact at `impact_speed`, 0.05 to 1; slower impacts lose a
        smaller fraction of their speed. With 1 (default), the contact is elastic: without
        dissipation, bodies do not come to rest.
    impact_speed
        Relative speed before the impact [m/s]; required if the restitution is less than 1.
    friction
        Coefficient of friction [-], not negative.
    friction_speed
        Regularization velocity [m/s] of Coulomb friction, at which friction reaches 76 % of its
        full value. At lower velocities, friction is nearly viscous, so a sticking contact creeps.
        Defaults to 1e-4, or to 1/200 of `stribeck` if this is less.
    max_step
        Largest step of adaptive integrators [s]. Defaults to no limit: a step that passes over a
        contact is repeated from the onset of the contact.
    static, stribeck
        Static coefficient of friction [-], and the velocity scale [m/s] of the decrease from the
        static to the kinetic coefficient `friction`. If both are omitted, the coefficient does not
        depend on the velocity. With a `friction_speed` of 1/200 of `stribeck`, the largest friction
        is up to 0.1 % below the static friction, with 1/20 up to 3 %. Errors of forces are ten
        times as large near self-locking.

    Raises
    ------
    BeamdaeError
        If `name` is invalid, `point` is not an attachment, `surface` is not a surface, neither can
        move, a number is outside its range, `restitution` is less than 1 without `impact_speed`,
        `friction` is not zero and the surface is fixed to a particle, only one of `static` and
        `stribeck` is given, or `static` is less than `friction` or combined with `friction=0`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(0.0, 1.0)))
    >>> floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    >>> bounce = bd.Contact("bounce", ball.point, floor, 1e6, restitution=0.7, impact_speed=4.4)
    """

    symbol = "contact"
    acts_between_attachments = True
    name: str
    point: Attachment
    surface: LineSurface | CircleSurface
    stiffness: float
    exponent: float = 1.5
    restitution: float = 1.0
    impact_speed: float | None = None
    friction: float = 0.0
    friction_speed: float | None = None
    max_step: float | None = None
    static: float | None = None
    stribeck: float | None = None
    _observed_points = ("point",)

    def __post_init__(self) -> None:
        convert_fields(self, point=require_attachment)
        if not isinstance(self.surface, (LineSurface, CircleSurface)):
            raise BeamdaeError(
                f"{self.name}: surface must be a LineSurface or a CircleSurface, "
                f"got {short_repr(self.surface)}."
            )
        if not self.point.size + self.surface.on.size:
            raise BeamdaeError(
                f"{self.name}: neither the point nor the surface can move; attach one of them to "
                "a body."
            )
        convert_fields(self, exponent=require_finite)
        require_unit_of_stiffness(self.name, self.stiffness, self.exponent)
        convert_fields(self, stiffness=require_positive, friction=require_non_negative)
        static, stribeck = require_stribeck(
            self.name, "friction", self.friction, self.static, self.stribeck
        )
        speed = self.friction_speed
        if speed is None:
            speed = _DEFAULT_FRICTION_SPEED
            if stribeck is not None:
                speed = min(speed, _RECOMMENDED_STRIBECK_SHARE * stribeck)
        speed = require_positive(self.name, "friction_speed", speed)
        set_fields(self, static=static, stribeck=stribeck, friction_speed=speed)
        if self.friction:
            require_angle(self.name, self.surface.on)
        convert_fields(
            self,
            exponent=partial(require_between, least=_MIN_EXPONENT, most=_MAX_EXPONENT),
            restitution=partial(require_between, least=_MIN_RESTITUTION, most=1.0),
            max_step=optional(require_positive),
            impact_speed=optional(require_positive),
        )
        if self.impact_speed is None and self.restitution < 1.0:
            raise BeamdaeError(
                f"{self.name}: restitution={self.restitution:g} requires "
                "impact_speed=; pass the impact speed [m/s] at which this restitution holds."
            )

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """The point, and the attachment of the surface."""
        return (self.point, self.surface.on)

    @property
    def laws(self) -> tuple[Law, ...]:
        """Constant law that limits steps to `max_step`, in a tuple; empty without a limit."""
        if self.max_step is None:
            return ()
        time_scale = MIN_STEPS_PER_TIME_SCALE * self.max_step
        return (replace(as_law(self.name, 0.0), time_scale=time_scale),)

    @property
    def hysteresis(self) -> float:
        """Hysteresis factor X [s/m], zero if no impact speed is given; see `hysteresis_factor`."""
        if self.impact_speed is None:
            return 0.0
        return hysteresis_factor(self.restitution, self.impact_speed)

    @property
    def _formula(self) -> ForceFormula:
        return _ContactFormula(type(self.surface).kind)

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        numbers = (self.stiffness, self.exponent, self.hysteresis)
        friction: tuple[float, ...] = ()
        if self.friction and self.friction_speed:
            law = self.friction, self.friction_speed, self.static, self.stribeck
            friction = friction_numbers(*law)
        return constant_formula(*self.surface.numbers), constant_formula(*numbers, *friction)

    @property
    def points(self) -> dict[str, Attachment]:
        """The point and the attachment of the surface, by the names "point" and "surface"."""
        return {"point": self.point, "surface": self.surface.on}

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Normal force N and friction force T [N] on the point.

        Positive T points along the direction of a line, or counter-clockwise around the center of a
        circle.
        """
        return self._observe_values({"normal": Variable("N", "N"), "friction": Variable("T", "N")})

    @property
    @rebuilt_for_mesh
    def sliding(self) -> Quantity:
        """Normal force N [N], and sliding velocity v [m/s] of the point relative to the surface.

        v is positive in the direction in which `force` counts T as positive, so that T v is the
        power of the friction.
        """
        return self._observe_values({"normal": Variable("N", "N"), "slip": Variable("v", "m/s")})

    @property
    def regularized_friction(self) -> RegularizedFriction | None:
        """Regularization of the friction; None without friction."""
        return RegularizedFriction(float(self.friction_speed or 0.0)) if self.friction else None

    @property
    def gaps(self) -> tuple[SurfaceGap, ...]:
        """Gap of the contact, as a tuple of one entry."""
        return (SurfaceGap(self.gap, str(self.point), self.surface.remedy),)

    @property
    def gap(self) -> Quantity:
        """Distance of the point from the surface [m], negative during penetration."""
        return self.surface.gap(self.point)
