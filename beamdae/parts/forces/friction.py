"""Friction in joints and guides: regularized Coulomb's law with Stribeck's peak."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_name,
    require_non_negative,
    require_positive,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import require_angle, rotate
from beamdae.parts.joints.joint import Joint, Revolute
from beamdae.parts.part import Part
from beamdae.symbolic.formulas import (
    Formula,
    FormulaExpression,
    build_formula_kernel,
    constant_formula,
)
from beamdae.symbolic.statements import SX, ForceKernel, ForceStatement, Local, Named, Quantity


def _rim_travel(a: Any, b: Any, own: Any) -> SX:
    """What the rim of a bearing has traveled; `own` is its radius."""
    return own[0] * (b[1] - a[1])


def _guide_travel(a: Any, b: Any, own: Any) -> SX:
    """How far a point has slid along a line fixed to the first body."""
    return ca.dot(rotate(a[1], (own[1], own[2])), b[0] - a[0])


def _smooth_magnitude(values: SX, eps: Any) -> SX:
    """|values|, smooth and zero at zero, off by eps^2 / (2 |values|) where that is small."""
    square = ca.sumsqr(values)
    return square / ca.sqrt(square + eps**2)


@dataclass(frozen=True)
class _FrictionLaw:
    """Travel, its rate and the friction against it.

    Attributes
    ----------
    size
        Number of the first local coordinates, which are of the first point.
    travel
        (first point moved, second point moved, numbers) -> travel [m].
    pressing, tilting
        Which multipliers are forces and moments.
    """

    size: int
    travel: Callable[[Any, Any, Any], SX]
    pressing: tuple[int, ...]
    tilting: tuple[int, ...]

    def __call__(self, local: Local, a: Any, b: Any, own: Any, law: Any) -> tuple[SX, SX, SX]:
        moved = self.travel(a(local.q[: self.size]), b(local.q[self.size :]), own())
        coefficient, excess, stribeck, regularization, smoothing = (law()[k] for k in range(5))
        speed = local.dot(moved)
        load = _smooth_magnitude(local.lam[list(self.pressing)], smoothing)
        if self.tilting:
            radius = own()[0]
            moments = local.lam[list(self.tilting)]
            load += _smooth_magnitude(moments, smoothing * radius) / radius
        shape = ca.tanh(speed / regularization) * (
            1.0 + excess * ca.exp(-((speed / stribeck) ** 2))
        )
        return moved, speed, coefficient * load * shape


@dataclass(frozen=True)
class _FrictionKernel:
    rubbing: _FrictionLaw

    def __call__(self, local: Local, *functions: Any) -> ForceKernel:
        moved, speed, friction = self.rubbing(local, *functions)
        force = ca.jtimes(moved, local.q, friction, True)
        return ForceKernel(local, force, powers=ca.vertcat(0, friction * speed))


@dataclass(frozen=True)
class _FrictionReaction:
    rubbing: _FrictionLaw
    is_bearing: bool

    def __call__(self, local: Local, a: Any, b: Any, own: Any, law: Any) -> SX:
        _, speed, friction = self.rubbing(local, a, b, own, law)
        return ca.vertcat(-friction * (own()[0] if self.is_bearing else 1.0), speed)


@dataclass(frozen=True, eq=False)
class Friction(Part):
    """Dry friction in a joint: it grows with what the joint holds, and works against its sliding.

    F = coefficient |N| tanh(v / regularization) (1 + (static / coefficient - 1)
    exp(-(v / stribeck)^2)), with v the speed of sliding and N the reaction of the joint. In a
    `Revolute` v is the speed of the bearing's rim and F acts at its radius; in a guide
    (`PointOnLine` and other joints with a direction) v is the speed along the direction. A guide
    that holds a moment M as well is pressed by M / radius besides, radius being half its length.
    Below the regularization velocity friction falls to zero: what would stick creeps.

    Stribeck's peak as in Olsson, Astrom, Canudas de Wit, Gafvert & Lischinsky, Eur. J. Control 4
    (1998) 176.

    Parameters
    ----------
    name, joint
        Unique name, and where it rubs.
    coefficient
        Coefficient of friction of fast sliding [-].
    regularization
        Velocity [m/s] of sliding at which friction has 76 % of its size; integrators follow changes
        over it by steps of its size over the acceleration.
    static, stribeck
        Coefficient towards rest [-], and the velocity [m/s] over which it falls to that of fast
        sliding; without these the coefficient is the same at all speeds.
    radius
        Of the bearing, or half the length of a guide that holds a moment [m].
    smoothing
        Reaction [N] below which its size is rounded off, off by smoothing^2 / (2 |N|) above it.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> block = mech.add(bd.RigidBody("block", mass=1.0, inertia=0.01, velocity=(2.0, 0.0)))
    >>> guide = bd.Prismatic("guide", mech.ground.at(0.0, 0.0), block.at(0.0, 0.0))
    >>> rub = bd.Friction("rub", mech.add(guide), 0.2, regularization=1e-3, radius=0.1)
    """

    name: str
    joint: Joint
    coefficient: float
    regularization: float
    static: float | None = None
    stribeck: float | None = None
    radius: float | None = None
    smoothing: float = 1e-3

    def __post_init__(self) -> None:
        set_fields(self, name=require_name("Friction", self.name))
        name = self.name
        if not (self._is_bearing or self._is_guide):
            raise BeamdaeError(
                f"{name}: joint must be one that turns or slides, such as Revolute or PointOnLine, "
                f"got {short_repr(self.joint)}."
            )
        if self._is_bearing:
            # A particle does not turn: what rubs on it would hold on to nothing.
            require_angle(name, self.joint.a)
            require_angle(name, self.joint.b)
        for quantity in ("regularization", "smoothing"):
            set_fields(
                self, **{quantity: require_positive(name, quantity, getattr(self, quantity))}
            )
        set_fields(self, coefficient=require_non_negative(name, "coefficient", self.coefficient))
        self._check_stribeck()
        self._check_radius()

    def _check_stribeck(self) -> None:
        if (self.static is None) != (self.stribeck is None):
            raise BeamdaeError(f"{self.name}: static and stribeck must be given both or neither.")
        if self.static is None:
            return
        static = require_finite(self.name, "static", self.static)
        set_fields(
            self, static=static, stribeck=require_positive(self.name, "stribeck", self.stribeck)
        )
        if not static >= self.coefficient > 0.0:
            raise BeamdaeError(
                f"{self.name}: static must be at least the coefficient, which must be positive, "
                f"got {static:g} and {self.coefficient:g}."
            )

    def _check_radius(self) -> None:
        wanted = self._is_bearing or bool(self._which("N m"))
        if wanted and self.radius is None:
            what = "of the bearing" if self._is_bearing else "half the length of the guide"
            raise BeamdaeError(f"{self.name}: friction in {self.joint.name} needs radius=, {what}.")
        if not wanted and self.radius is not None:
            raise BeamdaeError(
                f"{self.name}: radius has no meaning for {self.joint.name}, which holds no moment."
            )
        if self.radius is not None:
            set_fields(self, radius=require_positive(self.name, "radius", self.radius))

    @property
    def _is_bearing(self) -> bool:
        return isinstance(self.joint, Revolute)

    @property
    def _is_guide(self) -> bool:
        """Whether it holds what is across a direction, and perhaps the turn, but nothing else."""
        if not isinstance(self.joint, Joint) or not hasattr(self.joint, "direction"):
            return False
        return {held.name for held in self.joint.multipliers} <= {"normal", "angle"}

    def _which(self, unit: str) -> tuple[int, ...]:
        held = self.joint.multipliers
        return tuple(k for k, multiplier in enumerate(held) if multiplier.unit == unit)

    @property
    def _rubbing(self) -> _FrictionLaw:
        travel = _rim_travel if self._is_bearing else _guide_travel
        return _FrictionLaw(self.joint.a.size, travel, self._which("N"), self._which("N m"))

    @property
    def _functions(self) -> tuple[Callable[..., Any], ...]:
        along = getattr(self.joint, "direction", (1.0, 0.0))
        tx, ty = np.divide(along, np.hypot(*along)).tolist()
        excess, stribeck = 0.0, 1.0
        if self.static is not None and self.stribeck is not None:
            excess, stribeck = self.static / self.coefficient - 1.0, self.stribeck
        law = (self.coefficient, excess, stribeck, self.regularization, self.smoothing)
        own: Formula = constant_formula(1.0 if self.radius is None else self.radius, tx, ty)
        return (
            self.joint.a.checked_kinematics,
            self.joint.b.checked_kinematics,
            own,
            constant_formula(*law),
        )

    @property
    def reaction(self) -> Quantity:
        """Force F [N] (in a bearing moment M [N m]) on the body of the joint's b, and speed v."""
        first = Named("M", "N m") if self._is_bearing else Named("F", "N")
        kind = _FrictionReaction(self._rubbing, self._is_bearing)
        values, data = FormulaExpression.of(kind, self._functions)
        pieces = (self.joint.a.piece, self.joint.b.piece)
        return Quantity((first, Named("v", "m/s")), pieces, values, data, self.joint.name)

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """The friction."""
        joint = self.joint
        kernel, data = build_formula_kernel(
            _FrictionKernel(self._rubbing),
            self._functions,
            joint.a.size + joint.b.size,
            len(joint.multipliers),
        )
        pieces = (joint.a.piece, joint.b.piece)
        return [ForceStatement(self.name, kernel, pieces, data, joint.name)]
